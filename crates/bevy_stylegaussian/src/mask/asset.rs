//! Masks as files.

use std::{error::Error, sync::Arc};

use bevy::prelude::*;
use stylegaussian::StoredMask;
use stylegaussian_files::mask_from_bytes;

use crate::loader::FromFile;

/// A mask of one scene: `.mask.safetensors`, as [`stylegaussian_files::write_mask`] writes it. Show it with
/// [`StyleMask::saved`](crate::mask::StyleMask::saved).
#[derive(Asset, Clone, Debug, Reflect)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct SavedMask(pub Arc<StoredMask>);

impl FromFile for SavedMask {
    const EXTENSIONS: &[&str] = &["mask.safetensors"];

    fn from_file(bytes: Vec<u8>, path: &str) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(Self(Arc::new(mask_from_bytes(&bytes, path)?)))
    }
}
