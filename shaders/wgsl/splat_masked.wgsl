// Clouds that a mask hides or crops, for `splat_project` and `splat_cores`. CPU twin:
// `stylegaussian::mask::Visibility`.

/// Four channels of 8 bits per Gaussian, the first in the low bits.
@group(1) @binding(3) var<storage, read> mask: array<u32>;

/// The opacity of a chunk's Gaussian with its mask.
fn shown_opacity(opacity: f32, index: u32) -> f32 {
    let weights = mask[chunk.first_gaussian + index];
    let weight = f32((weights >> chunk.mask_shift) & 0xffu) / 255.0;
    return opacity * select(1.0 - weight, weight, (flags() & CROPPED) != 0u);
}
