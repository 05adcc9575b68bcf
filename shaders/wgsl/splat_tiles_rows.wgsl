// Rows of pixels in the blend of tiles.
//
// An invocation handles a quarter of a tile: four rows of four pixels, which it keeps in registers. A software
// adapter that runs eight invocations in lockstep reads each splat once for 128 pixels. A rasterizer would walk
// every footprint block by block, and load and store the pixels each time.

@group(0) @binding(0) var<uniform> tiles: SplatTiles;
/// End of each run's part of a tile's list, within the tile's segment `[tile, run]`.
@group(0) @binding(1) var<storage, read> run_ends: array<u32>;
/// Start of each segment in `entries`.
@group(0) @binding(2) var<storage, read> segments: array<u32>;
/// The lists, one after the other: record indices, front to back.
@group(0) @binding(3) var<storage, read> entries: array<u32>;
@group(0) @binding(4) var<storage, read> geometry_halves: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> color_halves: array<vec4<u32>>;
@group(0) @binding(6) var layer: texture_storage_2d<rgba16float, write>;

/// A pixel is finished if it lets less light through than this (the original rasterizer's bound).
const MIN_LIGHT: f32 = 1e-4;
/// log2(e) / 2: exp(-q / 2) is exp2(-HALF_LOG2_E q).
const HALF_LOG2_E: f32 = 0.72134752;

/// End of a tile's list, which is the start of the next one.
fn end_of_list(tile: u32) -> u32 {
    return segments[tile / TILES_PER_SEGMENT] + run_ends[tile * N_RUNS + N_RUNS - 1u];
}

/// Four pixels side by side.
struct Row {
    /// Share of the light from behind that the pixels still let through.
    light: vec4<f32>,
    red: vec4<f32>,
    green: vec4<f32>,
    blue: vec4<f32>,
    /// Splats with a smaller depth are hidden (reverse z).
    depth: vec4<f32>,
}

/// A row without splats.
fn row_at(pixel: vec2<u32>) -> Row {
    let depth = vec4(
        depth_at(pixel),
        depth_at(pixel + vec2(1u, 0u)),
        depth_at(pixel + vec2(2u, 0u)),
        depth_at(pixel + vec2(3u, 0u)),
    );
    return Row(vec4(1.0), vec4(0.0), vec4(0.0), vec4(0.0), depth);
}

/// Alpha of a splat in a row. Its precisions are multiplied by `-HALF_LOG2_E`. `dx` and `dy` are offsets from
/// its center.
fn alphas(splat: Splat, dx: vec4<f32>, dy: f32) -> vec4<f32> {
    let du = dx - splat.slope * dy;
    let power = splat.row_precision * du * du + splat.y_precision * dy * dy;
    return min(vec4(MAX_ALPHA), splat.opacity * exp2(power));
}

/// Blends a splat behind the earlier ones of a row, and returns its weights.
fn blend(row: ptr<function, Row>, splat: Splat, alpha: vec4<f32>) -> vec4<f32> {
    let seen = (alpha >= vec4(MIN_ALPHA)) & (vec4(splat.depth) >= (*row).depth);
    let weight = select(vec4(0.0), (*row).light * alpha, seen);
    (*row).red += weight * splat.color.r;
    (*row).green += weight * splat.color.g;
    (*row).blue += weight * splat.color.b;
    // light (1 - alpha), or unchanged if the splat is not seen.
    (*row).light -= weight;
    return weight;
}

/// Writes the pixels of a row that are within the picture.
fn store(row: Row, pixel: vec2<u32>, end: vec2<u32>) {
    if pixel.y >= end.y {
        return;
    }
    for (var i = 0u; i < 4u; i++) {
        if pixel.x + i < end.x {
            let color = vec4(row.red[i], row.green[i], row.blue[i], 1.0 - row.light[i]);
            textureStore(layer, vec2(pixel.x + i, pixel.y), color);
        }
    }
}

/// The splat of a record, with its precisions multiplied by `-HALF_LOG2_E`.
fn splat_of(record: u32) -> Splat {
    var splat = unpacked(geometry_halves[record], color_halves[record]);
    // Scaled once per splat instead of once per pixel, for the exp2 of `alphas`.
    splat.row_precision *= -HALF_LOG2_E;
    splat.y_precision *= -HALF_LOG2_E;
    return splat;
}

/// Whether four rows are finished. Finished pixels blend on until all sixteen are: they have less than
/// `MIN_LIGHT` left to give.
fn are_finished(light_0: vec4<f32>, light_1: vec4<f32>, light_2: vec4<f32>, light_3: vec4<f32>) -> bool {
    return all(max(max(light_0, light_1), max(light_2, light_3)) < vec4(MIN_LIGHT));
}

/// Whether no splat is before what four rows show: it is at the near plane.
fn are_hidden(depth_0: vec4<f32>, depth_1: vec4<f32>, depth_2: vec4<f32>, depth_3: vec4<f32>) -> bool {
    return all(min(min(depth_0, depth_1), min(depth_2, depth_3)) >= vec4(1.0));
}
