//! Blending the splats of one tile, front to back.

use std::ops::Range;

use super::bands::TILE;
use super::project::{MIN_ALPHA, Splat};

/// No splat hides what is behind it completely.
const MAX_ALPHA: f32 = 0.99;

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
        // What is left to pass through each pixel; 0 once the pixel is finished.
        let mut transmittance = [[1.0f32; TILE]; TILE];
        let mut n_unfinished = self.width * self.height;
        for &position in in_tile {
            let splat = &splats[position as usize];
            let (y, half_height) = (splat.center.y - self.y as f32, splat.half_size.y);
            for row in pixels_between(y - half_height, y + half_height, self.height) {
                let dy = row as f32 + 0.5 - y;
                let q_row = dy * dy * splat.y_precision;
                let middle = splat.center.x - self.x as f32 + splat.slope * dy;
                let half_width = ((splat.cutoff - q_row).max(0.0) / splat.row_precision).sqrt();
                for column in pixels_between(middle - half_width, middle + half_width, self.width) {
                    let remaining = &mut transmittance[row][column];
                    if *remaining == 0.0 {
                        continue;
                    }
                    let du = column as f32 + 0.5 - middle;
                    let q = q_row + du * du * splat.row_precision;
                    let alpha = (splat.opacity * (-0.5 * q).exp()).min(MAX_ALPHA);
                    if alpha < MIN_ALPHA {
                        continue;
                    }
                    let after = *remaining * (1.0 - alpha);
                    if after < MIN_TRANSMITTANCE {
                        *remaining = 0.0;
                        n_unfinished -= 1;
                        continue;
                    }
                    blend(column, row, position as usize, alpha * *remaining);
                    *remaining = after;
                }
            }
            if n_unfinished == 0 {
                break;
            }
        }
    }
}

/// The pixels, of `n` in a row, whose centers lie between `low` and `high`.
fn pixels_between(low: f32, high: f32, n: usize) -> Range<usize> {
    // A thousandth of a pixel covers the rounding of the range; alpha decides in the end.
    let first = (low - 0.5 - 1e-3).ceil().max(0.0) as usize;
    let end = ((high - 0.5 + 1e-3).floor() + 1.0).max(0.0) as usize;
    first.min(n)..end.min(n)
}
