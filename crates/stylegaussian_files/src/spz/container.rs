//! The arrays of an SPZ file, out of gzip or zstd.
//!
//! Memory grows with the decompressed bytes and never by a count in the file. Decompression stops one byte past
//! the size in the header.

use std::io::{self, Read};

use flate2::{Crc, bufread::GzDecoder};
use rayon::prelude::*;
use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};
use stylegaussian::work::{Canceled, Work};

use super::header::{HAS_EXTENSIONS, Header, N_BYTES};
use crate::error::{Mismatch, bytes_in_words, mismatch};

/// Bytes that are decompressed at a time.
const PIECE: u64 = 1 << 20;

/// The first two bytes of a gzip file.
pub(super) const GZIP: [u8; 2] = [0x1f, 0x8b];

/// The most bytes of extension records. Those that are known take 20.
const MAX_EXTENSION_BYTES: u64 = 1 << 20;

/// A decompressed file.
#[derive(Debug)]
pub(super) struct Contents {
    /// The header.
    pub header: Header,
    /// Positions, opacities, colors, scales, rotations, harmonics. Their lengths are those that the header
    /// demands.
    pub arrays: [Vec<u8>; 6],
    /// Records of extensions; empty if there are none.
    pub extensions: Vec<u8>,
}

/// Decompresses a file of any version.
pub(super) fn unpack(bytes: &[u8], work: &Work) -> Result<Contents, Mismatch> {
    if bytes.starts_with(&GZIP) {
        let mut decoder = GzDecoder::new(PLAIN_GZIP_HEADER.chain(after_gzip_header(bytes)?));
        let contents = unpack_sequence(&mut decoder, work)?;
        // The end of the data was read, and the checksum with it. The rest follows the gzip member.
        return match decoder.get_ref().get_ref().1.len() {
            0 => Ok(contents),
            n => Err(mismatch(
                format_args!("{} after the gzip data", bytes_in_words(n as u64)),
                "the end of the file",
            )),
        };
    }
    match bytes.get(..N_BYTES) {
        // The official reader refuses older versions without gzip, others read them.
        Some([b'N', b'G', b'S', b'P', 0..=3, 0, 0, 0, ..]) | None => unpack_sequence(&mut &bytes[..], work),
        Some(_) => unpack_frames(bytes, work),
    }
}

/// A gzip header without a name or anything else (RFC 1952, section 2.3).
const PLAIN_GZIP_HEADER: &[u8] = &[0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 255];

/// The data after a gzip file's header, which is checked. The library takes no names of 65,536 bytes or more,
/// which are sound.
fn after_gzip_header(bytes: &[u8]) -> Result<&[u8], Mismatch> {
    let cut = || mismatch("broken gzip data (the end of the file in its header)", "a whole gzip file");
    let (fixed, mut rest) = bytes.split_at_checked(PLAIN_GZIP_HEADER.len()).ok_or_else(cut)?;
    let (method, flags) = (fixed[2], fixed[3]);
    let has = |bit: u8| flags & (1 << bit) != 0;
    if method != 8 || flags >= 1 << 5 {
        let found = format_args!("broken gzip data (method {method}, flags {flags:#04x})").to_string();
        return Err(mismatch(found, "method 8 and known flags"));
    }
    if has(2) {
        let (length, after) = rest.split_first_chunk().ok_or_else(cut)?;
        rest = after.get(usize::from(u16::from_le_bytes(*length))..).ok_or_else(cut)?;
    }
    // The name and the comment.
    for _ in 0..u8::from(has(3)) + u8::from(has(4)) {
        let end = rest.iter().position(|&byte| byte == 0).ok_or_else(cut)?;
        rest = &rest[end + 1..];
    }
    if has(1) {
        let mut checksum = Crc::new();
        checksum.update(&bytes[..bytes.len() - rest.len()]);
        let (stored, after) = rest.split_first_chunk().ok_or_else(cut)?;
        // Its lower half.
        if checksum.sum() as u16 != u16::from_le_bytes(*stored) {
            return Err(mismatch("broken gzip data (a header of another checksum)", "a whole gzip file"));
        }
        rest = after;
    }
    Ok(rest)
}

/// Reads versions 1 to 3: header, arrays and extensions one after another.
fn unpack_sequence(source: &mut dyn Read, work: &Work) -> Result<Contents, Mismatch> {
    let first = take(source, N_BYTES as u64, "SPZ header", |_| Ok(()))?;
    // `take` returned that many.
    let header = Header::parse(&std::array::from_fn(|i| first[i]))?;
    if header.version > 3 {
        return Err(mismatch(format_args!("SPZ version {} in gzip", header.version), "1 to 3 in gzip"));
    }
    let mut arrays = [const { Vec::new() }; 6];
    let (mut n_read, total) = (0, header.array_bytes().iter().sum::<u64>().max(1));
    for ((array, n_bytes), name) in arrays.iter_mut().zip(header.array_bytes()).zip(NAMES) {
        *array = take(source, n_bytes, name, |n| work.at((n_read + n) as f32 / total as f32))?;
        n_read += n_bytes;
    }
    let limit = if header.flags & HAS_EXTENSIONS == 0 { 0 } else { MAX_EXTENSION_BYTES };
    let mut extensions = Vec::new();
    source.take(limit + 1).read_to_end(&mut extensions).map_err(broken)?;
    if extensions.len() as u64 > limit {
        let found = format_args!("more than {limit} bytes after the last array").to_string();
        return Err(mismatch(found, format_args!("the end after {} Gaussians", header.n)));
    }
    Ok(Contents { header, arrays, extensions })
}

