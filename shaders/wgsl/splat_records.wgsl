// The structs and records that the kernels of the splat pass exchange. Joined after the constants of
// `stylegaussian_shaders::splat`.

/// The number of records of a view, and how many of them hold a visible splat.
struct SplatCounts {
    /// One record for each Gaussian of each cloud; written by the CPU.
    n_records: u32,
    /// Written by `splat_sort_counts`.
    n_visible: u32,
}

/// Arguments of indirect commands: a dispatch, and the draw by quads.
struct SplatCommands {
    n_groups: u32,
    one_y: u32,
    one_z: u32,
    padding: u32,
    /// A strip of four corners for each visible splat.
    n_vertices: u32,
    n_instances: u32,
    first_vertex: u32,
    first_instance: u32,
}

/// The core of a splat in a shadow map: where its alpha is at least a threshold. With `place` in the disc of
/// radius 1, it is center + (width place.x, 0) + slant place.y, in normalized device coordinates.
struct SplatCore {
    center: vec2<f32>,
    slant: vec2<f32>,
    width: f32,
    /// Depth of the core's far end, 0..1, reverse z.
    depth: f32,
}

/// The footprint of one Gaussian: a record of 32 bytes. Records are stored as two halves in two arrays, so that
/// a binding holds twice as many.
///
/// With (dx, dy) the offset from the center in pixels, alpha is opacity exp(-q / 2) with q = row_precision (dx
/// - slope dy)^2 + y_precision dy^2. That is the inverse covariance with the square completed. The usual form a
/// dx^2 + 2 b dx dy + c dy^2 subtracts large numbers if the footprint is a needle; a sum of two squares does
/// not.
struct Splat {
    /// Projected mean, in pixels of the target.
    center: vec2<f32>,
    /// Shift of the middle of a row in x, per pixel in y.
    slope: f32,
    /// Inverse variance within a row, in px^-2.
    row_precision: f32,
    /// Inverse variance along y, in px^-2.
    y_precision: f32,
    /// Depth of the mean in the depth buffer, 0..1, reverse z.
    depth: f32,
    /// Display-referred, not clamped from above.
    color: vec3<f32>,
    /// Opacity, 0..1.
    opacity: f32,
}

/// The geometry half of a record: center, slope, row_precision.
fn packed_geometry(splat: Splat) -> vec4<f32> {
    return vec4(splat.center, splat.slope, splat.row_precision);
}

/// The color half of a record: y_precision, depth, then color and opacity as f16.
fn packed_color(splat: Splat) -> vec4<u32> {
    return vec4(
        bitcast<u32>(splat.y_precision),
        bitcast<u32>(splat.depth),
        pack2x16float(splat.color.rg),
        pack2x16float(vec2(splat.color.b, splat.opacity)),
    );
}

fn unpacked(geometry: vec4<f32>, color: vec4<u32>) -> Splat {
    let red_green = unpack2x16float(color.z);
    let blue_opacity = unpack2x16float(color.w);
    return Splat(
        geometry.xy,
        geometry.z,
        geometry.w,
        bitcast<f32>(color.x),
        bitcast<f32>(color.y),
        vec3(red_green, blue_opacity.x),
        blue_opacity.y,
    );
}


/// The q at which alpha falls to `MIN_ALPHA`: the edge of the footprint.
fn cutoff(opacity: f32) -> f32 {
    // The opacity of a record is rounded to f16, and may be just below `MIN_ALPHA`. The logarithm is negative
    // then.
    return max(2.0 * log(opacity / MIN_ALPHA), 0.0);
}
