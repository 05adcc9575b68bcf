//! A layer of colors and strokes.

use stylegaussian::{layers::Region, strokes::StrokeFactors};

use crate::{colors::GaussianColors, mask::GaussianMask, strokes::GaussianStrokes};

/// Colors and strokes in a region, or a change of the strokes below. The lowest layer comes first.
#[derive(Clone, Copy, Debug)]
pub struct GpuLayer<'a> {
    /// One color per Gaussian, or `None` for the captured colors.
    pub look: Option<&'a GaussianColors>,
    /// The look's strokes, or `None` if it has none: those below fade under it.
    pub strokes: Option<&'a GaussianStrokes>,
    /// The part of the scene that gets them.
    pub region: Region,
    /// Share of the colors below that is replaced within the region, 0..1.
    pub strength: f32,
    /// Painted weights, and the channel of them that counts here; `None` if all of the region counts.
    pub mask: Option<(&'a GaussianMask, u32)>,
    /// Changes of the strokes below, in place of colors and strokes of its own; else `None`.
    pub factors: Option<StrokeFactors>,
}
