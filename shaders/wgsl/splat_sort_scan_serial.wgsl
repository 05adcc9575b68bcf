// `splat_sort_scan` on adapters that are a CPU: one invocation sums up a digit.

/// `[digit, tile]`: counts in, sums of the tiles before out.
@group(0) @binding(2) var<storage, read_write> tile_counts: array<u32>;
/// Keys with each digit `[digit]`.
@group(0) @binding(3) var<storage, read_write> digit_counts: array<u32>;

@compute @workgroup_size(IN_STEP)
fn splat_sort_scan_serial(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let digit = invocation.x;
    let row = digit * tile_stride();
    let n_tiles = (n_keys() + TILE - 1u) / TILE;
    var before = 0u;
    for (var tile = 0u; tile < n_tiles; tile++) {
        let count = tile_counts[row + tile];
        tile_counts[row + tile] = before;
        before += count;
    }
    digit_counts[digit] = before;
}
