// A picture blurred by a Gaussian along rows or columns. Its edge pixels go on beyond it. CPU twin: `blurred`
// of the pictures of `stylegaussian::paint`.

@compute @workgroup_size(PAINT_SIDE, PAINT_SIDE)
fn paint_blur(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let at = invocation.xy;
    let size = vec2(task.output.width, task.output.height);
    if any(at >= size) {
        return;
    }
    let along = select(vec2(1, 0), vec2(0, 1), task.which == 1u);
    var sum = vec4(0.0);
    var total = 0.0;
    let reach = i32(hidden(task.reach));
    for (var d = -reach; d <= reach; d++) {
        let deviations = f32(d) / task.sigma;
        let weight = exp(-0.5 * deviations * deviations);
        sum += weight * pictures[pixel_at(task.input, vec2<i32>(at) + d * along)];
        total += weight;
    }
    pictures[task.output.first + at.y * size.x + at.x] = sum / total;
}
