// Blends the list of each tile, front to back, over nothing: the layer. CPU twin: `stylegaussian::splat`,
// module `composite`.

@compute @workgroup_size(QUARTERS_PER_WORKGROUP)
fn splat_tiles_blend(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tile = workgroup.x * TILES_PER_WORKGROUP + lane / 4u;
    if tile >= tiles.n_tiles.x * tiles.n_tiles.y {
        return;
    }
    let corner = vec2(tile % tiles.n_tiles.x, tile / tiles.n_tiles.x) * TILE_SIZE
        + vec2(lane & 1u, (lane >> 1u) & 1u) * 4u;
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
    if are_hidden(row_0.depth, row_1.depth, row_2.depth, row_3.depth) {
        i = end;
    }
    blend_list(&row_0, &row_1, &row_2, &row_3, i, end, middle);
    let end_pixel = vec2<u32>(tiles.viewport.xy + tiles.viewport.zw);
    store(row_0, pixel, end_pixel);
    store(row_1, pixel + below, end_pixel);
    store(row_2, pixel + 2u * below, end_pixel);
    store(row_3, pixel + 3u * below, end_pixel);
}
