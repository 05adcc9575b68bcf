//! The rows of one element: chosen scalar properties as f32, coordinates also as f64.

use std::{
    borrow::Cow,
    ops::Range,
    str::{FromStr, SplitAsciiWhitespace},
};

use ply_rs::ply::{ElementDef, Encoding, PropertyType, ScalarType};

use super::header::{Header, size_of_scalar};
use crate::error::{Mismatch, mismatch};

/// Chosen properties of the rows of an element, in the bytes of the file where they lie at the same place in
/// each row.
pub(super) struct Rows<'a> {
    bytes: Cow<'a, [u8]>,
    /// The first row.
    start: usize,
    /// Bytes from one row to the next.
    stride: usize,
    /// Place within a row and type of each column.
    fields: Vec<(usize, ScalarType)>,
    is_big_endian: bool,
    /// Whether all columns are f32, little endian.
    are_plain: bool,
    n_rows: usize,
}

impl Rows<'_> {
    /// Number of rows.
    pub(super) fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// Row `i` from column `first` on, as many numbers as `values` has room for.
    #[inline]
    pub(super) fn read(&self, i: usize, first: usize, values: &mut [f32]) {
        let row = &self.bytes[self.start + i * self.stride..][..self.stride];
        let columns = self.fields[first..].iter().zip(values);
        // Of nearly all files.
        if self.are_plain {
            columns.for_each(|(&(at, _), value)| {
                *value = row[at..].first_chunk().map_or(0.0, |bytes| f32::from_le_bytes(*bytes));
            });
        } else {
            columns
                .for_each(|((at, scalar), value)| *value = number(&row[*at..], scalar, self.is_big_endian));
        }
    }

    /// The numbers of row `i` from column `first` on.
    pub(super) fn array<const N: usize>(&self, i: usize, first: usize) -> [f32; N] {
        let mut values = [0.0; N];
        self.read(i, first, &mut values);
        values
    }

    /// Whether any of these columns has numbers that f32 may round.
    pub(super) fn are_wide(&self, columns: Range<usize>) -> bool {
        self.fields[columns].iter().any(|(_, scalar)| is_wide(scalar))
    }

    /// The numbers of row `i` from column `first` on, not rounded to f32.
    pub(super) fn wide<const N: usize>(&self, i: usize, first: usize) -> [f64; N] {
        let row = &self.bytes[self.start + i * self.stride..][..self.stride];
        std::array::from_fn(|column| {
            let (at, scalar) = &self.fields[first + column];
            wide_number(&row[*at..], scalar, self.is_big_endian)
        })
    }

    /// Drops all columns but the first `n_columns`, and gives back the memory of the others if the rows own
    /// theirs.
    pub(super) fn keep(&mut self, n_columns: usize) {
        let stride = n_columns * size_of::<f32>();
        if stride > self.stride || matches!(self.bytes, Cow::Borrowed(_)) {
            return;
        }
        let mut values = vec![0.0; n_columns];
        for i in 0..self.n_rows {
            self.read(i, 0, &mut values);
            // No farther than the end of the row that was read, since new rows are no longer than old ones.
            let row = &mut self.bytes.to_mut()[i * stride..][..stride];
            for (bytes, value) in row.as_chunks_mut::<4>().0.iter_mut().zip(&values) {
                *bytes = value.to_le_bytes();
            }
        }
        let bytes = self.bytes.to_mut();
        bytes.truncate(self.n_rows * stride);
        bytes.shrink_to_fit();
        (self.start, self.stride, self.is_big_endian, self.are_plain) = (0, stride, false, true);
        self.fields = floats(n_columns);
    }
}

/// Places and types of columns of f32, one after another.
fn floats(n_columns: usize) -> Vec<(usize, ScalarType)> {
    (0..n_columns).map(|i| (i * size_of::<f32>(), ScalarType::Float)).collect()
}

/// Whether a type has numbers that f32 rounds.
fn is_wide(scalar: &ScalarType) -> bool {
    matches!(scalar, ScalarType::Double | ScalarType::Int | ScalarType::UInt)
}

/// Columns in which numbers that are read one by one stay as fine as they are: f32 rounds coordinates visibly
/// that are far from their origin.
const COORDINATES: [&str; 3] = ["x", "y", "z"];

/// Places and types of the columns `names` in rows that are read one by one, and the bytes of such a row: f32,
/// or f64 if they are coordinates that f32 may round, as any text.
fn walked_fields(header: &Header, wanted: &str, names: &[String]) -> (Vec<(usize, ScalarType)>, usize) {
    let is_text = header.encoding() == Encoding::Ascii;
    let mut stride = 0;
    let field = |name: &String| {
        let property = header.element(wanted).and_then(|element| element.properties.get(name));
        let is_fine = property.is_some_and(|property| match &property.data_type {
            PropertyType::Scalar(scalar) => is_text || is_wide(scalar),
            PropertyType::List(..) => false,
        });
        let scalar = match is_fine && COORDINATES.contains(&&**name) {
            true => ScalarType::Double,
            false => ScalarType::Float,
        };
        let at = stride;
        stride += size_of_scalar(&scalar);
        (at, scalar)
    };
    (names.iter().map(field).collect(), stride)
}

