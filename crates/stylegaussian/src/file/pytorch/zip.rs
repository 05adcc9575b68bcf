//! The zip container of PyTorch files: stored entries, found through the central directory.
//!
//! PKWARE's APPNOTE 6.3: end of central directory record (4.3.16), its zip64 forms (4.3.14, 4.3.15), central headers
//! (4.3.12), local headers (4.3.7).

use std::{collections::HashMap, ops::Range};

use crate::file::error::{Mismatch, mismatch};

const EXPECTED: &str = "a whole zip archive of stored entries, as torch.save writes it";

/// An archive in memory.
pub(in crate::file) struct Archive<'a> {
    bytes: &'a [u8],
    /// Position of each entry's contents in `bytes`, by the entry's name.
    entries: HashMap<&'a str, Range<usize>>,
}

impl<'a> Archive<'a> {
    pub(in crate::file) fn open(bytes: &'a [u8]) -> Result<Self, Mismatch> {
        let (n_entries, directory) = central_directory(bytes)?;
        // No capacity from the unchecked count. One that is too large ends at the first header past the directory.
        let mut entries = HashMap::new();
        let mut at = 0;
        for _ in 0..n_entries {
            let (name, data, next) = entry(bytes, directory, at)?;
            entries.insert(name, data);
            at = next;
        }
        Ok(Self { bytes, entries })
    }

    /// The contents of an entry, or `None` if there is no such entry.
    pub(in crate::file) fn get(&self, name: &str) -> Option<&'a [u8]> {
        self.bytes.get(self.range(name)?)
    }

    /// The position of an entry's contents in the file, or `None` if there is no such entry.
    pub(super) fn range(&self, name: &str) -> Option<Range<usize>> {
        self.entries.get(name).cloned()
    }

    /// The names of all entries.
    pub(in crate::file) fn names(&self) -> impl Iterator<Item = &'a str> {
        self.entries.keys().copied()
    }
}

fn broken(what: &str) -> Mismatch {
    mismatch(format_args!("a zip archive with {what}"), EXPECTED)
}

/// `N` bytes at `at`.
fn array<const N: usize>(bytes: &[u8], at: usize) -> Result<[u8; N], Mismatch> {
    let slice = slice(bytes, at, N)?;
    let mut array = [0; N];
    array.copy_from_slice(slice);
    Ok(array)
}

fn slice(bytes: &[u8], at: usize, len: usize) -> Result<&[u8], Mismatch> {
    at.checked_add(len).and_then(|end| bytes.get(at..end)).ok_or_else(|| broken("a record past its end"))
}

fn u16_at(bytes: &[u8], at: usize) -> Result<u16, Mismatch> {
    array(bytes, at).map(u16::from_le_bytes)
}

fn u32_at(bytes: &[u8], at: usize) -> Result<u32, Mismatch> {
    array(bytes, at).map(u32::from_le_bytes)
}

/// A 64-bit field that counts or points into memory.
fn u64_at(bytes: &[u8], at: usize) -> Result<usize, Mismatch> {
    let value = array(bytes, at).map(u64::from_le_bytes)?;
    usize::try_from(value).map_err(|_| broken("a 64-bit field out of range"))
}

/// The number of entries and the central directory's bytes.
fn central_directory(bytes: &[u8]) -> Result<(usize, &[u8]), Mismatch> {
    const END: [u8; 4] = *b"PK\x05\x06";
    // The record is 22 bytes and a comment of up to 65,535.
    let last = bytes.len().checked_sub(22).ok_or_else(|| broken("too few bytes"))?;
    let first = last.saturating_sub(usize::from(u16::MAX));
    let end = (first..=last)
        .rev()
        // Backward, because the contents of an entry may hold the signature too.
        .find(|&at| bytes[at..at + 4] == END)
        .ok_or_else(|| broken("no end record (truncated?)"))?;
    let mut n_entries = usize::from(u16_at(bytes, end + 10)?);
    let mut size = u32_at(bytes, end + 12)? as usize;
    let mut start = u32_at(bytes, end + 16)? as usize;
    if let Some(locator) = end.checked_sub(20)
        && bytes[locator..locator + 4] == *b"PK\x06\x07"
    {
        let end64 = u64_at(bytes, locator + 8)?;
        if slice(bytes, end64, 4)? != b"PK\x06\x06" {
            return Err(broken("no zip64 end record where its locator points"));
        }
        // Saturating, so that an offset near 2^64 is past the end and does not wrap to the beginning.
        n_entries = u64_at(bytes, end64.saturating_add(32))?;
        size = u64_at(bytes, end64.saturating_add(40))?;
        start = u64_at(bytes, end64.saturating_add(48))?;
    }
    Ok((n_entries, slice(bytes, start, size)?))
}

