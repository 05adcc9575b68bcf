//! Laying paint on a scene: colors for all that is coarser than a stroke, and the strokes.

use std::sync::Arc;

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use super::{
    canvas::Canvas,
    detail::LOCAL,
    places::{Placement, place},
    proofs::LuminanceTexture,
    sight::weighted_median,
    surface::{Surface, moments},
    tone::{Curve, Tones},
};
use crate::{
    palette::LUMINANCE,
    recolor::{ColorMoments, Recoloring},
    scene::Scene,
    strokes::{FINE_SIDE, PlainSeed, StrokeSeed, StrokeWord, Strokes, mixed},
    work::{Canceled, Work},
};

/// Share of the way toward the painting's nearest colors, for hues that it does not have. Grass then turns to a
/// painting's gold and not to its mean.
const TO_PALETTE: f32 = 0.8;

/// Strength of the tone curve: at 1, the shares of dark and bright are the painting's.
const TONE: f32 = 0.9;

/// Largest excess of colors over a display's range. Overlapping Gaussians blur one another, so single ones
/// exceed it.
const OVERSHOOT: f32 = 0.3;

/// Share of the scene's own grain that is left under strokes. It should not make up for missing paint.
const OWN_GRAIN: f32 = 0.15;

/// Weight of chroma, beside luminance, in how much a Gaussian stands out.
const CHROMA: f32 = 0.15;

/// Energies at which half of the protection is reached: over the painting's strokes, and over the scene's usual
/// energy. Both must be exceeded.
const OF_STROKES: f32 = 0.015;
const OF_SCENE: f32 = 3.0;

/// Share of fine detail that protection takes: see [`StrokeRecord`](crate::strokes::StrokeRecord).
const PROTECTED: f32 = crate::strokes::PROTECTED;

/// A painting is quiet if the energy of its strokes is less than this many times the scene's usual energy. Then
/// more energy is required for protection, up to [`MOST_QUIET`] times as much, so that its strokes are not
/// lost. At four times as much, windows are painted over.
const QUIET: f32 = 40.0;
const MOST_QUIET: f32 = 2.0;

/// Ranges of the gains of wide and of fine detail. Overlapping Gaussians blur fine detail, so a gain of 1 shows
/// less of it than the painting has; above 2 its grain becomes beads.
const WIDE: (f64, f64) = (0.5, 1.2);
const FINE: (f64, f64) = (1.2, 2.0);

/// Share of the way to the painting's full contrast where no strokes add to it.
const BARE: f32 = 0.5;

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

/// Lays a mix of paintings on `scene`, which `surface` was made from. Weights are normalized to sum 1.
/// `content` c keeps that share of the base colors, 0..1, and takes it from the strokes.
///
/// Colors are mixed. Strokes are not, because a mean of two strokes is no stroke: each spot shows one painting,
/// and weights decide how many spots a painting gets ([`mixed`]).
///
/// The result depends neither on the number of threads nor on the run. If there is no painting with a weight
/// above 0, the colors are the base colors, and there are no strokes.
///
/// # Errors
/// If `work` is canceled.
///
/// # Panics
/// If `surface` was made from a scene of another number of Gaussians.
pub fn lay(
    scene: &Scene,
    surface: &Surface,
    paintings: &[(&Canvas, f64)],
    content: f64,
    work: &Work,
) -> Result<Painted, Canceled> {
    assert_eq!(scene.len(), surface.len(), "the surface of this scene");
    let given = given(paintings);
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
    for (i, (canvas, weight)) in given.into_iter().enumerate() {
        total += weight;
        let share = if i == 0 { 1.0 } else { (weight / total) as f32 };
        let part = work.part(i as f32 / n, (i + 1) as f32 / n);
        painted.mix(one(scene, surface, canvas, &part)?, share);
    }
    if kept > 0.0 && total > 0.0 {
        painted.keep(&surface.base, kept);
    }
    Ok(painted)
}

