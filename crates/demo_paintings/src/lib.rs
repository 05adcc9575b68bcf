//! Eight style images, painted by code, for the demo and its tests.
//!
//! The paintings differ as much as possible in colors and in texture at the scale of 5 to 40 pixels, the scale
//! of style statistics. They are the same pixel for pixel on every machine.

pub mod canvas;
pub mod noise;
pub mod paintings;
pub mod shapes;

pub use canvas::{Canvas, SIZE};

/// A painting: its file stem and the function that paints it.
#[derive(Clone, Copy, Debug)]
pub struct Painting {
    /// Short name in lower case, also the stem of its file.
    pub name: &'static str,
    /// Paints it. Every call gives the same pixels.
    pub paint: fn() -> Canvas,
}

/// All eight paintings, in the order of the demo.
pub const PAINTINGS: [Painting; 8] = [
    Painting { name: "strokes", paint: paintings::strokes::paint },
    Painting { name: "dots", paint: paintings::dots::paint },
    Painting { name: "print", paint: paintings::print::paint },
    Painting { name: "cubist", paint: paintings::cubist::paint },
    Painting { name: "mosaic", paint: paintings::mosaic::paint },
    Painting { name: "ink", paint: paintings::ink::paint },
    Painting { name: "halftone", paint: paintings::halftone::paint },
    Painting { name: "watercolor", paint: paintings::watercolor::paint },
];
