//! Baked light: a sun with soft shadows, and a sky with ambient occlusion.
//!
//! All Gaussians together become a grid of extinction, and rays march through it. A cell's value is the blocked
//! area per volume. A flat Gaussian of standard deviations a and b blocks 2 pi a b times its opacity, the
//! integral of its profile.

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use crate::brush::{Dab, Frame, paint, smoothstep};

/// Edge of a cell, in scene units: about the spacing of Gaussians on surfaces.
const CELL: f32 = 0.055;
/// Distance of a ray's start from its surface, in scene units, so that a surface does not shadow itself.
const LIFT: f32 = 1.7 * CELL;
/// Unit vector toward the sun.
pub const SUN: Vec3 = Vec3::new(0.53, 0.68, 0.506);
/// Number of sky rays per Gaussian.
const SKY_RAYS: u32 = 28;
/// Length of sky rays, in scene units.
const SKY_REACH: f32 = 1.5;
/// Length of sun rays, in scene units: across the island.
const SUN_REACH: f32 = 7.0;

/// Extinction per unit length, in a grid of cells.
#[derive(Debug)]
struct Grid {
    origin: Vec3,
    size: IVec3,
    extinction: Vec<f32>,
}

impl Grid {
    fn of(dabs: &[Dab]) -> Self {
        let mut low = Vec3::splat(f32::MAX);
        let mut high = Vec3::splat(f32::MIN);
        for dab in dabs {
            low = low.min(dab.frame.origin);
            high = high.max(dab.frame.origin);
        }
        // A margin around the outermost centers, as dabs and rays reach beyond them.
        let origin = low - Vec3::splat(3.0 * CELL);
        let size = ((high - origin) / CELL).ceil().as_ivec3() + IVec3::splat(4);
        let extinction = vec![0.0; (size.x * size.y * size.z) as usize];
        let mut grid = Self { origin, size, extinction };
        for dab in dabs {
            grid.deposit(dab);
        }
        grid
    }

    /// Spreads a dab's area over five points of its ellipse, the center and one on each half-axis.
    fn deposit(&mut self, dab: &Dab) {
        let area = std::f32::consts::TAU * dab.sigma.x * dab.sigma.y * dab.opacity * dab.blocks;
        let (x, y) = (dab.frame.x * dab.sigma.x * 1.1, dab.frame.y * dab.sigma.y * 1.1);
        for offset in [Vec3::ZERO, x, -x, y, -y] {
            if let Some(index) = self.index(dab.frame.origin + offset) {
                self.extinction[index] += area / 5.0 / (CELL * CELL * CELL);
            }
        }
    }

    /// Index of the cell around a position, or `None` if it is outside the grid.
    fn index(&self, position: Vec3) -> Option<usize> {
        let at = ((position - self.origin) / CELL).floor().as_ivec3();
        let inside = at.min(self.size - IVec3::ONE).max(IVec3::ZERO) == at;
        inside.then(|| ((at.z * self.size.y + at.y) * self.size.x + at.x) as usize)
    }

    /// The share of light that passes from `from` along `direction` for `reach`.
    fn passes(&self, from: Vec3, direction: Vec3, reach: f32) -> f32 {
        let step = direction * CELL;
        let mut at = from;
        let mut depth = 0.0;
        for _ in 0..(reach / CELL) as u32 {
            match self.index(at) {
                Some(index) => depth += self.extinction[index] * CELL,
                None => break,
            }
            // Hardly any light passes from here on.
            if depth > 5.0 {
                return 0.0;
            }
            at += step;
        }
        // exp(-depth) by the reciprocal of a truncated series: exact enough here, cheap, and the same
        // everywhere.
        1.0 / (1.0 + depth + 0.5 * depth * depth + depth * depth * depth / 6.0)
    }
}

/// Light from a direction of the sky, or from the ground below.
fn sky(direction: Vec3) -> Vec3 {
    let zenith = Vec3::new(0.40, 0.58, 0.98);
    let horizon = Vec3::new(0.86, 0.86, 0.92);
    let below = Vec3::new(0.46, 0.43, 0.39);
    if direction.y < 0.0 {
        return horizon.lerp(below, smoothstep(0.0, 0.35, -direction.y));
    }
    horizon.lerp(zenith, smoothstep(0.0, 0.8, direction.y))
}

