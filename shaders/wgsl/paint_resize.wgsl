// A picture at another size. CPU twin: `resized` of the pictures of `stylegaussian::paint`.

@compute @workgroup_size(PAINT_SIDE, PAINT_SIDE)
fn paint_resize(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let at = invocation.xy;
    let size = vec2(task.output.width, task.output.height);
    if any(at >= size) {
        return;
    }
    let width = vec2<f32>(vec2(task.input.width, task.input.height)) / vec2<f32>(size);
    let value = sampled(task.input, width * (vec2<f32>(at) + 0.5));
    pictures[task.output.first + at.y * size.x + at.x] = vec4(value, 0.0);
}
