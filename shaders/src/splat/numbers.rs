//! Numbers that Rust and the shaders of the splat pass share.

use stylegaussian::splat::{MAX_ALPHA, MIN_ALPHA};

use crate::{constants, float_constants};

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

/// These numbers in WGSL, and the bounds of alpha that both rasterizers share.
pub(super) fn in_wgsl() -> String {
    let integers = constants(&[
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