/// Reads the central header at `at`: the entry's name, the position of its contents, and the start of the next header.
fn entry<'a>(
    bytes: &[u8],
    directory: &'a [u8],
    at: usize,
) -> Result<(&'a str, Range<usize>, usize), Mismatch> {
    const HEADER: usize = 46;
    let header = slice(directory, at, HEADER)?;
    if header[..4] != *b"PK\x01\x02" {
        return Err(broken("a damaged central directory"));
    }
    let [n_name, n_extra, n_comment] = [
        usize::from(u16_at(header, 28)?),
        usize::from(u16_at(header, 30)?),
        usize::from(u16_at(header, 32)?),
    ];
    let name = std::str::from_utf8(slice(directory, at + HEADER, n_name)?)
        .map_err(|_| broken("a name that is no UTF-8"))?;
    let method = u16_at(header, 10)?;
    // torch.save only stores, so that tensors can be mapped into memory.
    if method != 0 {
        return Err(broken(&format!("entry `{name}` compressed (method {method})")));
    }
    let extra = slice(directory, at + HEADER + n_name, n_extra)?;
    let (size, local) = size_and_offset(header, extra)?;
    let data = local_data(bytes, local, size)?;
    Ok((name, data, at + HEADER + n_name + n_extra + n_comment))
}

/// The entry's size and the position of its local header: 32-bit fields, or the zip64 extra field if they are full.
fn size_and_offset(header: &[u8], extra: &[u8]) -> Result<(usize, usize), Mismatch> {
    let (compressed, size, local) = (u32_at(header, 20)?, u32_at(header, 24)?, u32_at(header, 42)?);
    // The field holds size, compressed size and offset, in this order. Stored entries have equal sizes, so the second
    // one is only skipped.
    let mut zip64 = Zip64::find(extra)?;
    let size = if size == u32::MAX { zip64.next()? } else { size as usize };
    if compressed == u32::MAX {
        zip64.next()?;
    }
    let local = if local == u32::MAX { zip64.next()? } else { local as usize };
    Ok((size, local))
}

/// The 8-byte values of the zip64 extra field (4.5.3), present only for fields that are full.
struct Zip64<'a>(&'a [u8]);

impl<'a> Zip64<'a> {
    fn find(mut extra: &'a [u8]) -> Result<Self, Mismatch> {
        while extra.len() >= 4 {
            let (id, size) = (u16_at(extra, 0)?, usize::from(u16_at(extra, 2)?));
            let data = slice(extra, 4, size)?;
            if id == 1 {
                return Ok(Self(data));
            }
            extra = &extra[4 + size..];
        }
        Ok(Self(&[]))
    }

    fn next(&mut self) -> Result<usize, Mismatch> {
        let value = u64_at(self.0, 0)?;
        self.0 = &self.0[8..];
        Ok(value)
    }
}

/// The position of an entry's contents, which follow its local header.
fn local_data(bytes: &[u8], local: usize, size: usize) -> Result<Range<usize>, Mismatch> {
    const HEADER: usize = 30;
    let header = slice(bytes, local, HEADER)?;
    if header[..4] != *b"PK\x03\x04" {
        return Err(broken("no entry where its directory points"));
    }
    // Two 16-bit lengths cannot overflow the sum.
    let skipped = HEADER + usize::from(u16_at(header, 26)?) + usize::from(u16_at(header, 28)?);
    // The local header repeats name and extra field with lengths of its own: torch pads there to align storages.
    let start = local.saturating_add(skipped);
    slice(bytes, start, size)?;
    Ok(start..start + size)
}
