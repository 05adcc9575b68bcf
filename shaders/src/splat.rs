//! Shaders of the splat pass: project, sort, draw, composite.

use bytemuck::{Pod, Zeroable};

use crate::{Layout, Source, layout};

/// Invocations in a workgroup of every kernel of the pass.
pub const WORKGROUP: u32 = 256;
/// Keys that one workgroup of the sort handles.
pub const TILE: u32 = 2048;
/// Values of one digit of the sort.
pub const N_DIGITS: u32 = WORKGROUP;
/// Pixels along a side of a cell.
pub const CELL: u32 = 8;
/// Runs of consecutive splats that cells are filled from: more need fewer dispatches, and more counters.
pub const N_RUNS: u32 = 64;
/// Invocations in a workgroup of kernels for adapters that are a CPU: as many as its vectors have numbers (256 bits), so
/// that each thread has one workgroup's invocations in step.
pub const IN_STEP: u32 = 8;
/// Rounds that the loops of an invocation take for a run in one dispatch. llvmpipe ends an invocation after 65,535, and counts
/// the rounds of [`IN_STEP`] invocations that may each keep the others waiting.
pub const ROUNDS_OF_RUN: u32 = 65_535 / IN_STEP - 100;
/// Cells whose lists are counted from a common start: a thousand counters are summed in one go.
pub const CELLS_OF_SEGMENT: u32 = 16;
/// Cells that one workgroup blends.
pub const CELLS_OF_GROUP: u32 = 16;
/// The key of a Gaussian that no pixel sees. Keys of depths are below it: it would be that of a NaN.
pub const INVISIBLE: u32 = u32::MAX;
/// `SplatChunk::sh_degree` of a scene that keeps no colors of its own.
pub const NO_SH: u32 = u32::MAX;
/// `SplatChunk::flags`: the first color source is the scene's own colors.
pub const FROM_CAPTURED_COLORS: u32 = 1;
/// `SplatChunk::flags`: the second color source is the scene's own colors.
pub const TO_CAPTURED_COLORS: u32 = 2;
/// `SplatChunk::flags`: sort by the distance from the eye instead of by view depth.
pub const BY_DISTANCE: u32 = 4;

/// `mode` of the composite: the layer as it is.
pub const MODE_ENCODED: u32 = 0;
/// `mode` of the composite: from sRGB's encoding to linear.
pub const MODE_LINEAR: u32 = 1;
/// `mode` of the composite: to linear, exposure undone.
pub const MODE_EXPOSED: u32 = 2;
/// `mode` of the composite: to linear, Reinhard and exposure undone.
pub const MODE_REINHARD: u32 = 3;
/// `mode` of the composite: to linear, Reinhard of the luminance and exposure undone.
pub const MODE_REINHARD_LUMINANCE: u32 = 4;
/// `mode` of the composite: a tone mapping undone by table, then exposure.
pub const MODE_TABLE: u32 = 5;
/// Texels along a side of a table of inverses.
pub const TABLE_SIZE: u32 = 32;
/// `curve` of a table of inverses: Stephen Hill's fit of ACES.
pub const CURVE_ACES_FITTED: u32 = 0;
/// `curve` of a table of inverses: Khronos' PBR Neutral.
pub const CURVE_PBR_NEUTRAL: u32 = 1;
/// `curve` of a table of inverses: the "somewhat boring" display transform.
pub const CURVE_SOMEWHAT_BORING: u32 = 2;
/// `curve` of a table of inverses: AgX.
pub const CURVE_AGX: u32 = 3;
/// `curve` of a table of inverses: Tony McMapface.
pub const CURVE_TONY_MC_MAPFACE: u32 = 4;
/// `curve` of a table of inverses: Blender's Filmic.
pub const CURVE_BLENDER_FILMIC: u32 = 5;