/// The properties `names` of the element called `wanted`, in that order, of a file with this header. Rows own
/// the file's bytes if they are given them.
pub(super) fn read_columns<'a>(
    header: &Header,
    file: Cow<'a, [u8]>,
    wanted: &str,
    names: &[String],
) -> Result<Rows<'a>, Mismatch> {
    if let Some((start, stride, fields)) = fixed_fields(header, wanted, names)? {
        let n_rows = header.element(wanted).map_or(0, |element| element.count);
        let start = header.payload + start;
        // No sum or product overflows: the header's counts were checked against the file's size.
        if file.get(start..start + n_rows * stride).is_none() {
            return Err(mismatch("the end of the file", format_args!("{n_rows} rows of `{wanted}`")));
        }
        let is_big_endian = header.encoding() == Encoding::BinaryBigEndian;
        // Rows without properties take no bytes, so a small file can declare 10^18 of them.
        let n_rows = if stride == 0 { 0 } else { n_rows };
        let are_plain =
            !is_big_endian && fields.iter().all(|(_, scalar)| matches!(scalar, ScalarType::Float));
        return Ok(Rows { bytes: file, start, stride, fields, is_big_endian, are_plain, n_rows });
    }
    let (fields, stride) = walked_fields(header, wanted, names);
    let payload = &file[header.payload..];
    let bytes = match header.encoding() {
        Encoding::Ascii => {
            let text = std::str::from_utf8(payload).map_err(|error| {
                mismatch(format_args!("bytes that are no text ({error})"), "ascii numbers")
            })?;
            walk(header, Ascii { words: text.split_ascii_whitespace() }, wanted, names, &fields)
        }
        Encoding::BinaryLittleEndian => {
            walk(header, Binary::<false> { bytes: payload }, wanted, names, &fields)
        }
        Encoding::BinaryBigEndian => walk(header, Binary::<true> { bytes: payload }, wanted, names, &fields),
    }?;
    Ok(Rows {
        n_rows: bytes.len().checked_div(stride).unwrap_or(0),
        bytes: bytes.into(),
        start: 0,
        stride,
        are_plain: fields.iter().all(|(_, scalar)| matches!(scalar, ScalarType::Float)),
        fields,
        is_big_endian: false,
    })
}

/// Start after the header, stride and fields of an element, or `None` if it or one before it has rows of no
/// common size: lists, or text.
type Fixed = Option<(usize, usize, Vec<(usize, ScalarType)>)>;

fn fixed_fields(header: &Header, wanted: &str, names: &[String]) -> Result<Fixed, Mismatch> {
    if header.encoding() == Encoding::Ascii {
        return Ok(None);
    }
    let mut start = 0;
    for element in header.elements() {
        let mut stride = 0;
        let mut at = Vec::with_capacity(element.properties.len());
        for property in element.properties.values() {
            let PropertyType::Scalar(scalar) = &property.data_type else { return Ok(None) };
            at.push((stride, scalar.clone()));
            stride += size_of_scalar(scalar);
        }
        if element.name == wanted {
            expect_properties(element, names)?;
            let place = |name: &String| element.properties.keys().position(|key| key == name);
            let fields = names.iter().filter_map(place).map(|i| at[i].clone()).collect();
            return Ok(Some((start, stride, fields)));
        }
        start += stride * element.count;
    }
    Err(mismatch("no such element", format_args!("element `{wanted}`")))
}

/// Checks that an element has all of these properties.
fn expect_properties(element: &ElementDef, names: &[String]) -> Result<(), Mismatch> {
    match names.iter().find(|name| !element.properties.contains_key(*name)) {
        None => Ok(()),
        Some(missing) => Err(mismatch(
            format_args!("no property `{missing}` in element `{}`", element.name),
            format_args!("`{missing}`"),
        )),
    }
}

/// The first `N` of `bytes` as little endian.
fn array<const N: usize>(bytes: &[u8], is_big_endian: bool) -> [u8; N] {
    let mut array = std::array::from_fn(|i| bytes[i]);
    if is_big_endian {
        array.reverse();
    }
    array
}

/// A scalar at the beginning of `bytes`, not rounded to f32.
fn wide_number(bytes: &[u8], scalar: &ScalarType, is_big_endian: bool) -> f64 {
    match scalar {
        ScalarType::Int => i32::from_le_bytes(array(bytes, is_big_endian)).into(),
        ScalarType::UInt => u32::from_le_bytes(array(bytes, is_big_endian)).into(),
        ScalarType::Double => f64::from_le_bytes(array(bytes, is_big_endian)),
        _ => number(bytes, scalar, is_big_endian).into(),
    }
}

