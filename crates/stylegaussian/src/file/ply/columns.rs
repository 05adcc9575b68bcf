//! The rows of one element: chosen scalar properties as f32.

use std::str::SplitAsciiWhitespace;

use ply_rs::ply::{ElementDef, Encoding, PropertyType, ScalarType};

use super::header::{Header, size_of_scalar};
use crate::file::error::{Mismatch, mismatch};

/// Values `[n_rows, n_columns]`, row-major.
pub(super) struct Columns {
    values: Vec<f32>,
    n_columns: usize,
}

impl Columns {
    /// The rows, first to last.
    pub(super) fn rows(&self) -> std::slice::ChunksExact<'_, f32> {
        self.values.chunks_exact(self.n_columns)
    }

    /// The same rows, each followed by `constants`.
    pub(super) fn with_constants(&self, constants: &[f32]) -> Self {
        let values = self.rows().flat_map(|row| row.iter().chain(constants).copied()).collect();
        Self { values, n_columns: self.n_columns + constants.len() }
    }

    /// Number of rows.
    pub(super) fn n_rows(&self) -> usize {
        self.values.len() / self.n_columns
    }
}

/// Reads the properties `names` of the element called `wanted`, in that order, and skips all others.
pub(super) fn read_columns(header: &Header, wanted: &str, names: &[String]) -> Result<Columns, Mismatch> {
    match header.encoding() {
        Encoding::Ascii => {
            let text = std::str::from_utf8(header.payload).map_err(|error| {
                mismatch(format_args!("bytes that are no text ({error})"), "ascii numbers")
            })?;
            walk(header, Ascii { words: text.split_ascii_whitespace() }, wanted, names)
        }
        Encoding::BinaryLittleEndian => {
            walk(header, Binary::<false> { bytes: header.payload }, wanted, names)
        }
        Encoding::BinaryBigEndian => walk(header, Binary::<true> { bytes: header.payload }, wanted, names),
    }
}

/// Reads the elements in the file's order up to the wanted one. Those before it are parsed to find their end.
fn walk(
    header: &Header,
    mut source: impl Source,
    wanted: &str,
    names: &[String],
) -> Result<Columns, Mismatch> {
    for element in header.elements() {
        // Without names every property is skipped.
        let names = if element.name == wanted { names } else { &[] };
        let columns = element_columns(element, &mut source, names)?;
        if element.name == wanted {
            return Ok(columns);
        }
    }
    Err(mismatch("no such element", format_args!("element `{wanted}`")))
}

/// Reads all rows of one element.
fn element_columns(
    element: &ElementDef,
    source: &mut impl Source,
    names: &[String],
) -> Result<Columns, Mismatch> {
    if let Some(missing) = names.iter().find(|name| !element.properties.contains_key(*name)) {
        return Err(mismatch(
            format_args!("no property `{missing}` in element `{}`", element.name),
            format_args!("`{missing}`"),
        ));
    }
    // Type and target column of each property, in the file's order.
    let plan: Vec<(&PropertyType, Option<usize>)> = element
        .properties
        .values()
        .map(|property| (&property.data_type, names.iter().position(|name| *name == property.name)))
        .collect();
    let n_columns = names.len();
    // The count is safe to allocate for: the header's check gave every declared row at least a byte per property.
    let mut values = Vec::with_capacity(element.count * n_columns);
    let mut row = vec![0.0; n_columns];
    // Rows without properties take no bytes, so a small file can declare 10^18 of them.
    let n_rows = if plan.is_empty() { 0 } else { element.count };
    for i in 0..n_rows {
        read_row(&plan, source, &mut row).map_err(|Mismatch { found, expected }| {
            mismatch(format_args!("{found} in row {i} of {n_rows} of element `{}`", element.name), expected)
        })?;
        values.extend_from_slice(&row);
    }
    Ok(Columns { values, n_columns })
}

fn read_row(
    plan: &[(&PropertyType, Option<usize>)],
    source: &mut impl Source,
    row: &mut [f32],
) -> Result<(), Mismatch> {
    for (data_type, column) in plan {
        match (data_type, column) {
            (PropertyType::Scalar(scalar), Some(column)) => row[*column] = source.number(scalar)?,
            (PropertyType::Scalar(scalar), None) => source.skip(scalar, 1)?,
            // A list has any length, so rows with lists have no common size and are walked one by one.
            (PropertyType::List(length, item), None) => {
                let length = source.length(length)?;
                source.skip(item, length)?;
            }
            (PropertyType::List(..), Some(_)) => return Err(mismatch("a list", "a number")),
        }
    }
    Ok(())
}

