// A layer that all samples of a pixel share.

@group(0) @binding(1) var layer: texture_2d<f32>;

@vertex
fn splat_composite_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    return covering(corner);
}

@fragment
fn splat_composite_fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return composited(textureLoad(layer, vec2<i32>(position.xy), 0));
}
