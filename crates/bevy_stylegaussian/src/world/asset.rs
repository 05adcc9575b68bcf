//! The manifest asset.

use std::{error::Error, sync::Arc};

use bevy::prelude::*;
use stylegaussian_files::world::World as Levels;

use crate::loader::FromFile;

/// The manifest of a world: the levels of detail of a capture, and the files that hold them. It loads from a
/// `lod-meta.json`, the streamed SOG of PlayCanvas, which `stylegaussian tile` writes too. Its files are loaded
/// by [`GaussianWorld`](super::GaussianWorld) as they are needed.
///
/// It loads if it is asked for, as a `Handle<WorldManifest>`, and not by its extension. As a
/// `Handle<GaussianScene>`, the same file is a scene that is loaded as a whole.
#[derive(Asset, Clone, Debug, Reflect)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct WorldManifest(Arc<Levels>);

impl WorldManifest {
    /// Makes an asset of levels of detail. Paths of files are those of assets, from the root of the default
    /// source on.
    pub fn new(levels: Levels) -> Self {
        Self(Arc::new(levels))
    }

    /// The levels of detail.
    pub fn levels(&self) -> &Arc<Levels> {
        &self.0
    }

    /// The smallest and the largest corner of the box around all parts, in the coordinates of the files, or
    /// `None` if there are none.
    pub fn bounds(&self) -> Option<[Vec3; 2]> {
        self.0.bounds()
    }
}

impl FromFile for WorldManifest {
    const EXTENSIONS: &[&str] = &[];

    fn from_file(bytes: Vec<u8>, path: &str) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(Self::new(Levels::read(&bytes).map_err(|mismatch| mismatch.at(path.as_ref()))?))
    }
}
