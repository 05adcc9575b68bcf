//! An artist's choices beside the paintings: a palette in their stead, and pinned places.

use std::{error::Error, sync::Arc};

use bevy::prelude::*;
use stylegaussian::paint::{Pin, StoredPins};
use stylegaussian_files::pins_from_bytes;

use crate::{loader::FromFile, style::wish::asset::StyleStatistics};

/// Colors in the paintings' stead, for [`StyleSource::palette`](crate::StyleSource::palette).
#[derive(Clone, Debug, PartialEq, Reflect)]
#[reflect(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum StylePalette {
    /// Those of an image. It needs the feature `images`.
    Image(Handle<Image>),
    /// Those of an image that was prepared before.
    Preset(Handle<StyleStatistics>),
    /// These, 2 to 256, each as frequent as the others.
    Colors(Vec<Color>),
}

impl From<Handle<Image>> for StylePalette {
    fn from(image: Handle<Image>) -> Self {
        Self::Image(image)
    }
}

impl From<Handle<StyleStatistics>> for StylePalette {
    fn from(statistics: Handle<StyleStatistics>) -> Self {
        Self::Preset(statistics)
    }
}

impl From<Vec<Color>> for StylePalette {
    fn from(colors: Vec<Color>) -> Self {
        Self::Colors(colors)
    }
}

/// A spot of a scene that is painted from a given spot of a painting, and so are its surroundings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Reflect)]
#[reflect(Clone, Debug, Default, PartialEq)]
pub struct StylePin {
    /// A point of the scene, in the entity's local space: on a surface, or no farther from one than a usual
    /// picture of the scene is wide.
    pub at: Vec3,
    /// A point of the painting, or of the part of it that is used, from the left and top edges, as shares of
    /// the sides, 0..1.
    pub place: Vec2,
    /// The number of the painting among the source's images and presets, from 0.
    pub painting: usize,
}

impl From<StylePin> for Pin {
    fn from(StylePin { at, place, painting }: StylePin) -> Self {
        Self { at, place, painting }
    }
}

/// Pinned places of a source.
#[derive(Clone, Debug, PartialEq, Reflect)]
#[reflect(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum StylePins {
    /// These.
    List(Vec<StylePin>),
    /// Those of a file that was saved with the scene. Those of another scene fail.
    File(Handle<StylePinsFile>),
}

impl Default for StylePins {
    /// None.
    fn default() -> Self {
        Self::List(Vec::new())
    }
}

impl From<Vec<StylePin>> for StylePins {
    fn from(pins: Vec<StylePin>) -> Self {
        Self::List(pins)
    }
}

impl From<Handle<StylePinsFile>> for StylePins {
    fn from(file: Handle<StylePinsFile>) -> Self {
        Self::File(file)
    }
}

/// Pinned places in a file: `.pins.json`, as `stylegaussian_files::write_pins` writes them.
#[derive(Asset, Clone, Debug, Reflect)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct StylePinsFile(pub Arc<StoredPins>);

impl FromFile for StylePinsFile {
    const EXTENSIONS: &[&str] = &["pins.json"];

    fn from_file(bytes: Vec<u8>, path: &str) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(Self(Arc::new(pins_from_bytes(&bytes, path)?)))
    }
}
