// Writes the draw of a slice: all have equally many splats, and the last one fewer. One invocation.

@group(0) @binding(0) var<storage, read> counts: SplatCounts;
@group(0) @binding(1) var<storage, read_write> commands: SplatCommands;

@compute @workgroup_size(1)
fn splat_slices_commands() {
    commands = SplatCommands(0u, 1u, 1u, 0u, 4u, slice_length(counts.n_visible), 0u, 0u);
}