/// A sequence of numbers in one of the encodings.
trait Source {
    /// The next number.
    fn number(&mut self, scalar: &ScalarType) -> Result<f32, Mismatch>;
    /// The next number as the length of a list.
    fn length(&mut self, scalar: &ScalarType) -> Result<usize, Mismatch>;
    /// Skips the next `count` numbers.
    fn skip(&mut self, scalar: &ScalarType, count: usize) -> Result<(), Mismatch>;
}

/// Numbers between white space. Line ends have no meaning, as in other readers.
struct Ascii<'a> {
    words: SplitAsciiWhitespace<'a>,
}

impl<'a> Ascii<'a> {
    fn word(&mut self) -> Result<&'a str, Mismatch> {
        self.words.next().ok_or_else(|| mismatch("the end of the file", "a number"))
    }
}

impl Source for Ascii<'_> {
    fn number(&mut self, _: &ScalarType) -> Result<f32, Mismatch> {
        let word = self.word()?;
        word.parse().map_err(|_| mismatch(format_args!("`{}`", word.escape_debug()), "a number"))
    }

    fn length(&mut self, _: &ScalarType) -> Result<usize, Mismatch> {
        let word = self.word()?;
        word.parse().map_err(|_| mismatch(format_args!("list length `{}`", word.escape_debug()), "a count"))
    }

    fn skip(&mut self, _: &ScalarType, count: usize) -> Result<(), Mismatch> {
        (0..count).try_for_each(|_| self.word().map(|_| ()))
    }
}

/// Packed numbers.
struct Binary<'a, const BIG_ENDIAN: bool> {
    bytes: &'a [u8],
}

impl<'a, const BIG_ENDIAN: bool> Binary<'a, BIG_ENDIAN> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], Mismatch> {
        let (taken, rest) = self
            .bytes
            .split_at_checked(n)
            .ok_or_else(|| mismatch("the end of the file", format_args!("{n} bytes")))?;
        self.bytes = rest;
        Ok(taken)
    }

    /// The next `N` bytes as little endian.
    fn array<const N: usize>(&mut self) -> Result<[u8; N], Mismatch> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        if BIG_ENDIAN {
            array.reverse();
        }
        Ok(array)
    }
}

impl<const BIG_ENDIAN: bool> Source for Binary<'_, BIG_ENDIAN> {
    #[inline]
    fn number(&mut self, scalar: &ScalarType) -> Result<f32, Mismatch> {
        Ok(match scalar {
            ScalarType::Char => i8::from_le_bytes(self.array()?).into(),
            ScalarType::UChar => u8::from_le_bytes(self.array()?).into(),
            ScalarType::Short => i16::from_le_bytes(self.array()?).into(),
            ScalarType::UShort => u16::from_le_bytes(self.array()?).into(),
            ScalarType::Int => i32::from_le_bytes(self.array()?) as f32,
            ScalarType::UInt => u32::from_le_bytes(self.array()?) as f32,
            ScalarType::Float => f32::from_le_bytes(self.array()?),
            ScalarType::Double => f64::from_le_bytes(self.array()?) as f32,
        })
    }

    fn length(&mut self, scalar: &ScalarType) -> Result<usize, Mismatch> {
        let length: i64 = match scalar {
            ScalarType::Char => i8::from_le_bytes(self.array()?).into(),
            ScalarType::UChar => u8::from_le_bytes(self.array()?).into(),
            ScalarType::Short => i16::from_le_bytes(self.array()?).into(),
            ScalarType::UShort => u16::from_le_bytes(self.array()?).into(),
            ScalarType::Int => i32::from_le_bytes(self.array()?).into(),
            ScalarType::UInt => u32::from_le_bytes(self.array()?).into(),
            ScalarType::Float | ScalarType::Double => {
                return Err(mismatch("a list length that is no integer", "a count"));
            }
        };
        usize::try_from(length).map_err(|_| mismatch(format_args!("list length {length}"), "a count"))
    }

    fn skip(&mut self, scalar: &ScalarType, count: usize) -> Result<(), Mismatch> {
        // A product that does not fit saturates, and is then more than the file holds.
        self.take(count.saturating_mul(size_of_scalar(scalar))).map(|_| ())
    }
}
