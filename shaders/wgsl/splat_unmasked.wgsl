// Clouds without a mask, for `splat_project` and `splat_cores`.

/// The opacity of a chunk's Gaussian with its mask.
fn shown_opacity(opacity: f32, index: u32) -> f32 {
    return opacity;
}
