// Clouds without a mask, for `splat_project` and `splat_cast`.

/// The opacity of a chunk's Gaussian as it is drawn.
fn shown_opacity(opacity: f32, index: u32) -> f32 {
    return opacity;
}
