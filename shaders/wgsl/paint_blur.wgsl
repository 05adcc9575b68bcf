// A picture blurred by a Gaussian along rows or columns. Its edge pixels go on beyond it. CPU twin: `blurred`
// of the pictures of `stylegaussian::paint`.

/// Writes a pixel if it is within the picture.
fn write(at: vec2<i32>, value: vec3<f32>) {
    let size = vec2<i32>(vec2(task.output.width, task.output.height));
    if all(at < size) {
        pictures[i32(task.output.first) + at.y * size.x + at.x] = vec4(value, 0.0);
    }
}

/// Four pixels of a row or column: most of what one of them reads, the next one reads too.
@compute @workgroup_size(PAINT_SIDE, PAINT_SIDE)
fn paint_blur(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let n = i32(PAINT_BLURRED);
    let along = select(vec2(1, 0), vec2(0, 1), task.which == 1u);
    let at = vec2<i32>(invocation.xy) * (1 + (n - 1) * along);
    if any(at >= vec2<i32>(vec2(task.output.width, task.output.height))) {
        return;
    }
    var sums = mat4x3<f32>();
    var total = 0.0;
    // Of the pixel that is read, in each of the sums.
    var weights = vec4(0.0);
    let reach = i32(hidden(task.reach));
    for (var d = -reach; d < reach + n; d++) {
        let deviations = f32(d) / task.sigma;
        let weight = select(0.0, exp(-0.5 * deviations * deviations), d <= reach);
        weights = vec4(weight, weights.xyz);
        total += weight;
        let pixel = pictures[pixel_at(task.input, at + d * along)].rgb;
        sums[0] += weights.x * pixel;
        sums[1] += weights.y * pixel;
        sums[2] += weights.z * pixel;
        sums[3] += weights.w * pixel;
    }
    write(at, sums[0] / total);
    write(at + along, sums[1] / total);
    write(at + 2 * along, sums[2] / total);
    write(at + 3 * along, sums[3] / total);
}
