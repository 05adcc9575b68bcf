// Blends the list of each tile, front to back, over nothing: the layer. CPU twin: `stylegaussian::splat`, module
// `composite`.

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
        blend_colors(&row_0, &row_1, &row_2, &row_3, splat, record, dx, d.y);
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
