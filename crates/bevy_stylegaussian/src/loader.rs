//! One asset loader for all assets that are parsed from a single file, and the errors of all loaders.

use std::{error::Error, marker::PhantomData};

use bevy::{
    asset::{AssetLoader, AssetPath, LoadContext, ReadAssetBytesError, io::Reader},
    prelude::*,
};

use stylegaussian::work::Canceled;

use crate::work::{Lane, Workers, for_one, taken};

/// An asset that is parsed from the bytes of one file.
pub(crate) trait FromFile: Asset + Sized {
    /// File extensions, without the leading dot.
    const EXTENSIONS: &[&str];

    /// Parses the file's bytes. `path` is the asset's path, for messages.
    fn from_file(bytes: Vec<u8>, path: &str) -> Result<Self, Box<dyn Error + Send + Sync>>;
}

/// An asset could not be loaded. Both messages name the asset.
#[derive(Debug, thiserror::Error)]
pub(crate) enum LoadError {
    /// The bytes could not be read.
    #[error("{path}: {source}")]
    Read {
        /// The asset's path.
        path: String,
        /// The error of the asset's source.
        source: std::io::Error,
    },
    /// A file that another one names could not be read.
    #[error("{path}: found no readable `{part}`, which it needs: {error}")]
    Part {
        /// The asset's path.
        path: String,
        /// The file's path relative to it.
        part: String,
        /// The error of the asset's source.
        error: Box<ReadAssetBytesError>,
    },
    /// Reading it panicked.
    #[error("reading the file ended early: the log says why")]
    Canceled(#[from] Canceled),
    /// The bytes could not be parsed.
    #[error("{0}")]
    Parse(Box<dyn Error + Send + Sync>),
}

/// Reads an asset's file, which `path` names in errors.
pub(crate) async fn read_all(reader: &mut dyn Reader, path: &AssetPath<'_>) -> Result<Vec<u8>, LoadError> {
    let mut bytes = Vec::new();
    match reader.read_to_end(&mut bytes).await {
        Ok(_) => Ok(bytes),
        Err(source) => Err(LoadError::Read { path: path.to_string(), source }),
    }
}

/// Loads assets of type `A`.
#[derive(TypePath)]
pub(crate) struct FileLoader<A: TypePath> {
    workers: Workers,
    // `fn() -> A` is `Send` and `Sync` whatever `A` is.
    asset: PhantomData<fn() -> A>,
}

impl<A: TypePath> FromWorld for FileLoader<A> {
    fn from_world(world: &mut World) -> Self {
        Self { workers: world.resource::<Workers>().clone(), asset: PhantomData }
    }
}

impl<A: FromFile> AssetLoader for FileLoader<A> {
    type Asset = A;
    type Settings = ();
    type Error = LoadError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _settings: &(),
        context: &mut LoadContext<'_>,
    ) -> Result<A, LoadError> {
        // The computation below must own the path: it cannot borrow the context.
        let path = context.path().to_string();
        let bytes = read_all(reader, context.path()).await?;
        // Not on the pool on which other assets wait for their files. If the last handle is dropped, Bevy drops
        // this future, and what has not begun never does.
        let parsing = self.workers.start(Lane::Short, move |_| for_one(A::from_file(bytes, &path)));
        taken(parsing).await?.map_err(LoadError::Parse)
    }

    fn extensions(&self) -> &[&str] {
        A::EXTENSIONS
    }
}
