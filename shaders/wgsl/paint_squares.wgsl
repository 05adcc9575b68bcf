// The luminance energy of detail at each pixel. Detail has more of the finest band than the painting: the
// difference is written over the first blurred copy. CPU twin: the detail of `stylegaussian::paint`.

@compute @workgroup_size(PAINT_SIDE, PAINT_SIDE)
fn paint_squares(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let pixel = invocation.xy;
    let size = vec2(task.output.width, task.output.height);
    if any(pixel >= size) {
        return;
    }
    let i = pixel.y * size.x + pixel.x;
    // These two are as large as the picture.
    let first = pictures[task.copies[0].first + i].rgb;
    let second = pictures[task.copies[1].first + i].rgb;
    let finest = (FINEST - 1.0) * (first - second);
    pictures[task.copies[1].first + i] = vec4(finest, 0.0);
    let detail = first + finest - sampled(task.copies[3], vec2<f32>(pixel) + 0.5);
    let luminance = dot(detail, vec3(LUMINANCE_R, LUMINANCE_G, LUMINANCE_B));
    pictures[task.output.first + i] = vec4(luminance * luminance);
}
