//! JPEG and PNG files without an end. Some programs leave the end out, and copies are cut off.
//!
//! A file is read without its end if it holds every row, and refused if pixels are missing, which decoders
//! would fill with gray.

use std::borrow::Cow;

use ::image::DynamicImage;

/// The first bytes of a JPEG file: the start marker, and the first byte of another.
const JPEG: [u8; 3] = [0xFF, 0xD8, 0xFF];
/// The end marker of a JPEG file.
const JPEG_END: [u8; 2] = [0xFF, 0xD9];
/// The first bytes of a PNG file.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
/// The last chunk of a PNG file: no data, its kind and the checksum.
const PNG_END: &[u8] = b"\0\0\0\0IEND\xAE\x42\x60\x82";

/// The state of a file's end.
#[derive(Debug, PartialEq)]
pub(super) enum Ending<'a> {
    /// The end is there, or the format has none that is looked at.
    Whole,
    /// The end is missing. The bytes are the file with an end, and the text names what was missing.
    Completed(Cow<'a, [u8]>, &'static str),
    /// Pixels are missing.
    Truncated,
}

/// Looks for the end of the file `bytes`. `decode` decodes such a file.
pub(super) fn ending<'a>(bytes: &'a [u8], decode: impl Fn(&[u8]) -> Option<DynamicImage>) -> Ending<'a> {
    if bytes.starts_with(&JPEG) {
        ending_of_jpeg(bytes, decode)
    } else if bytes.starts_with(PNG) {
        // The decoder sees whether rows are missing: the compressed pixels have an end of their own.
        match completed_png(bytes) {
            Some(completed) => Ending::Completed(completed.into(), "the PNG has no end (chunk IEND)"),
            None => Ending::Whole,
        }
    } else {
        Ending::Whole
    }
}

/// A JPEG file that ends within its last scan holds every row if no bit behind its end could change a pixel.
/// The file is decoded as if zeros followed, and as if several other bits did.
fn ending_of_jpeg<'a>(bytes: &'a [u8], decode: impl Fn(&[u8]) -> Option<DynamicImage>) -> Ending<'a> {
    /// Bits that differ from one another from the first on, or from the second on. A byte of ones needs a zero
    /// behind it, which says that it is no marker.
    const OTHERS: [&[u8]; 3] = [&[0xFF, 0x00], &[0x55], &[0xAA]];
    /// Repetitions: blocks of a refining scan may have one bit.
    const N: usize = 512;
    match JpegEnd::of(bytes) {
        JpegEnd::Marked => Ending::Whole,
        JpegEnd::InHeader => Ending::Truncated,
        JpegEnd::InLastScan => {
            // A lone 0xFF is half of a marker or of a data byte.
            let data = bytes.strip_suffix(&[0xFF]).unwrap_or(bytes);
            // Behind the end marker, decoders read zeros.
            let zeros = [data, &JPEG_END[..]].concat();
            let Some(picture) = decode(&zeros) else { return Ending::Truncated };
            let is_same = |bits: &[u8]| {
                let other = [data, &bits.repeat(N), &JPEG_END[..]].concat();
                decode(&other).is_some_and(|other| other == picture)
            };
            match OTHERS.into_iter().all(is_same) {
                true => Ending::Completed(zeros.into(), "the JPEG has no end marker"),
                false => Ending::Truncated,
            }
        }
    }
}

/// The place at which a JPEG file ends.
#[derive(Debug, PartialEq)]
enum JpegEnd {
    /// At its end marker.
    Marked,
    /// Within the data of its last scan.
    InLastScan,
    /// Before its last scan.
    InHeader,
}