/// The colors that a scene has under `strokes` that stay, if its paintings have changed since
/// [`lay`] gave these strokes: palette, tones and what is coarser than a stroke follow. Paintings, weights and
/// content are those of `lay`, and a painting is [read again](Canvas::reread) at its size.
///
/// # Errors
/// If `work` is canceled.
///
/// # Panics
/// If `surface` or `strokes` are of a scene of another number of Gaussians.
pub fn recolored(
    scene: &Scene,
    surface: &Surface,
    paintings: &[(&Canvas, f64)],
    content: f64,
    strokes: &Strokes,
    work: &Work,
) -> Result<Vec<[f32; 3]>, Canceled> {
    assert_eq!(scene.len(), surface.len(), "the surface of this scene");
    assert_eq!(scene.len(), strokes.words.len(), "the strokes of this scene");
    let given = given(paintings);
    let kept = content.clamp(0.0, 1.0) as f32;
    let colors = surface.base.iter().map(|color| color.to_array()).collect();
    let mut painted = Painted { colors, ..Painted::default() };
    let protection = |word: &u32| StrokeWord::unpacked(*word).protection;
    let protection: Vec<f32> = strokes.words.iter().map(protection).collect();
    let (mut total, n) = (0.0, given.len() as f32);
    for (i, (canvas, weight)) in given.into_iter().enumerate() {
        work.at(i as f32 / n)?;
        total += weight;
        let share = if i == 0 { 1.0 } else { (weight / total) as f32 };
        // All seeds of a painting have the same gain, and a mix numbers the paintings as they come.
        let of_painting = strokes.seeds.iter().map(StrokeSeed::plain);
        let wide = of_painting.filter(|seed| usize::from(seed.texture) == i).map(|seed| seed.wide).next();
        let under = Underpainting::new(surface, canvas);
        let [own_detail, _] = standing_out(surface, canvas, &under.recoloring);
        let colors = under.colors(surface, canvas, &own_detail, &protection, wide.unwrap_or(1.0));
        painted.mix(Painted { colors, ..Painted::default() }, share);
    }
    if kept > 0.0 && total > 0.0 {
        painted.keep(&surface.base, kept);
    }
    work.at(1.0)?;
    Ok(painted.colors)
}

/// The paintings that count.
fn given<'a>(paintings: &[(&'a Canvas, f64)]) -> Vec<(&'a Canvas, f64)> {
    paintings.iter().filter(|(_, weight)| *weight > 0.0 && weight.is_finite()).copied().collect()
}

impl Painted {
    /// Lays a share of another painting over this one.
    fn mix(&mut self, above: Self, share: f32) {
        for (color, above) in self.colors.iter_mut().zip(&above.colors) {
            *color = std::array::from_fn(|c| color[c] + share * (above[c] - color[c]));
        }
        self.fine_energy += f64::from(share) * (above.fine_energy - self.fine_energy);
        let first_seed = self.strokes.seeds.len() as u32;
        let texture = self.strokes.textures.len() as u8;
        for (word, above) in self.strokes.words.iter_mut().zip(&above.strokes.words) {
            let above = StrokeWord::unpacked(*above);
            let above = StrokeWord { seed: above.seed + first_seed, ..above };
            *word = mixed(StrokeWord::unpacked(*word), above, share).packed();
        }
        self.strokes.seeds.extend(above.strokes.seeds.iter().map(|seed| seed.with_texture(texture)));
        self.strokes.textures.extend(above.strokes.textures);
    }

    /// Keeps a share of the base colors.
    fn keep(&mut self, base: &[Vec3], kept: f32) {
        for (color, base) in self.colors.iter_mut().zip(base) {
            *color = std::array::from_fn(|c| color[c] + kept * (base[c] - color[c]));
        }
        for word in &mut self.strokes.words {
            let of = StrokeWord::unpacked(*word);
            *word = StrokeWord { share: (1.0 - kept) * of.share, ..of }.packed();
        }
    }

