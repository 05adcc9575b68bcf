// One level of a texture in signed bytes, and the next level: means of 2 x 2 texels. CPU twin:
// `stylegaussian::strokes::StrokeTexture`.

@compute @workgroup_size(PAINT_SIDE, PAINT_SIDE)
fn paint_level(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let texel = invocation.xy;
    let side = task.input.width;
    if any(texel >= vec2(side)) {
        return;
    }
    let first = task.input.first + texel.y * side + texel.x;
    packed[task.packed + texel.y * task.stride + texel.x] = pack4x8snorm(vec4(pictures[first].rgb, 0.0));
    if side > 1u && all((texel & vec2(1u)) == vec2(0u)) {
        let sum = pictures[first] + pictures[first + 1u] + pictures[first + side] + pictures[first + side + 1u];
        pictures[task.output.first + texel.y / 2u * task.output.width + texel.x / 2u] = 0.25 * sum;
    }
}
