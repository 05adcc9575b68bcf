// `splat_sort_scan` on adapters that are a CPU: one invocation sums up a digit.

/// `[digit, partition]`: counts in, sums of the partitions before out.
@group(0) @binding(2) var<storage, read_write> partition_counts: array<u32>;
/// Keys with each digit `[digit]`.
@group(0) @binding(3) var<storage, read_write> digit_counts: array<u32>;

@compute @workgroup_size(SOFTWARE_WORKGROUP)
fn splat_sort_scan_serial(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let digit = invocation.x;
    let row = digit * partition_stride();
    let n_partitions = (n_keys() + SORT_PARTITION - 1u) / SORT_PARTITION;
    var before = 0u;
    for (var partition = 0u; partition < n_partitions; partition++) {
        let count = partition_counts[row + partition];
        partition_counts[row + partition] = before;
        before += count;
    }
    digit_counts[digit] = before;
}
