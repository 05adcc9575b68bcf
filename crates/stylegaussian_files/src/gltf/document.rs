//! The JSON of a glTF file and its buffers: out of a GLB, from `data:` URIs, or from files beside it.

use std::{borrow::Cow, collections::BTreeSet, ops::Range, sync::Arc};

use serde_json::Value;

use super::base64;
use crate::{
    error::{Mismatch, bytes_in_words, mismatch},
    files::{Files, Unread},
    json::without_mark,
    names::check_downward,
};

/// The first bytes of a GLB.
pub(super) const MAGIC: &[u8] = b"glTF";

/// Types of a GLB's chunks.
pub(super) const JSON_CHUNK: &[u8; 4] = b"JSON";
pub(super) const BINARY_CHUNK: &[u8; 4] = b"BIN\0";

/// Memory of a scene per byte of its files. Quantized accessors need 2, and nodes may show one mesh many times.
pub(super) const MOST_MEMORY_PER_BYTE: usize = 64;

/// A glTF file in memory.
#[derive(Debug)]
pub(super) struct Document<'a> {
    /// The description, which is shared so that buffers can be given back while it is read.
    pub json: Arc<Value>,
    buffers: Vec<Buffer<'a>>,
    n_bytes: usize,
}

/// A buffer: the whole file, and its part of it.
#[derive(Debug, Default)]
struct Buffer<'a> {
    file: Cow<'a, [u8]>,
    part: Range<usize>,
}

impl<'a> Buffer<'a> {
    fn whole(file: Cow<'a, [u8]>) -> Self {
        Self { part: 0..file.len(), file }
    }
}

impl<'a> Document<'a> {
    /// Parses a file, which is taken, or asks for the buffers that lie beside it.
    pub fn open(files: &'a mut Files) -> Result<Self, Unread> {
        let (text, binary) = match files.main.strip_prefix(MAGIC) {
            Some(rest) => chunks(rest, files.main.len())?,
            None => (0..files.main.len(), None),
        };
        let json: Value = serde_json::from_slice(without_mark(&files.main[text]))
            .map_err(|error| mismatch(format_args!("broken JSON ({error})"), "a glTF file"))?;
        match json["asset"]["version"].as_str() {
            Some(version) if version.starts_with("2.") => {}
            Some(version) => return Err(mismatch(format_args!("glTF version `{version}`"), "2.0").into()),
            None => return Err(mismatch("JSON without asset.version", "a glTF file").into()),
        }
        let none = Vec::new();
        let described = json["buffers"].as_array().unwrap_or(&none);
        let names = described.iter().filter_map(file_name).collect::<Result<Vec<_>, _>>()?;
        // The file stays where it is until all are there.
        files.others(&names)?;
        let mut main = binary.map(|part| Buffer { file: files.take_main().into(), part });
        let mut n_bytes = main.as_ref().map_or(files.main.len(), |main| main.file.len());
        let mut others = files.others(&names)?.into_iter();
        n_bytes += others.clone().map(<[u8]>::len).sum::<usize>();
        let mut buffers = Vec::with_capacity(described.len());
        for (i, buffer) in described.iter().enumerate() {
            let found = match buffer["uri"].as_str() {
                Some(uri) if uri.starts_with("data:") => Buffer::whole(data(uri)?.into()),
                // `names` has one for each.
                Some(_) => Buffer::whole(others.next().unwrap_or_default().into()),
                None if i == 0 => main.take().unwrap_or_default(),
                None => Buffer::default(),
            };
            let stated = buffer["byteLength"].as_u64().unwrap_or_default();
            if stated > found.part.len() as u64 && !is_fallback(&json, i) {
                let found =
                    format_args!("{} of buffer {i}", bytes_in_words(found.part.len() as u64)).to_string();
                return Err(mismatch(found, format_args!("its byteLength {stated}")).into());
            }
            buffers.push(found);
        }
        Ok(Self { json: Arc::new(json), buffers, n_bytes })
    }

    /// Gives back the memory of buffer views that are not read again, of those behind which nothing else lies.
    pub fn release(&mut self, are_read: &BTreeSet<usize>) {
        let none = Vec::new();
        let views = self.json["bufferViews"].as_array().unwrap_or(&none);
        for (i, buffer) in self.buffers.iter_mut().enumerate() {
            let Cow::Owned(file) = &mut buffer.file else { continue };
            let others = views
                .iter()
                .enumerate()
                .filter(|(at, view)| !are_read.contains(at) && view["buffer"].as_u64() == Some(i as u64));
            let end = |view: &Value| {
                let number = |key: &str| view[key].as_u64().unwrap_or(0);
                usize::try_from(number("byteOffset").saturating_add(number("byteLength")))
                    .unwrap_or(usize::MAX)
            };
            let kept = others.map(|(_, view)| end(view)).max().unwrap_or(0);
            buffer.part.end = buffer.part.end.min(buffer.part.start.saturating_add(kept));
            file.truncate(buffer.part.end);
            file.shrink_to_fit();
        }
    }

    /// Bytes of all files.
    pub fn n_bytes(&self) -> usize {
        self.n_bytes
    }

    /// Item `index` of a top-level array.
    pub fn item(&self, array: &str, index: usize) -> Result<&Value, Mismatch> {
        item(&self.json, array, index)
    }

