// Counts the visible splats, and writes the commands of everything that runs over them. One workgroup.

@group(0) @binding(0) var<storage, read_write> counts: SplatCounts;
/// Keys with each digit `[digit]` in the first pass.
@group(0) @binding(1) var<storage, read> digit_counts: array<u32>;
/// A workgroup for each batch of visible splats, a quad for each of them.
@group(0) @binding(2) var<storage, read_write> commands: SplatCommands;

var<workgroup> n_visible: atomic<u32>;

@compute @workgroup_size(WORKGROUP)
fn splat_sort_counts(@builtin(local_invocation_index) lane: u32) {
    // Each visible splat has one digit, so the digits of the first pass count them all.
    atomicAdd(&n_visible, digit_counts[lane]);
    workgroupBarrier();
    // Every lane has added before one of them reads.
    if lane == 0u {
        let n = atomicLoad(&n_visible);
        counts.n_visible = n;
        commands = SplatCommands((n + SORT_BATCH - 1u) / SORT_BATCH, 1u, 1u, 0u, 4u, n, 0u, 0u);
    }
}
