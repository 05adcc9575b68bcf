//! Pictures to learn from: photos, or rendered views of the scene itself.

use std::path::PathBuf;

use glam::UVec2;
use stylegaussian::{
    Camera, Scene,
    splat::{Colors, render},
};
use stylegaussian_encoder::{
    Image, ImageError,
    image::{MIN_SIDE, Warned},
};

use crate::cameras::Distortion;

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
    Photo {
        /// The file.
        path: PathBuf,
        /// The camera before it was scaled. The photo has the proportions of its pictures, or of the lens.
        camera: Camera,
        /// The lens, if the camera is that of the photo without distortion.
        distortion: Option<Box<Distortion>>,
    },
    /// The scene itself, over white.
    Rendered,
}

impl TrainingView {
    /// A photo, scaled to `longer_side` pixels if it is larger. If it has a distortion, that is taken out.
    pub fn photo(path: PathBuf, camera: &Camera, distortion: Option<Distortion>, longer_side: u32) -> Self {
        // Enlarging adds no detail, and costs time in proportion to the area.
        let longer_side = longer_side.min(camera.size.max_element());
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Self {
            name,
            camera: fitted(camera, longer_side),
            picture: Picture::Photo { path, camera: camera.clone(), distortion: distortion.map(Box::new) },
        }
    }

    /// The scene as seen by `camera`, with `longer_side` pixels on the longer side.
    pub fn rendered(name: String, camera: &Camera, longer_side: u32) -> Self {
        Self { name, camera: fitted(camera, longer_side), picture: Picture::Rendered }
    }

    /// The picture, at the camera's size, with the warning if its file is damaged.
    ///
    /// # Errors
    /// If a photo cannot be read, or has other proportions than the camera's pictures.
    pub fn load(&self, scene: &Scene) -> Result<Warned, ImageError> {
        let size = self.camera.size;
        match &self.picture {
            Picture::Photo { path, camera, distortion } => {
                let of_photo = distortion.as_ref().map_or(camera.size, |lens| lens.size);
                let Warned { image, warning } = Image::open_photo(path, of_photo.into())?;
                let image = match distortion {
                    Some(lens) => lens.undistorted(&image, camera),
                    None => image,
                };
                Ok(Warned { image: image.resized(size.x, size.y), warning })
            }
            Picture::Rendered => {
                let view = render(scene, Colors::Captured, &self.camera);
                let over = |(color, alpha): (&[f32; 3], &f32)| {
                    // Colors are premultiplied. Spherical harmonics can leave 0..1, which no picture that an
                    // encoder learned from does.
                    color.map(|channel| (channel + (1.0 - alpha) * BACKGROUND).clamp(0.0, 1.0))
                };
                let rgb = view.color.iter().zip(&view.alpha).flat_map(over).collect();
                Ok(Warned { image: Image { width: size.x, height: size.y, rgb, alpha: None }, warning: None })
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

#[cfg(test)]
mod tests {
    use glam::{Affine3A, Vec2};
    use image::{Rgb, RgbImage};

    use super::*;

    fn camera(size: UVec2) -> Camera {
        let center = size.as_vec2() / 2.0;
        Camera {
            view_from_world: Affine3A::IDENTITY,
            focal: Vec2::splat(50.0),
            center,
            size,
            near: Camera::NEAR,
        }
    }

    /// Loads a photo of `photo` pixels, red on the left, of a camera of `size`.
    fn load(photo: UVec2, size: UVec2) -> Result<Image, ImageError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let red_left = |x, _| if x < photo.x / 2 { Rgb([255, 0, 0]) } else { Rgb([0, 0, 255]) };
        RgbImage::from_fn(photo.x, photo.y, red_left).save(&path).unwrap();
        let view = TrainingView::photo(path, &camera(size), None, 64);
        Ok(view.load(&Scene::default())?.image)
    }

    /// The proportions are those of the file's camera, and not of the view's, whose sides are multiples of 4.
    #[test]
    fn a_photo_fits_its_camera_at_any_scale() {
        for photo in [UVec2::new(50, 38), UVec2::new(25, 19), UVec2::new(100, 76), UVec2::new(12, 9)] {
            let image = load(photo, UVec2::new(50, 38)).unwrap();
            assert_eq!((image.width, image.height), (52, 40));
            assert!(image.rgb[0] > 0.9 && image.rgb[51 * 3] < 0.1);
        }
    }

    #[test]
    fn a_photo_of_other_proportions_is_refused() {
        for photo in [UVec2::new(38, 38), UVec2::new(38, 50), UVec2::new(50, 40)] {
            let error = load(photo, UVec2::new(50, 38)).unwrap_err().to_string();
            let expected = format!("the photo is {}x{} and its camera's picture 50x38", photo.x, photo.y);
            assert!(error.contains(&expected), "{error}");
        }
    }
}
