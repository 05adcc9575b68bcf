// Views by cameras outside of any atmosphere, for `splat_light`.

/// `air`, to which no atmosphere adds anything.
fn behind_atmosphere(air: Air, ray: vec3<f32>) -> Air {
    return air;
}
