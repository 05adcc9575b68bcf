//! Accessors: typed rows of a buffer view.

use serde_json::Value;

use super::document::Document;
use crate::error::{Mismatch, mismatch};

/// Types of components that attributes may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    F32,
}

impl Component {
    fn from_code(code: u64) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5126 => Self::F32,
            _ => return None,
        })
    }

    /// The number in glTF.
    pub fn code(self) -> u32 {
        match self {
            Self::I8 => 5120,
            Self::U8 => 5121,
            Self::I16 => 5122,
            Self::U16 => 5123,
            Self::F32 => 5126,
        }
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
#[derive(Clone, Copy, Debug)]
pub(super) struct Accessor<'a> {
    bytes: &'a [u8],
    stride: usize,
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
        let number = |value: &Value| value.as_u64().and_then(|number| usize::try_from(number).ok());
        let accessor = document.item("accessors", number(index).ok_or_else(|| wrong("no index".into()))?)?;
        if accessor.get("sparse").is_some() {
            return Err(mismatch(
                format!("{name}: a sparse accessor, which is not supported"),
                "a plain one",
            ));
        }
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
        let view = number(&accessor["bufferView"]).ok_or_else(|| wrong("no bufferView".into()))?;
        let (bytes, stride) = document.view(view)?;
        let row = width * component.n_bytes();
        let stride = stride.unwrap_or(row);
        let count = number(&accessor["count"]).ok_or_else(|| wrong("no count".into()))?;
        let offset = number(&accessor["byteOffset"]).unwrap_or(0);
        // The last row may end before the stride does.
        let needed = count.checked_sub(1).map_or(Some(0), |n| n.checked_mul(stride)?.checked_add(row));
        let fits = needed.and_then(|needed| bytes.get(offset..)?.get(..needed));
        match fits {
            Some(bytes) if stride >= row => Ok(Self {
                bytes,
                stride,
                component,
                is_normalized: accessor["normalized"].as_bool().unwrap_or(false),
                count,
            }),
            _ => Err(mismatch(
                format_args!("{name}: {count} rows of {row} bytes, {stride} apart, from {offset} on"),
                format_args!("rows inside of the buffer view's {} bytes", bytes.len()),
            )),
        }
    }

    /// Row `i`. `W` is the width that was asked for.
    pub fn row<const W: usize>(&self, i: usize) -> [f32; W] {
        let row = &self.bytes[i * self.stride..];
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
        std::array::from_fn(|column| self.word(&self.bytes[i * self.stride..], column))
    }

    fn word(&self, row: &[u8], column: usize) -> u16 {
        u16::from_le_bytes([row[2 * column], row[2 * column + 1]])
    }
}
