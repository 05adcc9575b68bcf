//! Eight style images of our own, painted by code, for the demo and its tests.
//!
//! Each painting is as far from the others as paintings can be, in palette and in texture at the scale of
//! 5 to 40 pixels, which is what style statistics see. The same pixels come out on every machine.

pub mod canvas;
pub mod noise;
pub mod paintings;
pub mod shapes;

pub use canvas::{Canvas, SIZE};

/// A painting: its file stem and the function that paints it.
#[derive(Clone, Copy, Debug)]
pub struct Painting {
    /// Short lower-case name, also the stem of its file.
    pub name: &'static str,
    /// Paints it, the same each time.
    pub paint: fn() -> Canvas,
}

/// All eight, in the order in which they are shown.
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
