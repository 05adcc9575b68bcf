//! Asset loaders: the bytes of a file to a scene, style statistics or a decoder.

use std::sync::Arc;

use bevy::{
    asset::{AssetLoader, LoadContext, io::Reader},
    prelude::*,
    tasks::AsyncComputeTaskPool,
};
use stylegaussian::file::{self, FileError};

use crate::asset::{GaussianDecoder, GaussianScene, StyleStatistics};

/// Why an asset could not be loaded. Both name the asset.
#[derive(Debug, thiserror::Error)]
pub(crate) enum LoadError {
    /// The bytes could not be read.
    #[error("{path}: {source}")]
    Read {
        /// The asset's path.
        path: String,
        /// What the asset's source said.
        source: std::io::Error,
    },
    /// The bytes are not what they must be.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Loads [`GaussianScene`]s. The content decides which kind of file it is, not the name.
#[derive(Default, TypePath)]
pub(crate) struct GaussianSceneLoader;

impl AssetLoader for GaussianSceneLoader {
    type Asset = GaussianScene;
    type Settings = ();
    type Error = LoadError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _settings: &(),
        context: &mut LoadContext<'_>,
    ) -> Result<GaussianScene, LoadError> {
        let (bytes, name) = read(reader, context).await?;
        // Parsing and finding neighbors take seconds for large scenes: not on the pool that waits for files.
        let parsing = AsyncComputeTaskPool::get().spawn(async move {
            let loaded = file::scene_from_bytes(&bytes, &name)?;
            drop(bytes);
            for warning in &loaded.warnings {
                warn!("{name}: {warning}");
            }
            Ok(GaussianScene::new(loaded.scene))
        });
        parsing.await
    }

    fn extensions(&self) -> &[&str] {
        &["sgs", "ply"]
    }
}

/// Loads [`StyleStatistics`].
#[derive(Default, TypePath)]
pub(crate) struct StyleStatisticsLoader;

impl AssetLoader for StyleStatisticsLoader {
    type Asset = StyleStatistics;
    type Settings = ();
    type Error = LoadError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _settings: &(),
        context: &mut LoadContext<'_>,
    ) -> Result<StyleStatistics, LoadError> {
        let (bytes, name) = read(reader, context).await?;
        Ok(StyleStatistics(Arc::new(file::style_from_bytes(&bytes, &name)?)))
    }

    fn extensions(&self) -> &[&str] {
        &["style.safetensors"]
    }
}

/// Loads [`GaussianDecoder`]s.
#[derive(Default, TypePath)]
pub(crate) struct GaussianDecoderLoader;

impl AssetLoader for GaussianDecoderLoader {
    type Asset = GaussianDecoder;
    type Settings = ();
    type Error = LoadError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _settings: &(),
        context: &mut LoadContext<'_>,
    ) -> Result<GaussianDecoder, LoadError> {
        let (bytes, name) = read(reader, context).await?;
        Ok(GaussianDecoder(Arc::new(file::decoder_from_bytes(&bytes, &name)?)))
    }

    fn extensions(&self) -> &[&str] {
        &["decoder.safetensors"]
    }
}

/// The asset's bytes, and its path to name it by.
async fn read(reader: &mut dyn Reader, context: &LoadContext<'_>) -> Result<(Vec<u8>, String), LoadError> {
    let path = context.path().to_string();
    let mut bytes = Vec::new();
    match reader.read_to_end(&mut bytes).await {
        Ok(_) => Ok((bytes, path)),
        Err(source) => Err(LoadError::Read { path, source }),
    }
}
