//! Paintings as styles. The page's worker reads their pixels, which the plugin paints with, or encodes them if
//! the decoder is to make the colors; where there is none, the page's thread does.

use std::{collections::HashMap, sync::Arc};

use bevy::{
    asset::RenderAssetUsages,
    image::{CompressedImageFormats, ImageSampler, ImageType},
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_stylegaussian::{
    style::{StyleInput, StyleStatistics},
    stylegaussian_files::style_from_bytes,
};
use js_sys::Uint8Array;
use wasm_bindgen::JsValue;

use crate::{
    bridge::{self, Event, Request},
    memory, style,
    worker::{self, Call, State},
};

/// The paintings that were dropped or asked for, by their names as styles.
#[derive(Resource, Default)]
pub struct Paintings(HashMap<String, Painting>);

/// A painting.
struct Painting {
    file: File,
    /// Its pixels, once somebody paints with them.
    image: Option<Handle<Image>>,
    /// The worker's part in them.
    pixels: Stage<()>,
    /// The statistics for the decoder, once the worker has encoded the painting.
    style: Handle<StyleStatistics>,
    /// The worker's part in them, and the bytes of the style.
    encoded: Stage<Vec<u8>>,
}

/// The file of a painting.
enum File {
    /// One that the visitor has dropped.
    Dropped(Uint8Array),
    /// An image beside the page, by its path in `assets`.
    Asset(String),
}

/// Something that the worker makes.
enum Stage<T> {
    No,
    Wanted,
    Coming(Call),
    Yes(T),
}

impl Painting {
    fn new(file: File, styles: &Assets<StyleStatistics>) -> Self {
        let style = styles.reserve_handle();
        Self { file, image: None, pixels: Stage::No, style, encoded: Stage::No }
    }
}

/// Takes images that the visitor has dropped.
pub fn take_dropped(
    mut requests: MessageReader<Request>,
    mut paintings: ResMut<Paintings>,
    styles: Res<Assets<StyleStatistics>>,
) {
    for request in requests.read() {
        let Request::AddPainting { name, bytes } = request else { continue };
        let painting = Painting::new(File::Dropped(bytes.clone()), &styles);
        paintings.0.insert(format!("image:{name}"), painting);
    }
}

impl Paintings {
    /// The input for a painting: `image:NAME` was dropped, `paint:NAME` is an image of the page. `None` if
    /// there is no such painting. If `by_decoder`, the decoder alone makes the colors. What the worker makes
    /// comes later.
    ///
    /// # Errors
    /// If there is no worker and the image cannot be decoded.
    pub fn input(
        &mut self,
        name: &str,
        by_decoder: bool,
        assets: &AssetServer,
        images: &mut Assets<Image>,
        styles: &Assets<StyleStatistics>,
    ) -> Result<Option<StyleInput>, String> {
        if let Some(path) = name.strip_prefix("paint:").filter(|path| style::is_plain(path)) {
            let asset = || Painting::new(File::Asset(format!("styles/{path}")), styles);
            self.0.entry(name.into()).or_insert_with(asset);
        }
        let Some(painting) = self.0.get_mut(name) else { return Ok(None) };
        let has_worker = worker::state() != State::Absent;
        if has_worker && by_decoder {
            if matches!(painting.encoded, Stage::No) {
                painting.encoded = Stage::Wanted;
            }
            return Ok(Some(StyleInput::Preset(painting.style.clone())));
        }
        if painting.image.is_none() {
            painting.image = Some(match &painting.file {
                _ if has_worker => {
                    painting.pixels = Stage::Wanted;
                    images.reserve_handle()
                }
                File::Dropped(bytes) => images.add(decode(&memory::copied(bytes)?)?),
                File::Asset(path) => assets.load(path.clone()),
            });
        }
        Ok(painting.image.clone().map(StyleInput::Image))
    }
}

impl Paintings {
    /// The file of a painting's statistics for the worker, or `None` if there is none yet.
    pub fn style_file(&self, name: &str) -> Option<JsValue> {
        match &self.0.get(name)?.encoded {
            Stage::Yes(bytes) => Some(worker::bytes(bytes)),
            _ => None,
        }
    }
}

/// Decodes an image. Its content decides its format, and not a name.
fn decode(bytes: &[u8]) -> Result<Image, String> {
    let kind = match bytes {
        [0xff, 0xd8, ..] => "jpg",
        [0x89, b'P', b'N', b'G', ..] => "png",
        _ => return Err("found neither a JPEG nor a PNG image".into()),
    };
    let sampler = ImageSampler::default();
    let usage = RenderAssetUsages::MAIN_WORLD;
    Image::from_buffer(bytes, ImageType::Extension(kind), CompressedImageFormats::NONE, true, sampler, usage)
        .map_err(|error| error.to_string())
}

/// An image of RGBA, behind its width and height.
///
/// # Errors
/// If there are fewer pixels, or more.
fn image(bytes: &[u8]) -> Result<Image, String> {
    let (size, pixels) = bytes.split_first_chunk::<8>().ok_or("found a part of an image")?;
    let [width, height] = [0, 4].map(|at| u32::from_le_bytes([0, 1, 2, 3].map(|i| size[at + i])));
    // Four bytes each, of numbers that may be anything.
    let expected = 4 * u128::from(width) * u128::from(height);
    if expected == 0 || pixels.len() as u128 != expected {
        return Err(format!("found {} bytes of {width} x {height} pixels", pixels.len()));
    }
    let size = Extent3d { width, height, depth_or_array_layers: 1 };
    let (of, usage) = (TextureFormat::Rgba8UnormSrgb, RenderAssetUsages::MAIN_WORLD);
    Ok(Image::new(size, TextureDimension::D2, pixels.to_vec(), of, usage))
}

/// Has the worker make what is wanted, and takes what it has made.
pub fn advance(
    mut paintings: ResMut<Paintings>,
    mut styles: ResMut<Assets<StyleStatistics>>,
    mut images: ResMut<Assets<Image>>,
) {
    for (name, painting) in &mut paintings.0 {
        // Asked for again, it is tried again.
        if let Err(error) = painting.advance_style(name, &mut styles) {
            bridge::tell(Event::Failed, &error);
            painting.encoded = Stage::No;
        }
        if let Err(error) = painting.advance_pixels(name, &mut images) {
            bridge::tell(Event::Failed, &error);
            (painting.pixels, painting.image) = (Stage::No, None);
        }
    }
}

impl Painting {
    /// Has the worker, which is ready, do this with the painting of this name.
    fn call(&self, function: &str, name: &str) -> Call {
        let file = match &self.file {
            File::Dropped(bytes) => bytes.clone().into(),
            File::Asset(path) => worker::asset(path),
        };
        let name = name.split_once(':').map_or(name, |(_, name)| name);
        worker::call(function, &[name.into(), file])
    }

    fn advance_style(&mut self, name: &str, styles: &mut Assets<StyleStatistics>) -> Result<(), String> {
        match &self.encoded {
            Stage::Wanted if worker::state() == State::Ready => {
                self.encoded = Stage::Coming(self.call("work_encode", name));
            }
            Stage::Coming(call) => {
                let Some(bytes) = call.answer().transpose()? else { return Ok(()) };
                let statistics = style_from_bytes(&bytes, name).map_err(|error| error.to_string())?;
                let style = StyleStatistics { statistics: Arc::new(statistics), paint: None };
                styles.insert(&self.style, style).map_err(|error| error.to_string())?;
                self.encoded = Stage::Yes(bytes);
            }
            _ => {}
        }
        Ok(())
    }

    fn advance_pixels(&mut self, name: &str, images: &mut Assets<Image>) -> Result<(), String> {
        match &self.pixels {
            Stage::Wanted if worker::state() == State::Ready => {
                self.pixels = Stage::Coming(self.call("work_pixels", name));
            }
            Stage::Coming(call) => {
                let Some(bytes) = call.answer().transpose()? else { return Ok(()) };
                if let Some(handle) = &self.image {
                    images.insert(handle, image(&bytes)?).map_err(|error| error.to_string())?;
                }
                self.pixels = Stage::Yes(());
            }
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_images_are_decoded() {
        let png = include_bytes!("../../../assets/styles/halftone.png");
        assert!(decode(png).is_ok());
        assert!(decode(&png[..100]).is_err());
        assert!(decode(b"GIF89a").is_err());
        assert!(decode(b"").is_err());
    }

    #[test]
    fn pixels_of_the_worker_are_as_many_as_it_says() {
        let bytes = [&[2, 0, 0, 0, 1, 0, 0, 0][..], &[7; 8]].concat();
        let image = image(&bytes).unwrap();
        assert_eq!((image.width(), image.height()), (2, 1));
        assert_eq!(image.data.as_deref(), Some(&[7; 8][..]));
        for bad in [&bytes[..15], &bytes[..7], &[0; 8], &[0xff; 8]] {
            assert!(super::image(bad).is_err(), "{bad:?}");
        }
    }
}