    /// One color per Gaussian `[N]` that includes the strokes: their mean over its footprint. Files of other
    /// formats hold no more.
    pub fn flattened(&self, scene: &Scene) -> Vec<[f32; 3]> {
        let sides = scene.broad_sides();
        let color = |i: usize| {
            let word = StrokeWord::unpacked(self.strokes.words[i]);
            let color = Vec3::from(self.colors[i]);
            if word.share <= 0.0 {
                return color.to_array();
            }
            let seed = self.strokes.seeds[word.seed as usize].plain();
            let local = scene.means[i] - seed.at;
            let texel = seed.place + seed.pitch * Vec2::new(seed.right.dot(local), seed.down.dot(local));
            let at = texel / FINE_SIDE as f32;
            // A standard deviation to either side.
            let level = (2.0 * sides[i] * (seed.pitch.x * seed.pitch.y).sqrt()).max(1.0).log2();
            let texture = &self.strokes.textures[usize::from(seed.texture)];
            let fine = texture.fine(at, level) * seed.fine * (1.0 - PROTECTED * word.protection);
            let wide = texture.wide(at, level) * seed.wide * (1.0 - word.protection);
            (color + word.share * (fine + wide)).to_array()
        };
        (0..scene.len()).into_par_iter().map(color).collect()
    }
}

/// One painting on a scene.
fn one(scene: &Scene, surface: &Surface, canvas: &Canvas, work: &Work) -> Result<Painted, Canceled> {
    let under = Underpainting::new(surface, canvas);
    work.at(0.1)?;
    let (placements, [own_detail, protection]) =
        rayon::join(|| placements(surface, canvas), || standing_out(surface, canvas, &under.recoloring));
    work.at(0.5)?;
    // The scene keeps its shapes, and all detail that stands out.
    let kept: Vec<f32> = (under.own.par_iter().zip(&under.low).zip(&own_detail))
        .map(|((own, low), p)| low.lerp(*own, *p).dot(LUMINANCE))
        .collect();
    let balance = Balance::new(scene, surface, canvas, &placements, &protection, &kept);
    work.at(0.8)?;
    let colors = under.colors(surface, canvas, &own_detail, &protection, balance.wide);
    let word = |(owner, protection): (&u32, &f32)| {
        StrokeWord { seed: *owner, protection: *protection, share: 1.0 }.packed()
    };
    work.at(1.0)?;
    Ok(Painted {
        colors,
        strokes: Strokes {
            words: surface.seeds.owners.iter().zip(&protection).map(word).collect(),
            seeds: seeds(surface, canvas, &placements, balance.fine, balance.wide),
            textures: vec![Arc::clone(&canvas.detail.texture)],
        },
        fine_energy: balance.fine_energy,
    })
}

/// The scene in a painting's colors, before its strokes are known.
struct Underpainting {
    recoloring: Recoloring,
    /// Colors with the scene's own detail `[N]`.
    own: Vec<Vec3>,
    /// Colors without it `[N]`.
    low: Vec<Vec3>,
}

impl Underpainting {
    fn new(surface: &Surface, canvas: &Canvas) -> Self {
        let recoloring = Recoloring::new(&surface.moments, &canvas.low.0);
        let recolored = |color: &Vec3| Vec3::from(recoloring.color(color.to_array()));
        let own = surface.base.par_iter().map(recolored).collect();
        let low = surface.low.par_iter().map(recolored).collect();
        Self { own, low, recoloring }
    }

    /// The colors under strokes with this gain of wide detail. `own_detail` is the share of its own detail that
    /// each Gaussian keeps `[N]`.
    fn colors(
        &self,
        surface: &Surface,
        canvas: &Canvas,
        own_detail: &[f32],
        protection: &[f32],
        wide: f32,
    ) -> Vec<[f32; 3]> {
        let detail = |i: usize| own_detail[i] + (1.0 - own_detail[i]) * OWN_GRAIN;
        let mixed = |i: usize| self.low[i].lerp(self.own[i], detail(i));
        let mixed: Vec<Vec3> = (0..self.own.len()).into_par_iter().map(mixed).collect();
        graded(surface, canvas, &mixed, protection, wide)
    }
}

