//! Accessors: typed rows of a buffer view, of which a sparse one replaces some.

use serde_json::Value;

use super::document::{Document, MOST_MEMORY_PER_BYTE, index as number};
use crate::error::{Mismatch, mismatch};

/// Types of components that attributes may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8 = 5120,
    U8 = 5121,
    I16 = 5122,
    U16 = 5123,
    F32 = 5126,
}

impl Component {
    fn from_code(code: u64) -> Option<Self> {
        let all = [Self::I8, Self::U8, Self::I16, Self::U16, Self::F32];
        all.into_iter().find(|component| u64::from(component.code()) == code)
    }

    /// The number in glTF.
    pub fn code(self) -> u32 {
        self as u32
    }

    /// Bytes of a component.
    pub fn n_bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::F32 => 4,
        }
    }
}

/// Rows of numbers in a buffer view. All of them lie inside of it.
#[derive(Clone, Debug)]
pub(super) struct Accessor<'a> {
    /// The rows, or `None` if all are 0.
    bytes: Option<&'a [u8]>,
    stride: usize,
    /// Rows in the place of others.
    sparse: Option<Sparse<'a>>,
    /// The type of the numbers.
    pub component: Component,
    is_normalized: bool,
    /// Number of rows.
    pub count: usize,
}

impl<'a> Accessor<'a> {
    /// Accessor `index`, which must have rows of `width` numbers. `name` is for messages.
    pub fn new(document: &'a Document, index: &Value, width: usize, name: &str) -> Result<Self, Mismatch> {
        let wrong = |found: String| mismatch(format!("{name}: {found}"), "an accessor of glTF 2.0");
        let accessor = document.item("accessors", number(index).ok_or_else(|| wrong("no index".into()))?)?;
        let kind = accessor["type"].as_str().unwrap_or_default();
        let found_width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 0,
        };
        if found_width != width {
            return Err(mismatch(format!("{name} of type `{kind}`"), format_args!("{width} numbers each")));
        }
        let code = accessor["componentType"].as_u64().unwrap_or_default();
        let component = Component::from_code(code).ok_or_else(|| wrong(format!("componentType {code}")))?;
        let count = number(&accessor["count"]).ok_or_else(|| wrong("no count".into()))?;
        let row = width * component.n_bytes();
        let sparse = match accessor.get("sparse") {
            Some(sparse) => Some(Sparse::new(document, sparse, row, count, name)?),
            None => None,
        };
        let is_normalized = accessor["normalized"].as_bool().unwrap_or(false);
        let plain = Self { bytes: None, stride: row, sparse, component, is_normalized, count };
        let Some(view) = number(&accessor["bufferView"]) else {
            // Rows of 0, by the specification. Without others among them they stand for compressed ones.
            let most = document.n_bytes().saturating_mul(MOST_MEMORY_PER_BYTE);
            return match plain.sparse {
                Some(_) if count.saturating_mul(row) <= most => Ok(plain),
                Some(_) => Err(wrong(format!("{count} rows of 0"))),
                None => Err(wrong("no bufferView".into())),
            };
        };
        let (bytes, stride) = document.view(view)?;
        let stride = stride.unwrap_or(row);
        let offset = number(&accessor["byteOffset"]).unwrap_or(0);
        match rows(bytes, offset, count, row, stride) {
            Some(bytes) => Ok(Self { bytes: Some(bytes), stride, ..plain }),
            None => Err(mismatch(
                format_args!("{name}: {count} rows of {row} bytes, {stride} apart, from {offset} on"),
                format_args!("rows inside of the buffer view's {} bytes", bytes.len()),
            )),
        }
    }

    /// The bytes from the beginning of row `i` on.
    fn stored(&self, i: usize) -> &'a [u8] {
        match (self.sparse.as_ref().and_then(|sparse| sparse.row(i)), self.bytes) {
            (Some(row), _) => row,
            (None, Some(bytes)) => &bytes[i * self.stride..],
            (None, None) => &ZEROS,
        }
    }

    /// Row `i`. `W` is the width that was asked for.
    pub fn row<const W: usize>(&self, i: usize) -> [f32; W] {
        let row = self.stored(i);
        let normalized = |value: f32, largest: f32| match self.is_normalized {
            // The smallest signed number is one step below -1.
            true => (value / largest).max(-1.0),
            false => value,
        };
        std::array::from_fn(|column| match self.component {
            Component::F32 => f32::from_le_bytes(std::array::from_fn(|byte| row[4 * column + byte])),
            Component::I8 => normalized(f32::from(row[column].cast_signed()), 127.0),
            Component::U8 => normalized(f32::from(row[column]), 255.0),
            Component::I16 => normalized(f32::from(self.word(row, column).cast_signed()), 32767.0),
            Component::U16 => normalized(f32::from(self.word(row, column)), 65535.0),
        })
    }

    /// Row `i` of a [`Component::U16`] accessor, as it is stored.
    pub fn words<const W: usize>(&self, i: usize) -> [u16; W] {
        let row = self.stored(i);
        std::array::from_fn(|column| self.word(row, column))
    }

    fn word(&self, row: &[u8], column: usize) -> u16 {
        u16::from_le_bytes([row[2 * column], row[2 * column + 1]])
    }
}

