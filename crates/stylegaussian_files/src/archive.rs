//! Zip archives in memory: stored and deflated entries, found through the central directory.
//!
//! PKWARE's APPNOTE 6.3: end of central directory record (4.3.16), its zip64 forms (4.3.14, 4.3.15), central
//! headers (4.3.12), local headers (4.3.7). It is our own because PyTorch's entries are read in place, and
//! because the crate `zip` reserves memory by the count that a damaged archive claims.

use std::{borrow::Cow, collections::BTreeMap, io::Read, ops::Range};

use flate2::{Crc, read::DeflateDecoder};

use super::error::{Mismatch, mismatch};

mod write;

pub(super) use write::write_stored;

const EXPECTED: &str = "a whole zip archive of stored or deflated entries";

/// The most bytes that the entries of an archive unpack to, per byte of the archive. Images and JSON were
/// packed before, so that real ratios are below 10; deflate alone reaches 1,032.
const MAX_RATIO: usize = 64;

/// Bytes that every archive may unpack to: the metadata of a tiny scene is long and packs well.
const FLOOR: usize = 1 << 20;

/// An archive in memory.
pub(super) struct Archive<'a> {
    bytes: &'a [u8],
    entries: BTreeMap<&'a str, Entry>,
    /// Bytes that may still be unpacked.
    budget: usize,
}

/// An entry of an archive.
struct Entry {
    /// Position of its contents in the archive.
    range: Range<usize>,
    is_deflated: bool,
    /// CRC-32 of the unpacked bytes.
    checksum: u32,
}

/// Whether a file begins as a zip archive does.
pub(super) fn is_zip(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04")
}

impl<'a> Archive<'a> {
    /// Reads the table of contents.
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, Mismatch> {
        let (n_entries, directory) = central_directory(bytes)?;
        // No capacity from the unchecked count. One that is too large ends at the first header past the
        // directory.
        let mut entries = BTreeMap::new();
        let mut at = 0;
        for _ in 0..n_entries {
            let (name, entry, next) = entry(bytes, directory, at)?;
            entries.insert(name, entry);
            at = next;
        }
        Ok(Self { bytes, entries, budget: MAX_RATIO.saturating_mul(bytes.len()).saturating_add(FLOOR) })
    }

    /// The position of a stored entry's contents in the file, or `None` if there is no such entry. Its checksum
    /// is not compared.
    pub(super) fn stored(&self, name: &str) -> Result<Option<Range<usize>>, Mismatch> {
        match self.entries.get(name) {
            Some(entry) if entry.is_deflated => {
                Err(mismatch(format_args!("a compressed zip entry `{name}`"), "a stored one"))
            }
            entry => Ok(entry.map(|entry| entry.range.clone())),
        }
    }

    /// The contents of an entry. Its checksum is compared.
    pub(super) fn unpack(&mut self, name: &str) -> Result<Cow<'a, [u8]>, Mismatch> {
        let Some(entry) = self.entries.get(name) else {
            let names: Vec<_> = self.names().take(12).map(|name| name.escape_debug().to_string()).collect();
            let found = format!("a zip archive without `{name}` (it has: {})", names.join(" "));
            return Err(mismatch(found, format_args!("`{name}`")));
        };
        let packed = slice(self.bytes, entry.range.start, entry.range.len())?;
        let contents = match entry.is_deflated {
            false => Cow::Borrowed(packed),
            true => Cow::Owned(inflate(packed, &mut self.budget, name)?),
        };
        let mut checksum = Crc::new();
        checksum.update(&contents);
        match checksum.sum() == entry.checksum {
            true => Ok(contents),
            false => Err(broken(&format!("entry `{name}` of another checksum"))),
        }
    }

    /// Whether there is an entry of this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.entries.contains_key(name)
    }

    /// The names of all entries, sorted.
    pub(super) fn names(&self) -> impl Iterator<Item = &'a str> {
        self.entries.keys().copied()
    }
}

/// Inflates an entry, and takes its size off the budget. Memory grows with the bytes that are there and not by
/// the header.
fn inflate(packed: &[u8], budget: &mut usize, name: &str) -> Result<Vec<u8>, Mismatch> {
    let mut contents = Vec::new();
    let mut unpacked = DeflateDecoder::new(packed).take(*budget as u64 + 1);
    if let Err(error) = unpacked.read_to_end(&mut contents) {
        return Err(broken(&format!("entry `{name}` that cannot be unpacked ({error})")));
    }
    let Some(rest) = budget.checked_sub(contents.len()) else {
        let found = format_args!("a zip archive that unpacks to more at `{name}`").to_string();
        return Err(mismatch(found, format_args!("at most {MAX_RATIO} times its size")));
    };
    *budget = rest;
    Ok(contents)
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

/// Reads the central header at `at`: the entry's name, the entry, and the start of the next header.
fn entry<'a>(bytes: &[u8], directory: &'a [u8], at: usize) -> Result<(&'a str, Entry, usize), Mismatch> {
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
    let (flags, method) = (u16_at(header, 8)?, u16_at(header, 10)?);
    if flags & 1 != 0 || !matches!(method, 0 | 8) {
        let how = if flags & 1 != 0 { "encrypted" } else { "compressed" };
        return Err(broken(&format!("entry `{name}` {how} (method {method})")));
    }
    let extra = slice(directory, at + HEADER + n_name, n_extra)?;
    let (size, local) = size_and_offset(header, extra)?;
    let range = local_data(bytes, local, size)?;
    let entry = Entry { range, is_deflated: method == 8, checksum: u32_at(header, 16)? };
    Ok((name, entry, at + HEADER + n_name + n_extra + n_comment))
}

/// The size of the entry's contents in the archive, and the position of its local header: 32-bit fields, or the
/// zip64 extra field if they are full.
fn size_and_offset(header: &[u8], extra: &[u8]) -> Result<(usize, usize), Mismatch> {
    let (compressed, size, local) = (u32_at(header, 20)?, u32_at(header, 24)?, u32_at(header, 42)?);
    // The field holds the unpacked size, the size in the archive and the offset, in this order.
    let mut zip64 = Zip64::find(extra)?;
    if size == u32::MAX {
        zip64.next()?;
    }
    let compressed = if compressed == u32::MAX { zip64.next()? } else { compressed as usize };
    let local = if local == u32::MAX { zip64.next()? } else { local as usize };
    Ok((compressed, local))
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
    // The local header repeats name and extra field with lengths of its own: torch pads there to align
    // storages.
    let start = local.saturating_add(skipped);
    slice(bytes, start, size)?;
    Ok(start..start + size)
}

#[cfg(test)]
pub(super) mod tests;
