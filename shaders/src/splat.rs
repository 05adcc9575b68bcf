//! Shaders of the splat pass: project, sort, draw, composite.

use bytemuck::{Pod, Zeroable};
use stylegaussian::{
    splat::{MAX_ALPHA, MIN_ALPHA},
    strokes::StrokeSeed,
};

use crate::{Layout, Source, float_constants, layout};

pub mod cast;
mod composite;
pub mod depth;
pub mod half;
pub mod light;
pub mod strokes;
mod tiles;

use self::half::SplatHalf;
use cast::{CoreCommand, SplatCore};
pub use composite::{CompositeKind, SplatComposite, SplatEdges, composite, edges, lift};
use depth::SplatIso;
use strokes::{CurvePoint, StrokeChange, StrokeChunk, StrokeDraw, StrokeMotion};
pub use tiles::{RunProgress, SplatTiles, tiles_blend, tiles_count, tiles_scan, tiles_scatter, tiles_total};

/// Invocations in a workgroup of every kernel of the pass.
pub const WORKGROUP: u32 = 256;
/// Keys in a batch of the sort: those that one workgroup handles.
pub const SORT_BATCH: u32 = 2048;
/// Values of one digit of the sort.
pub const N_DIGITS: u32 = WORKGROUP;
/// Pixels along a side of a tile.
pub const TILE_SIZE: u32 = 8;
/// Runs of consecutive splats that fill the lists of tiles. More runs need fewer dispatches, and more counters.
pub const N_RUNS: u32 = 64;
/// Invocations in a workgroup of the kernels for software adapters: as many as a CPU vector of 256 bits has
/// numbers, so that each thread runs one workgroup's invocations in lockstep.
pub const SOFTWARE_WORKGROUP: u32 = 8;
/// Loop iterations that an invocation spends on a run in one dispatch. llvmpipe ends an invocation after 65,535
/// iterations. It counts those of [`SOFTWARE_WORKGROUP`] invocations together, because each may keep the others
/// waiting.
pub const ITERATIONS_PER_DISPATCH: u32 = 65_535 / SOFTWARE_WORKGROUP - 100;
/// Tiles in a segment. Their lists are counted from a common start: a thousand counters, which one invocation
/// sums up.
pub const TILES_PER_SEGMENT: u32 = 16;
/// Tiles that one workgroup blends.
pub const TILES_PER_WORKGROUP: u32 = 16;
/// The key of a Gaussian that no pixel sees. Keys of depths are smaller: only a NaN would have this one.
pub const INVISIBLE: u32 = u32::MAX;
/// `SplatChunk::flags` from this bit on: the share of all opacities that is faded out, of [`MAX_FADED`].
pub const FADED_SHIFT: u32 = 16;
/// The number in `SplatChunk::flags` of a chunk that is faded out.
pub const MAX_FADED: u32 = 0xffff;
/// `SplatChunk::sh_degree` of a scene without spherical harmonics.
pub const NO_SH: u32 = u32::MAX;
/// `SplatChunk::flags`: the colors are the captured ones.
pub const CAPTURED_COLORS: u32 = 1;
/// `SplatChunk::flags`: sort by the distance from the eye instead of by view depth.
pub const BY_DISTANCE: u32 = 4;
/// `SplatChunk::flags`: the low-pass keeps the sum of a splat, as mip-splatting's 2D filter does.
pub const ANTIALIASED: u32 = 8;
/// `SplatChunk::flags`: the mask shows painted splats, and does not hide them.
pub const CROPPED: u32 = 16;
/// `SplatChunk::flags`: what lies before the near plane is not culled, and has a depth above 1.
pub const UNCLIPPED: u32 = 32;
/// `SplatChunk::flags`: splats keep the sums that they have in a picture of twice the width and height.
pub const HALF_SIZE: u32 = 64;

/// `mode` of the composite: the layer as it is.
pub const MODE_ENCODED: u32 = 0;
/// `mode` of the composite: from sRGB's encoding to linear.
pub const MODE_LINEAR: u32 = 1;
/// `mode` of the composite: to linear, then undo exposure.
pub const MODE_EXPOSED: u32 = 2;
/// `mode` of the composite: to linear, then undo Reinhard and exposure.
pub const MODE_REINHARD: u32 = 3;
/// `mode` of the composite: to linear, then undo Reinhard of the luminance and exposure.
pub const MODE_REINHARD_LUMINANCE: u32 = 4;
/// `mode` of the composite: undo tone mapping by a table, then exposure.
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
const CHUNK: &str = include_str!("../wgsl/splat_chunk.wgsl");
const FOOTPRINT: &str = include_str!("../wgsl/splat_footprint.wgsl");
const ONE_EYE: &str = include_str!("../wgsl/splat_one_eye.wgsl");
const QUADS: &str = include_str!("../wgsl/splat_quads.wgsl");
const SCAN: &str = include_str!("../wgsl/splat_scan.wgsl");
const SORT: &str = include_str!("../wgsl/splat_sort.wgsl");

