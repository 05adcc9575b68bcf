// Finds iso depths from the lists of tiles, as `splat_tiles_blend` blends them. Meshes do not matter: a surface
// behind them is not written.

@group(1) @binding(0) var<uniform> iso: SplatIso;
@group(1) @binding(1) var<storage, read_write> iso_depths: array<f32>;

/// Four pixels side by side.
struct Surface {
    /// Share of the light that they let through.
    light: vec4<f32>,
    /// Iso depth, where there is one.
    depth: vec4<f32>,
}

/// Puts a splat behind all that a row has.
fn cover(row: ptr<function, Surface>, splat: Splat, alpha: vec4<f32>) {
    let before = (*row).light;
    let light = before * select(vec4(1.0), 1.0 - alpha, alpha >= vec4(MIN_ALPHA));
    let crosses = (before >= vec4(iso.threshold)) & (light < vec4(iso.threshold));
    (*row).depth = select((*row).depth, vec4(splat.depth), crosses);
    (*row).light = light;
}

/// Writes the pixels of a row that are within the picture.
fn store_depths(row: Surface, pixel: vec2<u32>) {
    let size = vec2<u32>(iso.viewport.zw);
    if pixel.y >= size.y {
        return;
    }
    for (var i = 0u; i < 4u; i++) {
        if pixel.x + i < size.x {
            let value = select(-row.light[i], row.depth[i], row.light[i] < iso.threshold);
            iso_depths[place_of(pixel + vec2(i, 0u), iso)] = value;
        }
    }
}

@compute @workgroup_size(QUARTERS_PER_WORKGROUP)
fn splat_tiles_depth(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tile = workgroup.x * TILES_PER_WORKGROUP + lane / 4u;
    if tile >= tiles.n_tiles.x * tiles.n_tiles.y {
        return;
    }
    let pixel = vec2(tile % tiles.n_tiles.x, tile / tiles.n_tiles.x) * TILE_SIZE
        + vec2(lane & 1u, (lane >> 1u) & 1u) * 4u;
    let middle = vec2<f32>(pixel) + tiles.viewport.xy + 0.5;
    var row_0 = Surface(vec4(1.0), vec4(0.0));
    var row_1 = row_0;
    var row_2 = row_0;
    var row_3 = row_0;
    let end = end_of_list(tile);
    var i = 0u;
    if tile > 0u {
        i = end_of_list(tile - 1u);
    }
    for (; i < end; i++) {
        let splat = splat_of(entries[i]);
        let d = middle - splat.center;
        let dx = d.x + vec4(0.0, 1.0, 2.0, 3.0);
        cover(&row_0, splat, alphas(splat, dx, d.y));
        cover(&row_1, splat, alphas(splat, dx, d.y + 1.0));
        cover(&row_2, splat, alphas(splat, dx, d.y + 2.0));
        cover(&row_3, splat, alphas(splat, dx, d.y + 3.0));
        if all(max(max(row_0.light, row_1.light), max(row_2.light, row_3.light)) < vec4(iso.threshold)) {
            break;
        }
    }
    store_depths(row_0, pixel);
    store_depths(row_1, pixel + vec2(0u, 1u));
    store_depths(row_2, pixel + vec2(0u, 2u));
    store_depths(row_3, pixel + vec2(0u, 3u));
}
