// The radix sort of splats by key, least significant digit first (Satish, Harris and Garland, "Designing
// Efficient Sorting Algorithms for Manycore GPUs", 2009): stable, so ties keep the order of their Gaussians and
// never flicker.
//
// A pass sorts by one digit in three kernels: `splat_sort_histogram` counts the digits of each batch,
// `splat_sort_scan` turns counts into positions, `splat_sort_scatter` moves keys there. The first pass also
// drops invisible splats: it reads the keys of all records and writes only those of the visible ones.

/// Values of a digit of 8 bits: one for each invocation of a workgroup.
const N_DIGITS: u32 = WORKGROUP;
/// Keys that each invocation handles.
const ROUNDS: u32 = SORT_BATCH / N_DIGITS;

/// One pass of the sort.
struct SortPass {
    /// Position of the digit's lowest bit.
    shift: u32,
    /// 1 in the first pass, which reads no values: they are the record indices themselves.
    first: u32,
    padding: vec2<u32>,
}

@group(0) @binding(0) var<uniform> sort_pass: SortPass;
@group(0) @binding(1) var<storage, read> counts: SplatCounts;

/// The number of keys that this pass reads.
fn n_keys() -> u32 {
    return select(counts.n_visible, counts.n_records, sort_pass.first == 1u);
}

/// Distance from one digit's counts to the next one's: the batches of the first pass, the largest one.
fn batch_stride() -> u32 {
    return (counts.n_records + SORT_BATCH - 1u) / SORT_BATCH;
}

fn digit_of(key: u32) -> u32 {
    return (key >> sort_pass.shift) & (N_DIGITS - 1u);
}
