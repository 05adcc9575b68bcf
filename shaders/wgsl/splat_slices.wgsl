// Iso depths by quads. Blending cannot remember the splat behind which the light falls under the threshold, so
// the sorted splats are drawn in slices of equally many, from the nearest on. Within a slice they blend front
// to back into moments of depth: the sums of the weights, and of the weights times u and u^2, with u the binary
// logarithm of the depth of the slice's first splat over their own. Between slices, `splat_slices_cross` finds
// the pixels whose light the slice brings under the threshold.

/// Splats of a slice.
fn slice_length(n_visible: u32) -> u32 {
    return (n_visible + N_SLICES - 1u) / N_SLICES;
}

/// Depths that are 0 have no logarithm: no depth is nearer to it than this.
const FARTHEST_DEPTH: f32 = 1e-9;
