//! Blending the splats of one tile, front to back.

use std::f32::consts::{LN_2, LOG2_E};

use glam::Vec2;

use super::{
    alpha::{MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE},
    project::Splat,
};

/// Width and height of a tile, in pixels. A tile's transmittances (1 KiB) stay in a core's first-level cache,
/// and its groups of pixels fit the bits of a word.
pub(super) const TILE: usize = 16;

/// Pixels side by side that are blended at once: a *group*. Loops of this fixed length become vector
/// instructions.
pub(super) const GROUP: usize = 8;

/// Groups of a tile. They count from its top left, row by row.
pub(super) const GROUPS: usize = TILE * TILE / GROUP;

/// Groups of one row.
const IN_ROW: usize = TILE / GROUP;

/// Added to ranges of pixels, in pixels, for their rounding. A pixel too many costs time only: its alpha is
/// tested.
pub(super) const MARGIN: f32 = 1e-3;

/// The place of a tile in the picture, in pixels.
pub(super) struct Tile {
    /// Left edge.
    pub x: usize,
    /// Top edge.
    pub y: usize,
    /// Width: [`TILE`], or less at the picture's right edge.
    pub width: usize,
    /// Height: [`TILE`], or less at the picture's bottom edge.
    pub height: usize,
}

impl Tile {
    /// The center of a group's first pixel, in pixels of the picture.
    pub fn first_pixel(&self, group: usize) -> Vec2 {
        let (x, y) = (self.x + group % IN_ROW * GROUP, self.y + group / IN_ROW);
        Vec2::new(x as f32 + 0.5, y as f32 + 0.5)
    }

    /// Calls `blend(group, position of the splat, weights, alphas)` for each splat and each group of pixels
    /// that it reaches. Weights are `least` or more, or 0; pixels beyond the picture's edge have 0. `in_tile`
    /// lists the splats front to back.
    pub fn composite(
        &self,
        splats: &[Splat],
        in_tile: &[u32],
        least: f32,
        mut blend: impl FnMut(usize, usize, &[f32; GROUP], &[f32; GROUP]),
    ) {
        let mut pixels = Pixels::new(self.width, self.height);
        for &position in in_tile {
            let splat = &splats[position as usize];
            let rows = Rows::new(splat, self);
            // Groups that are reached and not finished, as bits: finished ones cost nothing.
            let mut remaining = rows.reached & pixels.unfinished;
            while remaining != 0 {
                let group = remaining.trailing_zeros() as usize;
                // Clears the lowest bit, which is this group's.
                remaining &= remaining - 1;
                let alphas = rows.alphas(splat, group);
                let weights = pixels.cover(group, &alphas, least);
                blend(group, position as usize, &weights, &alphas);
            }
            // Splats are sorted, so all that follow are hidden too.
            if pixels.unfinished == 0 {
                break;
            }
        }
    }
}

/// A splat in the rows of a tile. All rows are computed at once, before the first pixel.
struct Rows {
    /// The part of q that is the same in a row.
    q: [f32; TILE],
    /// Where the splat's alpha is largest, in pixels from the tile's left edge.
    middle: [f32; TILE],
    /// The groups that the splat may reach, as bits.
    reached: u32,
}

impl Rows {
    fn new(splat: &Splat, tile: &Tile) -> Self {
        let (x, y) = (splat.center.x - tile.x as f32, splat.center.y - tile.y as f32);
        // Standard deviation within a row, in pixels.
        let row_sigma = splat.row_precision.sqrt().recip();
        let (mut q, mut middle, mut reached) = ([0.0; TILE], [0.0; TILE], [0; TILE]);
        for row in 0..TILE {
            let dy = row as f32 + 0.5 - y;
            q[row] = dy * dy * splat.y_precision;
            middle[row] = x + splat.slope * dy;
            let half_width = larger(splat.cutoff - q[row], 0.0).sqrt() * row_sigma + MARGIN;
            let (left, right) = (middle[row] - half_width, middle[row] + half_width);
            let within = dy.abs() <= splat.half_size.y + MARGIN;
            for group in 0..IN_ROW {
                // Centers of the group's first and last pixels.
                let first = (group * GROUP) as f32 + 0.5;
                let last = first + (GROUP - 1) as f32;
                let bit = 1 << (row * IN_ROW + group);
                reached[row] |= if within & (left <= last) & (right >= first) { bit } else { 0 };
            }
        }
        Self { q, middle, reached: reached.iter().fold(0, |all, of_row| all | of_row) }
    }

