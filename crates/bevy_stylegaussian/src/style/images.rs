//! Style statistics of images: encoded in the background, kept for as long as the image is.

use std::sync::Arc;

use bevy::{
    platform::collections::{HashMap, hash_map::Entry},
    prelude::*,
    render::render_resource::TextureFormat,
    tasks::{AsyncComputeTaskPool, Task, block_on, poll_once},
};
use stylegaussian::ChannelStatistics;
use stylegaussian_encoder::{EncoderError, StyleSize, style_statistics};

use super::{event::StyleError, settings::StyleEncoder};

/// What encoding an image gives. Errors are shared by all who ask.
type Encoded = Result<Arc<ChannelStatistics>, Arc<StyleError>>;

/// The statistics of each image that was ever asked for.
#[derive(Resource, Default)]
pub(super) struct ImageStatistics {
    of_image: HashMap<AssetId<Image>, Encoding>,
}

enum Encoding {
    Running(Task<Encoded>),
    Done(Encoded),
}

impl ImageStatistics {
    /// The statistics of a loaded image, or `None` while they are computed; the first call starts that.
    pub(super) fn get(
        &mut self,
        id: AssetId<Image>,
        name: impl FnOnce() -> String,
        image: &Image,
        encoder: &StyleEncoder,
    ) -> Option<Encoded> {
        let encoding = match self.of_image.entry(id) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => entry.insert(encode(name(), image, encoder)),
        };
        if let Encoding::Running(task) = encoding {
            *encoding = Encoding::Done(block_on(poll_once(task))?);
        }
        match encoding {
            Encoding::Done(encoded) => Some(encoded.clone()),
            Encoding::Running(_) => None,
        }
    }
}

/// Forgets the statistics of images that changed or went, and all of them when the encoder is another.
pub(super) fn forget_changed_images(
    mut events: MessageReader<AssetEvent<Image>>,
    encoder: Res<StyleEncoder>,
    mut statistics: ResMut<ImageStatistics>,
) {
    if encoder.is_changed() {
        statistics.of_image.clear();
    }
    for event in events.read() {
        if let AssetEvent::Modified { id } | AssetEvent::Removed { id } = event {
            statistics.of_image.remove(id);
        }
    }
}

/// Starts to encode an image.
fn encode(name: String, image: &Image, encoder: &StyleEncoder) -> Encoding {
    let image = match pixels(image) {
        Ok(image) => image,
        Err(found) => return Encoding::Done(Err(Arc::new(StyleError::Image { image: name, found }))),
    };
    let encoder = encoder.clone();
    Encoding::Running(AsyncComputeTaskPool::get().spawn(async move {
        let error = |source: Arc<EncoderError>| {
            Arc::new(match *source {
                EncoderError::NoEncoder => StyleError::NoEncoder,
                _ => StyleError::Encoder { image: name.clone(), source },
            })
        };
        let encoder = encoder.open().map_err(error)?;
        // Statistics of pixels as they stand in the file: values of an sRGB texture are display-referred already.
        let image = image.try_into_dynamic().map_err(|source| {
            Arc::new(StyleError::Image { image: name.clone(), found: source.to_string() })
        })?;
        let statistics = style_statistics(encoder, &image.into(), StyleSize::default());
        Ok(Arc::new(statistics.map_err(|source| error(Arc::new(source)))?))
    }))
}

/// A copy of the image to take to another thread.
///
/// # Errors
/// Says what it is, when it has no pixels here.
fn pixels(image: &Image) -> Result<Image, String> {
    if image.data.is_none() {
        return Err("it has no pixels in main memory (load it with RenderAssetUsages::MAIN_WORLD)".into());
    }
    let mut image = image.clone();
    // The same bytes, loaded for another use: a style is what a person sees in the file.
    if image.texture_descriptor.format == TextureFormat::Rgba8Unorm {
        image.texture_descriptor.format = TextureFormat::Rgba8UnormSrgb;
    }
    Ok(image)
}
