//! The pixels of images, as canvases, encoders and bakes take them.

use bevy::{prelude::*, render::render_resource::TextureFormat};

use crate::style::wish::error::StyleError;

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
        return Err("it has no pixels in main memory (load it with RenderAssetUsages::MAIN_WORLD, or add a \
                    StyleLiving)"
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
