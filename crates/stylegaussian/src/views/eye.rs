//! The spot from which a capture was made, if it was made from about one spot within it: of a room, a courtyard
//! or a street, also of one whose sky is empty.
//!
//! Training splits Gaussians until they are a few pixels large. Seen from where the pictures were taken, they
//! are thus about equally large, and their sizes grow with the distance from there. Around a thing that was
//! seen from outside, no spot explains the sizes. With s the size of a Gaussian and r its distance from a spot,
//! the spot is that of the least
//!
//! ```text
//! variance of log(s / r) / variance of log s
//! ```
//!
//! Scenes of rays from about one spot have 0.05 to 0.35. Captures of things have 0.87 and more, and things in
//! scenes of rays from all around have 0.5 and more.
//!
//! A small thing on a large floor under a far sky has a spot too: beside the thing, whose Gaussians are small
//! because cameras went around it. What is near such a spot tells: sizes on the thing do not grow with the
//! distance from there, and so vary more than before if that is divided out. Around the spot of a capture from
//! within they do not.

use glam::{IVec3, Vec3};

use super::survey::Extent;
use crate::Scene;

/// Largest share of the variance that is left of a capture from within.
const MOST_LEFT: f64 = 0.4;

/// Share of the variance that two spots may differ by and still be equally good.
const HARDLY: f64 = 0.05;

/// Fewer Gaussians tell nothing.
const FEWEST: usize = 64;

/// Gaussians that are compared. The variance of n values is known to sqrt(2 / n) of it: a thirtieth.
const N_SAMPLE: usize = 2000;

/// Steps from the middle to either side of the box, and the part of it that they reach.
const STEPS: i32 = 3;
const REACH: f32 = 0.8;

/// Shares of the Gaussians nearest to a spot, and the variance that the distance may leave of their sizes in
/// each, in parts of it. Around the spot of a capture the nearest are about equally far, so that it explains
/// little of them: in scenes of rays, 0.2 to 1.05 are left, and 1.28 if the spot is the middle of a walk.
/// Beside a ball on the ground that was seen from all around, one of the shares leaves 1.5 to 2.2.
const NEAREST: [f32; 3] = [0.1, 0.2, 0.4];
const MOST_LEFT_OF_NEAREST: f64 = 1.4;

/// Halvings of the steps around the best spot: the last ones are a hundredth of the box.
const N_HALVINGS: usize = 5;

/// Least half size of the box along each axis, in its radii: a floor is seen from above it.
const LEAST_HEIGHT: f32 = 0.2;

/// The share of Gaussians that is nearer to the eye than its surroundings.
const NEAR_SHARE: f32 = 0.1;

/// The spot from which a capture was made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eye {
    /// Its place, in scene units.
    pub at: Vec3,
    /// The distance of what is near, in scene units; above 0.
    pub room: f32,
}

/// The eye, or `None` if the scene was seen from outside. `framed` `[n]` tells the masses of the dense part,
/// which must be seen from within too: a thing among its surroundings is not. `all` is the extent of the scene,
/// and `dense` that of the dense part.
pub(super) fn eye(stand_in: &Scene, framed: &[f32], all: &Extent, dense: &Extent) -> Option<Eye> {
    best(&sizes(stand_in, |i| framed[i] > 0.0), dense)?;
    let sizes = sizes(stand_in, |_| true);
    let at = best(&sizes, all)?;
    let explains_nearest = |&share: &f32| {
        let nearest = nearest(&sizes, at, share);
        left(&nearest, at) <= MOST_LEFT_OF_NEAREST * whole(&nearest)
    };
    if !NEAREST.iter().all(explains_nearest) {
        return None;
    }
    let (_, room) = near(&sizes, at)?;
    Some(Eye { at, room })
}

impl Eye {
    /// The eye above what is near. Sizes on a floor hardly tell a spot from its mirror image below.
    pub(super) fn above_floor(self, stand_in: &Scene, up: Vec3) -> Self {
        let sizes = sizes(stand_in, |_| true);
        let Some((middle, _)) = near(&sizes, self.at) else { return self };
        let height = up.dot(self.at - middle);
        let mirrored = self.at - 2.0 * height * up;
        let is_as_good = left(&sizes, mirrored) < left(&sizes, self.at) + HARDLY * whole(&sizes);
        if height < 0.0 && is_as_good { Self { at: mirrored, ..self } } else { self }
    }
}

