//! The paintings of a style on a surface: which one each seed takes, in which colors, and its place there.

use std::{borrow::Cow, sync::Arc};

use glam::Vec3;
use rayon::prelude::*;

use super::{
    canvas::Canvas,
    collection::choose,
    direction::Direction,
    hand::TO_PALETTE,
    places::{Hues, Placed, Placement, place},
    surface::Surface,
    tints::Tints,
};
use crate::{
    palette::{LUMINANCE, Palette},
    recolor::{ColorMoments, Recoloring},
    strokes::{FINE_SIDE, PlainSeed, StrokeSeed, StrokeTexture},
};

/// Share of the way that the colors of a collection's painting go, where it is, toward the mean of its places
/// there. At 1, its part of the scene would be as bright as the painting, whatever the light.
const TO_PLACES: f32 = 0.5;

/// The paintings on a surface.
pub(super) struct Choice<'a> {
    pub surface: &'a Surface,
    pub paintings: &'a [&'a Canvas],
    /// The number of the painting of each seed `[M]`.
    pub labels: Vec<u8>,
    /// Colors of all paintings, as far as they are used, or those that are given in their stead.
    pub tints: Cow<'a, Tints>,
    /// Colors of each painting, or the given ones for all.
    given: Option<&'a Tints>,
    /// Share of the scene that each painting gets, by what is seen.
    pub shares: Vec<f64>,
    /// Places of the seeds `[M]`, once they are chosen.
    pub placements: Vec<Placement>,
}

/// The textures that seeds use, and their number for each painting.
pub(super) struct Textures {
    pub textures: Vec<Arc<StrokeTexture>>,
    pub numbers: Vec<u8>,
}

