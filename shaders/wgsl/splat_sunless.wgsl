// Views in which no splats receive shadows, for `splat_light`.

/// The share of its light that a splat at a point of view space keeps, which loses `amount` in shadow.
fn shade_at(point: vec3<f32>, amount: f32) -> f32 {
    return 1.0;
}
