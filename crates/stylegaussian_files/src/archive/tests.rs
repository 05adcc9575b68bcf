//! Archives made here byte by byte.

use std::io::Write;

use flate2::{Compression, write::DeflateEncoder};

use super::*;

/// How an archive is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packing {
    Stored,
    /// Stored, and every size and offset stands in the 64-bit fields.
    Zip64,
    Deflated,
}

/// Fields of a record, one after the other.
fn record(signature: &[u8; 4], fields: &[&[u8]]) -> Vec<u8> {
    [&signature[..], &fields.concat()].concat()
}

/// A zip archive.
pub(crate) fn archive(entries: &[(&str, Vec<u8>)], packing: Packing) -> Vec<u8> {
    let zip64 = packing == Packing::Zip64;
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (name, contents) in entries {
        let packed = match packing {
            Packing::Deflated => {
                let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
                encoder.write_all(contents).unwrap();
                encoder.finish().unwrap()
            }
            _ => contents.clone(),
        };
        let method = [if packing == Packing::Deflated { 8 } else { 0 }, 0];
        let mut crc = Crc::new();
        crc.update(contents);
        let crc = crc.sum().to_le_bytes();
        let local = bytes.len() as u64;
        let sizes = [packed.len(), contents.len()].map(|n| (n as u32).to_le_bytes()).concat();
        let n_name = (name.len() as u16).to_le_bytes();
        bytes.extend(record(b"PK\x03\x04", &[&[0; 4], &method, &[0; 4], &crc, &sizes, &n_name, &[5, 0]]));
        bytes.extend(name.as_bytes());
        bytes.extend(*b"FB\x01\0Z"); // padding in an extra field, as torch aligns its storages
        bytes.extend(&packed);
        let (mut extra, mut sizes, mut offset) = (Vec::new(), sizes, local as u32);
        if zip64 {
            extra.extend(*b"\x01\0\x18\0");
            extra.extend([contents.len() as u64, packed.len() as u64, local].map(u64::to_le_bytes).concat());
            (sizes, offset) = (vec![0xff; 8], u32::MAX);
        }
        let n_extra = (extra.len() as u16).to_le_bytes();
        let fields: [&[u8]; 9] =
            [&[0; 6], &method, &[0; 4], &crc, &sizes, &n_name, &n_extra, &[0; 10], &offset.to_le_bytes()];
        directory.extend(record(b"PK\x01\x02", &fields));
        directory.extend([name.as_bytes(), &extra].concat());
    }
    let (start, n) = (bytes.len() as u64, entries.len() as u64);
    let n_directory = directory.len() as u64;
    bytes.extend(directory);
    let end = bytes.len() as u64;
    if zip64 {
        let fields = [n, n, n_directory, start].map(u64::to_le_bytes).concat();
        bytes.extend(record(b"PK\x06\x06", &[&44_u64.to_le_bytes(), &[0; 12], &fields]));
        bytes.extend(record(b"PK\x06\x07", &[&[0; 4], &end.to_le_bytes(), &[1, 0, 0, 0]]));
    }
    let (n, size, start) = match zip64 {
        true => (u16::MAX, u32::MAX, u32::MAX),
        false => (n as u16, n_directory as u32, start as u32),
    };
    let n = n.to_le_bytes();
    bytes.extend(record(
        b"PK\x05\x06",
        &[&[0; 4], &n, &n, &size.to_le_bytes(), &start.to_le_bytes(), &[0; 2]],
    ));
    bytes
}

#[test]
fn all_packings_give_the_same_entries() {
    let entries = [("x/data.pkl", b"one".to_vec()), ("x/data/0", vec![7; 300])];
    for packing in [Packing::Stored, Packing::Zip64, Packing::Deflated] {
        let bytes = archive(&entries, packing);
        let mut archive = Archive::open(&bytes).unwrap();
        assert_eq!(archive.names().collect::<Vec<_>>(), ["x/data.pkl", "x/data/0"]);
        for (name, contents) in &entries {
            assert_eq!(archive.unpack(name).unwrap(), &contents[..], "{packing:?}");
            match archive.stored(name) {
                Ok(range) => assert_eq!(bytes[range.unwrap()], contents[..], "{packing:?}"),
                Err(_) => assert_eq!(packing, Packing::Deflated),
            }
        }
        assert!(archive.stored("absent").unwrap().is_none() && !archive.has("absent"));
        assert!(archive.unpack("absent").unwrap_err().found.contains("it has: x/data.pkl x/data/0"));
    }
}

#[test]
fn damaged_archives_are_errors() {
    let entries = [("x/data.pkl", b"one".to_vec())];
    let good = archive(&entries, Packing::Zip64);
    let check = |bytes: Vec<u8>, part: &str| {
        let Err(Mismatch { found, .. }) = Archive::open(&bytes) else { panic!("no error for {part}") };
        assert!(found.contains(part), "{found}");
    };
    check(good[..good.len() - 1].into(), "no end record");
    check(good[..10].into(), "too few bytes");
    let at = |signature: &[u8]| good.windows(4).position(|w| w == signature).unwrap();
    let changed = |at: usize, value: u8| {
        let mut bytes = good.clone();
        bytes[at] = value;
        bytes
    };
    check(changed(at(b"PK\x01\x02") + 10, 93), "compressed (method 93)");
    check(changed(at(b"PK\x01\x02") + 8, 1), "encrypted");
    check(changed(at(b"PK\x01\x02"), 0), "damaged central directory");
    check(changed(at(b"PK\x03\x04"), 0), "no entry where");
    // A count of 2^63 entries, and an offset of 2^63.
    // The highest byte of a field of 8 bytes: at 32 + 7, 48 + 7 and 8 + 7 of its record.
    check(changed(at(b"PK\x06\x06") + 39, 0x80), "past its end");
    check(changed(at(b"PK\x06\x06") + 55, 0x80), "past its end");
    check(changed(at(b"PK\x06\x07") + 15, 0x80), "past its end");
}

#[test]
fn damaged_entries_are_errors() {
    let entries = [("a", (0..200).collect::<Vec<u8>>()), ("bomb", vec![0; 3 << 20])];
    for packing in [Packing::Stored, Packing::Deflated] {
        let mut bytes = archive(&entries[..1], packing);
        // The first byte of the contents: 30 of the header, 1 of the name, 5 of padding.
        bytes[36] ^= 0xff;
        let message = Archive::open(&bytes).unwrap().unpack("a").unwrap_err().found;
        assert!(
            message.contains("`a` of another checksum") || message.contains("cannot be unpacked"),
            "{message}"
        );
    }
    let bytes = archive(&entries, Packing::Deflated);
    let mut archive = Archive::open(&bytes).unwrap();
    assert!(archive.unpack("a").is_ok());
    assert!(archive.unpack("bomb").unwrap_err().found.contains("unpacks to more at `bomb`"));
}
