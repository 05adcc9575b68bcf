// A picture at half its size, rounded up: means of 2 x 2 pixels. CPU twin: `halved` of the pictures of
// `stylegaussian::paint`.

@compute @workgroup_size(PAINT_SIDE, PAINT_SIDE)
fn paint_halve(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let at = invocation.xy;
    let size = vec2(task.output.width, task.output.height);
    if any(at >= size) {
        return;
    }
    var sum = vec4(0.0);
    for (var k = 0; k < 4; k++) {
        sum += pictures[pixel_at(task.input, 2 * vec2<i32>(at) + vec2(k & 1, k >> 1u))];
    }
    pictures[task.output.first + at.y * size.x + at.x] = 0.25 * sum;
}
