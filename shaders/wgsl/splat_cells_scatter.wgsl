// Writes the lists. One invocation handles a run, in as many dispatches as `splat_cells_count`; runs follow one another in each
// list, and so do the splats of a run.

@group(0) @binding(0) var<uniform> cells: SplatCells;
@group(0) @binding(1) var<storage, read> counts: SplatCounts;
/// Slots of the visible splats, front to back.
@group(0) @binding(2) var<storage, read> slots: array<u32>;
/// What each of them reaches, as `splat_cells_count` writes it.
@group(0) @binding(3) var<storage, read> reaches: array<vec2<u32>>;
/// Where each run's part of a cell's list begins within its segment `[cell, run]`; afterwards where it ends.
@group(0) @binding(4) var<storage, read_write> run_ends: array<u32>;
/// Where each segment begins.
@group(0) @binding(5) var<storage, read> segments: array<u32>;
/// The lists, one after the other: slots.
@group(0) @binding(6) var<storage, read_write> entries: array<u32>;
/// `[run]`, zero before.
@group(0) @binding(7) var<storage, read_write> written: array<RunProgress>;

@compute @workgroup_size(IN_STEP)
fn splat_cells_scatter(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let run = invocation.x;
    let first_splat = first_of_run(run, counts.n_visible);
    let end = first_of_run(run + 1u, counts.n_visible);
    var progress = written[run];
    var rounds = ROUNDS_OF_RUN;
    while first_splat + progress.n_splats < end && rounds > 0u {
        let i = first_splat + progress.n_splats;
        let slot = slots[i];
        let first = reaches[i] & vec2(0xffffu);
        let last = reaches[i] >> vec2(16u);
        let size = last - first + 1u;
        let stop = min(size.x * size.y, progress.n_cells + rounds);
        rounds -= min(rounds, stop - progress.n_cells + 1u);
        var at = first + vec2(progress.n_cells % size.x, progress.n_cells / size.x);
        for (; progress.n_cells < stop; progress.n_cells++) {
            let cell = at.y * cells.n_cells.x + at.x;
            let in_segment = run_ends[cell * N_RUNS + run];
            run_ends[cell * N_RUNS + run] = in_segment + 1u;
            let place = segments[cell / CELLS_OF_SEGMENT] + in_segment;
            if place < cells.capacity {
                entries[place] = slot;
            }
            at = select(vec2(at.x + 1u, at.y), vec2(first.x, at.y + 1u), at.x == last.x);
        }
        if stop == size.x * size.y {
            progress = RunProgress(progress.n_splats + 1u, 0u);
        }
    }
    written[run] = progress;
}
