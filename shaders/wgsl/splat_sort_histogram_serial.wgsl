// `splat_sort_histogram` for software adapters. One invocation counts a batch: it waits for no other
// invocation, and runs in lockstep with those of the neighboring batches.

@group(0) @binding(2) var<storage, read> keys_in: array<u32>;
/// Counts `[digit, batch]`.
@group(0) @binding(3) var<storage, read_write> batch_counts: array<u32>;

/// Counts `[digit, lane]`: lanes in lockstep access consecutive words.
var<workgroup> histogram: array<u32, N_DIGITS * SOFTWARE_WORKGROUP>;

@compute @workgroup_size(SOFTWARE_WORKGROUP)
fn splat_sort_histogram_serial(
    @builtin(global_invocation_id) invocation: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let batch = invocation.x;
    let first = batch * SORT_BATCH;
    // A dispatch has as many workgroups as the other kernel, one per batch. Eight batches share a workgroup
    // here, so most of them have nothing to do.
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