impl JpegEnd {
    /// Follows the markers (ITU T.81, B.1.1). Segments are skipped by their lengths, since thumbnails in them
    /// have ends of their own.
    fn of(bytes: &[u8]) -> Self {
        const START_OF_SCAN: u8 = 0xDA;
        const END: u8 = 0xD9;
        // Behind the start marker.
        let mut rest = bytes.get(2..).unwrap_or_default();
        let mut scans = Scans::default();
        let mut in_scan = false;
        while let Some(at) = rest.iter().position(|&byte| byte == 0xFF) {
            let Some(&marker) = rest.get(at + 1) else { break };
            rest = match marker {
                END => return Self::Marked,
                // Fill bytes: the next one may begin the marker.
                0xFF => &rest[at + 1..],
                // A stuffed byte, a restart or a marker without a length.
                0x00 | 0x01 | 0xD0..=0xD8 => &rest[at + 2..],
                // Garbage between markers is skipped, as decoders do, but data of a scan is not a segment.
                _ => {
                    let Some(length) = rest.get(at + 2..at + 4) else { return Self::InHeader };
                    let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
                    let Some(behind) = rest.get(at + 2 + length..) else { return Self::InHeader };
                    let segment = rest.get(at + 4..at + 2 + length).unwrap_or_default();
                    match marker {
                        START_OF_SCAN => scans.scan(segment),
                        // Start of a frame, except for DHT, JPG and DAC, whose numbers lie between.
                        0xC0..=0xCF if !matches!(marker, 0xC4 | 0xC8 | 0xCC) => scans.frame(segment, marker),
                        _ => {}
                    }
                    in_scan = marker == START_OF_SCAN;
                    behind
                }
            };
        }
        if in_scan && scans.are_complete() {
            Self::InLastScan
        } else if in_scan || scans.n > 0 {
            Self::InHeader
        } else {
            // A file without a scan is for the decoder to refuse.
            Self::Marked
        }
    }
}

/// The bits of coefficients that a JPEG's scans have brought so far.
#[derive(Default)]
struct Scans {
    /// Number of scans.
    n: usize,
    is_progressive: bool,
    /// Each component's number, and for each of its 64 coefficients the lowest bit that a scan brought.
    components: Vec<(u8, [Option<u8>; 64])>,
}

impl Scans {
    /// A start of a frame (ITU T.81, B.2.2): precision, height, width, and three bytes for each component.
    fn frame(&mut self, segment: &[u8], marker: u8) {
        self.is_progressive = matches!(marker, 0xC2 | 0xC6 | 0xCA | 0xCE);
        let components = segment.get(6..).unwrap_or_default().chunks_exact(3);
        self.components = components.map(|component| (component[0], [None; 64])).collect();
    }

    /// A start of a scan (B.2.3): its components, the first and the last coefficient, the bits.
    fn scan(&mut self, segment: &[u8]) {
        self.n += 1;
        let n = usize::from(segment.first().copied().unwrap_or_default());
        let behind = 1 + 2 * n;
        let (Some(components), Some(range)) = (segment.get(1..behind), segment.get(behind..behind + 3))
        else {
            return;
        };
        let (first, last, lowest) = match self.is_progressive {
            true => (usize::from(range[0]), usize::from(range[1]), range[2] & 0xF),
            false => (0, 63, 0),
        };
        for component in components.chunks_exact(2) {
            let known = self.components.iter_mut().filter(|(number, _)| *number == component[0]);
            for (_, bits) in known {
                bits.iter_mut().take(last + 1).skip(first).for_each(|bit| *bit = Some(lowest));
            }
        }
    }

    /// Whether every bit of every coefficient has its scan.
    fn are_complete(&self) -> bool {
        !self.components.is_empty()
            && self.components.iter().all(|(_, bits)| bits.iter().all(|&bit| bit == Some(0)))
    }
}

/// A PNG file with its last chunk, if only that is missing, or in part, or the checksum of the chunk before it
/// as well.
fn completed_png(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut at = PNG.len();
    loop {
        let rest = bytes.get(at..)?;
        if PNG_END.starts_with(rest) {
            return (rest.len() < PNG_END.len()).then(|| [&bytes[..at], PNG_END].concat());
        }
        let (length, behind) = rest.split_first_chunk::<4>()?;
        let length = u32::from_be_bytes(*length) as usize;
        // The kind and the data, which the checksum is of.
        let contents = behind.get(..length.checked_add(4)?)?;
        if contents.starts_with(b"IEND") {
            return None;
        }
        let checksum = behind.get(contents.len()..contents.len() + 4);
        at += 4 + contents.len() + 4;
        if checksum.is_none() {
            return Some([&bytes[..at - 4], &checksum_of(contents).to_be_bytes(), PNG_END].concat());
        }
    }
}

/// The checksum of a PNG chunk's kind and data: CRC-32 (ISO/IEC 15948, annex D).
fn checksum_of(contents: &[u8]) -> u32 {
    !contents.iter().fold(!0_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg()))
    })
}
