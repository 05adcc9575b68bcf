//! Laying paint on a scene: colors for all that is coarser than a stroke, and the strokes.

use std::sync::Arc;

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use super::{
    balance::Balance,
    canvas::Canvas,
    choice::Choice,
    company::{Company, Manner},
    grade::Underpainting,
    hand::Hand,
    pins::{Pin, move_seeds, of_painting, pinned},
    places::Placement,
    sight::weighted_median,
    surface::Surface,
};
use crate::{
    palette::LUMINANCE,
    recolor::Recoloring,
    scene::Scene,
    strokes::{FINE_SIDE, MAX_TEXTURES, PlainSeed, StrokeSeed, StrokeTexture, StrokeWord, Strokes},
    work::{Canceled, Work},
};

/// Weight of chroma, beside luminance, in how much a Gaussian stands out.
const CHROMA: f32 = 0.15;

/// Energies at which half of the protection is reached: over the painting's strokes, and over the scene's usual
/// energy. Both must be exceeded, and so must [`LONE`].
const OF_STROKES: f32 = 0.015;
const OF_SCENE: f32 = 3.0;

/// Contrast over the usual one around it, at which half of the protection is reached. So a window stands out of
/// a wall, and neither the weave of a cloth nor one blossom of many does: all of a texture is painted.
const LONE: f32 = 2.0;

/// A painting is quiet if the energy of its strokes is less than this many times the scene's usual energy. Then
/// more energy is required for protection, up to [`MOST_QUIET`] times as much, so that its strokes are not
/// lost. At four times as much, windows are painted over.
const QUIET: f32 = 40.0;
const MOST_QUIET: f32 = 2.0;

/// A painted scene.
#[derive(Clone, Debug, Default)]
pub struct Painted {
    /// The color of each Gaussian `[N]`: display-referred, and up to 0.3 outside of 0..1.
    pub colors: Vec<[f32; 3]>,
    /// The strokes over them.
    pub strokes: Strokes,
    /// Energy of the strokes' fine detail in pictures, over that of the painting: about how much of the
    /// painting's brushwork is seen. A mean over mixed paintings.
    pub fine_energy: f64,
}

/// Paintings that are laid on together, and their pins, which number them.
pub(super) struct Part<'a> {
    pub paintings: Vec<&'a Canvas>,
    pins: Vec<Pin>,
    weight: f64,
}

/// The parts of a style: each painting, or all of a collection together.
pub(super) fn parts<'a>(paintings: &[(&'a Canvas, f64)], hand: &Hand) -> Vec<Part<'a>> {
    let given = paintings.iter().enumerate();
    let given = given.filter(|(_, (_, weight))| *weight > 0.0 && weight.is_finite());
    if !hand.is_collection {
        let part = |(i, (canvas, weight)): (usize, &(&'a Canvas, f64))| Part {
            paintings: vec![*canvas],
            pins: of_painting(hand.pins, i),
            weight: *weight,
        };
        return given.map(part).collect();
    }
    let mut part = Part { paintings: Vec::new(), pins: Vec::new(), weight: 0.0 };
    for (i, (canvas, weight)) in given {
        part.weight += weight;
        // The same painting twice is no choice.
        let known = part.paintings.iter().position(|known| known.is_same(canvas));
        let painting = known.unwrap_or(part.paintings.len());
        if known.is_none() {
            part.paintings.push(*canvas);
        }
        part.pins.extend(of_painting(hand.pins, i).into_iter().map(|pin| Pin { painting, ..pin }));
    }
    if part.paintings.is_empty() { Vec::new() } else { vec![part] }
}

/// Lays a mix or a collection of paintings on `scene`, which `surface` was made from. Weights are normalized to
/// sum 1. `content` c keeps that share of the base colors, 0..1, and takes it from the strokes.
///
/// In a mix, colors are mixed. Strokes are not, because a mean of two strokes is no stroke: each spot shows one
/// painting, and weights decide how many spots a painting gets ([`mixed`](crate::strokes::mixed)). In a
/// collection, each spot shows the painting that has a place like it, in colors of that painting; paintings of
/// any weight above 0 count alike.
///
/// The result depends neither on the number of threads nor on the run. If there is no painting with a weight
/// above 0, the colors are the base colors, and there are no strokes.
///
/// # Errors
/// If `work` is canceled.
///
/// # Panics
/// If `surface` was made from a scene of another number of Gaussians, if a pin names no painting, or if there
/// are more than [`MAX_TEXTURES`] paintings.
pub fn lay(
    scene: &Scene,
    surface: &Surface,
    paintings: &[(&Canvas, f64)],
    hand: &Hand,
    content: f64,
    work: &Work,
) -> Result<Painted, Canceled> {
    laid(scene, surface, paintings, (hand, content, None), work)
}

