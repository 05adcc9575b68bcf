//! 8-bit pictures of rendered views, and PNG files of them.

use std::path::Path;

use glam::UVec2;
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use stylegaussian::{
    Camera, Scene,
    paint::Painted,
    splat::{Colors, RenderedImage, render, render_strokes},
    strokes::StrokeKnobs,
};
use stylegaussian_encoder::Image;
use stylegaussian_files::write_atomically;

use crate::error::{Context, TrainError};

/// Draws `scene` in the colors of `painted`, with the strokes over them if there are any.
///
/// # Panics
/// If `painted` holds another number of colors than the scene has Gaussians.
pub fn draw(scene: &Scene, painted: &Painted, camera: &Camera) -> RenderedImage {
    let colors = Colors::Rgb(&painted.colors);
    match painted.strokes.seeds[..] {
        [] => render(scene, colors, camera),
        _ => render_strokes(scene, colors, (&painted.strokes, &StrokeKnobs::DEFAULT), camera, None),
    }
}

/// The background of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Background {
    /// No background: the picture keeps its alpha.
    Transparent,
    /// One display-referred RGB color.
    Color([u8; 3]),
}

/// An 8-bit picture: display-referred sRGB with straight alpha.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width and height, in pixels.
    pub size: UVec2,
    /// Row-major RGBA `[H, W]`, from the top left.
    pub rgba: Vec<[u8; 4]>,
}

impl Picture {
    /// A picture of one color.
    pub fn filled(size: UVec2, rgba: [u8; 4]) -> Self {
        Self { size, rgba: vec![rgba; size.x as usize * size.y as usize] }
    }

    /// The picture of a view over `background`. Colors out of range are clamped, after division by alpha.
    pub fn of(view: &RenderedImage, background: Background) -> Self {
        let pixel = |(color, &alpha): (&[f32; 3], &f32)| match background {
            Background::Transparent if alpha <= 0.0 => [0; 4],
            Background::Transparent => {
                let [r, g, b] = color.map(|channel| to_byte(channel / alpha));
                [r, g, b, to_byte(alpha)]
            }
            Background::Color(behind) => {
                let over = |i: usize| to_byte(color[i] + (1.0 - alpha) * f32::from(behind[i]) / 255.0);
                [over(0), over(1), over(2), 255]
            }
        };
        Self { size: view.size, rgba: view.color.iter().zip(&view.alpha).map(pixel).collect() }
    }

    /// An image as it is.
    pub fn of_image(image: &Image) -> Self {
        let opaque = |p: &[f32]| [to_byte(p[0]), to_byte(p[1]), to_byte(p[2]), 255];
        let rgba = image.rgb.chunks_exact(3).map(opaque).collect();
        Self { size: UVec2::new(image.width, image.height), rgba }
    }

    /// Copies `other` into this picture, its top left corner at `corner`; parts outside are cut off.
    pub fn paste(&mut self, other: &Self, corner: UVec2) {
        let width = other.size.x.min(self.size.x.saturating_sub(corner.x)) as usize;
        let height = other.size.y.min(self.size.y.saturating_sub(corner.y));
        if width == 0 {
            return;
        }
        for y in 0..height {
            let from = y as usize * other.size.x as usize;
            let to = (corner.y + y) as usize * self.size.x as usize + corner.x as usize;
            self.rgba[to..to + width].copy_from_slice(&other.rgba[from..from + width]);
        }
    }

    /// Writes a PNG atomically.
    ///
    /// # Errors
    /// If the file cannot be written. The message names it.
    pub fn write_png(&self, path: &Path) -> Result<(), TrainError> {
        let mut png = Vec::new();
        PngEncoder::new(&mut png)
            .write_image(self.rgba.as_flattened(), self.size.x, self.size.y, ExtendedColorType::Rgba8)
            .context(|| format!("{}: cannot encode the picture", path.display()))?;
        Ok(write_atomically(path, |out| out.write_all(&png))?)
    }
}

/// 0..1 to 0..255, rounded; NaN becomes 0.
fn to_byte(value: f32) -> u8 {
    // NaN passes through the clamp, and the cast makes it 0.
    (value * 255.0).round().clamp(0.0, 255.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(color: [f32; 3], alpha: f32) -> RenderedImage {
        RenderedImage { size: UVec2::ONE, color: vec![color], alpha: vec![alpha], depth: vec![0.0] }
    }

    #[track_caller]
    fn check(color: [f32; 3], alpha: f32, background: Background, expected: [u8; 4]) {
        assert_eq!(Picture::of(&view(color, alpha), background).rgba, [expected]);
    }

    #[test]
    fn alpha_is_straight() {
        check([0.25, 0.5, 0.0], 0.5, Background::Transparent, [128, 255, 0, 128]);
        check([0.0; 3], 0.0, Background::Transparent, [0, 0, 0, 0]);
        check([1.5, -0.5, 1.0], 1.0, Background::Transparent, [255, 0, 255, 255]);
    }

    #[test]
    fn a_background_fills_what_is_not_covered() {
        check([0.25, 0.5, 0.0], 0.5, Background::Color([255, 0, 51]), [191, 128, 26, 255]);
        check([0.0; 3], 0.0, Background::Color([1, 2, 3]), [1, 2, 3, 255]);
    }

    #[test]
    fn pasting_cuts_off_what_falls_outside() {
        let mut picture = Picture::filled(UVec2::new(2, 2), [0; 4]);
        picture.paste(&Picture::filled(UVec2::new(3, 3), [9; 4]), UVec2::new(1, 1));
        assert_eq!(picture.rgba, [[0; 4], [0; 4], [0; 4], [9; 4]]);
        picture.paste(&Picture::filled(UVec2::ONE, [5; 4]), UVec2::new(5, 0));
        assert_eq!(picture.rgba[1], [0; 4]);
    }
}