/// The longest row: four numbers of 4 bytes.
static ZEROS: [u8; 16] = [0; 16];

/// The bytes of `count` rows of `row` bytes in `bytes`, `stride` apart, or `None` if they do not lie inside.
fn rows(bytes: &[u8], offset: usize, count: usize, row: usize, stride: usize) -> Option<&[u8]> {
    // The last row may end before the stride does.
    let needed = count.checked_sub(1).map_or(Some(0), |n| n.checked_mul(stride)?.checked_add(row))?;
    bytes.get(offset..)?.get(..needed).filter(|_| stride >= row)
}

/// Rows of an accessor that take the place of others, by their ascending indices.
#[derive(Clone, Debug)]
struct Sparse<'a> {
    indices: Vec<usize>,
    values: &'a [u8],
    /// Bytes of a row.
    row: usize,
}

impl<'a> Sparse<'a> {
    /// The part `sparse` of an accessor of `n` rows of `row` bytes. `name` is for messages.
    fn new(
        document: &'a Document,
        sparse: &Value,
        row: usize,
        n: usize,
        name: &str,
    ) -> Result<Self, Mismatch> {
        let wrong = |found: String| mismatch(format!("{name}: {found}"), "a sparse accessor of glTF 2.0");
        let count = number(&sparse["count"]).ok_or_else(|| wrong("sparse rows without a count".into()))?;
        let index_bytes = match sparse["indices"]["componentType"].as_u64() {
            Some(5121) => 1,
            Some(5123) => 2,
            Some(5125) => 4,
            _ => return Err(wrong("sparse indices of a type that is no unsigned integer".into())),
        };
        let part = |key: &str, bytes: usize| {
            let part = &sparse[key];
            let view = number(&part["bufferView"])
                .ok_or_else(|| wrong(format!("sparse {key} without bufferView")))?;
            let found =
                rows(document.view(view)?.0, number(&part["byteOffset"]).unwrap_or(0), count, bytes, bytes);
            found.ok_or_else(|| {
                wrong(format!("{count} sparse {key} that do not lie inside of their bufferView"))
            })
        };
        let (indices, values) = (part("indices", index_bytes)?, part("values", row)?);
        let little_endian =
            |bytes: &[u8]| bytes.iter().rev().fold(0, |index, &byte| index << 8 | usize::from(byte));
        let indices: Vec<usize> = indices.chunks_exact(index_bytes).map(little_endian).collect();
        // The last one is the largest, then.
        match indices.is_sorted_by(|a, b| a < b) && indices.last().is_none_or(|&last| last < n) {
            true => Ok(Self { indices, values, row }),
            false => Err(wrong(format!("sparse indices that do not ascend below {n}"))),
        }
    }

    /// The row in the place of row `i`, or `None` if it stays.
    fn row(&self, i: usize) -> Option<&'a [u8]> {
        self.values.get(self.indices.binary_search(&i).ok()? * self.row..)
    }
}
