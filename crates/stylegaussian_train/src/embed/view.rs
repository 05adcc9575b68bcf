//! Pictures to learn from: photos, or rendered views of the scene itself.

use std::path::PathBuf;

use glam::UVec2;
use stylegaussian::{
    Camera, Scene,
    splat::{Colors, render},
};
use stylegaussian_encoder::{Image, ImageError, image::MIN_SIDE};

/// Background of rendered views: white, as paper. Encoders see it in cells at the silhouette.
const BACKGROUND: f32 = 1.0;

/// Width and height of pictures are multiples of this, in pixels, so that relu3_1's cells of 4x4 pixels fill
/// them.
const SIZE_STEP: u32 = 4;

/// A picture of the scene from a known camera.
#[derive(Clone, Debug)]
pub struct TrainingView {
    /// A name for messages.
    pub name: String,
    /// The camera, at the size at which the picture is used.
    pub camera: Camera,
    /// The source of the picture.
    pub picture: Picture,
}

/// The source of a picture. Pictures are made on demand, so that hundreds of views need no memory.
#[derive(Clone, Debug)]
pub enum Picture {
    /// An image file.
    Photo(PathBuf),
    /// The scene itself, over white.
    Rendered,
}

impl TrainingView {
    /// A photo, scaled to `longer_side` pixels if it is larger.
    pub fn photo(path: PathBuf, camera: &Camera, longer_side: u32) -> Self {
        // Enlarging adds no detail, and costs time in proportion to the area.
        let longer_side = longer_side.min(camera.size.max_element());
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Self { name, camera: fitted(camera, longer_side), picture: Picture::Photo(path) }
    }

    /// The scene as seen by `camera`, with `longer_side` pixels on the longer side.
    pub fn rendered(name: String, camera: &Camera, longer_side: u32) -> Self {
        Self { name, camera: fitted(camera, longer_side), picture: Picture::Rendered }
    }

    /// The picture, at the camera's size.
    ///
    /// # Errors
    /// If a photo cannot be read.
    pub fn load(&self, scene: &Scene) -> Result<Image, ImageError> {
        let size = self.camera.size;
        match &self.picture {
            Picture::Photo(path) => Ok(Image::open(path)?.resized(size.x, size.y)),
            Picture::Rendered => {
                let view = render(scene, Colors::Captured, &self.camera);
                let over = |(color, alpha): (&[f32; 3], &f32)| {
                    // Colors are premultiplied. Spherical harmonics can leave 0..1, which no picture that an
                    // encoder learned from does.
                    color.map(|channel| (channel + (1.0 - alpha) * BACKGROUND).clamp(0.0, 1.0))
                };
                let rgb = view.color.iter().zip(&view.alpha).flat_map(over).collect();
                Ok(Image { width: size.x, height: size.y, rgb })
            }
        }
    }
}

/// The camera with `longer_side` pixels on its longer side, both sides rounded to [`SIZE_STEP`].
fn fitted(camera: &Camera, longer_side: u32) -> Camera {
    let factor = longer_side as f32 / camera.size.max_element() as f32;
    let fit = |pixels: u32| {
        let steps = (pixels as f32 * factor / SIZE_STEP as f32).round() as u32;
        // Very long pictures would otherwise have a side that the encoder refuses.
        (steps * SIZE_STEP).max(MIN_SIDE)
    };
    camera.resized(UVec2::new(fit(camera.size.x), fit(camera.size.y)))
}
