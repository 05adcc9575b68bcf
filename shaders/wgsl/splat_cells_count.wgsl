// How many splats of each run reach into each cell. One invocation handles a run.

@group(0) @binding(0) var<uniform> cells: SplatCells;
@group(0) @binding(1) var<storage, read> counts: SplatCounts;
/// Slots of the visible splats, front to back.
@group(0) @binding(2) var<storage, read> slots: array<u32>;
@group(0) @binding(3) var<storage, read> places: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> looks: array<vec4<u32>>;
/// `[cell, run]`, zero before.
@group(0) @binding(5) var<storage, read_write> run_counts: array<u32>;
/// What each of the sorted splats reaches: first and last column, first and last row, as 16 bits each.
@group(0) @binding(6) var<storage, read_write> reaches: array<vec2<u32>>;

@compute @workgroup_size(IN_STEP)
fn splat_cells_count(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let run = invocation.x;
    let end = first_of_run(run + 1u, counts.n_visible);
    for (var i = first_of_run(run, counts.n_visible); i < end; i++) {
        let slot = slots[i];
        let reached = reach(unpacked(places[slot], looks[slot]));
        reaches[i] = vec2(reached.first.x | (reached.last.x << 16u), reached.first.y | (reached.last.y << 16u));
        // One loop instead of two: lanes that run in step wait for one another once.
        var at = reached.first;
        while at.y <= reached.last.y {
            run_counts[(at.y * cells.n_cells.x + at.x) * N_RUNS + run] += 1u;
            let ends_row = at.x == reached.last.x;
            at = select(vec2(at.x + 1u, at.y), vec2(reached.first.x, at.y + 1u), ends_row);
        }
    }
}