/// The place of each seed, chosen for the colors that the painting has.
fn placements(surface: &Surface, canvas: &Canvas) -> Vec<Placement> {
    let recoloring = Recoloring::new(&surface.moments, &canvas.whole.0);
    let hued =
        |color: &Vec3| canvas.palette.toward(Vec3::from(recoloring.color(color.to_array())), TO_PALETTE);
    let colors: Vec<Vec3> = surface.low.par_iter().map(hued).collect();
    let seed_colors: Vec<Vec3> = surface.seeds.colors.iter().map(hued).collect();
    place(surface, &colors, &seed_colors, canvas)
}

/// How much each Gaussian stands out, 0..1: the share of its own detail that it keeps `[N]`, and the share of
/// strokes that it is protected from `[N]`.
fn standing_out(surface: &Surface, canvas: &Canvas, recoloring: &Recoloring) -> [Vec<f32>; 2] {
    // |luminance of R d|^2 + CHROMA |R d - luminance|^2 = d^T Q d, where R is the recoloring's matrix.
    let zero = Vec3::from(recoloring.color([0.0; 3]));
    let column = |axis: Vec3| Vec3::from(recoloring.color(axis.to_array())) - zero;
    let map = Mat3::from_cols(column(Vec3::X), column(Vec3::Y), column(Vec3::Z));
    let luminance = Mat3::from_cols(LUMINANCE, LUMINANCE, LUMINANCE).transpose();
    let chroma = Mat3::IDENTITY - luminance;
    let row = super::frames::outer(LUMINANCE, LUMINANCE);
    let quadratic = map.transpose() * (row + chroma.transpose() * chroma * CHROMA) * map;
    let energies: Vec<f32> = surface.edges.par_iter().map(|edges| edges.dot(&quadratic).max(0.0)).collect();
    let stride = energies.len().div_ceil(1 << 16).max(1);
    let seen = energies.iter().copied().zip(surface.visibility.iter().copied());
    let usual = weighted_median(&mut seen.step_by(stride).collect::<Vec<_>>()).unwrap_or(0.0).max(1e-9);
    let of_strokes = OF_STROKES * canvas.detail.typical;
    let quiet = (QUIET * usual / canvas.detail.typical.max(1e-9)).clamp(1.0, MOST_QUIET);
    [1.0, quiet].map(|factor| {
        let half = of_strokes.max(factor * OF_SCENE * usual);
        let share = |energy: &f32| {
            let q = energy / half;
            q * q / (1.0 + q * q)
        };
        energies.par_iter().map(share).collect()
    })
}

/// How much detail is laid on.
struct Balance {
    /// Gains of fine and of wide detail.
    fine: f32,
    wide: f32,
    /// Energy of fine detail in the proofs, over the painting's.
    fine_energy: f64,
}

impl Balance {
    /// The gains at which pictures have as much detail as the painting. With K the detail that the scene keeps
    /// and P the painting's energy, the gains c of wide detail W and d of fine detail F solve |K + c W|^2 = P
    /// in wide bands and |K + c W + d F|^2 = P in fine ones.
    fn new(
        scene: &Scene,
        surface: &Surface,
        canvas: &Canvas,
        placements: &[Placement],
        protection: &[f32],
        kept: &[f32],
    ) -> Self {
        let kept = surface.proofs.bands(kept);
        let gains =
            [PROTECTED, 1.0].map(|most| protection.iter().map(|p| 1.0 - most * p).collect::<Vec<_>>());
        let plain = seeds(surface, canvas, placements, 1.0, 1.0);
        let texture = LuminanceTexture::new(&canvas.detail.texture);
        let owners = &surface.seeds.owners;
        let detail = surface.proofs.detail(scene, &plain, owners, [&gains[0], &gains[1]], &texture);
        let [of_fine, of_wide] = canvas.detail.energies;
        let product = |a: &super::proofs::Bands, b: &super::proofs::Bands| a.products(b);
        let (kk, kf, kw) =
            (product(&kept, &kept), product(&kept, &detail.fine), product(&kept, &detail.wide));
        let (ff, fw) = (product(&detail.fine, &detail.fine), product(&detail.fine, &detail.wide));
        let ww = product(&detail.wide, &detail.wide);
        let c = root(ww[1], kw[1] + fw[1], kk[1] + ff[1] + 2.0 * kf[1] - of_wide).clamp(WIDE.0, WIDE.1);
        let with_wide = kk[0] + 2.0 * c * kw[0] + c * c * ww[0];
        let d = root(ff[0], kf[0] + c * fw[0], with_wide - of_fine).clamp(FINE.0, FINE.1);
        Self { fine: d as f32, wide: c as f32, fine_energy: d * d * ff[0] / of_fine.max(1e-9) }
    }
}

