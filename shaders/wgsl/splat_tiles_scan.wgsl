// Turns counts into positions within a segment, which holds the lists of a few consecutive tiles: each count
// becomes the sum of the counts before it. One invocation handles a segment.

@group(0) @binding(0) var<uniform> tiles: SplatTiles;
/// Counts in, positions out `[tile, run]`.
@group(0) @binding(1) var<storage, read_write> run_counts: array<u32>;
/// Entries of each segment.
@group(0) @binding(2) var<storage, read_write> segments: array<u32>;

@compute @workgroup_size(SOFTWARE_WORKGROUP)
fn splat_tiles_scan(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let n_counts = tiles.n_tiles.x * tiles.n_tiles.y * N_RUNS;
    let first = invocation.x * TILES_PER_SEGMENT * N_RUNS;
    if first >= n_counts {
        return;
    }
    let end = min(first + TILES_PER_SEGMENT * N_RUNS, n_counts);
    var n_entries = 0u;
    for (var i = first; i < end; i++) {
        let n = run_counts[i];
        run_counts[i] = n_entries;
        n_entries += n;
    }
    segments[invocation.x] = n_entries;
}
