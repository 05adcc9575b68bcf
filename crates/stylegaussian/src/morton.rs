//! Morton (z-curve) order, which puts Gaussians that are close in space close together in memory.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Bits per axis. Three times 21 make a 63-bit code, the longest that fits a `u64`.
const BITS: u32 = 21;

/// The largest coordinate of a cell, 2^21 - 1.
const LAST_CELL: f64 = ((1_u32 << BITS) - 1) as f64;

/// Spreads the low 21 bits of `value` so that two zero bits stand between each.
///
/// Each step halves the groups of bits that are still together and moves the upper half up. The mask drops the
/// copies that the shift leaves behind.
fn spread(value: u32) -> u64 {
    let mut v = u64::from(value) & 0x1f_ffff;
    v = (v | (v << 32)) & 0x001f_0000_0000_ffff;
    v = (v | (v << 16)) & 0x001f_0000_ff00_00ff;
    v = (v | (v << 8)) & 0x100f_00f0_0f00_f00f;
    v = (v | (v << 4)) & 0x10c3_0c30_c30c_30c3;
    (v | (v << 2)) & 0x1249_2492_4924_9249
}

/// The 63-bit Morton code of a cell. x takes the lowest bit of each triple, z the highest.
pub fn code(x: u32, y: u32, z: u32) -> u64 {
    spread(x) | (spread(y) << 1) | (spread(z) << 2)
}

/// The permutation that sorts `means` `[N]` along the z-curve: entry i is the index of the i-th mean in that
/// order.
///
/// Cells are cubes, 2^21 along the longest side of the bounds, so the curve is as local along short sides as
/// along long ones. Means in one cell keep their order.
pub fn order(means: &[Vec3]) -> Vec<u32> {
    let Some(&first) = means.first() else { return Vec::new() };
    let (min, max) = means.iter().fold((first, first), |(min, max), &m| (min.min(m), max.max(m)));
    // In f64: of the 24 bits of an f32, 21-bit cells would leave three for rounding.
    let (min, max) = (min.as_dvec3(), max.as_dvec3());
    let extent = (max - min).max_element();
    // If all means are at one point, all of them are in cell 0.
    let cells_per_unit = if extent > 0.0 { LAST_CELL / extent } else { 0.0 };
    let mut keys: Vec<(u64, u32)> = means
        .par_iter()
        .zip(0..means.len() as u32)
        .map(|(mean, index)| {
            // Casts from float to integer saturate, so even a mean that is not finite gets a cell.
            let cell: DVec3 = (mean.as_dvec3() - min) * cells_per_unit;
            (code(cell.x as u32, cell.y as u32, cell.z as u32), index)
        })
        .collect();
    // The index breaks ties, so an unstable sort keeps the order within a cell.
    keys.par_sort_unstable();
    keys.into_iter().map(|(_, index)| index).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Interleaves bit by bit: the definition.
    fn code_by_definition(x: u32, y: u32, z: u32) -> u64 {
        (0..BITS).fold(0, |code, bit| {
            let bits = [x, y, z].map(|v| u64::from((v >> bit) & 1));
            code | (bits[0] << (3 * bit)) | (bits[1] << (3 * bit + 1)) | (bits[2] << (3 * bit + 2))
        })
    }

    #[test]
    fn code_interleaves_bits() {
        assert_eq!(code(1, 0, 0), 0b001);
        assert_eq!(code(0, 1, 0), 0b010);
        assert_eq!(code(0, 0, 1), 0b100);
        assert_eq!(code(3, 1, 2), 0b101_011);
        let last = (1 << BITS) - 1;
        assert_eq!(code(last, last, last), (1 << 63) - 1);
        for i in 0..BITS {
            let (x, y, z) = (1 << i, 0x155_555 ^ (3 << i), 0x0ab_cde >> (i / 2));
            assert_eq!(code(x, y, z), code_by_definition(x, y, z), "bit {i}");
        }
    }

    #[test]
    fn corners_of_a_cube_follow_the_z_curve() {
        let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 4.0 - 2.0;
        let means: Vec<Vec3> = [6, 1, 7, 0, 3, 5, 2, 4].map(corner).into();
        assert_eq!(order(&means), [3, 1, 6, 4, 7, 5, 0, 2]);
    }

    #[test]
    fn ties_keep_their_order_and_degenerate_input_is_fine() {
        assert_eq!(order(&[]), [0_u32; 0]);
        assert_eq!(order(&[Vec3::ONE; 4]), [0, 1, 2, 3]);
        let (a, b) = (Vec3::ZERO, Vec3::ONE);
        assert_eq!(order(&[b, a, b, a]), [1, 3, 0, 2]);
        assert_eq!(order(&[Vec3::NAN, a, b]).len(), 3);
    }
}
