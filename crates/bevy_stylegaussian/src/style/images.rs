//! Style statistics and paint of images. They are computed in the background and kept as long as the image.

use std::sync::{Arc, OnceLock};

use bevy::{platform::collections::HashMap, prelude::*, render::render_resource::TextureFormat};
use stylegaussian::recolor::ColorMoments;
use stylegaussian_encoder::{StyleSize, painted_style};

use crate::background::Background;

use super::{
    asset::{ImageEncoder, StyleStatistics},
    error::StyleError,
    first::palette_of,
    settings::StyleEncoder,
};

/// Statistics and paint of an image. All entities that use the image share an error.
pub(super) type Encoded = Result<StyleStatistics, Arc<StyleError>>;

/// The statistics of each image that was used as a style.
#[derive(Resource, Default)]
pub(super) struct ImageStatistics {
    of_image: HashMap<AssetId<Image>, Encoding>,
}

/// An image on its way to statistics and paint.
struct Encoding {
    /// Its palette, which is there at once or long before the rest.
    palette: Arc<OnceLock<ColorMoments>>,
    encoded: Background<Encoded>,
}

impl ImageStatistics {
    /// The statistics of a loaded image, or `None` while they are computed. The first call starts the computation.
    pub(super) fn get(
        &mut self,
        handle: &Handle<Image>,
        image: &Image,
        encoder: &ImageEncoder,
    ) -> Option<Encoded> {
        let encode = || {
            let name = name(handle);
            let palette = Arc::new(palette_at_once(image).map_or_else(OnceLock::new, OnceLock::from));
            let of_task = Arc::clone(&palette);
            let encoded = match pixels(image) {
                Ok(image) => {
                    let encoder = encoder.clone();
                    // Never on this thread, not even if pipelines are synchronous: that switch is about drawing.
                    Background::spawn(move || encode(name, image, &encoder, &of_task))
                }
                // Kept like statistics, so that it is reported once for each request and not computed again.
                Err(found) => Background::Ready(Err(Arc::new(StyleError::Image { image: name, found }))),
            };
            Encoding { palette, encoded }
        };
        self.of_image.entry(handle.id()).or_insert_with(encode).encoded.poll().cloned()
    }

    /// The palette of an image that was asked for by [`Self::get`], or `None` if it is not known yet.
    pub(super) fn palette(&self, handle: &Handle<Image>) -> Option<ColorMoments> {
        self.of_image.get(&handle.id())?.palette.get().copied()
    }
}

/// Forgets the statistics of images that changed or went, and all of them if the encoder changed.
pub(super) fn forget_changed_images(
    mut images: MessageReader<AssetEvent<Image>>,
    mut encoders: MessageReader<AssetEvent<ImageEncoder>>,
    encoder: Res<StyleEncoder>,
    mut statistics: ResMut<ImageStatistics>,
) {
    let id = encoder.0.id();
    // Every event is read, so that none is left for the next frame.
    let asset_changed =
        encoders.read().filter(|event| event.is_added(id) || event.is_modified(id)).count() > 0;
    // Features of two encoders cannot be compared, so nothing that was computed is of use.
    if asset_changed || encoder.is_changed() {
        statistics.of_image.clear();
    }
    // `Added` is left out: an image has no statistics before it exists.
    for event in images.read() {
        if let AssetEvent::Modified { id } | AssetEvent::Removed { id } = event {
            statistics.of_image.remove(id);
        }
    }
}

/// Encodes an image. Takes a while: not for the main thread. Its palette is set first.
fn encode(name: String, image: Image, encoder: &ImageEncoder, palette: &OnceLock<ColorMoments>) -> Encoded {
    let image = decoded(name.clone(), image)?;
    palette.get_or_init(|| palette_of(image.rgb.as_chunks().0, |pixel| *pixel));
    let error = |source| Arc::new(StyleError::Encoder { image: name.clone(), source });
    let encoder = encoder.get().map_err(error)?;
    let style = painted_style(encoder, &image, StyleSize::default());
    let (statistics, paint) = style.map_err(|source| error(Arc::new(source)))?;
    Ok(StyleStatistics { statistics: Arc::new(statistics), paint: Some(Arc::new(paint)) })
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

/// The name of an image for messages.
pub(super) fn name(handle: &Handle<Image>) -> String {
    handle.path().map_or_else(|| "a style image".into(), ToString::to_string)
}

/// An image as the encoder takes it. Takes a while: not for the main thread.
///
/// # Errors
/// If the pixels are not of 8 bits.
pub(super) fn decoded(name: String, image: Image) -> Result<stylegaussian_encoder::Image, StyleError> {
    // The pixels are used as they are in the file: values of an sRGB texture are display-referred already.
    let image = image.try_into_dynamic();
    let image = image.map_err(|source| StyleError::Image { image: name, found: source.to_string() })?;
    Ok(image.into())
}

/// A copy of the image for a task.
///
/// # Errors
/// If it has no pixels in main memory. The message says so.
pub(super) fn pixels(image: &Image) -> Result<Image, String> {
    if image.data.is_none() {
        return Err("it has no pixels in main memory (load it with RenderAssetUsages::MAIN_WORLD)".into());
    }
    let mut image = image.clone();
    // An image loaded as linear data (`is_srgb = false`) has the same bytes. A style is what a person sees in the file.
    if image.texture_descriptor.format == TextureFormat::Rgba8Unorm {
        image.texture_descriptor.format = TextureFormat::Rgba8UnormSrgb;
    }
    Ok(image)
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
