//! Blending the splats of one tile, front to back.

use std::ops::Range;

use super::{MAX_ALPHA, MIN_ALPHA, bands::TILE, project::Splat};

/// A pixel is finished before the splat that would bring its transmittance under this.
const MIN_TRANSMITTANCE: f32 = 1e-4;

/// A tile's place in the picture, in pixels.
pub(super) struct Tile {
    pub x: usize,
    pub y: usize,
    pub width: usize,
    pub height: usize,
}

impl Tile {
    /// Calls `blend(column, row, position of the splat, weight)` for each splat in each pixel it reaches, pixel and
    /// row counted within the tile; `in_tile` lists the splats front to back.
    pub fn composite(
        &self,
        splats: &[Splat],
        in_tile: &[u32],
        mut blend: impl FnMut(usize, usize, usize, f32),
    ) {
        let mut pixels = Pixels::new(self.width, self.height);
        for &position in in_tile {
            let splat = &splats[position as usize];
            let (y, half_height) = (splat.center.y - self.y as f32, splat.half_size.y);
            let row_sigma = splat.row_precision.sqrt().recip();
            for row in pixels_between(y - half_height, y + half_height, self.height) {
                if pixels.unfinished[row] == 0 {
                    continue;
                }
                let dy = row as f32 + 0.5 - y;
                let q_row = dy * dy * splat.y_precision;
                let middle = splat.center.x - self.x as f32 + splat.slope * dy;
                let half_width = (splat.cutoff - q_row).max(0.0).sqrt() * row_sigma;
                let reached = pixels_between(middle - half_width, middle + half_width, self.width);
                let mut left = bits(reached) & pixels.unfinished[row];
                while left != 0 {
                    let column = left.trailing_zeros() as usize;
                    left &= left - 1;
                    let du = column as f32 + 0.5 - middle;
                    let q = q_row + du * du * splat.row_precision;
                    let alpha = (splat.opacity * (-0.5 * q).exp()).min(MAX_ALPHA);
                    if let Some(weight) = pixels.cover(row, column, alpha) {
                        blend(column, row, position as usize, weight);
                    }
                }
            }
            if pixels.n_unfinished == 0 {
                break;
            }
        }
    }
}

/// How far the pixels of a tile have come.
struct Pixels {
    /// What is left to pass through each pixel, 0..1.
    transmittance: [[f32; TILE]; TILE],
    /// One bit per pixel, a word per row: most splats of a deep scene lie behind finished pixels only.
    unfinished: [u32; TILE],
    n_unfinished: usize,
}

impl Pixels {
    fn new(width: usize, height: usize) -> Self {
        let mut unfinished = [0; TILE];
        unfinished[..height].fill(bits(0..width));
        Self { transmittance: [[1.0; TILE]; TILE], unfinished, n_unfinished: width * height }
    }

    /// Puts a splat behind what an unfinished pixel has; its weight, or `None` where it is not drawn.
    fn cover(&mut self, row: usize, column: usize, alpha: f32) -> Option<f32> {
        if alpha < MIN_ALPHA {
            return None;
        }
        let before = self.transmittance[row][column];
        let after = before * (1.0 - alpha);
        if after < MIN_TRANSMITTANCE {
            self.unfinished[row] &= !(1 << column);
            self.n_unfinished -= 1;
            return None;
        }
        self.transmittance[row][column] = after;
        Some(alpha * before)
    }
}

/// A word with the bits of `pixels` set.
fn bits(pixels: Range<usize>) -> u32 {
    (1u32 << pixels.end) - (1u32 << pixels.start.min(pixels.end))
}

/// The pixels, of `n` in a row, whose centers lie between `low` and `high`.
fn pixels_between(low: f32, high: f32, n: usize) -> Range<usize> {
    // A thousandth of a pixel covers the rounding of the range; alpha decides in the end.
    let first = (low - 0.5 - 1e-3).ceil().max(0.0) as usize;
    let end = ((high - 0.5 + 1e-3).floor() + 1.0).max(0.0) as usize;
    first.min(n)..end.min(n)
}