const RECORDS: &str = include_str!("../wgsl/splat_records.wgsl");
const CELLS: &str = include_str!("../wgsl/splat_cells.wgsl");
const SCAN: &str = include_str!("../wgsl/splat_scan.wgsl");
const SORT: &str = include_str!("../wgsl/splat_sort.wgsl");

/// The constants above, in WGSL.
fn constants() -> String {
    let constants = [
        ("WORKGROUP", WORKGROUP),
        ("TILE", TILE),
        ("CELL", CELL),
        ("N_RUNS", N_RUNS),
        ("IN_STEP", IN_STEP),
        ("ROUNDS_OF_RUN", ROUNDS_OF_RUN),
        ("CELLS_OF_SEGMENT", CELLS_OF_SEGMENT),
        ("CELLS_OF_GROUP", CELLS_OF_GROUP),
        ("QUARTERS_OF_GROUP", 4 * CELLS_OF_GROUP),
        ("INVISIBLE", INVISIBLE),
        ("NO_SH", NO_SH),
        ("FROM_CAPTURED_COLORS", FROM_CAPTURED_COLORS),
        ("TO_CAPTURED_COLORS", TO_CAPTURED_COLORS),
        ("BY_DISTANCE", BY_DISTANCE),
        ("MODE_ENCODED", MODE_ENCODED),
        ("MODE_LINEAR", MODE_LINEAR),
        ("MODE_REINHARD", MODE_REINHARD),
        ("MODE_REINHARD_LUMINANCE", MODE_REINHARD_LUMINANCE),
        ("MODE_TABLE", MODE_TABLE),
        ("TABLE_SIZE", TABLE_SIZE),
        ("CURVE_ACES_FITTED", CURVE_ACES_FITTED),
        ("CURVE_PBR_NEUTRAL", CURVE_PBR_NEUTRAL),
        ("CURVE_SOMEWHAT_BORING", CURVE_SOMEWHAT_BORING),
        ("CURVE_AGX", CURVE_AGX),
        ("CURVE_TONY_MC_MAPFACE", CURVE_TONY_MC_MAPFACE),
        ("CURVE_BLENDER_FILMIC", CURVE_BLENDER_FILMIC),
    ];
    constants.iter().map(|(name, value)| format!("const {name}: u32 = {value}u;\n")).collect()
}

/// A shader from the constants and its files.
fn source(label: &'static str, files: &[&str]) -> Source {
    Source { label, wgsl: constants() + &files.join("\n") }
}

/// Cull, project, color.
pub fn project() -> Source {
    let sh = include_str!("../wgsl/splat_sh.wgsl");
    source("splat_project", &[RECORDS, sh, include_str!("../wgsl/splat_project.wgsl")])
}

/// Count the digits of each tile; `serial` for adapters that are a CPU.
pub fn sort_histogram(serial: bool) -> Source {
    if serial {
        let kernel = include_str!("../wgsl/splat_sort_histogram_serial.wgsl");
        return source("splat_sort_histogram_serial", &[RECORDS, SORT, kernel]);
    }
    let kernel = include_str!("../wgsl/splat_sort_histogram.wgsl");
    source("splat_sort_histogram", &[RECORDS, SORT, kernel])
}

/// From counts to places; `serial` for adapters that are a CPU.
pub fn sort_scan(serial: bool) -> Source {
    if serial {
        let kernel = include_str!("../wgsl/splat_sort_scan_serial.wgsl");
        return source("splat_sort_scan_serial", &[RECORDS, SORT, kernel]);
    }
    source("splat_sort_scan", &[RECORDS, SORT, SCAN, include_str!("../wgsl/splat_sort_scan.wgsl")])
}

/// Move keys to their places; `serial` for adapters that are a CPU.
pub fn sort_scatter(serial: bool) -> Source {
    if serial {
        let kernel = include_str!("../wgsl/splat_sort_scatter_serial.wgsl");
        return source("splat_sort_scatter_serial", &[RECORDS, SORT, kernel]);
    }
    source("splat_sort_scatter", &[RECORDS, SORT, SCAN, include_str!("../wgsl/splat_sort_scatter.wgsl")])
}

