// `splat_sort_histogram` on adapters that are a CPU: one invocation counts a tile, for which it waits for nobody, in step with
// those of the tiles beside it.

@group(0) @binding(2) var<storage, read> keys_in: array<u32>;
/// `[digit, tile]`.
@group(0) @binding(3) var<storage, read_write> tile_counts: array<u32>;

/// `[digit, lane]`.
var<workgroup> histogram: array<u32, N_DIGITS * IN_STEP>;

@compute @workgroup_size(IN_STEP)
fn splat_sort_histogram_serial(
    @builtin(global_invocation_id) invocation: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tile = invocation.x;
    let first = tile * TILE;
    // There are as many workgroups as tiles: the last ones have nothing to do.
    if first >= n_keys() {
        return;
    }
    // Workgroup memory starts as zero.
    let end = min(first + TILE, n_keys());
    for (var i = first; i < end; i++) {
        let key = keys_in[i];
        if key != INVISIBLE {
            histogram[digit_of(key) * IN_STEP + lane] += 1u;
        }
    }
    for (var digit = 0u; digit < N_DIGITS; digit++) {
        tile_counts[digit * tile_stride() + tile] = histogram[digit * IN_STEP + lane];
    }
}