impl<'a> Choice<'a> {
    /// Chooses a painting for each seed, except for those that have one already, and the colors.
    pub fn new(
        surface: &'a Surface,
        paintings: &'a [&'a Canvas],
        given: Option<&'a Tints>,
        fixed: impl Iterator<Item = (u32, usize)>,
    ) -> Self {
        let labels = match paintings {
            [_] => vec![0; surface.n_seeds()],
            _ => {
                let even: Vec<_> = paintings.iter().map(|canvas| (&canvas.tints, 1.0)).collect();
                let all = Tints::united(&even);
                with_hues(surface, &all.whole.0, &[&all.palette], |hues| {
                    choose(surface, paintings, hues, fixed)
                })
            }
        };
        Self::of(surface, paintings, labels, given)
    }

    /// That of strokes which are there already: `seeds` `[M]` in some of `textures`.
    pub fn laid(
        surface: &'a Surface,
        paintings: &'a [&'a Canvas],
        given: Option<&'a Tints>,
        seeds: &[StrokeSeed],
        textures: &[Arc<StrokeTexture>],
    ) -> Self {
        let seeds: Vec<PlainSeed> = seeds.iter().map(StrokeSeed::plain).collect();
        let first = seeds.iter().map(|seed| usize::from(seed.texture)).min().unwrap_or(0);
        let of_texture = |number: usize| {
            let known = textures.get(number);
            let known = known.and_then(|texture| paintings.iter().position(|canvas| canvas.follows(texture)));
            // In given colors, textures are no painting's own. They are in the order of the paintings.
            known.unwrap_or_else(|| number.saturating_sub(first).min(paintings.len() - 1)) as u8
        };
        let of_textures: Vec<u8> = (0..=usize::from(u8::MAX)).map(of_texture).collect();
        let labels: Vec<u8> = seeds.iter().map(|seed| of_textures[usize::from(seed.texture)]).collect();
        let placement = |(seed, label): (&PlainSeed, &u8)| {
            let at = seed.place * paintings[usize::from(*label)].size / FINE_SIDE as f32;
            Placement { at, right: seed.right, down: seed.down }
        };
        let placements = seeds.iter().zip(&labels).map(placement).collect();
        Self::of(surface, paintings, labels, given).placed(placements)
    }

    /// The choice of these paintings for the seeds `[M]`.
    fn of(
        surface: &'a Surface,
        paintings: &'a [&'a Canvas],
        labels: Vec<u8>,
        given: Option<&'a Tints>,
    ) -> Self {
        let mut seen = vec![0.0; paintings.len()];
        for (owner, visibility) in surface.seeds.owners.iter().zip(&surface.visibility) {
            seen[usize::from(labels[*owner as usize])] += f64::from(*visibility);
        }
        let total: f64 = seen.iter().sum();
        let share = |seen: &f64| if total > 0.0 { seen / total } else { 1.0 / paintings.len() as f64 };
        let shares: Vec<f64> = seen.iter().map(share).collect();
        let tints = match (given, paintings) {
            (Some(given), _) => Cow::Borrowed(given),
            (None, [one]) => Cow::Borrowed(&one.tints),
            _ => {
                let parts: Vec<_> =
                    paintings.iter().zip(&shares).map(|(c, share)| (&c.tints, *share)).collect();
                Cow::Owned(Tints::united(&parts))
            }
        };
        Self { surface, paintings, labels, tints, given, shares, placements: Vec::new() }
    }

    /// The place of each seed, chosen for the colors that its painting has. Strokes follow `direction` if there
    /// is one, and seeds that are `placed` stay.
    pub fn placements(&self, direction: Option<Direction>, placed: &[Placed]) -> Vec<Placement> {
        // In a collection, what is blue in the scene is compared with what is blue in all paintings together.
        let moments = match self.paintings {
            [one] => one.tints.whole.0,
            _ => {
                let parts = self.paintings.iter().zip(&self.shares);
                ColorMoments::mixed(parts.map(|(canvas, share)| (&canvas.tints.whole.0, *share)))
            }
        };
        let palettes: Vec<&Palette> = self.paintings.iter().map(|canvas| &canvas.tints.palette).collect();
        with_hues(self.surface, &moments, &palettes, |hues| {
            place(self.surface, self.paintings, &self.labels, hues, direction, placed)
        })
    }

    /// In the colors and shares of the scene that this one stands beside.
    pub fn beside(self, tints: &'a Tints, shares: &[f64]) -> Self {
        Self { tints: Cow::Borrowed(tints), shares: shares.to_vec(), ..self }
    }

    /// With these places.
    pub fn placed(self, placements: Vec<Placement>) -> Self {
        Self { placements, ..self }
    }

    /// The number of a Gaussian's painting.
    pub fn of_gaussian(&self, i: usize) -> usize {
        usize::from(self.labels[self.surface.seeds.owners[i] as usize])
    }

    /// The colors of a painting, or those in its stead.
    pub fn tints_of(&self, painting: usize) -> &Tints {
        self.given.unwrap_or(&self.paintings[painting].tints)
    }

    /// Luminance energy of fine and of wide detail that pictures should have.
    pub fn energies(&self) -> [f64; 2] {
        [0, 1].map(|kind: usize| {
            let parts = self.paintings.iter().zip(&self.shares);
            parts.map(|(canvas, share)| canvas.detail.energies[kind] * share).sum()
        })
    }

    /// The texture of a painting, in the given colors if there are any.
    pub fn texture(&self, painting: usize, given: Option<&Tints>) -> Arc<StrokeTexture> {
        let canvas = self.paintings[painting];
        match given {
            Some(given) => Arc::new(tinted(canvas, given)),
            None => Arc::clone(canvas.texture()),
        }
    }

    /// The textures of the paintings that are used: `texture` gives that of a painting.
    pub fn textures(&self, texture: impl Fn(usize) -> Arc<StrokeTexture>) -> Textures {
        let mut of = Textures { textures: Vec::new(), numbers: vec![0; self.paintings.len()] };
        for painting in 0..self.paintings.len() {
            // A painting alone is kept whole, whether or not there is a seed.
            if self.paintings.len() > 1 && !self.labels.contains(&(painting as u8)) {
                continue;
            }
            of.numbers[painting] = of.textures.len() as u8;
            of.textures.push(texture(painting));
        }
        of
    }

    /// By how much the colors of each painting of a collection have to be shifted to lie near those of its
    /// places. Nothing for a painting alone, which has all of the scene, and for colors that are given.
    pub fn shifts(&self, color: impl Fn(usize) -> Vec3 + Send + Sync) -> Vec<Vec3> {
        if self.paintings.len() < 2 || self.given.is_some() {
            return Vec::new();
        }
        let of_place = |j: usize| {
            let canvas = self.paintings[usize::from(self.labels[j])];
            canvas.colors[canvas.place_at(self.placements[j].at)]
        };
        let of_places: Vec<Vec3> = (0..self.labels.len()).map(of_place).collect();
        let colors: Vec<Vec3> = (0..self.surface.len()).into_par_iter().map(color).collect();
        let mut sums = vec![(Vec3::ZERO, 0.0_f32); self.paintings.len()];
        for (i, color) in colors.iter().enumerate() {
            let weight = self.surface.visibility[i];
            let (sum, total) = &mut sums[self.of_gaussian(i)];
            *sum += (of_places[self.surface.seeds.owners[i] as usize] - *color) * weight;
            *total += weight;
        }
        sums.into_iter().map(|(sum, total)| sum * (TO_PLACES / total.max(f32::MIN_POSITIVE))).collect()
    }
}

/// Calls `run` with the scene's colors, without detail, by these moments and each of these palettes.
fn with_hues<T>(
    surface: &Surface,
    moments: &ColorMoments,
    palettes: &[&Palette],
    run: impl FnOnce(&Hues) -> T,
) -> T {
    let recoloring = Recoloring::new(&surface.moments, moments);
    let hued = |painting: usize, color: Vec3| {
        palettes[painting].toward(Vec3::from(recoloring.color(color.to_array())), TO_PALETTE)
    };
    let gaussian = |painting: usize, i: usize| hued(painting, surface.low[i]);
    let seed = |painting: usize, j: usize| hued(painting, surface.seeds.colors[j]);
    run(&Hues { gaussian: &gaussian, seed: &seed })
}

/// A painting's texture in other colors: its light and dark stay, and its hues turn as the whole painting's do.
fn tinted(canvas: &Canvas, given: &Tints) -> StrokeTexture {
    let recoloring = Recoloring::new(&canvas.tints.whole.0, &given.whole.0);
    let zero = Vec3::from(recoloring.color([0.0; 3]));
    canvas.texture().mapped(|detail| {
        let turned = Vec3::from(recoloring.color(detail.to_array())) - zero;
        let chroma = turned - turned.dot(LUMINANCE);
        // A gray painting has hues by chance alone, which must not be blown up.
        let chroma = chroma.clamp_length_max(detail.length());
        chroma + detail.dot(LUMINANCE)
    })
}
