// Splats without strokes in the blend of tiles.

/// Blends a splat into four rows. `dx` and `dy` are offsets of the first from its center.
fn blend_colors(
    row_0: ptr<function, Row>,
    row_1: ptr<function, Row>,
    row_2: ptr<function, Row>,
    row_3: ptr<function, Row>,
    splat: Splat,
    record: u32,
    dx: vec4<f32>,
    dy: f32,
) {
    blend(row_0, splat, alphas(splat, dx, dy));
    blend(row_1, splat, alphas(splat, dx, dy + 1.0));
    blend(row_2, splat, alphas(splat, dx, dy + 2.0));
    blend(row_3, splat, alphas(splat, dx, dy + 3.0));
}
