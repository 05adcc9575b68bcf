// `splat_sort_histogram` on adapters that are a CPU: one invocation counts a tile, for which it waits for nobody.

@group(0) @binding(2) var<storage, read> keys_in: array<u32>;
/// `[digit, tile]`.
@group(0) @binding(3) var<storage, read_write> tile_counts: array<u32>;

var<workgroup> histogram: array<u32, N_DIGITS>;

@compute @workgroup_size(1)
fn splat_sort_histogram_serial(@builtin(workgroup_id) workgroup: vec3<u32>) {
    // Workgroup memory starts as zero.
    let end = min((workgroup.x + 1u) * TILE, n_keys());
    for (var i = workgroup.x * TILE; i < end; i++) {
        let key = keys_in[i];
        if key != INVISIBLE {
            histogram[digit_of(key)] += 1u;
        }
    }
    for (var digit = 0u; digit < N_DIGITS; digit++) {
        tile_counts[digit * tile_stride() + workgroup.x] = histogram[digit];
    }
}
