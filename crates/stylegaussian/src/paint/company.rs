//! Paint beside paint: what a painted scene tells a smaller one that stands in it, such as a mesh.
//!
//! A mesh alone would be recolored by its own colors: a red ball would get the painting's mean color, and all
//! of its contrast. Beside a painted scene, what was red there and what is red here become the same.

use std::sync::Arc;

use super::{
    canvas::Canvas,
    choice::Choice,
    grade::{Grades, Underpainting},
    hand::Hand,
    lay::{energies, parts, standing_out, usual_energy},
    places::{Placed, Placement},
    surface::Surface,
    tints::Tints,
};
use crate::{
    strokes::{StrokeSeed, StrokeTexture, Strokes},
    work::{Canceled, Work},
};

/// How a scene is painted, for those that stand beside it.
pub struct Company {
    /// That of each part of the style, in the order of its paintings.
    pub(super) manners: Vec<Manner>,
}

/// How a scene is painted by one part of a style.
pub(super) struct Manner {
    /// Colors of the paintings, by their shares of the scene.
    pub tints: Tints,
    /// Share of the scene that each painting has.
    pub shares: Vec<f64>,
    /// Usual energy of the scene's detail.
    pub usual: f32,
    /// Gain of wide detail.
    pub wide: f32,
    /// Changes of the scene's colors. They are found by its pictures, and a scene may have thousands of parts.
    pub grades: Grades,
    /// The texture of each painting, in the colors that it has in the scene.
    pub textures: Vec<Arc<StrokeTexture>>,
    /// The number of the painting of each seed `[M]`, and its place there.
    labels: Vec<u8>,
    placements: Vec<Placement>,
}

impl Manner {
    /// The seeds that the surface of a part of the scene shares, with their paintings and places in the scene.
    pub fn placed(&self, part: &Surface) -> Vec<Placed> {
        let placed = |(seed, number): (u32, &u32)| {
            let painting = usize::from(*self.labels.get(*number as usize)?);
            Some(Placed { seed, painting, placement: *self.placements.get(*number as usize)? })
        };
        (0..).zip(&part.shared).filter_map(placed).collect()
    }

    /// M, the number of seeds.
    pub fn n_seeds(&self) -> usize {
        self.labels.len()
    }
}

impl Company {
    /// The company of a scene that has these `strokes` of `paintings`, which were laid on with `hand`. No place
    /// is searched for.
    ///
    /// `None` if the strokes are not of this surface and these paintings.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn new(
        surface: &Surface,
        paintings: &[(&Canvas, f64)],
        hand: &Hand,
        strokes: &Strokes,
        work: &Work,
    ) -> Result<Option<Self>, Canceled> {
        let parts = parts(paintings, &Hand { pins: &[], ..*hand });
        let n_seeds = surface.n_seeds();
        if n_seeds == 0 || parts.len() * n_seeds > strokes.seeds.len() {
            return Ok(None);
        }
        let mut manners = Vec::new();
        for (part, seeds) in parts.iter().zip(strokes.seeds.chunks_exact(n_seeds)) {
            work.check()?;
            let choice = Choice::laid(surface, &part.paintings, hand.tints, seeds, &strokes.textures);
            let under = Underpainting::new(&choice);
            let energies = energies(&choice, &under.recoloring);
            let usual = usual_energy(surface, &energies);
            let [own_detail, _] = standing_out(&choice, &energies, usual);
            let mixed = under.mixed(&own_detail);
            let pixels = surface.proofs.pixels(&mixed);
            let shown = if pixels.is_empty() { &mixed } else { &pixels };
            let texture = |painting: usize| {
                let is_of = |(label, _): &(&u8, &StrokeSeed)| usize::from(**label) == painting;
                let seed = choice.labels.iter().zip(seeds).find(is_of).map(|(_, seed)| seed.plain());
                let known = seed.and_then(|seed| strokes.textures.get(usize::from(seed.texture)));
                match (hand.tints, known) {
                    // A tinted one is made once, and has one place on the GPU.
                    (Some(_), Some(known)) => Arc::clone(known),
                    _ => choice.texture(painting, hand.tints),
                }
            };
            let textures = (0..part.paintings.len()).map(texture).collect();
            let grades = Grades::new(&choice, shown, &mixed);
            manners.push(Manner {
                usual,
                // All seeds of a part have one gain.
                wide: seeds.first().map_or(1.0, |seed: &StrokeSeed| seed.plain().wide),
                grades,
                textures,
                tints: choice.tints.into_owned(),
                shares: choice.shares,
                labels: choice.labels,
                placements: choice.placements,
            });
        }
        Ok(Some(Self { manners }))
    }
}
