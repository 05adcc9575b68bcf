// Moves the keys of a batch, and their values, to their positions. One workgroup per batch.
//
// It takes 256 keys at a time. Each key sets its bit in the mask of its digit; the bits before it then count
// the keys that go before it. The order of atomic operations does not matter to a mask, so the sort stays
// stable, and needs no subgroups.

@group(0) @binding(2) var<storage, read> keys_in: array<u32>;
@group(0) @binding(3) var<storage, read> values_in: array<u32>;
/// Keys with a digit in earlier batches `[digit, batch]`.
@group(0) @binding(4) var<storage, read> batch_offsets: array<u32>;
/// Keys with each digit `[digit]`.
@group(0) @binding(5) var<storage, read> digit_counts: array<u32>;
@group(0) @binding(6) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(7) var<storage, read_write> values_out: array<u32>;

/// Words with a bit for each key of a round.
const MASK_WORDS: u32 = WORKGROUP / 32u;
/// One bit per key `[digit, word]`.
var<workgroup> masks: array<atomic<u32>, WORKGROUP * MASK_WORDS>;
/// Position of the next key with each digit.
var<workgroup> next: array<u32, WORKGROUP>;

@compute @workgroup_size(WORKGROUP)
fn splat_sort_scatter(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let n = n_keys();
    let word = lane / 32u;
    let bit = 1u << (lane % 32u);
    // Other lanes read it after the first barrier of the loop.
    next[lane] = sum_before(lane, digit_counts[lane]) + batch_offsets[lane * batch_stride() + workgroup.x];
    // As many rounds for every lane, because barriers demand it. The last batch may be short.
    for (var round = 0u; round < ROUNDS; round++) {
        let i = workgroup.x * SORT_BATCH + round * N_DIGITS + lane;
        // Lanes beyond the last key take part in the barriers, but in nothing else.
        var key = INVISIBLE;
        if i < n {
            key = keys_in[i];
        }
        let mask = digit_of(key) * MASK_WORDS;
        if key != INVISIBLE {
            atomicOr(&masks[mask + word], bit);
        }
        workgroupBarrier();
        if key != INVISIBLE {
            var position = next[mask / MASK_WORDS] + countOneBits(atomicLoad(&masks[mask + word]) & (bit - 1u));
            for (var before = 0u; before < word; before++) {
                position += countOneBits(atomicLoad(&masks[mask + before]));
            }
            keys_out[position] = key;
            if sort_pass.first == 1u {
                values_out[position] = i;
            } else {
                values_out[position] = values_in[i];
            }
        }
        workgroupBarrier();
        // Each lane advances its own digit, and clears its mask for the next round.
        for (var of_digit = 0u; of_digit < MASK_WORDS; of_digit++) {
            next[lane] += countOneBits(atomicExchange(&masks[lane * MASK_WORDS + of_digit], 0u));
        }
        workgroupBarrier();
    }
}
