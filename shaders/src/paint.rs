//! The shaders that make the strokes of a painting anew, when its image changes.

use bytemuck::{Pod, Zeroable};
use stylegaussian::{paint::redraw, palette::LUMINANCE};

use crate::{Source, constants, float_constants};

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

/// A kernel that works on pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaintStage {
    /// Reads an image.
    Read,
    /// Reads a picture at another size.
    Resize,
    /// Halves a picture.
    Halve,
    /// Blurs a picture along one axis.
    Blur,
    /// Squares the detail of a picture.
    Squares,
    /// Sums up a picture.
    Sum,
    /// Makes fine or wide detail.
    Detail,
    /// Packs a level of a texture, and makes the next.
    Level,
}

impl PaintStage {
    /// All of them, in order.
    pub const ALL: [Self; 8] = [
        Self::Read,
        Self::Resize,
        Self::Halve,
        Self::Blur,
        Self::Squares,
        Self::Sum,
        Self::Detail,
        Self::Level,
    ];

    /// The kernel: constants of the CPU twin, the pictures, and its own file.
    pub fn source(self) -> Source {
        let (label, kernel) = match self {
            Self::Read => ("paint_read", include_str!("../wgsl/paint_read.wgsl")),
            Self::Resize => ("paint_resize", include_str!("../wgsl/paint_resize.wgsl")),
            Self::Halve => ("paint_halve", include_str!("../wgsl/paint_halve.wgsl")),
            Self::Blur => ("paint_blur", include_str!("../wgsl/paint_blur.wgsl")),
            Self::Squares => ("paint_squares", include_str!("../wgsl/paint_squares.wgsl")),
            Self::Sum => ("paint_sum", include_str!("../wgsl/paint_sum.wgsl")),
            Self::Detail => ("paint_detail", include_str!("../wgsl/paint_detail.wgsl")),
            Self::Level => ("paint_level", include_str!("../wgsl/paint_level.wgsl")),
        };
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
}

/// Every joined source.
pub fn sources() -> Vec<Source> {
    PaintStage::ALL.map(PaintStage::source).into()
}
