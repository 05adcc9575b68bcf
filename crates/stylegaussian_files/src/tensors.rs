//! Safetensors: typed and checked reading, and streamed writing that gives the same bytes every time.
//!
//! Metadata `format` and `version` say what a file is.

use std::{
    borrow::Cow,
    collections::BTreeMap,
    io::{self, Write},
    ops::Range,
    str::FromStr,
};

use half::f16;
use rayon::prelude::*;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use serde_json::json;

use super::{
    error::{Mismatch, mismatch},
    pages::enlarge,
};

/// The version of all our formats that this build reads and writes.
const VERSION: &str = "1";

/// A safetensors file in memory.
#[derive(Debug)]
pub struct Reader<'a> {
    tensors: SafeTensors<'a>,
    metadata: BTreeMap<String, String>,
}

impl<'a> Reader<'a> {
    /// Parses the header, and checks counts, offsets and sizes against the size of the file.
    ///
    /// # Errors
    /// If it is no safetensors file, or not a whole one.
    pub fn new(bytes: &'a [u8]) -> Result<Self, Mismatch> {
        let broken = |error| mismatch(format_args!("a broken header ({error})"), "a whole safetensors file");
        // The header is parsed twice, because `SafeTensors` keeps its metadata to itself.
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(broken)?;
        let metadata = header.metadata().clone().unwrap_or_default().into_iter().collect();
        Ok(Self { tensors: SafeTensors::deserialize(bytes).map_err(broken)?, metadata })
    }

    /// Checks metadata `format` and `version`.
    pub(super) fn expect_format(&self, format: &str) -> Result<(), Mismatch> {
        self.expect_value("format", format)?;
        self.expect_value("version", VERSION)
    }

    /// Checks that metadata `key` is `value`.
    ///
    /// # Errors
    /// If it is not.
    pub fn expect_value(&self, key: &str, value: &str) -> Result<(), Mismatch> {
        let expected = format!("`{key}` = `{value}`");
        match self.metadata(key) {
            Some(found) if found == value => Ok(()),
            Some(found) => Err(mismatch(format_args!("metadata `{key}` = `{}`", shortened(found)), expected)),
            None => Err(mismatch(format_args!("no metadata `{key}`"), expected)),
        }
    }

    /// Metadata `key`, or `None` if there is none.
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.metadata.get(key).map(String::as_str)
    }

    /// Metadata `key` parsed as a `T`, or `None` if there is none.
    pub(super) fn parsed<T: FromStr>(&self, key: &str, expected: &str) -> Result<Option<T>, Mismatch> {
        let Some(text) = self.metadata(key) else { return Ok(None) };
        let found = || mismatch(format_args!("metadata `{key}` = `{}`", shortened(text)), expected);
        text.parse().map(Some).map_err(|_| found())
    }

    /// Metadata `key` parsed as a `T`.
    ///
    /// # Errors
    /// If there is none, or no `T`.
    pub fn required<T: FromStr>(&self, key: &str, expected: &str) -> Result<T, Mismatch> {
        self.parsed(key, expected)?.ok_or_else(|| mismatch(format_args!("no metadata `{key}`"), expected))
    }

    /// Names of all tensors, sorted.
    pub(super) fn names(&self) -> Vec<&str> {
        let mut names = self.tensors.names();
        names.sort_unstable();
        names
    }

    /// Whether there is a tensor of this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.tensors.tensor(name).is_ok()
    }

    /// The shape of a tensor, or `None` if there is none of this name.
    pub(super) fn shape(&self, name: &str) -> Option<Vec<usize>> {
        self.tensors.tensor(name).ok().map(|tensor| tensor.shape().to_vec())
    }

    /// A tensor of finite numbers, f16 or f32. `shape` has the size of each dimension, or its name if any size
    /// will do.
    ///
    /// # Errors
    /// If there is no such tensor, or a number is not finite.
    pub fn floats(&self, name: &str, shape: &[Dimension]) -> Result<Vec<f32>, Mismatch> {
        let tensor = self.tensor(name, shape)?;
        // Not cast in place: the bytes of a file may lie unaligned, and the machine may be big-endian.
        let values = match tensor.dtype() {
            Dtype::F32 => numbers(tensor.data(), f32::from_le_bytes),
            Dtype::F16 => numbers(tensor.data(), |bytes| f16::from_le_bytes(bytes).to_f32()),
            other => return Err(mismatch(format_args!("`{name}` of type {other:?}"), "F32 or F16")),
        };
        expect_finite(name, &values)?;
        Ok(values)
    }

    /// A tensor of u32.
    pub(super) fn indices(&self, name: &str, shape: &[Dimension]) -> Result<Vec<u32>, Mismatch> {
        let tensor = self.tensor(name, shape)?;
        if tensor.dtype() != Dtype::U32 {
            return Err(mismatch(format_args!("`{name}` of type {:?}", tensor.dtype()), "U32"));
        }
        Ok(tensor.data().chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }

    /// A tensor of u8, and its shape.
    pub(super) fn bytes(&self, name: &str, shape: &[Dimension]) -> Result<(&'a [u8], Vec<usize>), Mismatch> {
        let tensor = self.tensor(name, shape)?;
        match tensor.dtype() {
            Dtype::U8 => Ok((tensor.data(), tensor.shape().to_vec())),
            other => Err(mismatch(format_args!("`{name}` of type {other:?}"), "U8")),
        }
    }

    fn tensor(&self, name: &str, shape: &[Dimension]) -> Result<TensorView<'a>, Mismatch> {
        let expected = || {
            let sizes: Vec<String> = shape.iter().map(Dimension::to_string).collect();
            format!("tensor `{name}` [{}]", sizes.join(", "))
        };
        let tensor = self
            .tensors
            .tensor(name)
            .map_err(|_| mismatch(format_args!("no tensor `{name}`"), expected()))?;
        let fits = tensor.shape().len() == shape.len()
            && tensor.shape().iter().zip(shape).all(|(&found, expected)| expected.admits(found));
        if fits {
            Ok(tensor)
        } else {
            Err(mismatch(format_args!("`{name}` {:?}", tensor.shape()), expected()))
        }
    }
}