/// Means, and logarithms of sizes, of a sample of these Gaussians.
fn sizes(stand_in: &Scene, is_taken: impl Fn(usize) -> bool) -> Vec<(Vec3, f64)> {
    let of = |i: usize| {
        let [a, b, c] = stand_in.scales[i].to_array();
        // What is seen of a flat Gaussian are its two larger axes.
        let size = (a * b).max(b * c).max(c * a).sqrt();
        (size > 0.0 && size.is_finite() && is_taken(i)).then(|| (stand_in.means[i], f64::from(size).ln()))
    };
    let sizes: Vec<(Vec3, f64)> = (0..stand_in.len()).filter_map(of).collect();
    let stride = sizes.len().div_ceil(N_SAMPLE).max(1);
    sizes.into_iter().step_by(stride).collect()
}

/// Those nearest to a spot: this share of all, by their distance.
fn nearest(sizes: &[(Vec3, f64)], at: Vec3, share: f32) -> Vec<(Vec3, f64)> {
    let mut sizes = sizes.to_vec();
    sizes.sort_by(|(a, _), (b, _)| a.distance_squared(at).total_cmp(&b.distance_squared(at)));
    sizes.truncate((share * sizes.len() as f32) as usize);
    sizes
}

/// The middle of what is near a spot, and how far it reaches, above 0. `None` if there is nothing.
fn near(sizes: &[(Vec3, f64)], at: Vec3) -> Option<(Vec3, f32)> {
    let near = nearest(sizes, at, NEAR_SHARE);
    let room = near.last()?.0.distance(at);
    (room > 0.0).then(|| (near.iter().map(|(mean, _)| *mean).sum::<Vec3>() / near.len() as f32, room))
}

/// The variance of the sizes.
fn whole(sizes: &[(Vec3, f64)]) -> f64 {
    variance(sizes.iter().map(|(_, size)| *size))
}

/// The variance that is left of the sizes as they are seen from a spot.
fn left(sizes: &[(Vec3, f64)], spot: Vec3) -> f64 {
    // Never 0, whose logarithm is infinite.
    let distance = |mean: &Vec3| f64::from(mean.distance(spot).max(f32::MIN_POSITIVE)).ln();
    variance(sizes.iter().map(|(mean, size)| size - distance(mean)))
}

/// The spot that explains the sizes best, or `None` if none explains enough.
fn best(sizes: &[(Vec3, f64)], extent: &Extent) -> Option<Vec3> {
    if sizes.len() < FEWEST {
        return None;
    }
    let half_size = extent.half_size.max(Vec3::splat(LEAST_HEIGHT * extent.half_size.length()));
    let mut step = REACH / STEPS as f32 * half_size;
    let around = |middle: Vec3, n: i32, step: Vec3| {
        let axis = move || -n..=n;
        let spots =
            axis().flat_map(move |x| axis().flat_map(move |y| axis().map(move |z| IVec3::new(x, y, z))));
        spots.map(move |spot| middle + spot.as_vec3() * step)
    };
    // Of equal ones the first, so that the choice is the same each time.
    let first_of = |spots: &mut dyn Iterator<Item = Vec3>| {
        let spots = spots.map(|spot| (left(sizes, spot), spot));
        spots.reduce(|best, other| if other.0 < best.0 { other } else { best })
    };
    let mut found = first_of(&mut around(extent.center, STEPS, step))?;
    for _ in 0..N_HALVINGS {
        step /= 2.0;
        found = first_of(&mut std::iter::once(found.1).chain(around(found.1, 1, step)))?;
    }
    (found.0 < MOST_LEFT * whole(sizes)).then_some(found.1)
}

/// The variance of values that are run through twice, or NaN if there are none.
fn variance(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    values.map(|value| (value - mean).powi(2)).sum::<f64>() / n
}
