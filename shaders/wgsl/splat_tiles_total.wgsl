// Finds where each segment begins, and whether all lists fit. One invocation, for the 900 segments of a
// picture of 1280 x 720.

@group(0) @binding(0) var<uniform> tiles: SplatTiles;
@group(0) @binding(1) var<storage, read> counts: SplatCounts;
/// Entries of each segment; its start afterwards.
@group(0) @binding(2) var<storage, read_write> segments: array<u32>;
/// Progress of `splat_tiles_count` `[run]`.
@group(0) @binding(3) var<storage, read> counted: array<RunProgress>;
/// If the lists fit, the workgroups of `splat_tiles_blend` and no quad. Otherwise no workgroup and all quads.
@group(0) @binding(4) var<storage, read_write> commands: SplatCommands;

@compute @workgroup_size(1)
fn splat_tiles_total() {
    let n_tiles = tiles.n_tiles.x * tiles.n_tiles.y;
    var n_entries = 0u;
    // The length of an array is no uniform, as for `flags` of `splat_footprint`.
    let n_segments = min((n_tiles + TILES_PER_SEGMENT - 1u) / TILES_PER_SEGMENT, arrayLength(&segments));
    for (var i = 0u; i < n_segments; i++) {
        let n = segments[i];
        segments[i] = n_entries;
        n_entries += n;
    }
    var fits = n_entries <= tiles.capacity;
    // Counts of an unfinished run are incomplete.
    for (var run = 0u; run < N_RUNS; run++) {
        let n_splats = first_of_run(run + 1u, counts.n_visible) - first_of_run(run, counts.n_visible);
        fits = fits && counted[run].n_splats == n_splats;
    }
    let n_groups = (n_tiles + TILES_PER_WORKGROUP - 1u) / TILES_PER_WORKGROUP;
    commands = SplatCommands(
        select(0u, n_groups, fits), 1u, 1u, 0u,
        4u, select(counts.n_visible, 0u, fits), 0u, 0u,
    );
}
