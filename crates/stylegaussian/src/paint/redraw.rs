//! Detail of a picture that changes under strokes that stay: the steps that kernels take, and their twin.
//!
//! A seed's place is a spot of the picture, so another picture needs no other places, only another texture. It
//! is made as that of a [`Canvas`](super::Canvas), at the size at which the first one was read, so that strokes
//! keep their size.

use std::sync::Arc;

use glam::Vec2;

use super::{canvas, detail, painting::Paint, picture};
use crate::strokes::StrokeTexture;

pub use super::{
    detail::{FINEST, FLOOR, LEAST_TYPICAL, LOCAL, WHITEN, WHITENED},
    picture::{SHRUNK, copy_steps, reach},
};

/// Standard deviation over which local energy is measured, in pixels of the picture of energies, which is a
/// quarter as large.
pub const AROUND: f32 = detail::AROUND / 4.0;

/// The standard deviation by which a picture of `from` pixels is blurred before it is read at `to` pixels, or
/// `None` if it need not be.
pub fn softening(from: [u32; 2], to: [u32; 2]) -> Option<f32> {
    let size = |[width, height]: [u32; 2]| Vec2::new(width as f32, height as f32);
    picture::softening(size(from) / size(to))
}

/// An image of `width` x `height` pixels as a painting: display-referred RGB and alpha, not premultiplied
/// `[height, width]`, over white. One that is larger than a painting is shrunk: each pixel is the mean of its
/// area, as a frame has no time for more. The kernel is `paint_read`.
///
/// # Panics
/// If there is another number of pixels.
pub fn read(width: u32, height: u32, rgba: &[[f32; 4]]) -> Paint {
    assert_eq!(rgba.len(), width as usize * height as usize, "one color per pixel");
    let (columns, rows) = Paint::size_of(width, height);
    let step = [width as f32 / columns as f32, height as f32 / rows as f32];
    let mut rgb = Vec::with_capacity(3 * columns as usize * rows as usize);
    for i in 0..columns * rows {
        let [across, down] = [(i % columns, step[0], width), (i / columns, step[1], height)]
            .map(|(at, step, side)| covered(at, step, side));
        let (mut sum, mut area) = ([0.0; 3], 0.0);
        for (y, high) in down.clone() {
            for (x, wide) in across.clone() {
                let [r, g, b, alpha] = rgba[(y * width + x) as usize].map(within);
                for (sum, color) in sum.iter_mut().zip([r, g, b]) {
                    *sum += wide * high * (color * alpha + 1.0 - alpha);
                }
                area += wide * high;
            }
        }
        rgb.extend(sum.map(|sum| sum / area));
    }
    Paint::new(columns as usize, rows as usize, &rgb)
}

/// A number within 0..1; 0 if it is none.
fn within(value: f32) -> f32 {
    if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) }
}

/// The old pixels along a side of `side` that the new pixel `at` covers, which is `step` old ones wide, and how
/// much of each.
fn covered(at: u32, step: f32, side: u32) -> impl Iterator<Item = (u32, f32)> + Clone {
    let (low, high) = (at as f32 * step, (at + 1) as f32 * step);
    let first = (low as u32).min(side - 1);
    // In floats the last pixel may end beside the last old one.
    let end = (high.ceil() as u32).clamp(first + 1, side);
    (first..end).map(move |i| (i, high.min((i + 1) as f32) - low.max(i as f32)))
}

/// The texture of a painting's detail, if it is read at a size: see
/// [`Canvas::reading_size`](super::Canvas::reading_size). The kernels, for which all of it is used, are
/// `paint_resize`, `paint_halve`, `paint_blur`, `paint_squares`, `paint_sum`, `paint_detail` and `paint_level`.
pub fn redrawn(paint: &Paint, size: [u32; 2]) -> Arc<StrokeTexture> {
    canvas::texture_at(paint, size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{paint::Canvas, random::Random};

    #[test]
    fn small_images_are_read_as_they_are_and_over_white() {
        let rgba =
            [[0.2, 0.4, 0.6, 1.0], [0.0, 0.5, 1.0, 0.5], [2.0, -1.0, f32::NAN, 1.0], [0.3, 0.3, 0.3, 0.0]];
        let paint = read(2, 2, &rgba);
        assert_eq!((paint.width, paint.height), (2, 2));
        assert_eq!(paint.pixels, [51, 102, 153, 128, 191, 255, 255, 0, 0, 255, 255, 255]);
    }

    #[test]
    fn large_images_become_means_of_areas() {
        // 768 columns become 627, and 512 rows 418: 1.2249 old pixels to a new one.
        let (width, height) = (768, 512);
        let ramp = |i: u32| [(i % width) as f32 / 767.0, (i / width % 2) as f32, 0.25, 1.0];
        let rgba: Vec<_> = (0..width * height).map(ramp).collect();
        let paint = read(width, height, &rgba);
        assert_eq!((paint.width, paint.height), (627, 418));
        let pixel = |x: usize, y: usize| -> [u8; 3] { paint.pixels.as_chunks().0[y * 627 + x] };
        let [width, height] = [768.0 / 627.0, 512.0 / 418.0];
        // Column 300 covers 367.46 to 368.69; its middle is at 368.08 - 0.5 on the ramp.
        assert_eq!(pixel(300, 10)[0], (255.0_f32 * (300.5 * width - 0.5) / 767.0).round() as u8);
        // Row 0 covers all of row 0, which is 0, and a part of row 1.
        assert_eq!(pixel(5, 0)[1], (255.0 * (height - 1.0) / height).round() as u8);
        assert_eq!(pixel(626, 417)[2], 64);
    }

    #[test]
    fn a_canvas_that_is_read_again_keeps_its_size_and_has_the_texture_of_the_kernels() {
        let mut random = Random::new(5);
        let mut paint = |width: usize, height: usize| {
            let pixels = (0..3 * width * height).map(|_| random.below(256) as u8).collect();
            Paint { width, height, pixels, used: None }
        };
        let (first, other) = (paint(90, 60), paint(40, 80));
        let canvas = Canvas::new(&first);
        let again = canvas.reread(&other);
        assert_eq!(again.reading_size(), canvas.reading_size());
        assert_eq!(*again.texture(), redrawn(&other, canvas.reading_size()));
        assert_eq!(*canvas.reread(&first).texture(), *canvas.texture());
    }
}
