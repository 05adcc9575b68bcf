//! The pixels of images, as canvases, encoders and bakes take them.

use bevy::{prelude::*, render::render_resource::TextureFormat};
use stylegaussian::{
    paint::{Paint, pixels_of},
    work::{Canceled, Work},
};
use stylegaussian_encoder::{image::DynamicImage, paint_of_if_wanted};

use crate::style::{
    make::later::{Crop, Failure},
    wish::error::StyleError,
};

/// The part of an image that is used, as canvases and encoders take it. Takes a while: not for the main thread.
///
/// # Errors
/// If it is no part of it, or if `work` is canceled.
pub(super) fn decoded(
    name: &str,
    image: &DynamicImage,
    crop: Option<Crop>,
    work: &Work,
) -> Result<stylegaussian_encoder::Image, Failure> {
    let Some(crop) = crop else { return Ok(whole(image, work)?) };
    let size = [image.width() as usize, image.height() as usize];
    let edges = pixels_of(crop.area(), size);
    let edges = edges.map_err(|source| StyleError::Crop { image: name.into(), source })?;
    Ok(stylegaussian_encoder::Image::of_part(image, edges, work)?)
}

/// All of an image likewise.
///
/// # Errors
/// If `work` is canceled.
pub(crate) fn whole(image: &DynamicImage, work: &Work) -> Result<stylegaussian_encoder::Image, Canceled> {
    let edges = [0, 0, image.width() as usize, image.height() as usize];
    stylegaussian_encoder::Image::of_part(image, edges, work)
}

/// The paint of an image that strokes follow, as the GPU reads it: what is transparent is white.
///
/// # Errors
/// If `work` is canceled.
pub(super) fn over_white(image: stylegaussian_encoder::Image, work: &Work) -> Result<Paint, Canceled> {
    paint_of_if_wanted(&stylegaussian_encoder::Image { alpha: None, ..image }, work)
}

/// A copy of the image for a task.
///
/// # Errors
/// If it has no pixels in main memory, or if they are not of 8 bits. The message says so.
pub(crate) fn pixels(image: &Image) -> Result<DynamicImage, String> {
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
    // The pixels are used as they are in the file: values of an sRGB texture are display-referred already.
    image.try_into_dynamic().map_err(|source| source.to_string())
}
