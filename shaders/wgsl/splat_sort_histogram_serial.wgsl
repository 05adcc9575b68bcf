// `splat_sort_histogram` on adapters that are a CPU: one invocation counts a partition, for which it waits for nobody, in step with
// those of the partitions beside it.

@group(0) @binding(2) var<storage, read> keys_in: array<u32>;
/// `[digit, partition]`.
@group(0) @binding(3) var<storage, read_write> partition_counts: array<u32>;

/// `[digit, lane]`.
var<workgroup> histogram: array<u32, N_DIGITS * SOFTWARE_WORKGROUP>;

@compute @workgroup_size(SOFTWARE_WORKGROUP)
fn splat_sort_histogram_serial(
    @builtin(global_invocation_id) invocation: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let partition = invocation.x;
    let first = partition * SORT_PARTITION;
    // There are as many workgroups as partitions: the last ones have nothing to do.
    if first >= n_keys() {
        return;
    }
    // Workgroup memory starts as zero.
    let end = min(first + SORT_PARTITION, n_keys());
    for (var i = first; i < end; i++) {
        let key = keys_in[i];
        if key != INVISIBLE {
            histogram[digit_of(key) * SOFTWARE_WORKGROUP + lane] += 1u;
        }
    }
    for (var digit = 0u; digit < N_DIGITS; digit++) {
        partition_counts[digit * partition_stride() + partition] = histogram[digit * SOFTWARE_WORKGROUP + lane];
    }
}
