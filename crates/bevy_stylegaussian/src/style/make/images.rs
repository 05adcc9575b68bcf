//! Style statistics of images, which the decoder takes. They are computed in the background and kept as long as
//! the image.

use std::sync::Arc;

use bevy::{platform::collections::HashMap, prelude::*, render::render_resource::TextureFormat};
use stylegaussian::ChannelStatistics;
use stylegaussian_encoder::{StyleSize, style_statistics};

use crate::style::{
    make::canvases::{Later, later},
    wish::{
        asset::{ImageEncoder, StyleStatistics},
        error::StyleError,
        settings::StyleEncoder,
    },
};

/// Statistics of an image. All entities that use the image share an error.
pub(crate) type Encoded = Result<Arc<ChannelStatistics>, Arc<StyleError>>;

/// The statistics of each image that was decoded.
#[derive(Resource, Default)]
pub(crate) struct ImageStatistics {
    of_image: HashMap<AssetId<Image>, Later<Encoded>>,
    /// Those of presets, which are there already.
    of_preset: HashMap<AssetId<StyleStatistics>, (Arc<ChannelStatistics>, Later<Encoded>)>,
}

impl ImageStatistics {
    /// The statistics of a loaded image.
    pub(crate) fn of_image(
        &mut self,
        handle: &Handle<Image>,
        image: &Image,
        encoder: &ImageEncoder,
    ) -> Later<Encoded> {
        let encode = || {
            let (name, pixels, encoder) = (name(handle), pixels(image), encoder.clone());
            later(move || match pixels {
                Ok(image) => encode(name, image, &encoder),
                Err(found) => Err(Arc::new(StyleError::Image { image: name, found })),
            })
        };
        Arc::clone(self.of_image.entry(handle.id()).or_insert_with(encode))
    }

    /// The statistics of a preset: the same place in memory each time.
    pub(crate) fn of_preset(
        &mut self,
        handle: &Handle<StyleStatistics>,
        statistics: Arc<ChannelStatistics>,
    ) -> Later<Encoded> {
        let begin = || {
            let known = Arc::clone(&statistics);
            (Arc::clone(&statistics), later(move || Ok(known)))
        };
        let (of, known) = self.of_preset.entry(handle.id()).or_insert_with(begin);
        if !Arc::ptr_eq(of, &statistics) {
            (*of, *known) = begin();
        }
        Arc::clone(known)
    }
}

/// Forgets the statistics of images that changed or went, and all of them if the encoder changed.
pub(crate) fn forget_changed_images(
    mut images: MessageReader<AssetEvent<Image>>,
    mut presets: MessageReader<AssetEvent<StyleStatistics>>,
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
    for event in presets.read() {
        if let AssetEvent::Removed { id } = event {
            statistics.of_preset.remove(id);
        }
    }
    // `Added` is left out: an image has no statistics before it exists.
    for event in images.read() {
        if let AssetEvent::Modified { id } | AssetEvent::Removed { id } = event {
            statistics.of_image.remove(id);
        }
    }
}

/// Encodes an image. Takes a while: not for the main thread.
fn encode(name: String, image: Image, encoder: &ImageEncoder) -> Encoded {
    let image = decoded(name.clone(), image)?;
    let error = |source| Arc::new(StyleError::Encoder { image: name.clone(), source });
    let encoder = encoder.get().map_err(error)?;
    let statistics = style_statistics(encoder, &image, StyleSize::default());
    Ok(Arc::new(statistics.map_err(|source| error(Arc::new(source)))?))
}

/// The name of an image for messages.
pub(crate) fn name(handle: &Handle<Image>) -> String {
    handle.path().map_or_else(|| "a style image".into(), ToString::to_string)
}

/// An image as canvases and encoders take it. Takes a while: not for the main thread.
///
/// # Errors
/// If the pixels are not of 8 bits.
pub(crate) fn decoded(name: String, image: Image) -> Result<stylegaussian_encoder::Image, StyleError> {
    // The pixels are used as they are in the file: values of an sRGB texture are display-referred already.
    let image = image.try_into_dynamic();
    let image = image.map_err(|source| StyleError::Image { image: name, found: source.to_string() })?;
    Ok(image.into())
}

/// A copy of the image for a task.
///
/// # Errors
/// If it has no pixels in main memory. The message says so.
pub(crate) fn pixels(image: &Image) -> Result<Image, String> {
    if image.data.is_none() {
        return Err("it has no pixels in main memory (load it with RenderAssetUsages::MAIN_WORLD)".into());
    }
    let mut image = image.clone();
    // An image loaded as linear data (`is_srgb = false`) has the same bytes. A style is what a person sees in
    // the file.
    if image.texture_descriptor.format == TextureFormat::Rgba8Unorm {
        image.texture_descriptor.format = TextureFormat::Rgba8UnormSrgb;
    }
    Ok(image)
}
