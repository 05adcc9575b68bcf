// From display-referred colors back to light: the inverses of tone mapping. Joined to kernels that declare
// `mode`, one of the `MODE_` constants, and `inverse_table` with `table_sampler`, the result of
// `splat_inverse_table`. CPU twin: `stylegaussian::light::Display`.

/// From sRGB's encoding to linear (IEC 61966-2-1).
fn linear_from_srgb(c: vec3<f32>) -> vec3<f32> {
    return select(pow((c + 0.055) / 1.055, vec3(2.4)), c / 12.92, c <= vec3(0.04045));
}

/// Colors 0..1 as colors 0..`BRIGHTEST_SHOWN`: equal up to the knee, then ever slower, without a kink.
fn dimmed(c: vec3<f32>) -> vec3<f32> {
    let above = max(c - KNEE, vec3(0.0));
    let bend = 1.0 / (BRIGHTEST_SHOWN - KNEE) - 1.0 / (1.0 - KNEE);
    return min(c, vec3(KNEE)) + above / (1.0 + bend * above);
}

/// The inverse of Reinhard's c = x / (1 + x).
fn inverse_reinhard(c: vec3<f32>) -> vec3<f32> {
    let limited = dimmed(c);
    return limited / (1.0 - limited);
}

/// The inverse of Reinhard on the luminance (Rec. 709). Hue and saturation stay.
fn inverse_reinhard_luminance(c: vec3<f32>) -> vec3<f32> {
    let luminance = dot(c, LINEAR_LUMINANCE);
    let limited = dimmed(vec3(luminance)).x;
    return c * (limited / max(luminance, 1e-6)) / (1.0 - limited);
}

/// The inverse of a curve that has none for all colors.
fn inverse_by_table(encoded: vec3<f32>) -> vec3<f32> {
    // The table's axes: see `splat_inverse_table`. Texel centers lie half a texel from the edges.
    let along = asin(sqrt(encoded)) / radians(90.0);
    let size = f32(TABLE_SIZE);
    let at = (along * (size - 1.0) + 0.5) / size;
    return inverse_reinhard(textureSampleLevel(inverse_table, table_sampler, at, 0.0).rgb);
}

/// The linear color before tone mapping and after exposure of an encoded color 0..1.
fn exposed_color(encoded: vec3<f32>) -> vec3<f32> {
    switch mode {
        case MODE_REINHARD: { return inverse_reinhard(linear_from_srgb(encoded)); }
        case MODE_REINHARD_LUMINANCE: { return inverse_reinhard_luminance(linear_from_srgb(encoded)); }
        case MODE_TABLE: { return inverse_by_table(encoded); }
        default: { return linear_from_srgb(encoded); }
    }
}
