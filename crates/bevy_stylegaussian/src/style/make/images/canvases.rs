//! Canvases of images: paintings that are prepared for painting any scene. They are made by the first style
//! that needs them, and kept as long as the image. No encoder takes part.

use std::sync::{Arc, OnceLock};

use bevy::{platform::collections::HashMap, prelude::*, render::render_resource::TextureFormat};
use stylegaussian::{paint::Paint, recolor::ColorMoments, work::Work};
use stylegaussian_encoder::{image::DynamicImage, paint_of_if_wanted};

use super::pixels::{decoded, over_white, pixels};
use crate::style::{
    make::{
        first::{palette_of, palette_of_paint},
        later::{Crop, Failure, Later, Stretched, image_name, later, stretched},
        worker::{self, Painting},
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

impl ImageCanvas {
    /// A canvas that the first style makes that needs it.
    fn new(
        palette: Option<ColorMoments>,
        make: impl Fn(&OnceLock<ColorMoments>, &Work) -> Result<Stretched, Failure> + Send + 'static,
    ) -> Self {
        let palette = Arc::new(palette.map_or_else(OnceLock::new, OnceLock::from));
        let of_canvas = Arc::clone(&palette);
        let canvas = later(move |work: &Work| make(&of_canvas, work));
        Self { palette, canvas }
    }
}

impl ImageCanvases {
    /// The canvas of a loaded image, or of a part of it. `is_living` is whether strokes follow the image.
    pub(crate) fn get(
        &mut self,
        handle: &Handle<Image>,
        crop: Option<Crop>,
        image: &Image,
        is_living: bool,
    ) -> Later<Stretched> {
        let stretch = || {
            let (name, pixels) = (image_name(handle), pixels(image));
            // That of a part comes with its canvas.
            let at_once = if crop.is_none() { palette_at_once(image) } else { None };
            ImageCanvas::new(at_once, move |palette, work| match &pixels {
                Ok(image) => of_image(&name, crop, image, is_living, palette, work),
                Err(found) => Err(StyleError::Image { image: name.clone(), found: found.clone() }.into()),
            })
        };
        Arc::clone(&self.0.entry((handle.id(), crop)).or_insert_with(stretch).canvas)
    }

    /// The canvas of a whole image that there is one of already.
    pub(super) fn known(&self, id: AssetId<Image>) -> Option<Later<Stretched>> {
        self.0.get(&(id, None)).map(|known| Arc::clone(&known.canvas))
    }

    /// Whether there is a canvas of a whole image that strokes may follow, or one on its way.
    pub(super) fn may_be_followed(&self, id: AssetId<Image>) -> bool {
        let known = self.0.get(&(id, None));
        known.is_some_and(|known| known.canvas.known().is_none_or(|_| self.followed(id).is_some()))
    }

    /// The canvas of a whole image, or the reason why there is none, once a style has asked for it.
    pub(super) fn made(&self, id: AssetId<Image>) -> Option<&Result<Stretched, Arc<StyleError>>> {
        self.0.get(&(id, None))?.canvas.known()
    }

    /// The canvas of a whole image, if strokes may follow it: all of it is used, as the GPU reads all of it.
    pub(crate) fn followed(&self, id: AssetId<Image>) -> Option<&Arc<Painting>> {
        self.made(id)?.as_ref().ok().filter(|canvas| canvas.is_whole())
    }

    /// Forgets the canvases of an image and of its parts.
    pub(crate) fn forget(&mut self, id: AssetId<Image>) {
        self.0.retain(|(image, _), _| *image != id);
    }

    /// Forgets the canvases of an image's parts.
    pub(super) fn forget_parts(&mut self, id: AssetId<Image>) {
        self.0.retain(|(image, crop), _| *image != id || crop.is_none());
    }

    /// Sets the pixels of an image that are on the GPU alone.
    pub(super) fn insert(&mut self, id: AssetId<Image>, paint: Arc<Paint>) {
        let palette = palette_of_paint(&paint);
        let canvas =
            ImageCanvas::new(Some(palette), move |_, work| Ok(Arc::new(worker::followed(&paint, work)?)));
        self.0.insert((id, None), canvas);
    }

    /// The palette of an image that was asked for by [`Self::get`], or `None` if it is not known yet.
    pub(crate) fn palette(&self, handle: &Handle<Image>, crop: Option<Crop>) -> Option<ColorMoments> {
        self.0.get(&(handle.id(), crop))?.palette.get().copied()
    }
}

/// Prepares an image. Takes a while: not for the main thread. Its palette is set first.
fn of_image(
    name: &str,
    crop: Option<Crop>,
    image: &DynamicImage,
    is_living: bool,
    palette: &OnceLock<ColorMoments>,
    work: &Work,
) -> Result<Stretched, Failure> {
    // Of large images. Of others, the last part takes almost all of the time.
    let [decoding, shrinking, rest] = [(0.0, 0.2), (0.2, 0.6), (0.6, 1.0)].map(|(a, b)| work.part(a, b));
    let image = decoded(name, image, crop, &decoding)?;
    let paint = match is_living {
        true => over_white(image, &shrinking)?,
        false => paint_of_if_wanted(&image, &shrinking)?,
    };
    palette.get_or_init(|| palette_of_paint(&paint));
    // Strokes know what they follow by its canvas.
    if is_living && paint.is_usable() {
        return Ok(Arc::new(worker::followed(&paint, &rest)?));
    }
    stretched(name, &paint, &rest)
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
        let decoded = decoded("a", &pixels(&rgba).unwrap(), None, &Work::default()).unwrap();
        let later = palette_of(decoded.rgb.as_chunks().0, |pixel| *pixel);
        // The map from one to the other changes nothing.
        let same = Recoloring::new(&at_once, &later).color([0.2, 0.5, 0.7]);
        assert!(same.iter().zip([0.2, 0.5, 0.7]).all(|(a, b)| (a - b).abs() < 1e-4), "{same:?}");
        let floats = image(TextureFormat::R32Float, data);
        assert!(palette_at_once(&floats).is_none());
    }
}