/// Write the indirect commands.
pub fn sort_counts() -> Source {
    source("splat_sort_counts", &[RECORDS, include_str!("../wgsl/splat_sort_counts.wgsl")])
}

/// Draw the sorted splats.
pub fn draw() -> Source {
    source("splat_draw", &[RECORDS, include_str!("../wgsl/splat_draw.wgsl")])
}

/// Count the splats of each cell.
pub fn cells_count() -> Source {
    source("splat_cells_count", &[RECORDS, CELLS, include_str!("../wgsl/splat_cells_count.wgsl")])
}

/// From counts to places in the lists of cells.
pub fn cells_scan() -> Source {
    source("splat_cells_scan", &[RECORDS, CELLS, include_str!("../wgsl/splat_cells_scan.wgsl")])
}

/// Where segments begin, and whether the lists fit.
pub fn cells_total() -> Source {
    source("splat_cells_total", &[RECORDS, CELLS, include_str!("../wgsl/splat_cells_total.wgsl")])
}

/// Write the lists of cells.
pub fn cells_scatter() -> Source {
    source("splat_cells_scatter", &[RECORDS, CELLS, include_str!("../wgsl/splat_cells_scatter.wgsl")])
}

/// Blend the lists of cells, with or without a depth texture.
pub fn cells_blend(tested: bool) -> Source {
    let depth = match tested {
        false => include_str!("../wgsl/splat_cells_untested.wgsl"),
        true => include_str!("../wgsl/splat_cells_tested.wgsl"),
    };
    source("splat_cells_blend", &[RECORDS, CELLS, depth, include_str!("../wgsl/splat_cells_blend.wgsl")])
}

/// Put the layer over a picture of one sample per pixel, or of several.
pub fn composite(multisampled: bool) -> Source {
    let target = match multisampled {
        false => include_str!("../wgsl/splat_composite_single.wgsl"),
        true => include_str!("../wgsl/splat_composite_multi.wgsl"),
    };
    source("splat_composite", &[include_str!("../wgsl/splat_composite.wgsl"), target])
}

/// Undo a tone mapping, once for all colors.
pub fn inverse_table() -> Source {
    let tonemapping = include_str!("../wgsl/splat_tonemapping.wgsl");
    source("splat_inverse_table", &[tonemapping, include_str!("../wgsl/splat_inverse_table.wgsl")])
}

/// Every joined source of the splat pass.
pub fn sources() -> Vec<Source> {
    vec![
        project(),
        sort_histogram(false),
        sort_scan(false),
        sort_scatter(false),
        sort_histogram(true),
        sort_scan(true),
        sort_scatter(true),
        sort_counts(),
        draw(),
        cells_count(),
        cells_scan(),
        cells_total(),
        cells_scatter(),
        cells_blend(false),
        cells_blend(true),
        composite(false),
        composite(true),
        inverse_table(),
    ]
}

/// Every struct that the splat pass shares with Rust.
pub fn layouts() -> Vec<Layout> {
    vec![
        layout!(SplatChunk {
            view_from_scene_x,
            view_from_scene_y,
            view_from_scene_z,
            clip_from_view_x,
            clip_from_view_y,
            clip_from_view_z,
            clip_from_view_w,
            viewport,
            eye,
            axis,
            near,
            scale_unit,
            fade,
            n_gaussians,
            first_gaussian,
            first_slot,
            sh_degree,
            flags,
            padding,
        }),
        layout!(PackedGaussian { mean, opacity, rotation, scales }),
        layout!(SplatCounts { n_slots, n_visible }),
        layout!(SortPass { shift, first, padding }),
        layout!(SplatCommands {
            n_groups,
            one_y,
            one_z,
            padding,
            n_vertices,
            n_instances,
            first_vertex,
            first_instance,
        }),
        layout!(SplatDraw { viewport }),
        layout!(SplatCells { viewport, n_cells, capacity, padding }),
        layout!(RunProgress { n_splats, n_cells }),
        layout!(SplatComposite { exposure }),
    ]
}

