//! Zip archives in memory.

use std::io::{Cursor, Read};

use zip::ZipArchive;

use super::error::{Mismatch, mismatch};

/// The most bytes that the entries of an archive unpack to, per byte of the archive. Images and JSON are packed twice at
/// most, so that real ratios are below 10; deflate alone reaches 1,032.
const MAX_RATIO: usize = 64;

/// Bytes that every archive may unpack to: the metadata of a tiny scene is long and packs well.
const FLOOR: usize = 1 << 20;

/// An archive, and how much more may be unpacked of it.
pub(super) struct Archive<'a> {
    zip: ZipArchive<Cursor<&'a [u8]>>,
    budget: usize,
}

/// Whether a file begins as a zip archive does.
pub(super) fn is_zip(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04")
}

impl<'a> Archive<'a> {
    /// Reads the table of contents.
    pub fn open(bytes: &'a [u8]) -> Result<Self, Mismatch> {
        let zip = ZipArchive::new(Cursor::new(bytes))
            .map_err(|error| mismatch(format_args!("a damaged zip archive ({error})"), "a whole one"))?;
        Ok(Self { zip, budget: MAX_RATIO.saturating_mul(bytes.len()).saturating_add(FLOOR) })
    }

    /// Whether there is an entry of this name.
    pub fn has(&self, name: &str) -> bool {
        self.zip.index_for_name(name).is_some()
    }

    /// Whether an entry's name ends like this.
    pub fn has_end(&self, end: &str) -> bool {
        self.zip.file_names_raw().any(|name| name.ends_with(end.as_bytes()))
    }

    /// The names of the first entries, for messages.
    pub fn some_names(&self) -> String {
        let names: Vec<_> = self.zip.file_names_raw().take(12).map(|name| name.escape_ascii().to_string()).collect();
        names.join(" ")
    }

    /// Unpacks an entry, stored or deflated, and compares its checksum.
    pub fn unpack(&mut self, name: &str) -> Result<Vec<u8>, Mismatch> {
        let Some(index) = self.zip.index_for_name(name) else {
            let found = format!("a zip archive without `{name}` (it has: {})", self.some_names());
            return Err(mismatch(found, format_args!("`{name}`")));
        };
        let broken = |error: &dyn std::fmt::Display| {
            mismatch(format_args!("zip entry `{name}` that cannot be unpacked ({error})"), "a whole one")
        };
        let entry = self.zip.by_index(index).map_err(|error| broken(&error))?;
        // The size in the header is not believed: memory grows with what is there.
        let mut bytes = Vec::new();
        let limit = self.budget as u64 + 1;
        entry.take(limit).read_to_end(&mut bytes).map_err(|error| broken(&error))?;
        match self.budget.checked_sub(bytes.len()) {
            Some(rest) => self.budget = rest,
            None => {
                let expected = format_args!("at most {MAX_RATIO} times its size").to_string();
                return Err(mismatch(format_args!("a zip archive that unpacks to more at `{name}`"), expected));
            }
        }
        Ok(bytes)
    }
}
