// `splat_sort_histogram` on adapters that are a CPU: one invocation counts a batch, for which it waits for nobody, in step with
// those of the batches beside it.

@group(0) @binding(2) var<storage, read> keys_in: array<u32>;
/// `[digit, batch]`.
@group(0) @binding(3) var<storage, read_write> batch_counts: array<u32>;

/// `[digit, lane]`.
var<workgroup> histogram: array<u32, N_DIGITS * SOFTWARE_WORKGROUP>;

@compute @workgroup_size(SOFTWARE_WORKGROUP)
fn splat_sort_histogram_serial(
    @builtin(global_invocation_id) invocation: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let batch = invocation.x;
    let first = batch * SORT_BATCH;
    // There are as many workgroups as batches: the last ones have nothing to do.
    if first >= n_keys() {
        return;
    }
    // Workgroup memory starts as zero.
    let end = min(first + SORT_BATCH, n_keys());
    for (var i = first; i < end; i++) {
        let key = keys_in[i];
        if key != INVISIBLE {
            histogram[digit_of(key) * SOFTWARE_WORKGROUP + lane] += 1u;
        }
    }
    for (var digit = 0u; digit < N_DIGITS; digit++) {
        batch_counts[digit * batch_stride() + batch] = histogram[digit * SOFTWARE_WORKGROUP + lane];
    }
}
