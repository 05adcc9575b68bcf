// Multisampled targets: reading the sample's index makes the shader run once per sample.

@group(0) @binding(1) var layer: texture_multisampled_2d<f32>;

@fragment
fn splat_composite_fragment(
    @builtin(position) position: vec4<f32>,
    @builtin(sample_index) sample: u32,
) -> @location(0) vec4<f32> {
    return composited(textureLoad(layer, vec2<i32>(position.xy), i32(sample)));
}
