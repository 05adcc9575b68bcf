//! Paintings as styles. The page's worker reads their pixels, which the plugin paints with, or encodes them if
//! the decoder is to make the colors; where there is none, the page's thread does.

use std::{collections::HashMap, sync::Arc};

use bevy::{
    asset::RenderAssetUsages,
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_stylegaussian::{
    style::{StyleInput, StyleStatistics},
    stylegaussian_files::style_from_bytes,
};
use js_sys::Uint8Array;

use crate::{
    bridge::{self, Event},
    memory, style, work,
    worker::{self, Call, State},
};

/// The paintings that were dropped or asked for, by their names as styles.
#[derive(Resource, Default)]
pub struct Paintings(HashMap<String, Painting>);

/// A painting.
struct Painting {
    file: File,
    /// Its pixels, which are painted with.
    image: Made<Image>,
    /// Its statistics, which the decoder takes.
    style: Made<StyleStatistics>,
}

/// The file of a painting.
enum File {
    /// One that the visitor has dropped.
    Dropped(Uint8Array),
    /// An image beside the page, by its path in `assets`.
    Asset(String),
}

/// An asset of a painting, which the worker makes.
struct Made<A: Asset> {
    /// `None` until somebody needs it.
    handle: Option<Handle<A>>,
    /// The call that makes it, until it is answered.
    call: Option<Call>,
}

impl Painting {
    fn new(file: File) -> Self {
        Self { file, image: Made { handle: None, call: None }, style: Made { handle: None, call: None } }
    }
}

impl Paintings {
    /// Takes an image that the visitor has dropped, as the style `image:NAME`.
    pub fn add(&mut self, name: &str, bytes: Uint8Array) {
        self.0.insert(format!("image:{name}"), Painting::new(File::Dropped(bytes)));
    }

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
            let asset = || Painting::new(File::Asset(format!("styles/{path}")));
            self.0.entry(name.into()).or_insert_with(asset);
        }
        let Some(painting) = self.0.get_mut(name) else { return Ok(None) };
        let has_worker = worker::state() != State::Absent;
        if has_worker && by_decoder {
            let style = painting.style.handle.get_or_insert_with(|| styles.reserve_handle());
            return Ok(Some(StyleInput::Preset(style.clone())));
        }
        let image = match (&painting.image.handle, &painting.file) {
            (Some(image), _) => image.clone(),
            _ if has_worker => images.reserve_handle(),
            (None, File::Dropped(bytes)) => {
                images.add(image_of(&work::pixels_of(file_name(name), &memory::copied(bytes)?)?)?)
            }
            (None, File::Asset(path)) => assets.load(path.clone()),
        };
        painting.image.handle = Some(image.clone());
        Ok(Some(StyleInput::Image(image)))
    }
}

/// The name of a style without its kind.
fn file_name(style: &str) -> &str {
    style.split_once(':').map_or(style, |(_, name)| name)
}

/// An image of RGBA, behind its width and height.
///
/// # Errors
/// If there are fewer pixels, or more.
fn image_of(bytes: &[u8]) -> Result<Image, String> {
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
    for (name, Painting { file, image, style }) in &mut paintings.0 {
        let name = file_name(name);
        style.advance(&mut styles, || file.call("work_encode", name), |bytes| statistics_of(bytes, name));
        image.advance(&mut images, || file.call("work_pixels", name), image_of);
    }
}

/// The statistics of a painting, as the worker writes them.
fn statistics_of(bytes: &[u8], name: &str) -> Result<StyleStatistics, String> {
    let statistics = style_from_bytes(bytes, name).map_err(|error| error.to_string())?;
    Ok(StyleStatistics { statistics: Arc::new(statistics), paint: None })
}

impl File {
    /// Has the worker, which is ready, do this with a painting of this name.
    fn call(&self, function: &str, name: &str) -> Call {
        let file = match self {
            Self::Dropped(bytes) => bytes.clone().into(),
            Self::Asset(path) => worker::asset(path),
        };
        worker::call(function, &[name.into(), file])
    }
}

impl<A: Asset> Made<A> {
    /// Has the worker make the asset by `begin` once it is needed, and takes it as `read` gives it.
    fn advance(
        &mut self,
        assets: &mut Assets<A>,
        begin: impl FnOnce() -> Call,
        read: impl FnOnce(&[u8]) -> Result<A, String>,
    ) {
        let Some(handle) = &self.handle else { return };
        let answer = match &self.call {
            None if worker::state() == State::Ready && !assets.contains(handle) => {
                self.call = Some(begin());
                return;
            }
            None => return,
            Some(call) => call.answer(),
        };
        let Some(answer) = answer else { return };
        self.call = None;
        let asset = answer.and_then(|bytes| read(&bytes));
        let put = asset.and_then(|asset| assets.insert(handle, asset).map_err(|error| error.to_string()));
        if let Err(error) = put {
            bridge::tell(Event::Failed, &error);
            // Asked for again, it is tried again.
            self.handle = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_of_the_worker_are_as_many_as_it_says() {
        let bytes = [&[2, 0, 0, 0, 1, 0, 0, 0][..], &[7; 8]].concat();
        let image = image_of(&bytes).unwrap();
        assert_eq!((image.width(), image.height()), (2, 1));
        assert_eq!(image.data.as_deref(), Some(&[7; 8][..]));
        for bad in [&bytes[..15], &bytes[..7], &[0; 8], &[0xff; 8]] {
            assert!(image_of(bad).is_err(), "{bad:?}");
        }
    }
}
