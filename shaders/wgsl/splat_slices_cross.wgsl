// Finds where a slice brings the light under the threshold. One invocation per pixel of the viewport.

@group(0) @binding(0) var<uniform> iso: SplatIso;
@group(0) @binding(1) var<storage, read> counts: SplatCounts;
/// Record indices of the visible splats, front to back.
@group(0) @binding(2) var<storage, read> record_indices: array<u32>;
@group(0) @binding(3) var<storage, read> color_halves: array<vec4<u32>>;
/// The moments that `splat_slices_draw` drew.
@group(0) @binding(4) var moments: texture_2d<f32>;
@group(0) @binding(5) var<storage, read_write> iso_depths: array<f32>;

/// Half the width of a uniform distribution, in standard deviations.
const HALF_WIDTH: f32 = 1.7320508;

/// The depth of a sorted splat, which has a logarithm.
fn depth_of(rank: u32) -> f32 {
    return max(bitcast<f32>(color_halves[record_indices[rank]].y), FARTHEST_DEPTH);
}

@compute @workgroup_size(SLICES_SIDE, SLICES_SIDE)
fn splat_slices_cross(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let pixel = invocation.xy;
    if any(pixel >= vec2<u32>(iso.viewport.zw)) {
        return;
    }
    let place = place_of(pixel, iso);
    var before = 1.0;
    if iso.slice > 0u {
        before = -iso_depths[place];
    }
    if before <= 0.0 {
        return;
    }
    let sums = textureLoad(moments, pixel, 0);
    let light = before * (1.0 - sums.a);
    let first = iso.slice * slice_length(counts.n_visible);
    if light >= iso.threshold || first >= counts.n_visible {
        iso_depths[place] = -light;
        return;
    }
    // The share of the slice's weights that lies before the surface. As if they were spread evenly, with this
    // mean and this deviation, from the slice's first splat to its last.
    let share = (1.0 - iso.threshold / before) / sums.a;
    let mean = sums.r / sums.a;
    let deviation = sqrt(max(sums.g / sums.a - mean * mean, 0.0));
    let nearest = depth_of(first);
    let last = log2(nearest / depth_of(min(first + slice_length(counts.n_visible), counts.n_visible) - 1u));
    // Splats that are sorted by distance may lie beyond both.
    let u = clamp(mean + HALF_WIDTH * deviation * (2.0 * share - 1.0), min(mean, 0.0), max(mean, last));
    iso_depths[place] = clamp(nearest * exp2(-u), FARTHEST_DEPTH, 1.0);
}
