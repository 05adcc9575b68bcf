// Targets of one sample per pixel, in views with several: what comes after tone mapping.

/// Samples per pixel of the meshes' depth.
override n_samples: u32 = 1u;

@vertex
fn splat_composite_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    return covering(corner);
}

@fragment
fn splat_composite_fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(position.xy);
    let nearer = countOneBits(textureLoad(nearer_samples, pixel, 0).r);
    var texel = textureLoad(layer, pixel, 0);
    if nearer > 0u {
        // The mean of the samples, as it would be stored.
        texel = mix(texel, textureLoad(nearer_layer, pixel, 0), f32(nearer) / f32(n_samples));
    }
    return composited(texel);
}
