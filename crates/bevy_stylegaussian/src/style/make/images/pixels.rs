//! The pixels of images, as canvases, encoders and bakes take them.

use bevy::{prelude::*, render::render_resource::TextureFormat};
use stylegaussian::paint::Paint;
use stylegaussian_encoder::paint_of;

use crate::style::{make::later::Crop, wish::error::StyleError};

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

/// The part of an image that is used.
///
/// # Errors
/// If it is no part of it.
pub(crate) fn cropped(
    name: &str,
    image: stylegaussian_encoder::Image,
    crop: Option<Crop>,
) -> Result<stylegaussian_encoder::Image, StyleError> {
    let Some(crop) = crop else { return Ok(image) };
    image.cropped(crop.area()).map_err(|source| StyleError::Crop { image: name.into(), source })
}

/// The paint of an image that strokes follow, as the GPU reads it: what is transparent is white.
pub(super) fn over_white(image: stylegaussian_encoder::Image) -> Paint {
    paint_of(&stylegaussian_encoder::Image { alpha: None, ..image })
}

/// A copy of the image for a task.
///
/// # Errors
/// If it has no pixels in main memory. The message says so.
pub(crate) fn pixels(image: &Image) -> Result<Image, String> {
    if image.data.is_none() {
        return Err("it has no pixels in main memory (load it with RenderAssetUsages::MAIN_WORLD, or add a \
                    StyleLiving and use all of it)"
            .into());
    }
    let mut image = image.clone();
    // An image loaded as linear data (`is_srgb = false`) has the same bytes. A style is what a person sees in
    // the file.
    if image.texture_descriptor.format == TextureFormat::Rgba8Unorm {
        image.texture_descriptor.format = TextureFormat::Rgba8UnormSrgb;
    }
    Ok(image)
}
