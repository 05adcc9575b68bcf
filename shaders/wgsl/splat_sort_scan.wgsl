// Where each tile's keys with one digit start among all keys with that digit. One workgroup per digit.

/// `[digit, tile]`: counts in, sums of the tiles before out.
@group(0) @binding(2) var<storage, read_write> tile_counts: array<u32>;
/// Keys with each digit `[digit]`.
@group(0) @binding(3) var<storage, read_write> digit_counts: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn splat_sort_scan(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let digit = workgroup.x;
    let row = digit * tile_stride();
    let n_tiles = (n_keys() + TILE - 1u) / TILE;
    // Each invocation takes a run of tiles, so one scan over 256 sums serves any number of them.
    let run = (n_tiles + WORKGROUP - 1u) / WORKGROUP;
    let start = min(lane * run, n_tiles);
    let end = min(start + run, n_tiles);
    var sum = 0u;
    for (var tile = start; tile < end; tile++) {
        sum += tile_counts[row + tile];
    }
    var before = sum_before(lane, sum);
    if lane == WORKGROUP - 1u {
        digit_counts[digit] = before + sum;
    }
    for (var tile = start; tile < end; tile++) {
        let count = tile_counts[row + tile];
        tile_counts[row + tile] = before;
        before += count;
    }
}
