// From how many to where: each count becomes the sum of those before it. One invocation.

/// Whether the lists have room, as arguments of indirect commands.
struct SplatCellCommands {
    /// Workgroups of `splat_cells_blend`: none where the lists do not fit.
    n_groups: u32,
    one_y: u32,
    one_z: u32,
    padding: u32,
    /// The draw by quads, for lists that do not fit: otherwise of none.
    n_vertices: u32,
    n_instances: u32,
    first_vertex: u32,
    first_instance: u32,
}

@group(0) @binding(0) var<uniform> cells: SplatCells;
@group(0) @binding(1) var<storage, read> counts: SplatCounts;
@group(0) @binding(2) var<storage, read_write> run_counts: array<u32>;
@group(0) @binding(3) var<storage, read_write> commands: SplatCellCommands;

@compute @workgroup_size(1)
fn splat_cells_scan() {
    let n_cells = cells.n_cells.x * cells.n_cells.y;
    var n_entries = 0u;
    for (var i = 0u; i < n_cells * N_RUNS; i++) {
        let n = run_counts[i];
        run_counts[i] = n_entries;
        n_entries += n;
    }
    let fits = n_entries <= cells.capacity;
    let n_groups = (n_cells + CELLS_OF_GROUP - 1u) / CELLS_OF_GROUP;
    commands = SplatCellCommands(
        select(0u, n_groups, fits), 1u, 1u, 0u,
        4u, select(counts.n_visible, 0u, fits), 0u, 0u,
    );
}
