//! Style statistics of images, which the decoder takes. They are computed in the background and kept as long as
//! the image.

use std::sync::Arc;

use bevy::{platform::collections::HashMap, prelude::*};
use stylegaussian_encoder::{StyleSize, style_statistics};

use super::{
    EncoderChanges,
    pixels::{cropped, decoded, pixels},
};
use crate::style::{
    make::later::{Crop, Encoded, Later, image_name, later},
    wish::{encoder::ImageEncoder, error::StyleError},
};

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
            later(move || match pixels {
                Ok(image) => encode(name, crop, image, &encoder),
                Err(found) => Err(Arc::new(StyleError::Image { image: name, found })),
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
fn encode(name: String, crop: Option<Crop>, image: Image, encoder: &ImageEncoder) -> Encoded {
    let image = cropped(&name, decoded(name.clone(), image)?, crop)?;
    let error = |source| Arc::new(StyleError::Encoder { image: name.clone(), source });
    let encoder = encoder.get().map_err(error)?;
    let statistics = style_statistics(encoder, &image, StyleSize::default());
    Ok(Arc::new(statistics.map_err(|source| error(Arc::new(source)))?))
}
