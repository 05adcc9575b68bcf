// `splat_sort_scan` for software adapters: one invocation sums up a digit.

/// Counts in, sums over the earlier batches out `[digit, batch]`.
@group(0) @binding(2) var<storage, read_write> batch_counts: array<u32>;
/// Keys with each digit `[digit]`.
@group(0) @binding(3) var<storage, read_write> digit_counts: array<u32>;

@compute @workgroup_size(SOFTWARE_WORKGROUP)
fn splat_sort_scan_serial(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let digit = invocation.x;
    let row = digit * batch_stride();
    let n_batches = (n_keys() + SORT_BATCH - 1u) / SORT_BATCH;
    var before = 0u;
    for (var batch = 0u; batch < n_batches; batch++) {
        let count = batch_counts[row + batch];
        batch_counts[row + batch] = before;
        before += count;
    }
    digit_counts[digit] = before;
}