/// As [`lay`], on a scene that stands beside a painted one, whose `company` has the same paintings, hand and
/// content: what is alike in both is painted alike. `surface` is made [beside](Surface::beside) the other's, or
/// as that of a [part](Surface::part_of): then seeds that both share have the other's places, and new ones may
/// continue them. Pins are of the other scene, and are left out.
///
/// # Errors
/// If `work` is canceled.
///
/// # Panics
/// If `surface` was made from a scene of another number of Gaussians, or if there are more than
/// [`MAX_TEXTURES`] paintings.
pub fn lay_beside(
    scene: &Scene,
    surface: &Surface,
    paintings: &[(&Canvas, f64)],
    (hand, content, company): (&Hand, f64, &Company),
    work: &Work,
) -> Result<Painted, Canceled> {
    laid(scene, surface, paintings, (&Hand { pins: &[], ..*hand }, content, Some(company)), work)
}

fn laid(
    scene: &Scene,
    surface: &Surface,
    paintings: &[(&Canvas, f64)],
    (hand, content, company): (&Hand, f64, Option<&Company>),
    work: &Work,
) -> Result<Painted, Canceled> {
    assert_eq!(scene.len(), surface.len(), "the surface of this scene");
    assert!(paintings.len() <= MAX_TEXTURES, "at most {MAX_TEXTURES} paintings");
    let given = parts(paintings, hand);
    let kept = content.clamp(0.0, 1.0) as f32;
    let mut painted = Painted {
        colors: surface.base.iter().map(|color| color.to_array()).collect(),
        strokes: Strokes { words: vec![StrokeWord::NONE.packed(); scene.len()], ..Strokes::default() },
        fine_energy: 0.0,
    };
    if kept >= 1.0 {
        return Ok(painted);
    }
    let mut total = 0.0;
    let n = given.len() as f32;
    for (i, part) in given.iter().enumerate() {
        total += part.weight;
        let share = if i == 0 { 1.0 } else { (part.weight / total) as f32 };
        let work = work.part(i as f32 / n, (i + 1) as f32 / n);
        let manner = company.and_then(|company| company.manners.get(i));
        let above = one(scene, surface, part, (hand, manner), &work)?;
        let first_seed = painted.strokes.seeds.len() as u32;
        painted.mix(above, share, |seed| match (manner, surface.shared.get(seed as usize)) {
            // As in the scene that this one is a part of. It has all seeds for each part of the style, in turn.
            (Some(manner), Some(number)) => number + (i * manner.n_seeds()) as u32,
            _ => seed + first_seed,
        });
    }
    if kept > 0.0 && total > 0.0 {
        painted.keep(&surface.base, kept);
    }
    Ok(painted)
}

/// The colors that a scene has under `strokes` that stay, if its paintings have changed since
/// [`lay`] gave these strokes: palette, tones and what is coarser than a stroke follow. Paintings, weights,
/// hand and content are those of `lay`, and a painting is [read again](Canvas::reread) at its size. Pins do not
/// matter, since the strokes have them.
///
/// # Errors
/// If `work` is canceled.
///
/// # Panics
/// If `surface` or `strokes` are of a scene of another number of Gaussians, or the strokes of fewer paintings.
pub fn recolored(
    scene: &Scene,
    surface: &Surface,
    paintings: &[(&Canvas, f64)],
    hand: &Hand,
    content: f64,
    strokes: &Strokes,
    work: &Work,
) -> Result<Vec<[f32; 3]>, Canceled> {
    assert_eq!(scene.len(), surface.len(), "the surface of this scene");
    assert_eq!(scene.len(), strokes.words.len(), "the strokes of this scene");
    let kept = content.clamp(0.0, 1.0) as f32;
    let colors = surface.base.iter().map(|color| color.to_array()).collect();
    let mut painted = Painted { colors, ..Painted::default() };
    if kept >= 1.0 {
        return Ok(painted.colors);
    }
    let given = parts(paintings, &Hand { pins: &[], ..*hand });
    let n_seeds = surface.n_seeds();
    assert!(given.len() * n_seeds <= strokes.seeds.len(), "the strokes of these paintings");
    let protection = |word: &u32| StrokeWord::unpacked(*word).protection;
    let protection: Vec<f32> = strokes.words.iter().map(protection).collect();
    let (mut total, n) = (0.0, given.len() as f32);
    for (i, part) in given.iter().enumerate() {
        work.at(i as f32 / n)?;
        total += part.weight;
        let share = if i == 0 { 1.0 } else { (part.weight / total) as f32 };
        // Each part has all seeds of the surface, in turn, with one gain.
        let seeds = &strokes.seeds[i * n_seeds..][..n_seeds];
        let wide = seeds.first().map_or(1.0, |seed| seed.plain().wide);
        let choice = Choice::laid(surface, &part.paintings, hand.tints, seeds, &strokes.textures);
        let under = Underpainting::new(&choice);
        let energies = energies(&choice, &under.recoloring);
        let [own_detail, _] = standing_out(&choice, &energies, usual_energy(surface, &energies));
        let colors = under.colors(&choice, &own_detail, &protection, wide, (hand.palette, None));
        painted.mix(Painted { colors, ..Painted::default() }, share, |seed| seed);
    }
    if kept > 0.0 && total > 0.0 {
        painted.keep(&surface.base, kept);
    }
    work.at(1.0)?;
    Ok(painted.colors)
}

