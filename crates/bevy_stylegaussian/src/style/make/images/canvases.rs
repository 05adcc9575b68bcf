//! Canvases of images: paintings that are prepared for painting any scene. They are made by the first style
//! that needs them, and kept as long as the image. No encoder takes part.

use std::sync::{Arc, OnceLock};

use bevy::{platform::collections::HashMap, prelude::*, render::render_resource::TextureFormat};
use stylegaussian::{
    paint::{Canvas, Paint},
    recolor::ColorMoments,
};
use stylegaussian_encoder::paint_of;

use super::pixels::{decoded, pixels};
use crate::style::{
    make::{
        first::palette_of,
        later::{Later, Stretched, image_name, later},
    },
    wish::error::StyleError,
};

/// The canvas of each image that was painted with.
#[derive(Resource, Default)]
pub(crate) struct ImageCanvases(HashMap<AssetId<Image>, ImageCanvas>);

/// The canvas of an image.
struct ImageCanvas {
    /// Its palette, which is there at once or with the canvas.
    palette: Arc<OnceLock<ColorMoments>>,
    canvas: Later<Stretched>,
    /// The canvas once it is made.
    made: Arc<OnceLock<Stretched>>,
}

impl ImageCanvas {
    /// A canvas that the first style makes that needs it.
    fn new(
        palette: Option<ColorMoments>,
        make: impl FnOnce(&OnceLock<ColorMoments>) -> Stretched + Send + 'static,
    ) -> Self {
        let palette = Arc::new(palette.map_or_else(OnceLock::new, OnceLock::from));
        let made = Arc::new(OnceLock::new());
        let (of_canvas, known) = (Arc::clone(&palette), Arc::clone(&made));
        let canvas = later(move || known.get_or_init(|| make(&of_canvas)).clone());
        Self { palette, canvas, made }
    }
}

impl ImageCanvases {
    /// The canvas of a loaded image.
    pub(crate) fn get(&mut self, handle: &Handle<Image>, image: &Image) -> Later<Stretched> {
        let stretch = || {
            let (name, pixels) = (image_name(handle), pixels(image));
            ImageCanvas::new(palette_at_once(image), move |palette| match pixels {
                Ok(image) => stretched(name, image, palette),
                Err(found) => Err(Arc::new(StyleError::Image { image: name, found })),
            })
        };
        Arc::clone(&self.0.entry(handle.id()).or_insert_with(stretch).canvas)
    }

    /// The canvas of an image that there is one of already.
    pub(super) fn known(&self, id: AssetId<Image>) -> Option<Later<Stretched>> {
        self.0.get(&id).map(|known| Arc::clone(&known.canvas))
    }

    /// Whether there is a canvas of an image, or one on its way.
    pub(super) fn has(&self, id: AssetId<Image>) -> bool {
        self.0.contains_key(&id)
    }

    /// The canvas of an image, or the reason why there is none, once a style has asked for it.
    pub(crate) fn made(&self, id: AssetId<Image>) -> Option<&Stretched> {
        self.0.get(&id)?.made.get()
    }

    /// Forgets the canvas of an image.
    pub(super) fn forget(&mut self, id: AssetId<Image>) {
        self.0.remove(&id);
    }

    /// Sets the pixels of an image that are on the GPU alone.
    pub(super) fn insert(&mut self, id: AssetId<Image>, paint: Arc<Paint>) {
        let palette = palette_of(paint.pixels.as_chunks().0, |pixel: &[u8; 3]| {
            pixel.map(|byte| f32::from(byte) / 255.0)
        });
        self.0.insert(id, ImageCanvas::new(Some(palette), move |_| Ok(Arc::new(Canvas::new(&paint)))));
    }

    /// The palette of an image that was asked for by [`Self::get`], or `None` if it is not known yet.
    pub(crate) fn palette(&self, handle: &Handle<Image>) -> Option<ColorMoments> {
        self.0.get(&handle.id())?.palette.get().copied()
    }
}

/// Prepares an image. Takes a while: not for the main thread. Its palette is set first.
fn stretched(name: String, image: Image, palette: &OnceLock<ColorMoments>) -> Stretched {
    let image = decoded(name, image)?;
    palette.get_or_init(|| palette_of(image.rgb.as_chunks().0, |pixel| *pixel));
    Ok(Arc::new(Canvas::new(&paint_of(&image))))
}

/// The palette of an image whose pixels can be read as they are, which takes less than a millisecond.
fn palette_at_once(image: &Image) -> Option<ColorMoments> {
    let format = image.texture_descriptor.format;
    let data = image.data.as_ref()?;
    // Over white, as images are decoded.
    let over_white = |pixel: &[u8; 4]| {
        let [r, g, b, alpha] = pixel.map(|byte| f32::from(byte) / 255.0);
        [r, g, b].map(|color| color * alpha + 1.0 - alpha)
    };
    matches!(format, TextureFormat::Rgba8Unorm | TextureFormat::Rgba8UnormSrgb)
        .then(|| palette_of(data.as_chunks().0, over_white))
}

#[cfg(test)]
mod tests {
    use bevy::{
        asset::RenderAssetUsages,
        render::render_resource::{Extent3d, TextureDimension},
    };
    use stylegaussian::recolor::Recoloring;

    use super::*;

    #[test]
    fn the_palette_at_once_is_that_of_the_decoded_image() {
        let size = Extent3d { width: 40, height: 30, depth_or_array_layers: 1 };
        let data: Vec<u8> = (0..40 * 30 * 4).map(|i: u32| (i * i % 251) as u8).collect();
        let image =
            |format, data| Image::new(size, TextureDimension::D2, data, format, RenderAssetUsages::default());
        let rgba = image(TextureFormat::Rgba8UnormSrgb, data.clone());
        let at_once = palette_at_once(&rgba).unwrap();
        let decoded = decoded("a".into(), rgba).unwrap();
        let later = palette_of(decoded.rgb.as_chunks().0, |pixel| *pixel);
        // The map from one to the other changes nothing.
        let same = Recoloring::new(&at_once, &later).color([0.2, 0.5, 0.7]);
        assert!(same.iter().zip([0.2, 0.5, 0.7]).all(|(a, b)| (a - b).abs() < 1e-4), "{same:?}");
        let floats = image(TextureFormat::R32Float, data);
        assert!(palette_at_once(&floats).is_none());
    }
}
