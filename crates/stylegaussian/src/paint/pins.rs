//! Pinned places: spots of a scene that are painted from given spots of a painting.

use std::collections::VecDeque;

use glam::{Vec2, Vec3};

use super::{
    canvas::Canvas,
    direction::Direction,
    hand::Hand,
    places::{Placed, Placement},
    surface::Surface,
};
use crate::{
    look::SceneFingerprint,
    scene::Scene,
    strokes::{FINE_SIDE, PlainSeed, StrokeSeed, Strokes},
};

/// Radius around a pin within which seeds continue its place, in pixels of the painting: two and a half times
/// their distance, so that the strokes around it are seen to go on.
const REACH: f32 = 70.0;

/// Least cosine between the normals of neighbors that continue one another: strokes do not go around corners.
const SAME_SIDE: f32 = 0.5;

/// Distance from a pin to the nearest seed at most, in pixels of the painting: the side of a usual picture of
/// the scene. What is farther away is no point of the scene.
const FARTHEST: f32 = 512.0;

/// A spot of a scene that is painted from a given spot of a painting. So are its surroundings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pin {
    /// A point of the scene, in scene units: on a surface, or no farther from one than a usual picture of the
    /// scene is wide.
    pub at: Vec3,
    /// A point of the painting, from its left and its top edge, as shares of its sides, 0..1.
    pub place: Vec2,
    /// Which painting of the style it is, from 0.
    pub painting: usize,
}

/// A pin that cannot be honored.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PinError {
    /// Its point in the scene is no point.
    #[error("pin {number}: found the point {at} in the scene, expected three finite numbers")]
    Scene {
        /// Its number, from 1.
        number: usize,
        /// The point.
        at: Vec3,
    },
    /// Its point in the scene is far outside of it.
    #[error("pin {number}: found the point {at} far from the scene, expected one on it")]
    Far {
        /// Its number, from 1.
        number: usize,
        /// The point.
        at: Vec3,
    },
    /// Its point in the painting is outside of it.
    #[error("pin {number}: found the point {place} in the painting, expected one from 0,0 to 1,1")]
    Place {
        /// Its number, from 1.
        number: usize,
        /// The point.
        place: Vec2,
    },
    /// It names a painting that the style does not have.
    #[error("pin {number}: found painting {painting}, expected one of the style's {n}, counted from 0")]
    Painting {
        /// Its number, from 1.
        number: usize,
        /// The painting.
        painting: usize,
        /// Paintings of the style.
        n: usize,
    },
    /// Its point in the painting may not be used.
    #[error(
        "pin {number}: found the point {place} in or beside what is transparent, expected one to paint from"
    )]
    Unused {
        /// Its number, from 1.
        number: usize,
        /// The point.
        place: Vec2,
    },
}

impl Pin {
    /// Checks pins on their own.
    ///
    /// # Errors
    /// If a point is no point, or outside of the painting.
    pub fn check(pins: &[Self]) -> Result<(), PinError> {
        for (number, pin) in (1..).zip(pins) {
            if !pin.at.is_finite() {
                return Err(PinError::Scene { number, at: pin.at });
            }
            if !(pin.place.cmpge(Vec2::ZERO) & pin.place.cmple(Vec2::ONE)).all() {
                return Err(PinError::Place { number, place: pin.place });
            }
        }
        Ok(())
    }

    /// Checks pins for this scene and these paintings.
    pub(crate) fn check_for<'a>(
        pins: &[Self],
        surface: &Surface,
        paintings: impl Iterator<Item = &'a Canvas> + Clone,
    ) -> Result<(), PinError> {
        Self::check(pins)?;
        for (number, pin) in (1..).zip(pins) {
            // Pins of a whole scene are far from most of its parts.
            let may_be_far = surface.is_beside || surface.n_seeds() == 0;
            if !may_be_far && pin.nearest_seed(surface).is_none() {
                return Err(PinError::Far { number, at: pin.at });
            }
            let Some(canvas) = paintings.clone().nth(pin.painting) else {
                let n = paintings.clone().count();
                return Err(PinError::Painting { number, painting: pin.painting, n });
            };
            if !canvas.is_used(canvas.place_at(pin.place * canvas.size)) {
                return Err(PinError::Unused { number, place: pin.place });
            }
        }
        Ok(())
    }

    /// The nearest seed, or `None` if all are far away.
    fn nearest_seed(&self, surface: &Surface) -> Option<usize> {
        let seeds = &surface.seeds.seeds;
        let apart = |j: &usize| seeds[*j].at.distance_squared(self.at);
        let nearest = (0..seeds.len()).min_by(|a, b| apart(a).total_cmp(&apart(b)))?;
        (apart(&nearest) <= (FARTHEST * surface.pixel).powi(2)).then_some(nearest)
    }
}

/// Pinned places of a scene, as a file keeps them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StoredPins {
    /// The scene that they belong to, or `None` if it is not known.
    pub scene: Option<SceneFingerprint>,
    /// The pins.
    pub pins: Vec<Pin>,
}

/// Pins that belong to another scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found pins of another scene ({found}), expected those of this scene ({expected})")]
pub struct OtherScene {
    found: SceneFingerprint,
    expected: SceneFingerprint,
}

