// How many splats are visible, as the commands of everything that runs over them. One workgroup.

/// Arguments of the indirect commands.
struct SplatCommands {
    /// Workgroups of a kernel that runs over tiles of visible splats.
    n_tiles: u32,
    one_y: u32,
    one_z: u32,
    padding: u32,
    /// The draw: a strip of four corners for each visible splat.
    n_vertices: u32,
    n_instances: u32,
    first_vertex: u32,
    first_instance: u32,
}

@group(0) @binding(0) var<storage, read_write> counts: SplatCounts;
/// Keys with each digit `[digit]`, of the first pass.
@group(0) @binding(1) var<storage, read> digit_counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> commands: SplatCommands;

var<workgroup> n_visible: atomic<u32>;

@compute @workgroup_size(WORKGROUP)
fn splat_sort_counts(@builtin(local_invocation_index) lane: u32) {
    atomicAdd(&n_visible, digit_counts[lane]);
    workgroupBarrier();
    if lane == 0u {
        let n = atomicLoad(&n_visible);
        counts.n_visible = n;
        commands = SplatCommands((n + TILE - 1u) / TILE, 1u, 1u, 0u, 4u, n, 0u, 0u);
    }
}