/// One dimension of an expected shape.
#[derive(Clone, Copy, Debug)]
pub enum Dimension {
    /// Exactly this size.
    Is(usize),
    /// This size, or 0.
    IsOrNone(usize),
    /// Any size. The text is the dimension's letter in the documentation, such as D.
    Any(&'static str),
}

impl Dimension {
    fn admits(&self, found: usize) -> bool {
        match self {
            Self::Is(size) => *size == found,
            Self::IsOrNone(size) => *size == found || found == 0,
            Self::Any(_) => true,
        }
    }
}

impl std::fmt::Display for Dimension {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Is(size) => write!(f, "{size}"),
            Self::IsOrNone(size) => write!(f, "{size} or 0"),
            Self::Any(letter) => f.write_str(letter),
        }
    }
}

/// The numbers of `B` bytes each.
fn numbers<const B: usize>(bytes: &[u8], number: impl Fn([u8; B]) -> f32 + Sync) -> Vec<f32> {
    let stored = bytes.as_chunks::<B>().0;
    let mut values = vec![0.0; stored.len()];
    enlarge(&mut values);
    values.par_iter_mut().zip(stored).for_each(|(value, &bytes)| *value = number(bytes));
    values
}

/// Checks that no value is NaN or infinite.
pub(super) fn expect_finite(name: &str, values: &[f32]) -> Result<(), Mismatch> {
    // Without an early end the loop over a block takes vector instructions, and a block has one end to ask for.
    let is_finite = |block: &[f32]| block.iter().fold(true, |all, value| all & value.is_finite());
    if values.par_chunks(4096).all(is_finite) {
        return Ok(());
    }
    let index = values.iter().position(|value| !value.is_finite()).unwrap_or(0);
    Err(mismatch(format_args!("`{name}` with {} at {index}", values[index]), "finite numbers"))
}

/// The beginning of a text from a file, for messages: a damaged file may hold megabytes of it.
fn shortened(text: &str) -> Cow<'_, str> {
    const MOST: usize = 60;
    match text.char_indices().nth(MOST) {
        None => text.into(),
        Some((end, _)) => format!("{}...", &text[..end]).into(),
    }
}

