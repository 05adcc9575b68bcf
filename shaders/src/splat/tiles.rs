//! Shaders of the tile rasterizer, which draws on software adapters.

use bytemuck::{Pod, Zeroable};

use super::text::{RECORDS, source};
use crate::Source;

pub(super) const ROWS: &str = include_str!("../../wgsl/splat_tiles_rows.wgsl");
pub(super) const TILES: &str = include_str!("../../wgsl/splat_tiles.wgsl");

/// Counts the splats of each tile.
pub fn tiles_count() -> Source {
    source("splat_tiles_count", &[RECORDS, TILES, include_str!("../../wgsl/splat_tiles_count.wgsl")])
}

/// Turns counts into positions in the lists of tiles.
pub fn tiles_scan() -> Source {
    source("splat_tiles_scan", &[RECORDS, TILES, include_str!("../../wgsl/splat_tiles_scan.wgsl")])
}

/// Finds where segments begin, and whether the lists fit.
pub fn tiles_total() -> Source {
    source("splat_tiles_total", &[RECORDS, TILES, include_str!("../../wgsl/splat_tiles_total.wgsl")])
}

/// Writes the lists of tiles.
pub fn tiles_scatter() -> Source {
    source("splat_tiles_scatter", &[RECORDS, TILES, include_str!("../../wgsl/splat_tiles_scatter.wgsl")])
}

/// Blends the lists of tiles, with or without a depth texture.
pub fn tiles_blend(tested: bool) -> Source {
    blend(tested, &[include_str!("../../wgsl/splat_tiles_unpainted.wgsl")])
}

/// The blend with or without a depth texture. `colors` says how splats are colored.
pub(super) fn blend(tested: bool, colors: &[&str]) -> Source {
    let depth = match tested {
        false => include_str!("../../wgsl/splat_tiles_untested.wgsl"),
        true => include_str!("../../wgsl/splat_tiles_tested.wgsl"),
    };
    let kernel = include_str!("../../wgsl/splat_tiles_blend.wgsl");
    source("splat_tiles_blend", &[&[RECORDS, TILES, depth, ROWS], colors, &[kernel]].concat())
}

/// The tiles of a view.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatTiles {
    /// Left, top, width and height of the viewport, in pixels of the target.
    pub viewport: [f32; 4],
    /// Columns and rows of tiles.
    pub n_tiles: [u32; 2],
    /// Entries that all lists together have room for.
    pub capacity: u32,
    /// Unused.
    pub padding: u32,
}

/// Progress of a run, which may take several dispatches.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct RunProgress {
    /// Splats that are finished.
    pub n_splats: u32,
    /// Finished tiles of the next splat.
    pub n_tiles: u32,
}
