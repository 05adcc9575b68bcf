//! The scene formats: one file each, one entry each in [`FORMATS`].
//!
//! Apart from [`format`](super::format), which all of them import.

use super::{
    checkpoint,
    error::{Mismatch, mismatch},
    format::{Format, WriteScene},
    gltf,
    json::without_mark,
    ksplat, ply, sgs, sog, splat, spz,
};

/// All formats. A file is of the first one that recognizes it. Those that go by the extension come last.
pub(super) const FORMATS: &[&Format] = &[
    &ply::FORMAT,
    // Before .sgs, whose mark is a byte that may be part of a number here.
    &spz::FORMAT,
    &gltf::GLB,
    // Before .sgs, too: its mark may be a brace within JSON.
    &sog::FORMAT,
    &sog::JSON,
    &sgs::FORMAT,
    &checkpoint::FORMAT,
    &splat::FORMAT,
    &ksplat::FORMAT,
    &gltf::GLTF,
];

/// The format of a file.
pub(super) fn format_of(bytes: &[u8], extension: &str) -> Result<&'static Format, Mismatch> {
    if bytes.is_empty() {
        return Err(mismatch("an empty file", expected()));
    }
    let format = FORMATS.iter().find(|format| (format.recognizes)(bytes, extension));
    format.copied().ok_or_else(|| mismatch(unknown(bytes), expected()))
}

/// The end of the names of PlayCanvas' compressed .ply files, which are of another layout than those of the
/// plain extension.
const COMPRESSED_PLY: &str = ".compressed.ply";

/// The writer that a file's name in lower case asks for, by `extension` in most cases.
pub(super) fn writer_of(name: &str, extension: &str) -> Option<WriteScene> {
    if name.ends_with(COMPRESSED_PLY) {
        return Some(ply::write_compressed);
    }
    let is_of = |format: &&&Format| format.write.is_some() && format.extensions.contains(&extension);
    FORMATS.iter().find(is_of).and_then(|format| format.write)
}

/// The extensions of the formats that can be written, in lower case and without the leading dot.
pub fn writable_extensions() -> Vec<&'static str> {
    let writable = FORMATS.iter().filter(|format| format.write.is_some());
    writable.flat_map(|format| format.extensions).copied().collect()
}

/// The extensions of the formats that can be read, in lower case and without the leading dot.
pub fn readable_extensions() -> Vec<&'static str> {
    FORMATS.iter().flat_map(|format| format.extensions).copied().collect()
}

/// The formats that can be written, as a list of extensions for messages.
pub(super) fn writable() -> String {
    writable_extensions().iter().map(|extension| format!("`.{extension}`")).collect::<Vec<_>>().join(", ")
}

/// The formats that can be read, for messages.
fn expected() -> String {
    FORMATS.iter().map(|format| format.name).collect::<Vec<_>>().join(", ")
}

/// Beginnings of files that people try and that are not read.
const NOT_READ: &[(&[u8], &str)] = &[
    (b"\x80\x02", "a bare pickle stream (torch.save before version 1.6)"),
    (b"RAD0", "a .rad of Spark"),
    (b"PK\x03\x04", "a zip archive with neither `meta.json` (SOG) nor `data.pkl` (PyTorch checkpoint)"),
    (b"\x28\xb5\x2f\xfd", "a zstd file"),
    (b"LASF", "a LAS point cloud"),
    (b"PXR-USDC", "a USD scene"),
    (b"#usda", "a USD scene"),
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"RIFF", "a WebP image"),
    (b"GIF8", "a GIF image"),
    (b"%PDF", "a PDF document"),
    (b"SQLite format 3", "an SQLite database"),
    (b"<", "an HTML or XML page (of a download that failed?)"),
    (
        b"version https://git-lfs",
        "a pointer of Git LFS, which stands for the file (`git lfs pull` fetches it)",
    ),
    (b"{", "JSON of no known scene"),
];

/// A file that no format recognizes. Formats that people try and that are not read are named.
fn unknown(bytes: &[u8]) -> String {
    let bytes = without_mark(bytes);
    if let Some((_, name)) = NOT_READ.iter().find(|(start, _)| bytes.starts_with(start)) {
        return format!("{name}, which is not supported");
    }
    format!("a file that starts with `{}`", bytes[..bytes.len().min(8)].escape_ascii())
}
