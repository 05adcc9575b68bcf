// `splat_sort_scatter` for software adapters. One invocation moves a batch, key by key, in lockstep with those
// of the neighboring batches.

@group(0) @binding(2) var<storage, read> keys_in: array<u32>;
@group(0) @binding(3) var<storage, read> values_in: array<u32>;
/// Keys with a digit in earlier batches `[digit, batch]`.
@group(0) @binding(4) var<storage, read> batch_offsets: array<u32>;
/// Keys with each digit `[digit]`.
@group(0) @binding(5) var<storage, read> digit_counts: array<u32>;
@group(0) @binding(6) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(7) var<storage, read_write> values_out: array<u32>;

/// Position of the next key with each digit `[digit, lane]`.
var<workgroup> next: array<u32, N_DIGITS * SOFTWARE_WORKGROUP>;

@compute @workgroup_size(SOFTWARE_WORKGROUP)
fn splat_sort_scatter_serial(
    @builtin(global_invocation_id) invocation: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let batch = invocation.x;
    let first = batch * SORT_BATCH;
    // As in `splat_sort_histogram_serial`, most workgroups have nothing to do.
    if first >= n_keys() {
        return;
    }
    var before = 0u;
    for (var digit = 0u; digit < N_DIGITS; digit++) {
        next[digit * SOFTWARE_WORKGROUP + lane] = before + batch_offsets[digit * batch_stride() + batch];
        before += digit_counts[digit];
    }
    let end = min(first + SORT_BATCH, n_keys());
    for (var i = first; i < end; i++) {
        let key = keys_in[i];
        if key == INVISIBLE {
            continue;
        }
        let of_digit = digit_of(key) * SOFTWARE_WORKGROUP + lane;
        let position = next[of_digit];
        next[of_digit] = position + 1u;
        keys_out[position] = key;
        if sort_pass.first == 1u {
            values_out[position] = i;
        } else {
            values_out[position] = values_in[i];
        }
    }
}