/// The values of a tensor to be written.
enum Values<'a> {
    /// Written as they are.
    F32(&'a [f32]),
    /// Rounded to f16 when written. Values beyond its range are clamped to it.
    F16(&'a [f32]),
    /// Written as they are.
    U32(&'a [u32]),
    /// Written as they are.
    U8(Cow<'a, [u8]>),
    /// f32, each made from its flat index when it is written.
    Made(Box<dyn Fn(usize) -> f32 + 'a>),
}

impl Values<'_> {
    fn dtype(&self) -> Dtype {
        match self {
            Self::F32(_) | Self::Made(_) => Dtype::F32,
            Self::F16(_) => Dtype::F16,
            Self::U32(_) => Dtype::U32,
            Self::U8(_) => Dtype::U8,
        }
    }

    /// Appends the little-endian bytes of the values in `range`.
    fn append(&self, range: Range<usize>, bytes: &mut Vec<u8>) {
        // Clamped, since a value that rounds to infinity would make the file unreadable.
        let (min, max) = (f16::MIN.to_f32(), f16::MAX.to_f32());
        let half = |value: &f32| f16::from_f32(value.clamp(min, max)).to_le_bytes();
        match self {
            Self::F32(values) => bytes.extend(values[range].iter().flat_map(|value| value.to_le_bytes())),
            Self::F16(values) => bytes.extend(values[range].iter().flat_map(half)),
            Self::U32(values) => bytes.extend(values[range].iter().flat_map(|value| value.to_le_bytes())),
            Self::U8(values) => bytes.extend_from_slice(&values[range]),
            Self::Made(value) => bytes.extend(range.flat_map(|index| value(index).to_le_bytes())),
        }
    }
}

/// A tensor to be written.
struct Tensor<'a> {
    name: String,
    shape: Vec<usize>,
    values: Values<'a>,
}

/// A safetensors file to be written.
#[derive(Default)]
pub struct Writer<'a> {
    metadata: BTreeMap<String, String>,
    tensors: Vec<Tensor<'a>>,
}

impl<'a> Writer<'a> {
    /// A file of this format and the current version.
    pub fn new(format: &str) -> Self {
        let mut writer = Self::default();
        writer.set("format", format);
        writer.set("version", VERSION);
        writer
    }

    /// Sets a metadata value.
    pub fn set(&mut self, key: &str, value: impl ToString) {
        self.metadata.insert(key.into(), value.to_string());
    }

    /// Adds an f32 tensor.
    pub fn f32(&mut self, name: impl Into<String>, shape: &[usize], values: &'a [f32]) {
        self.add(name.into(), shape, Values::F32(values));
    }

    /// Adds a tensor rounded to f16. Values beyond its range are clamped to it.
    pub(super) fn f16(&mut self, name: impl Into<String>, shape: &[usize], values: &'a [f32]) {
        self.add(name.into(), shape, Values::F16(values));
    }

    /// Adds a u32 tensor.
    pub(super) fn u32(&mut self, name: impl Into<String>, shape: &[usize], values: &'a [u32]) {
        self.add(name.into(), shape, Values::U32(values));
    }

    /// Adds a u8 tensor.
    pub(super) fn u8(&mut self, name: &str, shape: &[usize], values: impl Into<Cow<'a, [u8]>>) {
        self.add(name.into(), shape, Values::U8(values.into()));
    }

    /// Adds an f32 tensor that is not in memory. `value` computes each number from its flat index when it is
    /// written.
    pub(super) fn made(&mut self, name: &str, shape: &[usize], value: impl Fn(usize) -> f32 + 'a) {
        self.add(name.into(), shape, Values::Made(Box::new(value)));
    }

    fn add(&mut self, name: String, shape: &[usize], values: Values<'a>) {
        self.tensors.push(Tensor { name, shape: shape.into(), values });
    }

    /// Writes header and tensors.
    ///
    /// # Errors
    /// If `out` takes no more.
    pub fn write(mut self, out: &mut dyn Write) -> io::Result<()> {
        // Wide types first, so that every tensor starts aligned to its type.
        self.tensors.sort_by(|a, b| {
            let width = |tensor: &Tensor| tensor.values.dtype().bitsize();
            width(b).cmp(&width(a)).then_with(|| a.name.cmp(&b.name))
        });
        let header = self.header();
        out.write_all(&(header.len() as u64).to_le_bytes())?;
        out.write_all(&header)?;
        for tensor in &self.tensors {
            write_values(tensor, out)?;
        }
        Ok(())
    }

    /// The JSON header, padded to 8 bytes. Ours, since the safetensors crate writes metadata in a hash map's
    /// random order, and equal scenes are to give equal files.
    fn header(&self) -> Vec<u8> {
        // This map keeps its keys sorted, so that the bytes do not depend on the order of calls.
        let mut header = serde_json::Map::new();
        header.insert("__metadata__".into(), json!(self.metadata));
        let mut start = 0;
        for Tensor { name, shape, values } in &self.tensors {
            let dtype = values.dtype();
            let end = start + shape.iter().product::<usize>() * dtype.bitsize() / 8;
            header.insert(
                name.clone(),
                json!({ "dtype": dtype, "shape": shape, "data_offsets": [start, end] }),
            );
            // Readers refuse gaps between tensors.
            start = end;
        }
        // The data follow the header and its length of 8 bytes. JSON allows the spaces that align them.
        let mut bytes = serde_json::Value::from(header).to_string().into_bytes();
        bytes.resize(bytes.len().next_multiple_of(8), b' ');
        bytes
    }
}

/// Writes a tensor's values chunk by chunk, so that memory never holds all of them twice.
fn write_values(tensor: &Tensor, out: &mut dyn Write) -> io::Result<()> {
    const CHUNK: usize = 1 << 16;
    let n_values: usize = tensor.shape.iter().product();
    let mut bytes = Vec::new();
    for start in (0..n_values).step_by(CHUNK) {
        bytes.clear();
        tensor.values.append(start..(start + CHUNK).min(n_values), &mut bytes);
        out.write_all(&bytes)?;
    }
    Ok(())
}
