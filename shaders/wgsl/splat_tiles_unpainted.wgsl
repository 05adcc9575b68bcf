// Splats without strokes in the blend of tiles.

/// Blends the entries from `first` to `end` into four rows. `middle` is the middle of the first pixel.
fn blend_list(
    row_0: ptr<function, Row>,
    row_1: ptr<function, Row>,
    row_2: ptr<function, Row>,
    row_3: ptr<function, Row>,
    first: u32,
    end: u32,
    middle: vec2<f32>,
) {
    for (var i = first; i < end; i++) {
        let splat = splat_of(entries[i]);
        let d = middle - splat.center;
        let dx = d.x + vec4(0.0, 1.0, 2.0, 3.0);
        blend(row_0, splat, alphas(splat, dx, d.y));
        blend(row_1, splat, alphas(splat, dx, d.y + 1.0));
        blend(row_2, splat, alphas(splat, dx, d.y + 2.0));
        blend(row_3, splat, alphas(splat, dx, d.y + 3.0));
        if are_finished((*row_0).light, (*row_1).light, (*row_2).light, (*row_3).light) {
            break;
        }
    }
}
