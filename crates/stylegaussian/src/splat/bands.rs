//! Finding the splats that each tile of the picture sees.
//!
//! The picture is cut into tiles of 16 x 16 pixels. A *band* is one row of tiles. Its pixels are contiguous in
//! a row-major picture, so each thread can own whole bands.

use std::ops::Range;

use glam::UVec2;

use super::composite::{MARGIN, TILE, Tile};
use super::project::Splat;

/// For each band, the splats that may touch it, front to back.
pub(super) struct Bands {
    /// Width and height of the picture, in pixels.
    pub size: UVec2,
    /// For each band, positions in the list of splats, ascending.
    pub splats: Vec<Vec<u32>>,
}

impl Bands {
    /// Assigns `splats`, sorted front to back, to the bands of a picture of `size` pixels. A splat that crosses
    /// several bands is in the list of each.
    pub fn new(splats: &[Splat], size: UVec2) -> Self {
        let n_bands = (size.y as usize).div_ceil(TILE);
        let mut bands = vec![Vec::new(); n_bands];
        // In the order of depth, so that each list is front to back without a sort.
        for (position, splat) in splats.iter().enumerate() {
            let (top, bottom) = (splat.center.y - splat.half_size.y, splat.center.y + splat.half_size.y);
            for band in tiles_between(top, bottom, n_bands) {
                bands[band].push(position as u32);
            }
        }
        Self { size, splats: bands }
    }

    /// The tiles of one band, and the splats of each.
    ///
    /// Lists of tiles should live as long as their band is blended. Those of the whole picture would hold each
    /// splat once per tile.
    pub fn tiles(&self, band: usize, splats: &[Splat]) -> impl Iterator<Item = (Tile, Vec<u32>)> {
        let size = self.size.as_usizevec2();
        let y = band * TILE;
        let height = TILE.min(size.y - y);
        self.tile_lists(band, splats).into_iter().enumerate().map(move |(column, in_tile)| {
            let x = column * TILE;
            (Tile { x, y, width: TILE.min(size.x - x), height }, in_tile)
        })
    }

    /// For each tile of a band, the positions of the splats with a footprint that reaches it.
    fn tile_lists(&self, band: usize, splats: &[Splat]) -> Vec<Vec<u32>> {
        let n_tiles = (self.size.x as usize).div_ceil(TILE);
        let top = (band * TILE) as f32;
        let mut lists = vec![Vec::new(); n_tiles];
        for &position in &self.splats[band] {
            // The box of a slanted needle crosses many tiles of a band that the needle itself does not reach.
            let (left, right) = extent_within(&splats[position as usize], top, top + TILE as f32);
            for tile in tiles_between(left, right, n_tiles) {
                lists[tile].push(position);
            }
        }
        lists
    }
}

/// The x range of the part of a footprint between the heights `top` and `bottom`, all in pixels.
fn extent_within(splat: &Splat, top: f32, bottom: f32) -> (f32, f32) {
    let (lowest, highest) = (-splat.half_size.y, splat.half_size.y);
    // `top` is above `bottom`, so `from` is at most `to`, and the clamps below do not panic.
    let from = (top - splat.center.y).clamp(lowest, highest);
    let to = (bottom - splat.center.y).clamp(lowest, highest);
    let edge = |dy: f32, side: f32| {
        let within_row = (splat.cutoff - dy * dy * splat.y_precision).max(0.0);
        splat.center.x + splat.slope * dy + side * (within_row / splat.row_precision).sqrt()
    };
    // Each side of an ellipse is furthest out at one height and monotonic on either side of it, so within the
    // band it is furthest out at that height clamped to the band.
    let left = edge((-splat.rightmost_dy).clamp(from, to), -1.0);
    let right = edge(splat.rightmost_dy.clamp(from, to), 1.0);
    (left, right)
}

/// The tiles, of `n` in a row, that overlap the range from `low` to `high` pixels.
fn tiles_between(low: f32, high: f32, n: usize) -> Range<usize> {
    let first = ((low - MARGIN) / TILE as f32).max(0.0) as usize;
    let end = rounded_up((high + MARGIN) / TILE as f32);
    first.min(n)..end.min(n)
}

/// The least integer that is not below `value`, or 0.
fn rounded_up(value: f32) -> usize {
    // Casts round toward 0, and are no calls, which `ceil` and `floor` are if the processor is not known.
    let down = value.max(0.0) as usize;
    down.saturating_add(usize::from(value > down as f32))
}