/// The positive root x of a x^2 + 2 b x + c = 0, or 0.
fn root(a: f64, b: f64, c: f64) -> f64 {
    if a > 1e-12 { (-b + (b * b - a * c).max(0.0).sqrt()) / a } else { 0.0 }
}

/// The seeds as they are drawn, with these gains.
fn seeds(
    surface: &Surface,
    canvas: &Canvas,
    placements: &[Placement],
    fine: f32,
    wide: f32,
) -> Vec<StrokeSeed> {
    // The texture is a square.
    let texels = FINE_SIDE as f32 / canvas.size;
    let seed = |(j, placement): (usize, &Placement)| {
        PlainSeed {
            at: surface.seeds.seeds[j].at,
            right: placement.right,
            down: placement.down,
            pitch: texels / surface.pixel,
            place: placement.at * texels,
            fine,
            wide,
            texture: 0,
        }
        .packed()
    };
    placements.iter().enumerate().map(seed).collect()
}

/// Colors with the painting's palette and tones: under strokes those of the painting without its strokes,
/// elsewhere those of the whole painting.
fn graded(
    surface: &Surface,
    canvas: &Canvas,
    colors: &[Vec3],
    protection: &[f32],
    wide: f32,
) -> Vec<[f32; 3]> {
    let shown = surface.proofs.pixels(colors);
    let from = moments(&shown, &surface.visibility, colors);
    let grades = [&canvas.low, &canvas.whole].map(|(to, tones)| Grade::new(&from, &shown, to, tones));
    let range = (Vec3::splat(-OVERSHOOT), Vec3::splat(1.0 + OVERSHOOT));
    let color = |i: usize| {
        let fine = 1.0 - PROTECTED * protection[i];
        let wide = wide * (1.0 - protection[i]);
        let [under, bare] = [0, 1].map(|k: usize| grades[k].color(colors[i]).clamp(range.0, range.1));
        // Energies add up: without strokes all contrast is the scene's.
        let color = under.lerp(bare, BARE * (1.0 - fine * fine).max(0.0));
        let color = canvas.palette.toward(color, TO_PALETTE).clamp(range.0, range.1);
        // Wide detail brings the painting's large shapes back.
        color.lerp(canvas.mean, (LOCAL * wide).min(1.0)).to_array()
    };
    (0..colors.len()).into_par_iter().map(color).collect()
}

/// A change of moments, then of tones.
struct Grade<'a> {
    recoloring: Recoloring,
    from: Tones,
    to: &'a Tones,
}

impl<'a> Grade<'a> {
    fn new(from: &ColorMoments, shown: &[Vec3], to: &ColorMoments, tones: &'a Tones) -> Self {
        let recoloring = Recoloring::new(from, to);
        let luminance = |color: &Vec3| Vec3::from(recoloring.color(color.to_array())).dot(LUMINANCE);
        let from = Tones::new(shown.par_iter().map(luminance).collect());
        Self { recoloring, from, to: tones }
    }

    fn color(&self, color: Vec3) -> Vec3 {
        let color = Vec3::from(self.recoloring.color(color.to_array()));
        let luminance = color.dot(LUMINANCE);
        color + TONE * (Curve::new(&self.from, self.to).at(luminance) - luminance)
    }
}
