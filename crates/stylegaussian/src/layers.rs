//! Looks in space: layers of colors, each within a region of the scene.
//!
//! Layers lie on one another, the first at the bottom. Each one replaces the share w of the colors below it,
//! where w is its region's weight at a Gaussian's mean. A color has four numbers: red, green and blue,
//! multiplied by the fourth, which is the share of the looks. Its rest is the share of the captured,
//! view-dependent colors, which only a view knows. The kernel of the same name is `mix_layers`.

use glam::{Affine3A, Vec3};
use rayon::prelude::*;

mod cover;
mod lattice;
mod shape;
#[cfg(test)]
mod tests;

pub use cover::{Cover, RegionCover};
pub use lattice::lattice_noise;
pub use shape::Shape;

/// A part of space with a soft edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// The shape, in world units, around its own origin.
    pub shape: Shape,
    /// The shape's space from the scene's. The shape's space has the world's units: it is only turned and
    /// moved.
    pub shape_from_scene: Affine3A,
    /// Width of the edge in world units, at least 0: half of it lies within the shape.
    pub softness: f32,
}

impl Region {
    /// All of space.
    pub const EVERYWHERE: Self =
        Self { shape: Shape::Everything, shape_from_scene: Affine3A::IDENTITY, softness: 0.0 };

    /// The weight at a point of the scene: 1 within the shape, 0 outside, and a smooth step between them across
    /// the edge. 0 if the region or the point is not finite.
    pub fn weight(&self, point: Vec3) -> f32 {
        let distance = self.shape.distance(self.shape_from_scene.transform_point3(point));
        let half = 0.5 * self.softness;
        // A comparison with NaN is false, so that a distance that is none counts as outside.
        let is_near = distance < half;
        if !is_near {
            return 0.0;
        }
        if distance <= -half {
            return 1.0;
        }
        // In this form an edge of infinite width has half of the weight everywhere.
        let t = 0.5 - distance / self.softness;
        t * t * (3.0 - 2.0 * t)
    }
}

/// Colors in a region.
#[derive(Clone, Copy, Debug)]
pub struct Layer<'a> {
    /// One color per Gaussian `[N]`, premultiplied, or `None` for the captured colors.
    pub look: Option<&'a [[f32; 4]]>,
    /// The part of the scene that gets them.
    pub region: Region,
    /// Share of the colors below that is replaced within the region, 0..1.
    pub strength: f32,
    /// Painted weights and the channel of them that counts here; `None` if all of the region counts.
    pub mask: Option<(&'a [[u8; 4]], usize)>,
}

impl Layer<'_> {
    /// The share of the colors below Gaussian `i`, with this mean, that the layer replaces.
    fn share(&self, i: usize, mean: Vec3) -> f32 {
        let painted = self.mask.map_or(1.0, |(mask, channel)| f32::from(mask[i][channel]) / 255.0);
        self.strength * painted * self.region.weight(mean)
    }
}

/// The colors of N Gaussians under `layers`, from the captured colors up `[N]`, premultiplied.
///
/// # Panics
/// If a look or a mask does not have one entry per mean.
pub fn mix_layers(means: &[Vec3], layers: &[Layer]) -> Vec<[f32; 4]> {
    for layer in layers {
        assert!(layer.look.is_none_or(|look| look.len() == means.len()), "one color per Gaussian");
        assert!(layer.mask.is_none_or(|(mask, _)| mask.len() == means.len()), "one weight per Gaussian");
    }
    let mixed = |(i, &mean): (usize, &Vec3)| {
        layers.iter().fold([0.0; 4], |below: [f32; 4], layer| {
            let share = layer.share(i, mean);
            let above = layer.look.map_or([0.0; 4], |look| look[i]);
            std::array::from_fn(|c| below[c] + share * (above[c] - below[c]))
        })
    };
    means.par_iter().enumerate().map(mixed).collect()
}