    /// The bytes of a buffer view, and its stride if it has one.
    pub fn view(&self, index: usize) -> Result<(&[u8], Option<usize>), Mismatch> {
        let view = self.item("bufferViews", index)?;
        let number = |key: &str| self::index(&view[key]);
        let buffer = number("buffer").and_then(|buffer| self.buffers.get(buffer));
        let (start, length) = (number("byteOffset").unwrap_or(0), number("byteLength").unwrap_or(0));
        let end = start.checked_add(length);
        let bytes =
            buffer.zip(end).and_then(|(buffer, end)| buffer.file[buffer.part.clone()].get(start..end));
        let compression = compression(view);
        // A writer that names one buffer for both has no fallback.
        let is_packed = compression.is_some_and(|name| view["extensions"][name]["buffer"] == view["buffer"]);
        match (bytes.filter(|_| !is_packed), compression) {
            (Some(bytes), _) => Ok((bytes, number("byteStride"))),
            (None, Some(name)) => Err(mismatch(
                format_args!("bufferViews[{index}] compressed by {name}, which is not supported"),
                "a glTF without it, or with a fallback buffer",
            )),
            (None, None) => {
                Err(mismatch(format_args!("bufferViews[{index}] outside of its buffer"), "one inside of it"))
            }
        }
    }
}

/// Extensions that compress buffer views. They are not read, but the buffers that may take their place are.
pub(super) const COMPRESSIONS: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// The extension that compresses a buffer view, or `None` if its bytes are plain.
fn compression(view: &Value) -> Option<&'static str> {
    COMPRESSIONS.into_iter().find(|name| view["extensions"].get(name).is_some())
}

/// Whether a buffer only stands for what compressed views unpack to, so that its bytes may not be there.
fn is_fallback(json: &Value, buffer: usize) -> bool {
    if compression(&json["buffers"][buffer]).is_some() {
        return true;
    }
    let views = json["bufferViews"].as_array().into_iter().flatten();
    let mut of_buffer = views.filter(|view| view["buffer"].as_u64() == Some(buffer as u64)).peekable();
    of_buffer.peek().is_some() && of_buffer.all(|view| compression(view).is_some())
}

/// Item `index` of a top-level array.
pub(super) fn item<'a>(json: &'a Value, array: &str, index: usize) -> Result<&'a Value, Mismatch> {
    json[array]
        .get(index)
        .ok_or_else(|| mismatch(format_args!("a reference to {array}[{index}]"), "an index that exists"))
}

/// The places of the JSON and of the binary chunk in a GLB of `n_bytes`, whose magic is left out of `rest`.
fn chunks(rest: &[u8], n_bytes: usize) -> Result<(Range<usize>, Option<Range<usize>>), Mismatch> {
    let cut =
        || mismatch(format_args!("a GLB cut off after {}", bytes_in_words(n_bytes as u64)), "a whole one");
    let word = |bytes: &[u8], at: usize| Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?));
    let version = word(rest, 0).ok_or_else(cut)?;
    if version != 2 {
        return Err(mismatch(format_args!("GLB version {version}"), "2"));
    }
    let length = word(rest, 4).ok_or_else(cut)? as usize;
    if length > n_bytes {
        return Err(mismatch(
            bytes_in_words(n_bytes as u64),
            format_args!("the {length} that the GLB states"),
        ));
    }
    let mut rest = &rest[8..];
    let mut found = [None, None];
    while !rest.is_empty() {
        let chunk_bytes = word(rest, 0).ok_or_else(cut)? as usize;
        let (header, after) = rest.split_at_checked(8).ok_or_else(cut)?;
        let (chunk, after) = after.split_at_checked(chunk_bytes).ok_or_else(cut)?;
        let at = [JSON_CHUNK, BINARY_CHUNK].iter().position(|kind| header[4..] == kind[..]);
        // Unknown chunks are to be ignored.
        if let Some(at) = at {
            let end = n_bytes - after.len();
            found[at].get_or_insert(end - chunk.len()..end);
        }
        rest = after;
    }
    match found {
        [Some(json), binary] => Ok((json, binary)),
        [None, _] => Err(mismatch("a GLB without a JSON chunk", "one")),
    }
}

/// The file beside this one that holds a buffer, or `None` if none does.
fn file_name(buffer: &Value) -> Option<Result<String, Mismatch>> {
    let uri = buffer["uri"].as_str().filter(|uri| !uri.starts_with("data:"))?;
    let name = percent_decoded(uri);
    Some(check_downward(&name).map(|()| name))
}

/// A URI with its `%20` and the like replaced. Broken ones stay, and fail as a file name.
fn percent_decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, after @ ..] = rest {
        let hex =
            (*first == b'%').then(|| after.get(..2).and_then(|hex| std::str::from_utf8(hex).ok())).flatten();
        match hex.and_then(|hex| u8::from_str_radix(hex, 16).ok()) {
            Some(byte) => (bytes.push(byte), rest = &after[2..]),
            None => (bytes.push(*first), rest = after),
        };
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The bytes of a `data:` URI.
fn data(uri: &str) -> Result<Vec<u8>, Mismatch> {
    match uri.split_once(";base64,") {
        Some((_, text)) => base64::decode(text),
        None => Err(mismatch("a data: URI without `;base64,`", "base64")),
    }
}

/// A number that counts something.
pub(super) fn index(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|number| usize::try_from(number).ok())
}
