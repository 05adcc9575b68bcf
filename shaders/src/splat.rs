//! Shaders of the splat pass: project, sort, draw, composite.
//!
//! Parts import `numbers`, `text` and `chunk`, which import no part. No part imports this module.

use bytemuck::{Pod, Zeroable};

use crate::Source;

pub mod cast;
mod chunk;
mod composite;
pub mod depth;
pub mod half;
pub mod light;
mod numbers;
pub mod strokes;
mod text;
mod tiles;

pub use chunk::SplatChunk;
pub use composite::{CompositeKind, SplatComposite, SplatEdges, composite, edges, lift};
pub use numbers::*;
use text::{CHUNK, FOOTPRINT, ONE_EYE, QUADS, RECORDS, mask, source};
pub use tiles::{RunProgress, SplatTiles, tiles_blend, tiles_count, tiles_scan, tiles_scatter, tiles_total};

const SCAN: &str = include_str!("../wgsl/splat_scan.wgsl");
const SORT: &str = include_str!("../wgsl/splat_sort.wgsl");

/// Culls, projects and colors Gaussians, those of clouds with a mask or of clouds without.
pub fn project(masked: bool) -> Source {
    project_for(masked, ONE_EYE)
}

/// The same for two eyes of one head.
pub fn project_eyes(masked: bool) -> Source {
    project_for(masked, include_str!("../wgsl/splat_two_eyes.wgsl"))
}

fn project_for(masked: bool, eyes: &str) -> Source {
    let sh = include_str!("../wgsl/splat_sh.wgsl");
    let kernel = include_str!("../wgsl/splat_project.wgsl");
    source("splat_project", &[RECORDS, CHUNK, sh, mask(masked), eyes, FOOTPRINT, kernel])
}

/// Counts the digits of each batch. `serial` is for software adapters.
pub fn sort_histogram(serial: bool) -> Source {
    if serial {
        let kernel = include_str!("../wgsl/splat_sort_histogram_serial.wgsl");
        return source("splat_sort_histogram_serial", &[RECORDS, SORT, kernel]);
    }
    let kernel = include_str!("../wgsl/splat_sort_histogram.wgsl");
    source("splat_sort_histogram", &[RECORDS, SORT, kernel])
}

/// Turns counts into positions. `serial` is for software adapters.
pub fn sort_scan(serial: bool) -> Source {
    if serial {
        let kernel = include_str!("../wgsl/splat_sort_scan_serial.wgsl");
        return source("splat_sort_scan_serial", &[RECORDS, SORT, kernel]);
    }
    source("splat_sort_scan", &[RECORDS, SORT, SCAN, include_str!("../wgsl/splat_sort_scan.wgsl")])
}

/// Moves keys to their positions. `serial` is for software adapters.
pub fn sort_scatter(serial: bool) -> Source {
    if serial {
        let kernel = include_str!("../wgsl/splat_sort_scatter_serial.wgsl");
        return source("splat_sort_scatter_serial", &[RECORDS, SORT, kernel]);
    }
    source("splat_sort_scatter", &[RECORDS, SORT, SCAN, include_str!("../wgsl/splat_sort_scatter.wgsl")])
}

/// Writes the indirect commands.
pub fn sort_counts() -> Source {
    source("splat_sort_counts", &[RECORDS, include_str!("../wgsl/splat_sort_counts.wgsl")])
}

/// Draws the sorted splats.
pub fn draw() -> Source {
    source("splat_draw", &[RECORDS, QUADS, include_str!("../wgsl/splat_draw.wgsl")])
}

/// Undoes a tone mapping, once for all colors.
pub fn inverse_table() -> Source {
    source("splat_inverse_table", &[light::TONEMAPPING, include_str!("../wgsl/splat_inverse_table.wgsl")])
}

/// Every joined source of the splat pass.
pub fn sources() -> Vec<Source> {
    vec![
        project(false),
        project(true),
        project_eyes(false),
        project_eyes(true),
        cast::cores(false),
        cast::cores(true),
        cast::draw(),
        cast::write(),
        sort_histogram(false),
        sort_scan(false),
        sort_scatter(false),
        sort_histogram(true),
        sort_scan(true),
        sort_scatter(true),
        sort_counts(),
        draw(),
        tiles_count(),
        tiles_scan(),
        tiles_total(),
        tiles_scatter(),
        tiles_blend(false),
        tiles_blend(true),
        composite(CompositeKind::Single),
        composite(CompositeKind::Multi),
        composite(CompositeKind::Resolved),
        lift(),
        edges(false),
        edges(true),
        inverse_table(),
        light::light(false, false),
        light::light(true, false),
        light::light(false, true),
        light::light(true, true),
        strokes::records(),
        strokes::draw(),
        strokes::tiles_blend(false),
        strokes::tiles_blend(true),
        depth::tiles(),
        depth::slices_commands(),
        depth::slices_draw(),
        depth::slices_cross(),
        depth::write(),
        half::depth(),
        half::upsample(),
    ]
}

/// One Gaussian as the project kernel reads it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PackedGaussian {
    /// Mean, in scene units.
    pub mean: [f32; 3],
    /// Opacity, 0..1.
    pub opacity: f32,
    /// Unit quaternion (x, y, z, w) as 16-bit signed fractions, two to a word, the first in the low bits.
    pub rotation: [u32; 2],
    /// Standard deviations along the local axes as f16, in [`SplatChunk::scale_unit`].
    pub scales: [u32; 2],
}

/// The number of records of a view, and how many of them hold a visible splat.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SplatCounts {
    /// One record for each Gaussian of each cloud; written by the CPU.
    pub n_records: u32,
    /// Written by the sort.
    pub n_visible: u32,
}

/// One pass of the sort.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SortPass {
    /// Position of the digit's lowest bit.
    pub shift: u32,
    /// 1 in the first pass, which reads no values: they are the record indices themselves.
    pub first: u32,
    /// Unused.
    pub padding: [u32; 2],
}

/// Arguments of indirect commands: a dispatch, and the draw by quads.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SplatCommands {
    /// Workgroups.
    pub n_groups: u32,
    /// Workgroups in y.
    pub one_y: u32,
    /// Workgroups in z.
    pub one_z: u32,
    /// Unused.
    pub padding: u32,
    /// Corners of a splat's quad.
    pub n_vertices: u32,
    /// Splats.
    pub n_instances: u32,
    /// Zero.
    pub first_vertex: u32,
    /// Zero.
    pub first_instance: u32,
}

/// The uniforms of the draw.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SplatDraw {
    /// Left, top, width and height of the viewport, in pixels of the target.
    pub viewport: [f32; 4],
}
