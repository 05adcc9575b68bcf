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

/// As that of a build with the feature. No image is followed.
#[derive(SystemParam)]
pub(crate) struct Followed<'w>(PhantomData<&'w ()>);

impl Followed<'_> {
    pub(crate) fn has(&self, _: AssetId<Image>) -> bool {
        false
    }
}

/// As that of a build with the feature. There is no encoder.
#[derive(SystemParam)]
pub(crate) struct LoadingEncoder<'w>(PhantomData<&'w ()>);

impl LoadingEncoder<'_> {
    pub(crate) fn is_loading(&self) -> bool {
        false
    }
}

fn no_images(handle: &Handle<Image>) -> Arc<StyleError> {
    Arc::new(StyleError::NoImages { image: image_name(handle) })
}
