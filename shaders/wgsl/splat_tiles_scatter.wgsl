// Writes the lists of tiles. One invocation handles a run, in as many dispatches as `splat_tiles_count`. Runs
// follow one another in each list, and so do the splats of a run: lists stay front to back without a sort.

@group(0) @binding(0) var<uniform> tiles: SplatTiles;
@group(0) @binding(1) var<storage, read> counts: SplatCounts;
/// Record indices of the visible splats, front to back.
@group(0) @binding(2) var<storage, read> record_indices: array<u32>;
/// The tiles that each sorted splat reaches, as `splat_tiles_count` writes them.
@group(0) @binding(3) var<storage, read> reaches: array<vec2<u32>>;
/// Start of each run's part of a tile's list within the tile's segment `[tile, run]`; its end afterwards.
@group(0) @binding(4) var<storage, read_write> run_ends: array<u32>;
/// Start of each segment in `entries`.
@group(0) @binding(5) var<storage, read> segments: array<u32>;
/// The lists, one after the other: record indices.
@group(0) @binding(6) var<storage, read_write> entries: array<u32>;
/// Progress `[run]`, zero before the first dispatch.
@group(0) @binding(7) var<storage, read_write> written: array<RunProgress>;

@compute @workgroup_size(SOFTWARE_WORKGROUP)
fn splat_tiles_scatter(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let run = invocation.x;
    let first_splat = first_of_run(run, counts.n_visible);
    let end = first_of_run(run + 1u, counts.n_visible);
    var progress = written[run];
    var iterations = ITERATIONS_PER_DISPATCH;
    while first_splat + progress.n_splats < end && iterations > 0u {
        let i = first_splat + progress.n_splats;
        let record = record_indices[i];
        let first = reaches[i] & vec2(0xffffu);
        let last = reaches[i] >> vec2(16u);
        let size = last - first + 1u;
        let stop = min(size.x * size.y, progress.n_tiles + iterations);
        iterations -= min(iterations, stop - progress.n_tiles + 1u);
        var at = first + vec2(progress.n_tiles % size.x, progress.n_tiles / size.x);
        for (; progress.n_tiles < stop; progress.n_tiles++) {
            let tile = at.y * tiles.n_tiles.x + at.x;
            let in_segment = run_ends[tile * N_RUNS + run];
            run_ends[tile * N_RUNS + run] = in_segment + 1u;
            let position = segments[tile / TILES_PER_SEGMENT] + in_segment;
            // Lists that do not fit are not blended; only writes out of bounds must not happen.
            if position < tiles.capacity {
                entries[position] = record;
            }
            at = select(vec2(at.x + 1u, at.y), vec2(first.x, at.y + 1u), at.x == last.x);
        }
        if stop == size.x * size.y {
            progress = RunProgress(progress.n_splats + 1u, 0u);
        }
    }
    written[run] = progress;
}
