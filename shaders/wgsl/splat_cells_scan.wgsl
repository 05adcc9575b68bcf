// From how many to where within a segment, which is the lists of a few consecutive cells: each count becomes the sum of those
// before it. One invocation handles a segment.

@group(0) @binding(0) var<uniform> cells: SplatCells;
/// `[cell, run]`.
@group(0) @binding(1) var<storage, read_write> run_counts: array<u32>;
/// Entries of each segment.
@group(0) @binding(2) var<storage, read_write> segments: array<u32>;

@compute @workgroup_size(IN_STEP)
fn splat_cells_scan(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let n_counts = cells.n_cells.x * cells.n_cells.y * N_RUNS;
    let first = invocation.x * CELLS_OF_SEGMENT * N_RUNS;
    if first >= n_counts {
        return;
    }
    let end = min(first + CELLS_OF_SEGMENT * N_RUNS, n_counts);
    var n_entries = 0u;
    for (var i = first; i < end; i++) {
        let n = run_counts[i];
        run_counts[i] = n_entries;
        n_entries += n;
    }
    segments[invocation.x] = n_entries;
}