/// The constants above in WGSL, and the bounds of alpha that both rasterizers share.
fn constants() -> String {
    let integers = crate::constants(&[
        ("WORKGROUP", WORKGROUP),
        ("SORT_BATCH", SORT_BATCH),
        ("TILE_SIZE", TILE_SIZE),
        ("N_RUNS", N_RUNS),
        ("SOFTWARE_WORKGROUP", SOFTWARE_WORKGROUP),
        ("ITERATIONS_PER_DISPATCH", ITERATIONS_PER_DISPATCH),
        ("TILES_PER_SEGMENT", TILES_PER_SEGMENT),
        ("TILES_PER_WORKGROUP", TILES_PER_WORKGROUP),
        ("QUARTERS_PER_WORKGROUP", 4 * TILES_PER_WORKGROUP),
        ("INVISIBLE", INVISIBLE),
        ("FADED_SHIFT", FADED_SHIFT),
        ("MAX_FADED", MAX_FADED),
        ("NO_SH", NO_SH),
        ("CAPTURED_COLORS", CAPTURED_COLORS),
        ("BY_DISTANCE", BY_DISTANCE),
        ("ANTIALIASED", ANTIALIASED),
        ("CROPPED", CROPPED),
        ("UNCLIPPED", UNCLIPPED),
        ("HALF_SIZE", HALF_SIZE),
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
    ]);
    integers + &float_constants(&[("MIN_ALPHA", MIN_ALPHA), ("MAX_ALPHA", MAX_ALPHA)])
}

/// A shader from the constants and its files.
fn source(label: &'static str, files: &[&str]) -> Source {
    Source { label, wgsl: constants() + &files.join("\n") }
}

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

/// The opacities of clouds with a mask or of clouds without.
fn mask(masked: bool) -> &'static str {
    match masked {
        false => include_str!("../wgsl/splat_unmasked.wgsl"),
        true => include_str!("../wgsl/splat_masked.wgsl"),
    }
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
        light::light(false),
        light::light(true),
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

/// Every struct that the splat pass shares with Rust.
pub fn layouts() -> Vec<Layout> {
    let mut layouts = vec![
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
            n_gaussians,
            first_gaussian,
            first_record,
            sh_degree,
            flags,
            mask_shift,
            least_variance,
            least_opacity,
        }),
        layout!(PackedGaussian { mean, opacity, rotation, scales }),
        layout!(SplatCounts { n_records, n_visible }),
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
        layout!(SplatCore { center, slant, width, depth }),
        layout!(CoreCommand { n_vertices, n_instances, first_vertex, first_instance }),
        layout!(SplatDraw { viewport }),
        layout!(SplatTiles { viewport, n_tiles, capacity, padding }),
        layout!(RunProgress { n_splats, n_tiles }),
        layout!(SplatComposite { exposure }),
        layout!(SplatIso { viewport, place, step, threshold, slice, padding_0, padding_1, padding_2 }),
        layout!(SplatHalf { viewport, limit, padding }),
        layout!(SplatEdges { limit }),
        layout!(StrokeChunk {
            chunk,
            amount,
            protection,
            stroke_scale,
            n_motions,
            light,
            relief,
            n_lights,
            is_stable,
            n_changes,
            padding,
            motions,
            changes,
        }),
        layout!(CurvePoint { at, padding_0, toward, padding_1 }),
        layout!(StrokeChange {
            direction,
            first,
            gain,
            stroke_scale,
            relief,
            motion,
            added_relief,
            n_points,
            padding_0,
            padding_1,
            points,
        }),
        layout!(StrokeMotion { toward, first, end, kind, phase, amount }),
        layout!(StrokeSeed { at, pitch, rotation_xy, rotation_z_aspect, place, look }),
        layout!(StrokeDraw { near, n_lights, is_stable, scale_octaves }),
    ];
    layouts.extend(light::layouts());
    layouts
}

/// One chunk of one cloud as one camera sees it. View space is x right, y up, z backward. Matrices are stored
/// as rows.
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
    /// Origin of the rays in the scene's space: (eye, 1), or (-direction, 0) if they are parallel.
    pub eye: [f32; 4],
    /// The point where the image axis (view -z) meets the picture, in normalized device coordinates.
    pub axis: [f32; 2],
    /// Gaussians at this view depth or nearer are culled, in world units.
    pub near: f32,
    /// The unit of [`PackedGaussian::scales`], in scene units.
    pub scale_unit: f32,
    /// Gaussians in this chunk.
    pub n_gaussians: u32,
    /// Index of the chunk's first Gaussian in its scene.
    pub first_gaussian: u32,
    /// Index of the chunk's first record.
    pub first_record: u32,
    /// Degree of the spherical harmonics, or [`NO_SH`].
    pub sh_degree: u32,
    /// [`CAPTURED_COLORS`], [`BY_DISTANCE`], [`ANTIALIASED`], [`CROPPED`], [`UNCLIPPED`], [`HALF_SIZE`].
    pub flags: u32,
    /// Position of the mask's channel in a word, in bits.
    pub mask_shift: u32,
    /// Splats with a smaller sum of their variances along x and y are culled, in px^2.
    pub least_variance: f32,
    /// Splats of less opacity are culled.
    pub least_opacity: f32,
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
