//! The part of a painting that a style carries.

use glam::Vec3;

use super::picture::Picture;

/// Most pixels of a painting: 512 x 512, as AdaIN sees it. In bytes it takes 768 KiB.
pub const MAX_PIXELS: usize = 512 * 512;

/// A painting's pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Paint {
    /// Columns.
    pub width: usize,
    /// Rows, from the top.
    pub height: usize,
    /// Display-referred RGB, row-major `[height, width, 3]`, at most [`MAX_PIXELS`] pixels.
    pub pixels: Vec<u8>,
}

impl Paint {
    /// The columns and rows at which a painting of `width` x `height` pixels is kept: shrunk to at most
    /// [`MAX_PIXELS`] with its proportions, and never enlarged.
    pub fn size_of(width: u32, height: u32) -> (u32, u32) {
        let n_pixels = f64::from(width) * f64::from(height);
        let factor = (MAX_PIXELS as f64 / n_pixels).sqrt();
        if factor >= 1.0 {
            return (width, height);
        }
        // Rounded down, because two sides rounded up could exceed the limit. A line keeps one pixel of width.
        let shrink = |side: u32| ((f64::from(side) * factor) as u32).clamp(1, MAX_PIXELS as u32);
        (shrink(width), shrink(height))
    }

    /// A painting of display-referred RGB 0..1, row-major `[height, width, 3]`.
    pub fn new(width: usize, height: usize, rgb: &[f32]) -> Self {
        // The cast saturates, and makes 0 of NaN.
        let pixels = rgb.iter().map(|value| (value * 255.0).round() as u8).collect();
        Self { width, height, pixels }
    }

    /// It as a picture of colors 0..1.
    pub(super) fn picture(&self) -> Picture {
        let color = |p: &[u8; 3]| Vec3::from(p.map(f32::from)) / 255.0;
        let values = self.pixels.as_chunks().0.iter().map(color).collect();
        Picture { width: self.width, height: self.height, values }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paintings_are_kept_below_the_limit() {
        assert_eq!(Paint::size_of(512, 512), (512, 512));
        assert_eq!(Paint::size_of(2048, 512), (1024, 256));
        assert_eq!(Paint::size_of(3, 7), (3, 7));
        for (width, height) in [(16_000, 40), (1000, 741), (16_384, 4096), (1 << 20, 1), (1, 1 << 20)] {
            let (width, height) = Paint::size_of(width, height);
            assert!(
                width as usize * height as usize <= MAX_PIXELS && width.min(height) > 0,
                "{width}x{height}"
            );
        }
    }
}