impl Painted {
    /// Lays a share of another painting over this one. The `number` of each of its seeds decides whether it is
    /// shown.
    fn mix(&mut self, above: Self, share: f32, number: impl Fn(u32) -> u32) {
        for (color, above) in self.colors.iter_mut().zip(&above.colors) {
            *color = std::array::from_fn(|c| color[c] + share * (above[c] - color[c]));
        }
        self.fine_energy += f64::from(share) * (above.fine_energy - self.fine_energy);
        self.strokes.mix_by(&above.strokes, share, number);
    }

    /// Keeps a share of the base colors.
    fn keep(&mut self, base: &[Vec3], kept: f32) {
        for (color, base) in self.colors.iter_mut().zip(base) {
            *color = std::array::from_fn(|c| color[c] + kept * (base[c] - color[c]));
        }
        self.strokes.fade(1.0 - kept);
    }

    /// One color per Gaussian `[N]` that includes the strokes, if there are any: their mean over its footprint.
    /// Files of other formats hold no more.
    pub fn flattened(&self, scene: &Scene) -> Vec<[f32; 3]> {
        if self.strokes.seeds.is_empty() {
            return self.colors.clone();
        }
        let sides = scene.broad_sides();
        (0..scene.len()).into_par_iter().map(|i| self.flattened_at(i, scene.means[i], sides[i])).collect()
    }

    /// The color of Gaussian `i` with its strokes' mean around `at`, within the deviation `side`.
    pub(crate) fn flattened_at(&self, i: usize, at: Vec3, side: f32) -> [f32; 3] {
        let word = StrokeWord::unpacked(self.strokes.words[i]);
        let color = Vec3::from(self.colors[i]);
        if word.share <= 0.0 {
            return color.to_array();
        }
        let seed = self.strokes.seeds[word.seed as usize].plain();
        let local = at - seed.at;
        let texel = seed.place + seed.pitch * Vec2::new(seed.right.dot(local), seed.down.dot(local));
        let at = texel / FINE_SIDE as f32;
        let level = seed.level_of(side);
        let texture = &self.strokes.textures[usize::from(seed.texture)];
        let [fine, wide] = seed.gains(&word);
        (color + fine * texture.fine(at, level) + wide * texture.wide(at, level)).to_array()
    }
}

/// One part of a style on a scene, in the manner of the scene that it stands beside if there is one.
fn one(
    scene: &Scene,
    surface: &Surface,
    part: &Part,
    (hand, manner): (&Hand, Option<&Manner>),
    work: &Work,
) -> Result<Painted, Canceled> {
    let pinned = pinned(surface, &part.paintings, &part.pins, hand.direction);
    let shared = manner.map_or_else(Vec::new, |manner| manner.placed(surface));
    let fixed = shared.iter().chain(&pinned).map(|placed| (placed.seed, placed.painting));
    let mut choice = Choice::new(surface, &part.paintings, hand.tints, fixed);
    if let Some(manner) = manner {
        choice = choice.beside(&manner.tints, &manner.shares);
    }
    let under = Underpainting::new(&choice);
    work.at(0.1)?;
    let (placements, [own_detail, protection]) = rayon::join(
        || choice.placements(hand.direction, &shared),
        || {
            let energies = energies(&choice, &under.recoloring);
            let usual = manner.map_or_else(|| usual_energy(surface, &energies), |manner| manner.usual);
            standing_out(&choice, &energies, usual)
        },
    );
    let choice = choice.placed(placements);
    work.at(0.5)?;
    let used = choice.textures(|painting| match manner {
        Some(manner) => Arc::clone(&manner.textures[painting]),
        None => choice.texture(painting, hand.tints),
    });
    let balance = match manner {
        Some(manner) => Balance::beside(manner.wide),
        None => {
            let kept = under.kept(&own_detail);
            let textures: Vec<&StrokeTexture> = used.textures.iter().map(|texture| &**texture).collect();
            let plain = seeds(&choice, &used.numbers, 1.0, 1.0);
            Balance::new(scene, &choice, &plain, &textures, &protection, &kept)
        }
    };
    work.at(0.8)?;
    let grades = manner.map(|manner| &manner.grades);
    let colors = under.colors(&choice, &own_detail, &protection, balance.wide, (hand.palette, grades));
    let word = |(owner, protection): (&u32, &f32)| {
        StrokeWord { seed: *owner, protection: *protection, share: 1.0 }.packed()
    };
    let mut seeds = seeds(&choice, &used.numbers, balance.fine, balance.wide);
    move_seeds(&mut seeds, &part.paintings, &pinned);
    work.at(1.0)?;
    Ok(Painted {
        colors,
        strokes: Strokes {
            words: surface.seeds.owners.iter().zip(&protection).map(word).collect(),
            seeds,
            textures: used.textures,
        },
        fine_energy: balance.fine_energy,
    })
}

