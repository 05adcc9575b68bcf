//! One asset loader for all assets that are parsed from a single file.

use std::{error::Error, marker::PhantomData};

use bevy::{
    asset::{AssetLoader, LoadContext, io::Reader},
    prelude::*,
    tasks::AsyncComputeTaskPool,
};

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
    /// The bytes could not be parsed.
    #[error("{0}")]
    Parse(Box<dyn Error + Send + Sync>),
}

/// Loads assets of type `A`.
#[derive(TypePath)]
// `fn() -> A` is `Send` and `Sync` whatever `A` is.
pub(crate) struct FileLoader<A: TypePath>(PhantomData<fn() -> A>);

impl<A: TypePath> Default for FileLoader<A> {
    fn default() -> Self {
        Self(PhantomData)
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
        // The task below must own the path: it cannot borrow the context.
        let path = context.path().to_string();
        let mut bytes = Vec::new();
        if let Err(source) = reader.read_to_end(&mut bytes).await {
            return Err(LoadError::Read { path, source });
        }
        // Parsing a large scene takes seconds, which would block the pool on which other assets wait for their files.
        let parsing = AsyncComputeTaskPool::get().spawn(async move { A::from_file(bytes, &path) });
        parsing.await.map_err(LoadError::Parse)
    }

    fn extensions(&self) -> &[&str] {
        A::EXTENSIONS
    }
}
