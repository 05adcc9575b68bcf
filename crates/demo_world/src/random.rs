//! Random numbers and noise, made with integer arithmetic so that they are the same on every machine.

use glam::{Vec2, Vec3};

/// The golden-ratio increment of SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number
/// generators", 2014).
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// SplitMix64's output function, a bijection of u64 that scatters neighboring inputs.
fn scatter(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// The upper 24 bits as a number in [0, 1). An f32 holds each of these numbers exactly.
fn unit(bits: u64) -> f32 {
    (bits >> 40) as f32 / (1 << 24) as f32
}

/// A stream of random numbers. Every part of the world has its own stream, so that a change of one part leaves
/// the others alone.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        Self(scatter(seed.wrapping_mul(GOLDEN)))
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(GOLDEN);
        unit(scatter(self.0))
    }

    /// Uniform in [low, high).
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// Uniform in [-1, 1).
    pub fn signed(&mut self) -> f32 {
        self.range(-1.0, 1.0)
    }

    /// Uniform in the cube [-1, 1)^3.
    pub fn cube(&mut self) -> Vec3 {
        let x = self.signed();
        let y = self.signed();
        Vec3::new(x, y, self.signed())
    }

    /// Uniform on the unit sphere, by rejection: points of the cube outside the ball are dropped. It needs no
    /// trigonometry.
    pub fn direction(&mut self) -> Vec3 {
        loop {
            let candidate = self.cube();
            let squared = candidate.length_squared();
            // Points near the center are dropped as well: their direction would be inexact.
            if (0.01..1.0).contains(&squared) {
                return candidate / squared.sqrt();
            }
        }
    }

    /// One of the given values, each with the same probability.
    pub fn pick<T: Copy>(&mut self, values: &[T]) -> T {
        let index = (self.unit() * values.len() as f32) as usize;
        // The product may round up to the length.
        values[index.min(values.len() - 1)]
    }
}

/// A uniform number in [0, 1), a hash of a lattice point.
pub fn lattice(x: i32, y: i32, z: i32) -> f32 {
    let key = (x as u32 as u64) | ((y as u32 as u64) << 32);
    unit(scatter(scatter(key.wrapping_add(GOLDEN)) ^ (z as u32 as u64).wrapping_mul(GOLDEN)))
}

fn smooth(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}

/// Value noise of space, in [0, 1), with one feature per unit.
pub fn noise3(p: Vec3) -> f32 {
    let corner = p.floor();
    let (t, at) = (p - corner, corner.as_ivec3());
    let (tx, ty, tz) = (smooth(t.x), smooth(t.y), smooth(t.z));
    let edge = |y, z| {
        let from = lattice(at.x, at.y + y, at.z + z);
        from + (lattice(at.x + 1, at.y + y, at.z + z) - from) * tx
    };
    let face = |z| edge(0, z) + (edge(1, z) - edge(0, z)) * ty;
    face(0) + (face(1) - face(0)) * tz
}

/// Value noise of the plane, in [0, 1).
pub fn noise2(p: Vec2) -> f32 {
    noise3(Vec3::new(p.x, 0.5, p.y))
}

/// Four octaves of noise, in [0, 1).
pub fn fractal3(p: Vec3) -> f32 {
    let mut sum = 0.0;
    // The weights 8, 4, 2 and 1 in fifteenths sum to 1.
    let mut weight = 8.0 / 15.0;
    let mut at = p;
    for _ in 0..4 {
        sum += weight * noise3(at);
        weight *= 0.5;
        // Not quite twice as fine, and shifted, so that the lattices of octaves do not coincide.
        at = at * 2.03 + Vec3::new(17.1, 31.7, 5.3);
    }
    sum
}

/// Four octaves of noise of the plane, in [0, 1).
pub fn fractal2(p: Vec2) -> f32 {
    fractal3(Vec3::new(p.x, 0.5, p.y))
}

/// A point's place in cellular noise (Worley): cells around randomly placed centers, one per unit.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Vector from the nearest center to the point.
    pub offset: Vec3,
    /// Difference of the distances to the second nearest and the nearest center: 0 on the seams between cells.
    pub seam: f32,
    /// A uniform number in [0, 1), the same all over the cell.
    pub id: f32,
}

/// The cell that a point lies in.
pub fn cell(p: Vec3) -> Cell {
    let base = p.floor().as_ivec3();
    let mut nearest = (f32::MAX, Vec3::ZERO, 0.0);
    let mut second = f32::MAX;
    for step in 0..27 {
        let (x, y, z) = (base.x + step % 3 - 1, base.y + step / 3 % 3 - 1, base.z + step / 9 - 1);
        // One lattice at three places far apart gives three independent numbers.
        let jitter = Vec3::new(lattice(x, y, z), lattice(x, y, z + 7919), lattice(x + 6007, y, z));
        let offset = p - (Vec3::new(x as f32, y as f32, z as f32) + jitter);
        let distance = offset.length();
        if distance < nearest.0 {
            second = nearest.0;
            nearest = (distance, offset, lattice(x, y + 104_729, z));
        } else {
            second = second.min(distance);
        }
    }
    Cell { offset: nearest.1, seam: second - nearest.0, id: nearest.2 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splitmix_of_the_reference() {
        // First output of SplitMix64 from state 0, as published with the generator.
        assert_eq!(scatter(0u64.wrapping_add(GOLDEN)), 0xe220_a839_7b1d_cdaf);
    }

    #[test]
    fn noise_is_the_lattice_value_on_the_lattice() {
        assert_eq!(noise3(Vec3::new(3.0, -2.0, 5.0)), lattice(3, -2, 5));
        let between = noise3(Vec3::new(3.5, -2.0, 5.0));
        assert!((between - 0.5 * (lattice(3, -2, 5) + lattice(4, -2, 5))).abs() < 1e-6);
    }

    #[test]
    fn directions_are_unit_and_balanced() {
        let mut random = Random::new(1);
        let mut sum = Vec3::ZERO;
        for _ in 0..4000 {
            let direction = random.direction();
            assert!((direction.length() - 1.0).abs() < 1e-5);
            sum += direction;
        }
        assert!(sum.length() / 4000.0 < 0.05);
    }
}
