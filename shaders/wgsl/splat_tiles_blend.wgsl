// Blends the list of each tile, front to back, over nothing: the layer. CPU twin: `stylegaussian::splat`, module
// `composite`.
//
// An invocation handles a quarter of a tile: four rows of four pixels, which it keeps in registers. A software
// adapter that runs eight invocations in lockstep reads each splat once for 128 pixels. A rasterizer would walk every
// footprint block by block, and load and store the pixels each time.

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

/// Blends a splat behind the earlier ones of a row. `dx` and `dy` are offsets from its center.
fn blend(row: ptr<function, Row>, splat: Splat, dx: vec4<f32>, dy: f32) {
    let du = dx - splat.slope * dy;
    let power = splat.row_precision * du * du + splat.y_precision * dy * dy;
    let alpha = min(vec4(MAX_ALPHA), splat.opacity * exp2(power));
    let seen = (alpha >= vec4(MIN_ALPHA)) & (vec4(splat.depth) >= (*row).depth);
    let weight = select(vec4(0.0), (*row).light * alpha, seen);
    (*row).red += weight * splat.color.r;
    (*row).green += weight * splat.color.g;
    (*row).blue += weight * splat.color.b;
    // light (1 - alpha), or unchanged if the splat is not seen.
    (*row).light -= weight;
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

@compute @workgroup_size(QUARTERS_PER_WORKGROUP)
fn splat_tiles_blend(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tile = workgroup.x * TILES_PER_WORKGROUP + lane / 4u;
    if tile >= tiles.n_tiles.x * tiles.n_tiles.y {
        return;
    }
    let corner = vec2(tile % tiles.n_tiles.x, tile / tiles.n_tiles.x) * TILE_SIZE + vec2(lane & 1u, (lane >> 1u) & 1u) * 4u;
    let pixel = vec2<u32>(tiles.viewport.xy) + corner;
    let middle = vec2<f32>(pixel) + 0.5;
    let below = vec2(0u, 1u);
    var row_0 = row_at(pixel);
    var row_1 = row_at(pixel + below);
    var row_2 = row_at(pixel + 2u * below);
    var row_3 = row_at(pixel + 3u * below);
    let end = end_of_list(tile);
    var i = 0u;
    if tile > 0u {
        i = end_of_list(tile - 1u);
    }
    for (; i < end; i++) {
        let record = entries[i];
        var splat = unpacked(geometry_halves[record], color_halves[record]);
        // Scaled once per splat instead of once per pixel, for the exp2 of `blend`.
        splat.row_precision *= -HALF_LOG2_E;
        splat.y_precision *= -HALF_LOG2_E;
        let d = middle - splat.center;
        let dx = d.x + vec4(0.0, 1.0, 2.0, 3.0);
        blend(&row_0, splat, dx, d.y);
        blend(&row_1, splat, dx, d.y + 1.0);
        blend(&row_2, splat, dx, d.y + 2.0);
        blend(&row_3, splat, dx, d.y + 3.0);
        let brightest = max(max(row_0.light, row_1.light), max(row_2.light, row_3.light));
        // Finished pixels blend on until all sixteen are finished. They have less than MIN_LIGHT left to give.
        if all(brightest < vec4(MIN_LIGHT)) {
            break;
        }
    }
    let end_pixel = vec2<u32>(tiles.viewport.xy + tiles.viewport.zw);
    store(row_0, pixel, end_pixel);
    store(row_1, pixel + below, end_pixel);
    store(row_2, pixel + 2u * below, end_pixel);
    store(row_3, pixel + 3u * below, end_pixel);
}
