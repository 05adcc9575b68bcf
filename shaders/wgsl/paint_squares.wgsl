// The luminance energy of detail at each pixel. CPU twin: the detail of `stylegaussian::paint`.

@compute @workgroup_size(PAINT_SIDE, PAINT_SIDE)
fn paint_squares(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let pixel = invocation.xy;
    let size = vec2(task.output.width, task.output.height);
    if any(pixel >= size) {
        return;
    }
    let at = vec2<f32>(pixel) + 0.5;
    let first = sampled(task.copies[0], at);
    let second = sampled(task.copies[1], at);
    let detail = FINEST * (first - second) + second - sampled(task.copies[3], at);
    let luminance = dot(detail, vec3(LUMINANCE_R, LUMINANCE_G, LUMINANCE_B));
    pictures[task.output.first + pixel.y * size.x + pixel.x] = vec4(luminance * luminance);
}
