// Targets without multisampling.

@group(0) @binding(1) var layer: texture_2d<f32>;

@fragment
fn splat_composite_fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return composited(textureLoad(layer, vec2<i32>(position.xy), 0));
}
