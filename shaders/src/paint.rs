//! The shaders that make the strokes of a painting anew, when its image changes.

use bytemuck::{Pod, Zeroable};
use stylegaussian::{paint::redraw, palette::LUMINANCE};

use crate::{Layout, Source, constants, float_constants, layout};

/// Invocations along a side of a workgroup.
pub const PAINT_SIDE: u32 = 8;
/// Pixels of a row or column that an invocation of `paint_blur` blurs.
pub const PAINT_BLURRED: u32 = 4;
/// Invocations in a workgroup of `paint_sum`.
pub const PAINT_SUM_WORKGROUP: u32 = 256;
/// Pixels that a workgroup of `paint_sum` sums up: four for each invocation. Two steps then suffice for a
/// million pixels, more than a painting has.
pub const PAINT_SUMMED: u32 = 1024;

/// A picture in the buffer of pictures.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PaintPicture {
    /// Its first pixel.
    pub first: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Its sides, as shares of those of the picture that it is a copy of.
    pub shrunk: f32,
}

/// One step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PaintStep {
    /// The picture that is read.
    pub input: PaintPicture,
    /// The picture that is written.
    pub output: PaintPicture,
    /// The painting.
    pub original: PaintPicture,
    /// Energies of detail around each pixel.
    pub around: PaintPicture,
    /// Copies of the painting at the size at which it is read: itself, by 1, 4 and 24 pixels blurred.
    pub copies: [PaintPicture; 4],
    /// Standard deviation of a blur, in pixels.
    pub sigma: f32,
    /// Pixels on each side that it reads.
    pub reach: u32,
    /// 0 for a blur along rows, 1 for one along columns. 0 for fine detail, 1 for wide detail.
    pub which: u32,
    /// First packed texel, or the number of channels of an image.
    pub packed: u32,
    /// Packed texels to a row.
    pub stride: u32,
    /// Where the sum of the painting's pixels is, and behind it that of the energies.
    pub sums: u32,
    /// Whether the image's colors are linear.
    pub is_linear: u32,
    /// Unused.
    pub padding: u32,
}

/// A kernel from the constants of the CPU twin, the pictures, and its own file.
fn source(label: &'static str, kernel: &str) -> Source {
    let integers = constants(&[
        ("PAINT_SIDE", PAINT_SIDE),
        ("PAINT_BLURRED", PAINT_BLURRED),
        ("PAINT_SUM_WORKGROUP", PAINT_SUM_WORKGROUP),
        ("PAINT_SUMMED", PAINT_SUMMED),
    ]);
    let floats = float_constants(&[
        ("FINEST", redraw::FINEST),
        ("LOCAL", redraw::LOCAL),
        ("WHITEN", redraw::WHITEN),
        ("LEAST_WHITENED", redraw::WHITENED.0),
        ("MOST_WHITENED", redraw::WHITENED.1),
        ("FLOOR", redraw::FLOOR),
        ("LEAST_TYPICAL", redraw::LEAST_TYPICAL),
        ("LUMINANCE_R", LUMINANCE.x),
        ("LUMINANCE_G", LUMINANCE.y),
        ("LUMINANCE_B", LUMINANCE.z),
    ]);
    let wgsl = [&integers, &floats, include_str!("../wgsl/paint_pictures.wgsl"), kernel].join("\n");
    Source { label, wgsl }
}

/// Reads an image.
pub fn paint_read() -> Source {
    source("paint_read", include_str!("../wgsl/paint_read.wgsl"))
}

/// Reads a picture at another size.
pub fn paint_resize() -> Source {
    source("paint_resize", include_str!("../wgsl/paint_resize.wgsl"))
}

/// Halves a picture.
pub fn paint_halve() -> Source {
    source("paint_halve", include_str!("../wgsl/paint_halve.wgsl"))
}

/// Blurs a picture along one axis.
pub fn paint_blur() -> Source {
    source("paint_blur", include_str!("../wgsl/paint_blur.wgsl"))
}

/// Squares the detail of a picture.
pub fn paint_squares() -> Source {
    source("paint_squares", include_str!("../wgsl/paint_squares.wgsl"))
}

/// Sums up a picture.
pub fn paint_sum() -> Source {
    source("paint_sum", include_str!("../wgsl/paint_sum.wgsl"))
}

/// Makes fine or wide detail.
pub fn paint_detail() -> Source {
    source("paint_detail", include_str!("../wgsl/paint_detail.wgsl"))
}

/// Packs a level of a texture, and makes the next.
pub fn paint_level() -> Source {
    source("paint_level", include_str!("../wgsl/paint_level.wgsl"))
}

/// Every joined source.
pub fn sources() -> Vec<Source> {
    vec![
        paint_read(),
        paint_resize(),
        paint_halve(),
        paint_blur(),
        paint_squares(),
        paint_sum(),
        paint_detail(),
        paint_level(),
    ]
}

/// Every struct that the shaders share with Rust.
pub fn layouts() -> Vec<Layout> {
    vec![
        layout!(PaintPicture { first, width, height, shrunk }),
        layout!(PaintStep {
            input,
            output,
            original,
            around,
            copies,
            sigma,
            reach,
            which,
            packed,
            stride,
            sums,
            is_linear,
            padding,
        }),
    ]
}
