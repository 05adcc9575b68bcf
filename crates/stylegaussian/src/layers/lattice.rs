//! Noise on a lattice: the same in Rust and in WGSL, since it is made of whole numbers.

use glam::{UVec3, Vec3};

/// Value noise, 0..1: a random number at every whole point, mixed smoothly between them.
///
/// Points beyond a million are poorly resolved: f32 has no digits left between two of them.
pub fn lattice_noise(point: Vec3) -> f32 {
    let cell = point.floor();
    let t = point - cell;
    let t = t * t * (3.0 - 2.0 * t);
    // As the shader does: to a signed number, then its bits. Both saturate.
    let base = UVec3::new(cell.x as i32 as u32, cell.y as i32 as u32, cell.z as i32 as u32);
    let at = |x: u32, y: u32, z: u32| {
        hash(UVec3::new(base.x.wrapping_add(x), base.y.wrapping_add(y), base.z.wrapping_add(z)))
    };
    let along_x = |y: u32, z: u32| at(0, y, z) + t.x * (at(1, y, z) - at(0, y, z));
    let along_y = |z: u32| along_x(0, z) + t.y * (along_x(1, z) - along_x(0, z));
    along_y(0) + t.z * (along_y(1) - along_y(0))
}

/// A random number of a whole point, 0..1: the first of pcg3d's three (Jarzynski and Olano, "Hash Functions for
/// GPU Rendering", 2020).
fn hash(point: UVec3) -> f32 {
    let step = |v: u32| v.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    let (mut x, mut y, mut z) = (step(point.x), step(point.y), step(point.z));
    x = x.wrapping_add(y.wrapping_mul(z));
    y = y.wrapping_add(z.wrapping_mul(x));
    z = z.wrapping_add(x.wrapping_mul(y));
    (x, y, z) = (x ^ (x >> 16), y ^ (y >> 16), z ^ (z >> 16));
    x = x.wrapping_add(y.wrapping_mul(z));
    // 24 bits, which f32 holds exactly.
    (x >> 8) as f32 / (1 << 24) as f32
}
