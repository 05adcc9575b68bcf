//! Blending the splats of one tile, front to back.

use std::ops::Range;

use super::{
    alpha::{MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE},
    project::Splat,
};

/// Width and height of a tile, in pixels. A tile's transmittances (1 KiB) stay in a core's first-level cache, and one
/// row of its pixels fits the bits of a word.
pub(super) const TILE: usize = 16;

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
    /// Calls `blend(column, row, position of the splat, weight)` for each splat and each pixel that it reaches with a weight
    /// of `least` or more. Column and row count from the tile's top left; `in_tile` lists the splats front to back.
    pub fn composite(
        &self,
        splats: &[Splat],
        in_tile: &[u32],
        least: f32,
        mut blend: impl FnMut(usize, usize, usize, f32),
    ) {
        let mut pixels = Pixels::new(self.width, self.height);
        for &position in in_tile {
            let splat = &splats[position as usize];
            let (y, half_height) = (splat.center.y - self.y as f32, splat.half_size.y);
            // Standard deviation within a row, in pixels.
            let row_sigma = splat.row_precision.sqrt().recip();
            for row in pixels_between(y - half_height, y + half_height, self.height) {
                if pixels.unfinished[row] == 0 {
                    continue;
                }
                let dy = row as f32 + 0.5 - y;
                let q_row = dy * dy * splat.y_precision;
                let middle = splat.center.x - self.x as f32 + splat.slope * dy;
                // The range of rows has a margin, so the outermost row may miss the footprint.
                let half_width = (splat.cutoff - q_row).max(0.0).sqrt() * row_sigma;
                let reached = pixels_between(middle - half_width, middle + half_width, self.width);
                // Pixels that are reached and not finished, as bits: finished ones cost nothing.
                let mut remaining = bits(reached) & pixels.unfinished[row];
                while remaining != 0 {
                    let column = remaining.trailing_zeros() as usize;
                    // Clears the lowest bit, which is this column's.
                    remaining &= remaining - 1;
                    let du = column as f32 + 0.5 - middle;
                    let q = q_row + du * du * splat.row_precision;
                    let alpha = (splat.opacity * (-0.5 * q).exp()).min(MAX_ALPHA);
                    let weight = pixels.cover(row, column, alpha, least);
                    if let Some(weight) = weight.filter(|weight| *weight >= least) {
                        blend(column, row, position as usize, weight);
                    }
                }
            }
            // Splats are sorted, so all that follow are hidden too.
            if pixels.n_unfinished == 0 {
                break;
            }
        }
    }
}

/// The state of a tile's pixels between two splats.
struct Pixels {
    /// Share of the light from behind that still passes through each pixel, 0..1.
    transmittance: [[f32; TILE]; TILE],
    /// One bit per pixel, one word per row: most splats of a deep scene lie behind finished pixels only.
    unfinished: [u32; TILE],
    /// Number of bits set in `unfinished`.
    n_unfinished: usize,
}

impl Pixels {
    fn new(width: usize, height: usize) -> Self {
        // Rows below the edge of the picture have no bits, and are skipped like finished ones.
        let mut unfinished = [0; TILE];
        unfinished[..height].fill(bits(0..width));
        Self { transmittance: [[1.0; TILE]; TILE], unfinished, n_unfinished: width * height }
    }

    /// Puts a splat behind all that an unfinished pixel has. Returns its weight, or `None` if it is not drawn. Behind it, weights
    /// below `least` are not looked for.
    fn cover(&mut self, row: usize, column: usize, alpha: f32, least: f32) -> Option<f32> {
        // The ranges above have margins, and the rule is that of the pixel alone.
        if alpha < MIN_ALPHA {
            return None;
        }
        let before = self.transmittance[row][column];
        let after = before * (1.0 - alpha);
        // The splat that would finish a pixel is dropped and not drawn last, as in the original rasterizer.
        let hidden = after < MIN_TRANSMITTANCE;
        // No weight behind is larger than what passes through.
        if hidden || after < least {
            self.unfinished[row] &= !(1 << column);
            self.n_unfinished -= 1;
        }
        self.transmittance[row][column] = after;
        (!hidden).then_some(alpha * before)
    }
}

/// A word with the bits `pixels` set. `TILE` < 32, so that no shift overflows.
fn bits(pixels: Range<usize>) -> u32 {
    // An empty range may start beyond its end.
    (1u32 << pixels.end) - (1u32 << pixels.start.min(pixels.end))
}

/// The pixels, of `n` in a row, with centers between `low` and `high`.
fn pixels_between(low: f32, high: f32, n: usize) -> Range<usize> {
    // A thousandth of a pixel covers the rounding of the range. A pixel too many costs time only: its alpha is tested.
    let (low, high) = (low - 0.5 - 1e-3, high - 0.5 + 1e-3);
    let first = rounded_up(low);
    let end = if high >= 0.0 { (high as usize).saturating_add(1) } else { 0 };
    first.min(n)..end.min(n)
}

/// The least integer that is not below `value`, or 0.
pub(super) fn rounded_up(value: f32) -> usize {
    // Casts round toward 0, and are no calls, which `ceil` and `floor` are if the processor is not known.
    let down = value.max(0.0) as usize;
    down.saturating_add(usize::from(value > down as f32))
}
