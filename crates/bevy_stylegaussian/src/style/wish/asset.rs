//! Assets that a style is made of: statistics, looks and decoders.

use std::{error::Error, sync::Arc};

use bevy::prelude::*;
use stylegaussian::{ChannelStatistics, Decoder, Look, paint::Paint};
use stylegaussian_files::{decoder_from_bytes, look_from_bytes, paint_from_bytes, style_from_bytes};

use crate::loader::FromFile;

/// A style that was read from an image before: `.style.safetensors`, as `stylegaussian style IMAGE` writes it.
/// It needs no encoder at run time, not even to be decoded.
#[derive(Asset, Clone, Reflect)]
#[reflect(opaque)]
#[reflect(Clone)]
pub struct StyleStatistics {
    /// Statistics of the style's features, which the decoder takes.
    pub statistics: Arc<ChannelStatistics>,
    /// The painting's own paint, or `None` if the file carries none. Such a style cannot be painted, only
    /// decoded, for which the scene needs features: see [`StyleMethod`](crate::style::StyleMethod).
    pub paint: Option<Arc<Paint>>,
}

impl FromFile for StyleStatistics {
    const EXTENSIONS: &[&str] = &["style.safetensors"];

    fn from_file(bytes: Vec<u8>, path: &str) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let statistics = Arc::new(style_from_bytes(&bytes, path)?);
        Ok(Self { statistics, paint: paint_from_bytes(&bytes, path)?.map(Arc::new) })
    }
}

/// Baked colors of one scene, and the strokes over them: `.look.safetensors`, as `stylegaussian bake` writes
/// them. It belongs to the scene that it was baked for, from whichever file that is loaded, and needs neither
/// features nor a decoder.
#[derive(Asset, Clone, Debug, Reflect)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct StyleLook(pub Arc<Look>);

impl FromFile for StyleLook {
    const EXTENSIONS: &[&str] = &["look.safetensors"];

    fn from_file(bytes: Vec<u8>, path: &str) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(Self(Arc::new(look_from_bytes(&bytes, path)?)))
    }
}

/// A decoder from features to colors: `.decoder.safetensors`, as `stylegaussian train` writes them. Use it with
/// [`StyleDecoder`](crate::style::decoder::StyleDecoder).
#[derive(Asset, Clone, Debug, Reflect)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct GaussianDecoder(pub Arc<Decoder>);

impl FromFile for GaussianDecoder {
    const EXTENSIONS: &[&str] = &["decoder.safetensors"];

    fn from_file(bytes: Vec<u8>, path: &str) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(Self(Arc::new(decoder_from_bytes(&bytes, path)?)))
    }
}