impl StoredPins {
    /// Pins of `scene`.
    pub fn new(scene: &Scene, pins: Vec<Pin>) -> Self {
        Self { scene: Some(SceneFingerprint::of(scene)), pins }
    }

    /// The pins, for `scene`.
    ///
    /// # Errors
    /// If they belong to another one.
    pub fn pins_for(&self, scene: &Scene) -> Result<&[Pin], OtherScene> {
        let expected = SceneFingerprint::of(scene);
        match self.scene {
            Some(found) if found != expected => Err(OtherScene { found, expected }),
            _ => Ok(&self.pins),
        }
    }
}

/// The seeds whose places `pins` decide: of each pin the nearest seed, and those around it that are nearer to
/// no other pin and that the painting goes on for.
pub(super) fn pinned(
    surface: &Surface,
    paintings: &[&Canvas],
    pins: &[Pin],
    direction: Option<Direction>,
) -> Vec<Placed> {
    let seeds = &surface.seeds.seeds;
    let firsts: Vec<Option<usize>> = pins.iter().map(|pin| pin.nearest_seed(surface)).collect();
    let reach = REACH * surface.pixel;
    let mut all = Vec::new();
    for (number, (pin, first)) in pins.iter().zip(&firsts).enumerate() {
        let Some(start) = *first else { continue };
        let canvas = paintings[pin.painting];
        let at = pin.place * canvas.size;
        let mut own = Placement::on(&seeds[start], canvas.place_at(at), canvas, direction);
        let offset = pin.at - seeds[start].at;
        own.at = at - Vec2::new(offset.dot(own.right), offset.dot(own.down)) / surface.pixel;
        let is_own = |j: usize| {
            let apart = seeds[j].at.distance_squared(pin.at);
            let others = pins.iter().zip(&firsts).enumerate().filter(|(other, _)| *other != number);
            let mut taken = others.map(|(other, (pin, first))| {
                let other_apart = seeds[j].at.distance_squared(pin.at);
                *first == Some(j) || other_apart < apart || (other_apart == apart && other < number)
            });
            apart < reach * reach && !taken.any(|taken| taken)
        };
        let mut is_seen = vec![false; seeds.len()];
        is_seen[start] = true;
        let mut queue = VecDeque::from([(start, own)]);
        while let Some((i, placement)) = queue.pop_front() {
            all.push(Placed { seed: i as u32, painting: pin.painting, placement });
            for &j in &surface.seeds.around[i] {
                let j = j as usize;
                let goes_on = !std::mem::replace(&mut is_seen[j], true)
                    && is_own(j)
                    && seeds[i].normal.dot(seeds[j].normal).abs() > SAME_SIDE;
                if goes_on {
                    let next = placement.continued(&seeds[i], &seeds[j], surface.pixel);
                    let is_inside = (next.at.cmpge(Vec2::ZERO) & next.at.cmplt(canvas.size)).all();
                    if is_inside && canvas.is_used(canvas.place_at(next.at)) {
                        queue.push_back((j, next));
                    }
                }
            }
        }
    }
    all
}

/// Moves seeds `[M]` of one surface to their pinned places.
pub(super) fn move_seeds(seeds: &mut [StrokeSeed], paintings: &[&Canvas], pinned: &[Placed]) {
    for Placed { seed, painting, placement } in pinned {
        let seed = &mut seeds[*seed as usize];
        let Placement { at, right, down } = *placement;
        let canvas = paintings[*painting];
        let place = at * (FINE_SIDE as f32 / canvas.size);
        let moved = PlainSeed { right, down, place, ..seed.plain() }.packed();
        *seed = moved.with_direction(canvas.strokes[canvas.place_at(at)].0);
    }
}

/// Honors the pins of `hand` on `strokes` that were laid on by the same hand without pins, from the same
/// paintings with the same weights and not as a collection. The result is that of laying on with pins: they
/// move strokes and change nothing else. No place is searched for and no picture drawn, so a pin is there at
/// once.
///
/// # Errors
/// If a pin is no pin for this scene and these paintings. The strokes are then as they were.
pub fn pin(
    strokes: &mut Strokes,
    surface: &Surface,
    paintings: &[(&Canvas, f64)],
    hand: &Hand,
) -> Result<(), PinError> {
    Pin::check_for(hand.pins, surface, paintings.iter().map(|(canvas, _)| *canvas))?;
    let n_seeds = surface.n_seeds();
    // Each painting with a weight has all seeds of the surface, in turn.
    let given = paintings.iter().enumerate().filter(|(_, (_, weight))| *weight > 0.0 && weight.is_finite());
    for ((painting, (canvas, _)), seeds) in given.zip(strokes.seeds.chunks_exact_mut(n_seeds.max(1))) {
        let own = of_painting(hand.pins, painting);
        move_seeds(seeds, &[canvas], &pinned(surface, &[canvas], &own, hand.direction));
    }
    Ok(())
}

/// The pins of one painting, as those of a style of that alone.
pub(super) fn of_painting(pins: &[Pin], painting: usize) -> Vec<Pin> {
    pins.iter().filter(|pin| pin.painting == painting).map(|pin| Pin { painting: 0, ..*pin }).collect()
}
