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
    /// Whether each pixel may be used `[height, width]`: for places, and for the painting's colors. `None` if
    /// all may. If none may, there is nothing to paint with, and all are used.
    pub used: Option<Vec<bool>>,
}

/// A part of a painting that does not exist.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "found the area {left},{top} to {right},{bottom}, expected one of at least a pixel within 0,0 to 1,1 \
     (left,top to right,bottom)"
)]
pub struct AreaError {
    left: f32,
    top: f32,
    right: f32,
    bottom: f32,
}

/// The first and the last column and row, exclusive, of an area of an image of `size` pixels: left, top, right
/// and bottom edges. `area` has the same as shares of the sides, 0..1, which are rounded to edges of pixels.
///
/// # Errors
/// If the area is outside of the image, or holds no pixel.
pub fn pixels_of(area: [f32; 4], size: [usize; 2]) -> Result<[usize; 4], AreaError> {
    let [left, top, right, bottom] = area;
    let edges = [0, 1, 2, 3].map(|i| (area[i] * size[i % 2] as f32).round() as usize);
    match area.iter().all(|edge| (0.0..=1.0).contains(edge)) && edges[0] < edges[2] && edges[1] < edges[3] {
        true => Ok(edges),
        false => Err(AreaError { left, top, right, bottom }),
    }
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
        Self { width, height, pixels, used: None }
    }

    /// The same painting, of which only some pixels may be used `[height * width]`; `None` for all of them.
    ///
    /// # Panics
    /// If there is not one value per pixel.
    #[must_use]
    pub fn with_used(self, used: Option<Vec<bool>>) -> Self {
        assert!(used.as_ref().is_none_or(|used| 3 * used.len() == self.pixels.len()), "one value per pixel");
        // Bytes of paint do not depend on how its maker says that all of it is used.
        Self { used: used.filter(|used| used.contains(&false)), ..self }
    }

    /// Whether any pixel may be used.
    pub fn is_usable(&self) -> bool {
        self.used.as_ref().map_or(!self.pixels.is_empty(), |used| used.contains(&true))
    }

    /// The part of the painting in `area`: see [`pixels_of`].
    ///
    /// # Errors
    /// As those of [`pixels_of`].
    pub fn cropped(&self, area: [f32; 4]) -> Result<Self, AreaError> {
        let [left, top, right, bottom] = pixels_of(area, [self.width, self.height])?;
        let (rows, width) = (top..bottom, right - left);
        let pixels = rows.clone().flat_map(|y| &self.pixels[3 * (y * self.width + left)..][..3 * width]);
        let used = self.used.as_ref().map(|used| {
            rows.clone().flat_map(|y| &used[y * self.width + left..][..width]).copied().collect()
        });
        let pixels = pixels.copied().collect();
        Ok(Self { width, height: bottom - top, pixels, used: None }.with_used(used))
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
    fn a_crop_has_the_pixels_of_its_area() {
        let pixels = (0..3 * 12).collect();
        let used = (0..12).map(|i| i != 6).collect();
        let paint = Paint { width: 4, height: 3, pixels, used: Some(used) };
        let part = paint.cropped([0.5, 0.3, 1.0, 1.0]).unwrap();
        assert_eq!((part.width, part.height), (2, 2));
        assert_eq!(part.pixels, [18, 19, 20, 21, 22, 23, 30, 31, 32, 33, 34, 35]);
        assert_eq!(part.used, Some(vec![false, true, true, true]));
        assert_eq!(paint.cropped([0.0, 0.0, 1.0, 1.0]).unwrap(), paint);
        assert!(paint.cropped([0.0, 0.0, 0.5, 1.0]).unwrap().used.is_none());
        for bad in [[0.5, 0.0, 0.55, 1.0], [-0.1, 0.0, 1.0, 1.0], [0.0, f32::NAN, 1.0, 1.0]] {
            assert!(paint.cropped(bad).is_err(), "{bad:?}");
        }
    }

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
