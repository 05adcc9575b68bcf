//! Inputs that come later: assets that are loaded, and values that are made by the first computation that needs
//! them.

use std::sync::{Arc, LazyLock};

use bevy::{asset::LoadState, prelude::*};
use stylegaussian::{ChannelStatistics, paint::Paint};

use crate::style::{make::worker::Painting, wish::error::StyleError};

/// An input, or `Ok(None)` while it is being loaded or computed.
pub(crate) type Input<T> = Result<Option<T>, Arc<StyleError>>;

/// A value that the first computation makes that needs it.
pub(crate) type Later<T> = Arc<LazyLock<T, Box<dyn FnOnce() -> T + Send>>>;

/// The canvas of a painting. All entities that use the painting share an error.
pub(crate) type Stretched = Result<Arc<Painting>, Arc<StyleError>>;

/// The statistics of a painting. All entities that use the painting share an error.
pub(crate) type Encoded = Result<Arc<ChannelStatistics>, Arc<StyleError>>;

/// A value that is made later.
pub(crate) fn later<T>(make: impl FnOnce() -> T + Send + 'static) -> Later<T> {
    Arc::new(LazyLock::new(Box::new(make)))
}

/// An asset, or `Ok(None)` while it may still come.
pub(crate) fn loaded<'a, A: Asset>(
    server: &AssetServer,
    assets: &'a Assets<A>,
    handle: &Handle<A>,
) -> Result<Option<&'a A>, Arc<StyleError>> {
    let asset = assets.get(handle);
    // A reload that fails leaves the old asset in place, and that is used. Assets that a program adds have no
    // load state.
    match server.get_load_state(handle) {
        Some(LoadState::Failed(error)) if asset.is_none() => {
            Err(Arc::new(StyleError::Load(error.to_string())))
        }
        _ => Ok(asset),
    }
}

/// The name of an asset for messages: its path, or what it is if it has none.
pub(crate) fn name<A: Asset>(handle: &Handle<A>, what: &str) -> String {
    handle.path().map_or_else(|| what.into(), ToString::to_string)
}

/// The part of an image that is used, in a form that can be looked up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Crop([u32; 4]);

impl Crop {
    pub(crate) fn new(part: Rect) -> Self {
        Self([part.min.x, part.min.y, part.max.x, part.max.y].map(f32::to_bits))
    }

    /// Left, top, right and bottom edges, as shares of the sides.
    pub(crate) fn area(self) -> [f32; 4] {
        self.0.map(f32::from_bits)
    }
}

/// The canvas of a painting that may be used.
pub(crate) fn stretched(name: String, paint: &Paint) -> Stretched {
    match paint.is_usable() {
        true => Ok(Arc::new(Painting::new(paint))),
        false => Err(Arc::new(StyleError::Transparent { image: name })),
    }
}

/// The name of an image that is a style.
pub(crate) fn image_name(handle: &Handle<Image>) -> String {
    name(handle, "a style image")
}
