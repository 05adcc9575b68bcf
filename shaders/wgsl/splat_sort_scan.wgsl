// Finds where each batch's keys with one digit start among all keys with that digit. One workgroup per digit.

/// Counts in, sums over the earlier batches out `[digit, batch]`.
@group(0) @binding(2) var<storage, read_write> batch_counts: array<u32>;
/// Keys with each digit `[digit]`.
@group(0) @binding(3) var<storage, read_write> digit_counts: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn splat_sort_scan(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let digit = workgroup.x;
    let row = digit * batch_stride();
    let n_batches = (n_keys() + SORT_BATCH - 1u) / SORT_BATCH;
    // Each invocation sums consecutive batches, so that one scan over 256 sums serves any number of batches.
    let run = (n_batches + WORKGROUP - 1u) / WORKGROUP;
    let start = min(lane * run, n_batches);
    let end = min(start + run, n_batches);
    var sum = 0u;
    for (var batch = start; batch < end; batch++) {
        sum += batch_counts[row + batch];
    }
    // The loop below writes in place without a barrier: each lane reads and writes its own batches only.
    var before = sum_before(lane, sum);
    if lane == WORKGROUP - 1u {
        digit_counts[digit] = before + sum;
    }
    for (var batch = start; batch < end; batch++) {
        let count = batch_counts[row + batch];
        batch_counts[row + batch] = before;
        before += count;
    }
}