    /// The splat's alphas in a group's pixels.
    fn alphas(&self, splat: &Splat, group: usize) -> [f32; GROUP] {
        let (row, first) = (group / IN_ROW, group % IN_ROW * GROUP);
        let (q_row, left) = (self.q[row], first as f32 - self.middle[row]);
        std::array::from_fn(|i| {
            let du = left + (i as f32 + 0.5);
            let q = q_row + du * du * splat.row_precision;
            smaller(splat.opacity * falloff(q), MAX_ALPHA)
        })
    }
}

/// The state of a tile's pixels between two splats.
struct Pixels {
    /// Share of the light from behind that still passes through each pixel of each group, 0..1; 0 if the pixel
    /// is finished.
    transmittance: [[f32; GROUP]; GROUPS],
    /// One bit per group: most splats of a deep scene lie behind finished pixels only.
    unfinished: u32,
}

impl Pixels {
    fn new(width: usize, height: usize) -> Self {
        let (mut transmittance, mut unfinished) = ([[0.0; GROUP]; GROUPS], 0);
        // Pixels beyond the edge of the picture count as finished.
        for (group, transmittance) in transmittance.iter_mut().enumerate() {
            let (row, first) = (group / IN_ROW, group % IN_ROW * GROUP);
            let inside = if row < height { width.saturating_sub(first).min(GROUP) } else { 0 };
            transmittance[..inside].fill(1.0);
            unfinished |= u32::from(inside > 0) << group;
        }
        Self { transmittance, unfinished }
    }

    /// Puts a splat behind all that a group has. Returns its weights. Behind it, weights below `least` are not
    /// looked for.
    fn cover(&mut self, group: usize, alphas: &[f32; GROUP], least: f32) -> [f32; GROUP] {
        // No weight behind is larger than what passes through.
        let enough = larger(least, MIN_TRANSMITTANCE);
        let before = self.transmittance[group];
        let (mut weights, mut behind) = ([0.0; GROUP], [0.0; GROUP]);
        for i in 0..GROUP {
            let (alpha, before) = (alphas[i], before[i]);
            let after = before * (1.0 - alpha);
            let product = alpha * before;
            // The groups above have margins, and the rule is that of the pixel alone.
            let drawn = mask(alpha >= MIN_ALPHA);
            // The splat that would finish a pixel is dropped and not drawn last, as in the original rasterizer.
            let kept = drawn & mask(after >= MIN_TRANSMITTANCE) & mask(product >= least);
            weights[i] = f32::from_bits(product.to_bits() & kept);
            let unfinished = after.to_bits() & mask(after >= enough);
            behind[i] = f32::from_bits(unfinished & drawn | before.to_bits() & !drawn);
        }
        self.transmittance[group] = behind;
        let open = behind.iter().fold(0, |all, transmittance| all | transmittance.to_bits());
        if open == 0 {
            self.unfinished &= !(1 << group);
        }
        weights
    }
}

/// exp(-q / 2) for a q of 0 or more, in steps that are vector instructions: 2^y = 2^n 2^f, with n the integer
/// nearest to y.
fn falloff(q: f32) -> f32 {
    /// 1.5 x 2^23. A sum with it is rounded to an integer, which its lowest bits hold.
    const ROUND: f32 = 12_582_912.0;
    // At -126 the exponent is the least of a normal number.
    let y = larger(-0.5 * LOG2_E * q, -126.0);
    let rounded = y + ROUND;
    let f = y - (rounded - ROUND);
    // 2^f to a ten-millionth: 1, ln 2, and the other coefficients with the least largest relative error.
    let power = 0.001_330_060_7 * f + 0.009_669_691;
    let power = power * f + 0.055_505_585;
    let power = power * f + 0.240_222_83;
    let power = power * f + LN_2;
    let power = power * f + 1.0;
    // The exponent of a number is above its 23 bits of mantissa.
    f32::from_bits(power.to_bits().wrapping_add(rounded.to_bits() << 23))
}

/// All bits if `condition` holds, else none. Numbers are masked by it, since the compiler would make branches
/// of `if`, and no processor foretells them.
fn mask(condition: bool) -> u32 {
    u32::from(condition).wrapping_neg()
}

/// The larger of two numbers, neither of which is NaN. `f32::max` looks for NaN.
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller of two numbers, neither of which is NaN.
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn falloff_is_the_exponential() {
        for i in 0..20_000 {
            let q = i as f32 * 1e-3;
            let (found, expected) = (f64::from(falloff(q)), (-0.5 * f64::from(q)).exp());
            // A rounding of q / 2 is a ten-millionth of up to 10.
            assert!((found / expected - 1.0).abs() < 2e-6, "q {q}: found {found}, expected {expected}");
        }
        for q in [180.0, 1e3, 1e9, f32::MAX] {
            assert!((0.0..1e-37).contains(&falloff(q)), "q {q}: {}", falloff(q));
        }
    }
}