/// Energy of the detail of each Gaussian, in the colors of a recoloring `[N]`.
pub(super) fn energies(choice: &Choice, recoloring: &Recoloring) -> Vec<f32> {
    // |luminance of R d|^2 + CHROMA |R d - luminance|^2 = d^T Q d, where R is the recoloring's matrix.
    let zero = Vec3::from(recoloring.color([0.0; 3]));
    let column = |axis: Vec3| Vec3::from(recoloring.color(axis.to_array())) - zero;
    let map = Mat3::from_cols(column(Vec3::X), column(Vec3::Y), column(Vec3::Z));
    let luminance = Mat3::from_cols(LUMINANCE, LUMINANCE, LUMINANCE).transpose();
    let chroma = Mat3::IDENTITY - luminance;
    let row = super::frames::outer(LUMINANCE, LUMINANCE);
    let quadratic = map.transpose() * (row + chroma.transpose() * chroma * CHROMA) * map;
    choice.surface.edges.par_iter().map(|edges| edges.dot(&quadratic).max(0.0)).collect()
}

/// The usual one of these energies `[N]`, by what is seen.
pub(super) fn usual_energy(surface: &Surface, energies: &[f32]) -> f32 {
    let stride = energies.len().div_ceil(1 << 16).max(1);
    let seen = energies.iter().copied().zip(surface.visibility.iter().copied());
    weighted_median(&mut seen.step_by(stride).collect::<Vec<_>>()).unwrap_or(0.0).max(1e-9)
}

/// How much each Gaussian of these energies `[N]` stands out, 0..1: the share of its own detail that it keeps
/// `[N]`, and the share of strokes that it is protected from `[N]`.
pub(super) fn standing_out(choice: &Choice, energies: &[f32], usual: f32) -> [Vec<f32>; 2] {
    // Energies at which half of the protection is reached, in each painting.
    let halves = |typical: f32| {
        let of_strokes = OF_STROKES * typical;
        let quiet = (QUIET * usual / typical.max(1e-9)).clamp(1.0, MOST_QUIET);
        [1.0, quiet].map(|factor| of_strokes.max(factor * OF_SCENE * usual))
    };
    let halves: Vec<[f32; 2]> = choice.paintings.iter().map(|canvas| halves(canvas.detail.typical)).collect();
    [0, 1].map(|which: usize| {
        let share = |(i, energy): (usize, &f32)| {
            let q = energy / halves[choice.of_gaussian(i)][which];
            let q = q.min(choice.surface.lone[i] / LONE);
            q * q / (1.0 + q * q)
        };
        energies.par_iter().enumerate().map(share).collect()
    })
}

/// The seeds as they are drawn, with these gains and numbers of the paintings' textures.
fn seeds(choice: &Choice, textures: &[u8], fine: f32, wide: f32) -> Vec<StrokeSeed> {
    let seed = |(j, placement): (usize, &Placement)| {
        let painting = usize::from(choice.labels[j]);
        let canvas = choice.paintings[painting];
        // The texture is a square.
        let texels = FINE_SIDE as f32 / canvas.size;
        PlainSeed {
            at: choice.surface.seeds.seeds[j].at,
            right: placement.right,
            down: placement.down,
            pitch: texels / choice.surface.pixel,
            place: placement.at * texels,
            fine,
            wide,
            texture: textures[painting],
        }
        .packed()
        // The texture is stretched, and a direction is not.
        .with_direction(canvas.strokes[canvas.place_at(placement.at)].0)
    };
    choice.placements.iter().enumerate().map(seed).collect()
}
