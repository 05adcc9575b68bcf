// Counts the splats of each run that reach into each tile. One invocation handles a run. The kernel is
// dispatched again until all runs are finished, because llvmpipe ends an invocation after 65,535 loop
// iterations.

@group(0) @binding(0) var<uniform> tiles: SplatTiles;
@group(0) @binding(1) var<storage, read> counts: SplatCounts;
/// Record indices of the visible splats, front to back.
@group(0) @binding(2) var<storage, read> record_indices: array<u32>;
@group(0) @binding(3) var<storage, read> geometry_halves: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> color_halves: array<vec4<u32>>;
/// Counts `[tile, run]`, zero before the first dispatch.
@group(0) @binding(5) var<storage, read_write> run_counts: array<u32>;
/// The tiles that each sorted splat reaches: first and last column, first and last row, as 16 bits each.
@group(0) @binding(6) var<storage, read_write> reaches: array<vec2<u32>>;
/// Progress `[run]`, zero before the first dispatch.
@group(0) @binding(7) var<storage, read_write> counted: array<RunProgress>;

@compute @workgroup_size(SOFTWARE_WORKGROUP)
fn splat_tiles_count(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let run = invocation.x;
    let first_splat = first_of_run(run, counts.n_visible);
    let end = first_of_run(run + 1u, counts.n_visible);
    var progress = counted[run];
    var iterations = ITERATIONS_PER_DISPATCH;
    while first_splat + progress.n_splats < end && iterations > 0u {
        let i = first_splat + progress.n_splats;
        let record = record_indices[i];
        let reached = reach(unpacked(geometry_halves[record], color_halves[record]));
        reaches[i] = vec2(reached.first.x | (reached.last.x << 16u), reached.first.y | (reached.last.y << 16u));
        let size = reached.last - reached.first + 1u;
        // A large splat may take several dispatches: its progress is kept tile by tile.
        let stop = min(size.x * size.y, progress.n_tiles + iterations);
        iterations -= min(iterations, stop - progress.n_tiles + 1u);
        var at = reached.first + vec2(progress.n_tiles % size.x, progress.n_tiles / size.x);
        for (; progress.n_tiles < stop; progress.n_tiles++) {
            run_counts[(at.y * tiles.n_tiles.x + at.x) * N_RUNS + run] += 1u;
            // A select instead of a division per tile.
            at = select(vec2(at.x + 1u, at.y), vec2(reached.first.x, at.y + 1u), at.x == reached.last.x);
        }
        if stop == size.x * size.y {
            progress = RunProgress(progress.n_splats + 1u, 0u);
        }
    }
    counted[run] = progress;
}
