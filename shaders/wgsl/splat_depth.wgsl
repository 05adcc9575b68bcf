// Iso depth: for each pixel the depth of the splat, front to back, behind which less than a threshold of the
// light passes. What its kernels share. CPU twin: `stylegaussian::splat::iso_depth`.
//
// Iso depths are kept in a buffer, one number for each pixel of the viewport: the depth (0..1, reverse z), and
// minus the light that passes (0..1) as long as that is not under the threshold.

/// The uniforms of all kernels.
struct SplatIso {
    /// Left, top, width and height of the viewport that splats are drawn in, in its own pixels.
    viewport: vec4<f32>,
    /// Left and top of the picture in the depth attachment, in pixels of that.
    place: vec2<f32>,
    /// Pixels of the attachment along a side of one of the viewport.
    step: f32,
    /// Share of the light, 0.02..1.
    threshold: f32,
    /// The slice that is drawn.
    slice: u32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

/// Where a pixel, counted from the corner of the viewport, is in the buffer.
fn place_of(pixel: vec2<u32>, iso: SplatIso) -> u32 {
    return pixel.y * u32(iso.viewport.z) + pixel.x;
}
