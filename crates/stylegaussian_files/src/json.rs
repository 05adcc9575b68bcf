//! JSON as other programs write it.

use serde::Deserialize;

use super::error::{Mismatch, mismatch};

/// The mark that some editors and Windows programs put before UTF-8.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// The text without a byte order mark, which no parser of JSON takes.
pub(super) fn without_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text)
}

/// JSON of a certain shape.
pub(super) fn parse<'a, T: Deserialize<'a>>(json: &'a [u8], expected: &str) -> Result<T, Mismatch> {
    serde_json::from_slice(without_mark(json))
        .map_err(|error| mismatch(format_args!("JSON with an error ({error})"), expected))
}
