// Splats with strokes in the blend of tiles.

/// Strokes of less weight are left out. Ten such splats in a pixel change it by less than a step of eight bits.
const LEAST_WEIGHT: f32 = 2e-4;

/// The weights that strokes have in a row: those of the splat, where it shows any.
fn stroke_weights(weight: vec4<f32>, alpha: vec4<f32>) -> vec4<f32> {
    return select(vec4(0.0), weight, (weight >= vec4(LEAST_WEIGHT)) & (alpha >= vec4(LEAST_ALPHA)));
}

/// Adds strokes to a row.
fn paint(row: ptr<function, Row>, strokes: Strokes, weight: vec4<f32>, dx: vec4<f32>, dy: f32) {
    for (var i = 0u; i < 4u; i++) {
        if weight[i] > 0.0 {
            let detail = weight[i] * stroke_detail(strokes, vec2(dx[i], dy));
            (*row).red[i] += detail.r;
            (*row).green[i] += detail.g;
            (*row).blue[i] += detail.b;
        }
    }
}

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
    let alpha_0 = alphas(splat, dx, dy);
    let alpha_1 = alphas(splat, dx, dy + 1.0);
    let alpha_2 = alphas(splat, dx, dy + 2.0);
    let alpha_3 = alphas(splat, dx, dy + 3.0);
    let weight_0 = stroke_weights(blend(row_0, splat, alpha_0), alpha_0);
    let weight_1 = stroke_weights(blend(row_1, splat, alpha_1), alpha_1);
    let weight_2 = stroke_weights(blend(row_2, splat, alpha_2), alpha_2);
    let weight_3 = stroke_weights(blend(row_3, splat, alpha_3), alpha_3);
    let packed = stroke_records[record];
    let is_seen = any(weight_0 + weight_1 + weight_2 + weight_3 > vec4(0.0));
    if is_seen && has_strokes(packed) {
        let strokes = unpacked_strokes(packed);
        paint(row_0, strokes, weight_0, dx, dy);
        paint(row_1, strokes, weight_1, dx, dy + 1.0);
        paint(row_2, strokes, weight_2, dx, dy + 2.0);
        paint(row_3, strokes, weight_3, dx, dy + 3.0);
    }
}
