// Where each partition's keys with one digit start among all keys with that digit. One workgroup per digit.

/// `[digit, partition]`: counts in, sums of the partitions before out.
@group(0) @binding(2) var<storage, read_write> partition_counts: array<u32>;
/// Keys with each digit `[digit]`.
@group(0) @binding(3) var<storage, read_write> digit_counts: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn splat_sort_scan(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let digit = workgroup.x;
    let row = digit * partition_stride();
    let n_partitions = (n_keys() + SORT_PARTITION - 1u) / SORT_PARTITION;
    // Each invocation takes a run of partitions, so one scan over 256 sums serves any number of them.
    let run = (n_partitions + WORKGROUP - 1u) / WORKGROUP;
    let start = min(lane * run, n_partitions);
    let end = min(start + run, n_partitions);
    var sum = 0u;
    for (var partition = start; partition < end; partition++) {
        sum += partition_counts[row + partition];
    }
    var before = sum_before(lane, sum);
    if lane == WORKGROUP - 1u {
        digit_counts[digit] = before + sum;
    }
    for (var partition = start; partition < end; partition++) {
        let count = partition_counts[row + partition];
        partition_counts[row + partition] = before;
        before += count;
    }
}
