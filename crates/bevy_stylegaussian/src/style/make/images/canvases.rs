//! Canvases of images: paintings that are prepared for painting any scene. They are made by the first style
//! that needs them, and kept as long as the image. No encoder takes part.

use std::sync::{Arc, OnceLock};

use bevy::{platform::collections::HashMap, prelude::*, render::render_resource::TextureFormat};
use stylegaussian::recolor::ColorMoments;
use stylegaussian_encoder::paint_of;

use super::pixels::{cropped, decoded, pixels};
use crate::style::{
    make::{
        first::{palette_of, palette_of_paint},
        later::{Crop, Later, Stretched, image_name, later, stretched},
    },
    wish::error::StyleError,
};

/// The canvas of each image that was painted with.
#[derive(Resource, Default)]
pub(crate) struct ImageCanvases(HashMap<(AssetId<Image>, Option<Crop>), ImageCanvas>);

/// The canvas of an image.
struct ImageCanvas {
    /// Its palette, which is there at once or with the canvas.
    palette: Arc<OnceLock<ColorMoments>>,
    canvas: Later<Stretched>,
}

impl ImageCanvases {
    /// The canvas of a loaded image, or of a part of it.
    pub(crate) fn get(
        &mut self,
        handle: &Handle<Image>,
        crop: Option<Crop>,
        image: &Image,
    ) -> Later<Stretched> {
        let stretch = || {
            let name = image_name(handle);
            // That of a part comes with its canvas.
            let at_once = if crop.is_none() { palette_at_once(image) } else { None };
            let palette = Arc::new(at_once.map_or_else(OnceLock::new, OnceLock::from));
            let of_canvas = Arc::clone(&palette);
            let pixels = pixels(image);
            let canvas = later(move || match pixels {
                Ok(image) => of_image(name, crop, image, &of_canvas),
                Err(found) => Err(Arc::new(StyleError::Image { image: name, found })),
            });
            ImageCanvas { palette, canvas }
        };
        Arc::clone(&self.0.entry((handle.id(), crop)).or_insert_with(stretch).canvas)
    }

    /// The palette of an image that was asked for by [`Self::get`], or `None` if it is not known yet.
    pub(crate) fn palette(&self, handle: &Handle<Image>, crop: Option<Crop>) -> Option<ColorMoments> {
        self.0.get(&(handle.id(), crop))?.palette.get().copied()
    }
}

/// Forgets the canvases of images that changed or went.
pub(crate) fn forget_changed_canvases(
    mut images: MessageReader<AssetEvent<Image>>,
    mut canvases: ResMut<ImageCanvases>,
) {
    // `Added` is left out: there is no canvas before the image exists.
    for event in images.read() {
        if let AssetEvent::Modified { id } | AssetEvent::Removed { id } = event {
            canvases.0.retain(|(image, _), _| image != id);
        }
    }
}

/// Prepares an image. Takes a while: not for the main thread. Its palette is set first.
fn of_image(name: String, crop: Option<Crop>, image: Image, palette: &OnceLock<ColorMoments>) -> Stretched {
    let image = cropped(&name, decoded(name.clone(), image)?, crop)?;
    let paint = paint_of(&image);
    palette.get_or_init(|| palette_of_paint(&paint));
    stretched(name, &paint)
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
    // Of what is transparent, no color is used: that takes a look at the whole image.
    let is_whole = data.as_chunks::<4>().0.iter().all(|pixel| pixel[3] >= 128);
    (is_whole && matches!(format, TextureFormat::Rgba8Unorm | TextureFormat::Rgba8UnormSrgb))
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
        // Opaque enough to be used, and not wholly.
        let byte = |i: u32| if i % 4 == 3 { 128 + (i % 128) as u8 } else { (i * i % 251) as u8 };
        let data: Vec<u8> = (0..40 * 30 * 4).map(byte).collect();
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