/// The arrays, for messages.
const NAMES: [&str; 6] = ["positions", "opacities", "colors", "scales", "rotations", "spherical harmonics"];

/// The next `n_bytes` of the data. `tell` hears before each piece how many there are.
fn take(
    source: &mut dyn Read,
    n_bytes: u64,
    name: &str,
    tell: impl Fn(u64) -> Result<(), Canceled>,
) -> Result<Vec<u8>, Mismatch> {
    let mut bytes = Vec::new();
    loop {
        let left = n_bytes - bytes.len() as u64;
        if left == 0 {
            return Ok(bytes);
        }
        tell(bytes.len() as u64)?;
        if Read::take(&mut *source, left.min(PIECE)).read_to_end(&mut bytes).map_err(broken)? == 0 {
            return Err(mismatch(
                format_args!("the end of the data in the {name}"),
                format_args!("{} more", bytes_in_words(left)),
            ));
        }
    }
}

/// A gzip stream that ends early or does not fit its checksum.
fn broken(error: io::Error) -> Mismatch {
    mismatch(format_args!("broken gzip data ({error})"), "a whole gzip file")
}

/// Reads version 4: a header of 32 bytes, extensions, a table of the frames' lengths, and a zstd frame for each
/// array that is not empty.
fn unpack_frames(bytes: &[u8], work: &Work) -> Result<Contents, Mismatch> {
    let cut = || mismatch(bytes_in_words(bytes.len() as u64), "an SPZ header and a table of streams");
    let header = Header::parse(bytes.first_chunk().ok_or_else(cut)?)?;
    let at_table =
        u32::from_le_bytes(*bytes.get(16..20).and_then(<[u8]>::first_chunk).ok_or_else(cut)?) as usize;
    let expected: Vec<(usize, u64)> =
        header.array_bytes().into_iter().enumerate().filter(|&(_, n_bytes)| n_bytes > 0).collect();
    if usize::from(bytes[15]) != expected.len() {
        let found = format_args!("{} streams", bytes[15]).to_string();
        return Err(mismatch(found, format_args!("{}, one for each property", expected.len())));
    }
    let before_table = bytes.get(FRAMES_HEADER_BYTES..at_table).ok_or_else(cut)?;
    let table = bytes.get(at_table..at_table + 16 * expected.len()).ok_or_else(cut)?;
    let mut rest = &bytes[at_table + table.len()..];
    let mut frames = Vec::with_capacity(expected.len());
    for (entry, (array, n_bytes)) in table.as_chunks::<16>().0.iter().zip(expected) {
        let [compressed, plain] = [0, 8].map(|at| u64::from_le_bytes(std::array::from_fn(|i| entry[at + i])));
        if plain != n_bytes {
            let found = format_args!("{} of {}", bytes_in_words(plain), NAMES[array]).to_string();
            return Err(mismatch(found, format_args!("{n_bytes} for {} Gaussians", header.n)));
        }
        let (frame, after) =
            usize::try_from(compressed).ok().and_then(|n| rest.split_at_checked(n)).ok_or_else(|| {
                mismatch(
                    format_args!("the end of the file in the {}", NAMES[array]),
                    format_args!("{compressed} bytes"),
                )
            })?;
        frames.push((array, frame, plain));
        rest = after;
    }
    if !rest.is_empty() {
        return Err(mismatch(
            format_args!("{} after the last stream", bytes_in_words(rest.len() as u64)),
            "the end of the file",
        ));
    }
    let decoded = frames.into_par_iter().map(|(array, frame, plain)| {
        work.check()?;
        Ok((array, inflate(frame, plain, array)?))
    });
    let mut arrays = [const { Vec::new() }; 6];
    for (array, bytes) in decoded.collect::<Result<Vec<_>, Mismatch>>()? {
        arrays[array] = bytes;
    }
    let has_extensions = header.flags & HAS_EXTENSIONS != 0;
    let extensions = if has_extensions { before_table.to_vec() } else { Vec::new() };
    Ok(Contents { header, arrays, extensions })
}

/// Bytes of a version 4 header.
pub(super) const FRAMES_HEADER_BYTES: usize = 32;

/// Decompresses one zstd frame of `n_bytes`.
fn inflate(mut frame: &[u8], n_bytes: u64, array: usize) -> Result<Vec<u8>, Mismatch> {
    let name = NAMES[array];
    let broken = |error: &dyn std::fmt::Display| {
        mismatch(format_args!("a broken zstd frame of {name} ({error})"), format_args!("{n_bytes} bytes"))
    };
    let mut decoder = FrameDecoder::new();
    decoder.reset(&mut frame).map_err(|error| broken(&error))?;
    // The decoder stops at the first block that ends past this many bytes. No block has more than 128 KiB.
    let limit = usize::try_from(n_bytes + 1).map_err(|error| broken(&error))?;
    let is_whole = decoder
        .decode_blocks(&mut frame, BlockDecodingStrategy::UptoBytes(limit))
        .map_err(|error| broken(&error))?;
    if !is_whole {
        return Err(broken(&"it is longer"));
    }
    let bytes = decoder.collect().unwrap_or_default();
    if bytes.len() as u64 != n_bytes || !frame.is_empty() {
        return Err(broken(&format_args!("{} bytes, {} left over", bytes.len(), frame.len())));
    }
    let checksums = decoder.get_checksum_from_data().zip(decoder.get_calculated_checksum());
    match checksums.is_none_or(|(stored, found)| stored == found) {
        true => Ok(bytes),
        false => Err(broken(&"wrong checksum")),
    }
}
