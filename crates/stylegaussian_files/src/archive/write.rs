//! Writing an archive whose entries are stored as they are.

use std::io::Write;

use flate2::Crc;

use crate::{error::mismatch, format::Unwritten};

/// The version of the format that a reader must know: 2.0.
const VERSION: [u8; 2] = [20, 0];

/// Midnight of the first day of 1980, from which zip counts: the same scene gives the same file.
const TIME: [u8; 4] = [0, 0, 0x21, 0];

/// Writes an archive of these files.
pub(crate) fn write_stored(out: &mut dyn Write, entries: &[(&str, Vec<u8>)]) -> Result<(), Unwritten> {
    let (mut position, mut directory) = (0_u64, Vec::new());
    let total: u64 =
        entries.iter().map(|(name, contents)| 128 + 2 * name.len() as u64 + contents.len() as u64).sum();
    if u32::try_from(total).is_err() {
        return Err(mismatch(format_args!("{total} bytes"), "less than 4 GiB, as a zip archive holds").into());
    }
    for (name, contents) in entries {
        let mut crc = Crc::new();
        crc.update(contents);
        let size = (contents.len() as u32).to_le_bytes();
        // Flags and method 0, time, checksum, both sizes, lengths of the name and of nothing more.
        let mut common = [VERSION, [0; 2], [0; 2]].concat();
        common.extend(TIME);
        common.extend([crc.sum().to_le_bytes(), size, size].concat());
        common.extend((name.len() as u16).to_le_bytes());
        common.extend([0; 2]);
        let header = [&b"PK\x03\x04"[..], &common[..], name.as_bytes()].concat();
        out.write_all(&header)?;
        out.write_all(contents)?;
        directory.extend(b"PK\x01\x02");
        directory.extend(VERSION);
        directory.extend(&common);
        // No comment, the first disk, no attributes.
        directory.extend([0; 10]);
        directory.extend((position as u32).to_le_bytes());
        directory.extend(name.as_bytes());
        position += (header.len() + contents.len()) as u64;
    }
    let n = (entries.len() as u16).to_le_bytes();
    let mut end = b"PK\x05\x06\0\0\0\0".to_vec();
    end.extend([n, n].concat());
    end.extend((directory.len() as u32).to_le_bytes());
    end.extend((position as u32).to_le_bytes());
    end.extend([0; 2]);
    out.write_all(&directory)?;
    Ok(out.write_all(&end)?)
}