/// Directions toward the sun's disc, which is widened for soft shadows.
fn sun_rays() -> [Vec3; 7] {
    let frame = Frame::facing(Vec3::ZERO, SUN, Vec3::X);
    let ring = |index: u32| {
        let angle = std::f32::consts::TAU * index as f32 / 6.0;
        // The real disc has a radius of 0.0047.
        (frame.z + frame.vector(libm::cosf(angle), libm::sinf(angle), 0.0) * 0.035).normalize()
    };
    [frame.z, ring(0), ring(1), ring(2), ring(3), ring(4), ring(5)]
}

/// Directions about +z with a density proportional to their cosine, by Malley's method: points of a disc are
/// lifted onto the hemisphere.
fn cosine_directions() -> Vec<Vec3> {
    // pi (3 - sqrt 5): a spiral by this angle fills the disc without arms.
    const GOLDEN_ANGLE: f32 = 2.399_963_2;
    (0..SKY_RAYS)
        .map(|index| {
            // Steps of the squared radius are rings of equal area.
            let squared = (index as f32 + 0.5) / SKY_RAYS as f32;
            let (radius, angle) = (squared.sqrt(), index as f32 * GOLDEN_ANGLE);
            Vec3::new(radius * libm::cosf(angle), radius * libm::sinf(angle), (1.0 - squared).sqrt())
        })
        .collect()
}

/// Tone curve: linear up to 0.7, then bending toward 1, so that no light clips.
fn shoulder(x: f32) -> f32 {
    const KNEE: f32 = 0.7;
    if x <= KNEE { x } else { KNEE + (1.0 - KNEE) * (1.0 - 1.0 / (1.0 + (x - KNEE) / (1.0 - KNEE))) }
}

/// The display color (sRGB by power 2.2, 0..1) of every dab `[N]`.
pub fn bake(dabs: &[Dab]) -> Vec<Vec3> {
    let grid = Grid::of(dabs);
    let (sun_rays, sky_directions) = (sun_rays(), cosine_directions());
    let sunlight = paint(0xfff0d2) * 1.22;
    dabs.par_iter()
        .map(|dab| {
            let from = dab.frame.origin + dab.shade * LIFT;
            // Wrapped diffuse light: at `wrap` 0 this is the cosine, at 1 even the far side gets some.
            let facing = ((dab.shade.dot(SUN) + dab.wrap) / (1.0 + dab.wrap)).max(0.0);
            let mut sun = 0.0;
            if facing > 0.0 {
                for ray in sun_rays {
                    sun += grid.passes(from, ray, SUN_REACH) / sun_rays.len() as f32;
                }
            }
            let around = Frame::facing(Vec3::ZERO, dab.shade, Vec3::X);
            let mut ambient = Vec3::ZERO;
            for local in &sky_directions {
                let direction = around.vector(local.x, local.y, local.z);
                ambient += sky(direction) * grid.passes(from, direction, SKY_REACH);
            }
            // The weights of sun, sky and a little light from everywhere were set by eye.
            let light = sunlight * facing * sun + ambient * (0.62 / SKY_RAYS as f32) + Vec3::splat(0.03);
            let lit = dab.color * light + dab.glow;
            let display = |x: f32| libm::powf(shoulder(x), 1.0 / 2.2).clamp(0.0, 1.0);
            Vec3::new(display(lit.x), display(lit.y), display(lit.z))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_roof_shadows_the_floor() {
        let white = |center: Vec3, sigma| Dab::flat(center, Vec3::Y, Vec3::X, (sigma, sigma), Vec3::ONE);
        let mut dabs = vec![white(Vec3::ZERO, 0.03), white(Vec3::new(4.0, 0.0, 0.0), 0.03)];
        for index in 0..900 {
            let (x, z) = (index % 30, index / 30);
            dabs.push(white(SUN / SUN.y + Vec3::new(x as f32 - 14.5, 0.0, z as f32 - 14.5) * 0.05, 0.03));
        }
        let colors = bake(&dabs);
        assert!(colors[0].x < 0.75 * colors[1].x, "{} in the shadow, {} in the sun", colors[0], colors[1]);
        assert!(colors[1].x > 0.9);
    }

    #[test]
    fn the_shoulder_never_clips() {
        assert_eq!(shoulder(0.5), 0.5);
        assert!(shoulder(10.0) < 1.0 && shoulder(10.0) > shoulder(2.0));
    }
}
