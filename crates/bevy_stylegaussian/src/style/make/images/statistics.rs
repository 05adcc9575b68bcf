//! Style statistics of images, which the decoder takes. They are computed in the background and kept as long as
//! the image.

use std::sync::Arc;

use bevy::{platform::collections::HashMap, prelude::*};
use stylegaussian::work::Work;
use stylegaussian_encoder::{EncoderError, StyleSize, image::DynamicImage, style_statistics_if_wanted};

use super::{
    EncoderChanges,
    pixels::{decoded, pixels},
};
use crate::style::{
    make::later::{Crop, Encoded, Failure, Later, image_name, later},
    wish::{encoder::ImageEncoder, error::StyleError},
};

/// Share of encoding that reading the pixels of an image is said to take, which depends on its size.
const DECODING: f32 = 0.1;

/// The statistics of each image that was decoded.
#[derive(Resource, Default)]
pub(crate) struct ImageStatistics(HashMap<(AssetId<Image>, Option<Crop>), Later<Encoded>>);

impl ImageStatistics {
    /// The statistics of a loaded image.
    pub(crate) fn get(
        &mut self,
        handle: &Handle<Image>,
        crop: Option<Crop>,
        image: &Image,
        encoder: &ImageEncoder,
    ) -> Later<Encoded> {
        let encode = || {
            let (name, pixels, encoder) = (image_name(handle), pixels(image), encoder.clone());
            later(move |work: &Work| match &pixels {
                Ok(image) => encode(&name, crop, image, &encoder, work),
                Err(found) => Err(StyleError::Image { image: name.clone(), found: found.clone() }.into()),
            })
        };
        Arc::clone(self.0.entry((handle.id(), crop)).or_insert_with(encode))
    }
}

/// Forgets the statistics of images that changed or went, and all of them if the encoder changed.
pub(crate) fn forget_changed_statistics(
    mut images: MessageReader<AssetEvent<Image>>,
    mut encoder: EncoderChanges,
    mut statistics: ResMut<ImageStatistics>,
) {
    // Features of two encoders cannot be compared, so nothing that was computed is of use.
    if encoder.read() {
        statistics.0.clear();
    }
    // `Added` is left out: an image has no statistics before it exists.
    for event in images.read() {
        if let AssetEvent::Modified { id } | AssetEvent::Removed { id } = event {
            statistics.0.retain(|(image, _), _| image != id);
        }
    }
}

/// Encodes an image. Takes a while: not for the main thread.
fn encode(
    name: &str,
    crop: Option<Crop>,
    image: &DynamicImage,
    encoder: &ImageEncoder,
    work: &Work,
) -> Result<Encoded, Failure> {
    let image = decoded(name, image, crop, &work.part(0.0, DECODING))?;
    let failed = |source| StyleError::Encoder { image: name.into(), source };
    let encoder = encoder.get().map_err(failed)?;
    let work = work.part(DECODING, 1.0);
    match style_statistics_if_wanted(encoder, &image, StyleSize::default(), &work) {
        Ok(statistics) => Ok(Arc::new(statistics)),
        Err(EncoderError::Canceled(canceled)) => Err(canceled.into()),
        Err(source) => Err(failed(Arc::new(source)).into()),
    }
}
