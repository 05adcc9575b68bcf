//! The files that make up one scene, in memory: the one that was named, and those that it names.

use std::collections::BTreeMap;

use stylegaussian::work::{Canceled, Work};

use super::error::Mismatch;

/// The bytes of a scene's files. A reader asks for others by name; whoever reads for it (a folder, an asset
/// server) adds them, and it reads again.
#[derive(Debug)]
pub(super) struct Files {
    /// The file that was named.
    pub main: Vec<u8>,
    /// Its extension in lower case, without the leading dot.
    pub extension: String,
    /// Files that it names, by their paths relative to it, with `/` between the parts.
    others: BTreeMap<String, Vec<u8>>,
    /// Progress of reading them, and whether the scene is still wanted.
    pub work: Work,
}

/// A scene that was not read.
#[derive(Debug)]
pub(super) enum Unread {
    /// The files contradict themselves or the format.
    Mismatch(Mismatch),
    /// These files are needed too, by their paths relative to the one that was named.
    Needs(Vec<String>),
}

impl From<Mismatch> for Unread {
    fn from(mismatch: Mismatch) -> Self {
        Self::Mismatch(mismatch)
    }
}

impl From<Canceled> for Unread {
    fn from(canceled: Canceled) -> Self {
        Self::Mismatch(canceled.into())
    }
}

impl Files {
    /// A scene's first file.
    pub fn new(main: Vec<u8>, extension: String) -> Self {
        Self { main, extension, others: BTreeMap::new(), work: Work::default() }
    }

    /// The bytes of the file that was named, for a reader that needs no other and gives them back early.
    pub fn take_main(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.main)
    }

    /// Adds a file that was asked for.
    pub fn add(&mut self, name: String, bytes: Vec<u8>) {
        self.others.insert(name, bytes);
    }

    /// The files of these names, in their order.
    ///
    /// # Errors
    /// If some are not there yet. All of them are named, so that they can be read at once.
    pub fn others(&self, names: &[String]) -> Result<Vec<&[u8]>, Unread> {
        let missing: Vec<String> =
            names.iter().filter(|name| !self.others.contains_key(*name)).cloned().collect();
        if missing.is_empty() {
            return Ok(names.iter().map(|name| &self.others[name][..]).collect());
        }
        Err(Unread::Needs(missing))
    }
}