/// A scalar at the beginning of `bytes`.
fn number(bytes: &[u8], scalar: &ScalarType, is_big_endian: bool) -> f32 {
    match scalar {
        ScalarType::Char => bytes[0].cast_signed().into(),
        ScalarType::UChar => bytes[0].into(),
        ScalarType::Short => i16::from_le_bytes(array(bytes, is_big_endian)).into(),
        ScalarType::UShort => u16::from_le_bytes(array(bytes, is_big_endian)).into(),
        ScalarType::Int => i32::from_le_bytes(array(bytes, is_big_endian)) as f32,
        ScalarType::UInt => u32::from_le_bytes(array(bytes, is_big_endian)) as f32,
        ScalarType::Float => f32::from_le_bytes(array(bytes, is_big_endian)),
        ScalarType::Double => f64::from_le_bytes(array(bytes, is_big_endian)) as f32,
    }
}

/// Reads the elements in the file's order up to the wanted one, whose rows of `fields` it returns, little
/// endian. Those before it are parsed to find their end.
fn walk(
    header: &Header,
    mut source: impl Source,
    wanted: &str,
    names: &[String],
    fields: &[(usize, ScalarType)],
) -> Result<Vec<u8>, Mismatch> {
    for element in header.elements() {
        // Without names every property is skipped.
        let names = if element.name == wanted { names } else { &[] };
        let values = element_values(element, &mut source, names, fields)?;
        if element.name == wanted {
            return Ok(values);
        }
    }
    Err(mismatch("no such element", format_args!("element `{wanted}`")))
}

/// Reads all rows of one element.
fn element_values(
    element: &ElementDef,
    source: &mut impl Source,
    names: &[String],
    fields: &[(usize, ScalarType)],
) -> Result<Vec<u8>, Mismatch> {
    expect_properties(element, names)?;
    // Type and target field of each property, in the file's order.
    let field = |name: &String| names.iter().position(|wanted| wanted == name).map(|column| &fields[column]);
    let plan: Vec<(&PropertyType, Option<&(usize, ScalarType)>)> =
        element.properties.values().map(|property| (&property.data_type, field(&property.name))).collect();
    let stride = names.iter().zip(fields).map(|(_, (_, scalar))| size_of_scalar(scalar)).sum();
    // The count is safe to allocate for: the header's check gave every declared row at least a byte per
    // property.
    let mut values = Vec::with_capacity(element.count * stride);
    let mut row = vec![0; stride];
    // Rows without properties take no bytes, so a small file can declare 10^18 of them.
    let n_rows = if plan.is_empty() { 0 } else { element.count };
    for i in 0..n_rows {
        read_row(&plan, source, &mut row).map_err(|Mismatch { found, expected }| {
            mismatch(format_args!("{found} in row {i} of {n_rows} of element `{}`", element.name), expected)
        })?;
        values.extend_from_slice(&row);
    }
    Ok(values)
}

fn read_row(
    plan: &[(&PropertyType, Option<&(usize, ScalarType)>)],
    source: &mut impl Source,
    row: &mut [u8],
) -> Result<(), Mismatch> {
    for (data_type, field) in plan {
        match (data_type, field) {
            (PropertyType::Scalar(scalar), Some((at, ScalarType::Double))) => {
                row[*at..at + 8].copy_from_slice(&source.wide_number(scalar)?.to_le_bytes());
            }
            (PropertyType::Scalar(scalar), Some((at, _))) => {
                row[*at..at + 4].copy_from_slice(&source.number(scalar)?.to_le_bytes());
            }
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
    /// The next number, not rounded to f32.
    fn wide_number(&mut self, scalar: &ScalarType) -> Result<f64, Mismatch>;
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

    fn parsed<T: FromStr>(&mut self) -> Result<T, Mismatch> {
        let word = self.word()?;
        word.parse().map_err(|_| mismatch(format_args!("`{}`", word.escape_debug()), "a number"))
    }
}

impl Source for Ascii<'_> {
    fn number(&mut self, _: &ScalarType) -> Result<f32, Mismatch> {
        self.parsed()
    }

    fn wide_number(&mut self, _: &ScalarType) -> Result<f64, Mismatch> {
        self.parsed()
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
        self.take(size_of_scalar(scalar)).map(|bytes| number(bytes, scalar, BIG_ENDIAN))
    }

    fn wide_number(&mut self, scalar: &ScalarType) -> Result<f64, Mismatch> {
        self.take(size_of_scalar(scalar)).map(|bytes| wide_number(bytes, scalar, BIG_ENDIAN))
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
