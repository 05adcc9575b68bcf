//! Files of rows of one size, which may be read in parts.

/// Text before the rows: that before their number, and that after it. Empty in a `.splat`.
#[derive(Debug, Default)]
pub(super) struct Header {
    pub(super) before: Vec<u8>,
    pub(super) after: Vec<u8>,
    /// The number of rows, or `None` if the file has none before them.
    pub(super) count: Option<u64>,
    /// The size of a row, in bytes.
    pub(super) row: u64,
    /// The size of the header, in bytes.
    pub(super) size: u64,
}

impl Header {
    /// The header of a file with this many rows.
    pub(super) fn of(&self, count: u64) -> Vec<u8> {
        match self.count {
            Some(_) => [&self.before[..], count.to_string().as_bytes(), &self.after[..]].concat(),
            None => Vec::new(),
        }
    }
}
