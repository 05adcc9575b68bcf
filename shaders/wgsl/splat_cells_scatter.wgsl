// Writes the lists. One invocation handles a run; runs follow one another in each list, and so do the splats of a run.

@group(0) @binding(0) var<uniform> cells: SplatCells;
@group(0) @binding(1) var<storage, read> counts: SplatCounts;
/// Slots of the visible splats, front to back.
@group(0) @binding(2) var<storage, read> slots: array<u32>;
/// What each of them reaches, as `splat_cells_count` writes it.
@group(0) @binding(3) var<storage, read> reaches: array<vec2<u32>>;
/// Where each run's part of a cell's list begins `[cell, run]`; afterwards where it ends.
@group(0) @binding(4) var<storage, read_write> run_ends: array<u32>;
/// The lists, one after the other: slots.
@group(0) @binding(5) var<storage, read_write> entries: array<u32>;

@compute @workgroup_size(IN_STEP)
fn splat_cells_scatter(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let run = invocation.x;
    let end = first_of_run(run + 1u, counts.n_visible);
    for (var i = first_of_run(run, counts.n_visible); i < end; i++) {
        let slot = slots[i];
        let first = reaches[i] & vec2(0xffffu);
        let last = reaches[i] >> vec2(16u);
        var at = first;
        while at.y <= last.y {
            let of_run = (at.y * cells.n_cells.x + at.x) * N_RUNS + run;
            let place = run_ends[of_run];
            run_ends[of_run] = place + 1u;
            if place < cells.capacity {
                entries[place] = slot;
            }
            let ends_row = at.x == last.x;
            at = select(vec2(at.x + 1u, at.y), vec2(first.x, at.y + 1u), ends_row);
        }
    }
}
