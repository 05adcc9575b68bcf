// `splat_sort_scatter` on adapters that are a CPU: one invocation moves a tile, key by key.

@group(0) @binding(2) var<storage, read> keys_in: array<u32>;
@group(0) @binding(3) var<storage, read> values_in: array<u32>;
/// `[digit, tile]`: keys with that digit in the tiles before.
@group(0) @binding(4) var<storage, read> tile_offsets: array<u32>;
/// Keys with each digit `[digit]`.
@group(0) @binding(5) var<storage, read> digit_counts: array<u32>;
@group(0) @binding(6) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(7) var<storage, read_write> values_out: array<u32>;

/// Where the next key with each digit goes.
var<workgroup> next: array<u32, N_DIGITS>;

@compute @workgroup_size(1)
fn splat_sort_scatter_serial(@builtin(workgroup_id) workgroup: vec3<u32>) {
    var before = 0u;
    for (var digit = 0u; digit < N_DIGITS; digit++) {
        next[digit] = before + tile_offsets[digit * tile_stride() + workgroup.x];
        before += digit_counts[digit];
    }
    let end = min((workgroup.x + 1u) * TILE, n_keys());
    for (var i = workgroup.x * TILE; i < end; i++) {
        let key = keys_in[i];
        if key == INVISIBLE {
            continue;
        }
        let digit = digit_of(key);
        let place = next[digit];
        next[digit] = place + 1u;
        keys_out[place] = key;
        if sort_pass.first == 1u {
            values_out[place] = i;
        } else {
            values_out[place] = values_in[i];
        }
    }
}
