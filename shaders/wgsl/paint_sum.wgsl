// Sums of the pixels of a picture, one for each workgroup. A second step sums these up.

var<workgroup> sums: array<vec4<f32>, PAINT_SUM_WORKGROUP>;

@compute @workgroup_size(PAINT_SUM_WORKGROUP)
fn paint_sum(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let n = task.input.width * task.input.height;
    let begin = workgroup.x * PAINT_SUMMED;
    let end = min(begin + PAINT_SUMMED, n);
    var sum = vec4(0.0);
    for (var i = begin + local; i < end; i += PAINT_SUM_WORKGROUP) {
        sum += pictures[task.input.first + i];
    }
    sums[local] = sum;
    workgroupBarrier();
    for (var n_left = PAINT_SUM_WORKGROUP / 2u; n_left > 0u; n_left /= 2u) {
        if local < n_left {
            sums[local] += sums[local + n_left];
        }
        workgroupBarrier();
    }
    if local == 0u {
        pictures[task.output.first + workgroup.x] = sums[0];
    }
}
