// Views in which no splats receive shadows, for `splat_light`.

/// The share of the sun's light that reaches a point of view space.
fn sunlight(point: vec3<f32>) -> f32 {
    return 1.0;
}
