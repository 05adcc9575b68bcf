//! Takes the place of images in a build without the feature `images`: a style of an image is an error.

use std::{marker::PhantomData, sync::Arc};

use bevy::{ecs::system::SystemParam, prelude::*};
use stylegaussian::recolor::ColorMoments;

use crate::style::{
    make::later::{Crop, Encoded, Input, Later, Stretched, image_name},
    wish::error::StyleError,
};

/// As that of a build with the feature. It holds nothing.
#[derive(SystemParam)]
pub(crate) struct ImageInputs<'w>(PhantomData<&'w ()>);

impl ImageInputs<'_> {
    pub(crate) fn canvas(&mut self, handle: &Handle<Image>, _: Option<Crop>) -> Input<Later<Stretched>> {
        Err(no_images(handle))
    }

    pub(crate) fn is_encoder_loading(&self) -> bool {
        false
    }

    pub(crate) fn follows(&self, _: AssetId<Image>) -> bool {
        false
    }

    pub(crate) fn palette(&self, _: &Handle<Image>, _: Option<Crop>) -> Option<ColorMoments> {
        None
    }

    pub(crate) fn statistics(&mut self, handle: &Handle<Image>, _: Option<Crop>) -> Input<Later<Encoded>> {
        Err(no_images(handle))
    }
}

/// As that of a build with the feature. There is no encoder.
#[derive(SystemParam)]
pub(crate) struct EncoderChanges<'w>(PhantomData<&'w ()>);

impl EncoderChanges<'_> {
    pub(crate) fn read(&mut self) -> bool {
        false
    }
}

fn no_images(handle: &Handle<Image>) -> Arc<StyleError> {
    Arc::new(StyleError::NoImages { image: image_name(handle) })
}
