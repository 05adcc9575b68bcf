// Counts each digit in each batch. One workgroup per batch.

@group(0) @binding(2) var<storage, read> keys_in: array<u32>;
/// Counts `[digit, batch]`: the scan reads those of a digit in order.
@group(0) @binding(3) var<storage, read_write> batch_counts: array<u32>;

var<workgroup> histogram: array<atomic<u32>, WORKGROUP>;

@compute @workgroup_size(WORKGROUP)
fn splat_sort_histogram(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    // Workgroup memory starts as zero.
    let n = n_keys();
    for (var round = 0u; round < ROUNDS; round++) {
        let i = workgroup.x * SORT_BATCH + round * N_DIGITS + lane;
        if i < n {
            let key = keys_in[i];
            if key != INVISIBLE {
                atomicAdd(&histogram[digit_of(key)], 1u);
            }
        }
    }
    workgroupBarrier();
    batch_counts[lane * batch_stride() + workgroup.x] = atomicLoad(&histogram[lane]);
}