/// One chunk of one cloud as one camera sees it. View space is x right, y up, z backward; matrices are kept as rows.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatChunk {
    /// View from scene, first row.
    pub view_from_scene_x: [f32; 4],
    /// View from scene, second row.
    pub view_from_scene_y: [f32; 4],
    /// View from scene, third row.
    pub view_from_scene_z: [f32; 4],
    /// Clip from view, first row; reverse z.
    pub clip_from_view_x: [f32; 4],
    /// Clip from view, second row.
    pub clip_from_view_y: [f32; 4],
    /// Clip from view, third row.
    pub clip_from_view_z: [f32; 4],
    /// Clip from view, fourth row.
    pub clip_from_view_w: [f32; 4],
    /// Left, top, width and height of the viewport, in pixels of the target.
    pub viewport: [f32; 4],
    /// Where rays come from, in the scene's space: (eye, 1), or (-direction, 0) where they are parallel.
    pub eye: [f32; 4],
    /// Where the image axis (view -z) meets the picture, in normalized device coordinates.
    pub axis: [f32; 2],
    /// View depth at which Gaussians and nearer ones are culled, in world units.
    pub near: f32,
    /// The unit of [`PackedGaussian::scales`], in scene units.
    pub scale_unit: f32,
    /// Share of the second color source, 0..1.
    pub fade: f32,
    /// Gaussians in this chunk.
    pub n_gaussians: u32,
    /// Index of the chunk's first Gaussian in its scene.
    pub first_gaussian: u32,
    /// Index of the chunk's first record.
    pub first_slot: u32,
    /// Degree of the spherical harmonics, or [`NO_SH`].
    pub sh_degree: u32,
    /// [`FROM_CAPTURED_COLORS`], [`TO_CAPTURED_COLORS`], [`BY_DISTANCE`].
    pub flags: u32,
    /// Unused.
    pub padding: [u32; 2],
}

/// One Gaussian as the project kernel reads it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PackedGaussian {
    /// Mean, in scene units.
    pub mean: [f32; 3],
    /// 0..1.
    pub opacity: f32,
    /// Unit quaternion (x, y, z, w) as 16-bit signed fractions, two to a word, the first in the low bits.
    pub rotation: [u32; 2],
    /// Standard deviations along the local axes as f16, in [`SplatChunk::scale_unit`].
    pub scales: [u32; 2],
}

/// How many records a view has room for, and how many of them hold a visible splat.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SplatCounts {
    /// One for each Gaussian of each cloud.
    pub n_slots: u32,
    /// Written by the sort.
    pub n_visible: u32,
}

/// One of the passes of the sort.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SortPass {
    /// Position of the digit's lowest bit.
    pub shift: u32,
    /// 1 in the first pass, whose values are the slots themselves.
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

/// Where a view is drawn.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SplatDraw {
    /// Left, top, width and height of the viewport, in pixels of the target.
    pub viewport: [f32; 4],
}

/// The cells of a view.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatCells {
    /// Left, top, width and height of the viewport, in pixels of the target.
    pub viewport: [f32; 4],
    /// Columns and rows of cells.
    pub n_cells: [u32; 2],
    /// How many entries all lists together have room for.
    pub capacity: u32,
    /// Unused.
    pub padding: u32,
}

/// How far a run has come.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct RunProgress {
    /// Splats that are done.
    pub n_splats: u32,
    /// Cells of the next one that are done.
    pub n_cells: u32,
}

/// How the layer becomes the target's.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SplatComposite {
    /// What the camera multiplies colors with before tone mapping: 2^exposure of its color grading.
    pub exposure: f32,
}
