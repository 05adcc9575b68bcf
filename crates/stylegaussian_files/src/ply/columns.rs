//! The rows of one element: chosen scalar properties as f32.

use std::{borrow::Cow, str::SplitAsciiWhitespace};

use half::f16;
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
    /// Columns of whole numbers of 16 bits that are the bits of half floats.
    halves: Vec<usize>,
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
        let columns = self.fields[first..].iter().zip(&mut *values);
        // Of nearly all files.
        if self.are_plain {
            columns.for_each(|(&(at, _), value)| {
                *value = row[at..].first_chunk().map_or(0.0, |bytes| f32::from_le_bytes(*bytes));
            });
        } else {
            columns
                .for_each(|((at, scalar), value)| *value = number(&row[*at..], scalar, self.is_big_endian));
        }
        // Of nearly all files, there are none.
        for column in self.halves.iter().filter_map(|column| column.checked_sub(first)) {
            values.get_mut(column).into_iter().for_each(|value| *value = half_of(*value));
        }
    }

    /// Takes the whole numbers in `columns` for the bits of half floats, if that makes sense: next to none is
    /// infinite or NaN, and most of those that are not 0 are normal numbers. Whole numbers of any use fail in
    /// one or the other: small ones are the bits of numbers below 6e-5, and of all 65,536 words one in 32 is
    /// no number.
    pub(super) fn take_for_halves(&mut self, columns: &[usize]) -> bool {
        let makes_sense = |&column: &usize| {
            let (mut n_wild, mut n_normal, mut n_tiny) = (0, 0, 0);
            for i in 0..self.n_rows {
                let [value] = self.array(i, column);
                let value = f16::from_f32(half_of(value));
                if !value.is_finite() {
                    n_wild += 1;
                } else if value.is_normal() {
                    n_normal += 1;
                } else if value != f16::ZERO {
                    n_tiny += 1;
                }
            }
            100 * n_wild <= self.n_rows && n_tiny <= n_normal
        };
        let make_sense = columns.iter().all(makes_sense);
        if make_sense {
            self.halves = columns.to_vec();
        }
        make_sense
    }

    /// The numbers of row `i` from column `first` on.
    pub(super) fn array<const N: usize>(&self, i: usize, first: usize) -> [f32; N] {
        let mut values = [0.0; N];
        self.read(i, first, &mut values);
        values
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
        self.halves.clear();
        self.fields = floats(n_columns);
    }
}

/// Places and types of columns of f32, one after another.
fn floats(n_columns: usize) -> Vec<(usize, ScalarType)> {
    (0..n_columns).map(|i| (i * size_of::<f32>(), ScalarType::Float)).collect()
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
        let halves = Vec::new();
        return Ok(Rows { bytes: file, start, stride, fields, is_big_endian, are_plain, halves, n_rows });
    }
    let payload = &file[header.payload..];
    let bytes = match header.encoding() {
        Encoding::Ascii => {
            let text = std::str::from_utf8(payload).map_err(|error| {
                mismatch(format_args!("bytes that are no text ({error})"), "ascii numbers")
            })?;
            walk(header, Ascii { words: text.split_ascii_whitespace() }, wanted, names)
        }
        Encoding::BinaryLittleEndian => walk(header, Binary::<false> { bytes: payload }, wanted, names),
        Encoding::BinaryBigEndian => walk(header, Binary::<true> { bytes: payload }, wanted, names),
    }?;
    let stride = names.len() * size_of::<f32>();
    Ok(Rows {
        n_rows: bytes.len().checked_div(stride).unwrap_or(0),
        bytes: bytes.into(),
        start: 0,
        stride,
        fields: floats(names.len()),
        is_big_endian: false,
        are_plain: true,
        halves: Vec::new(),
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

/// The half float of a whole number of 16 bits, with or without a sign.
fn half_of(number: f32) -> f32 {
    f16::from_bits(number as i32 as u16).to_f32()
}

/// A scalar at the beginning of `bytes`.
fn number(bytes: &[u8], scalar: &ScalarType, is_big_endian: bool) -> f32 {
    fn array<const N: usize>(bytes: &[u8], is_big_endian: bool) -> [u8; N] {
        let mut array = std::array::from_fn(|i| bytes[i]);
        if is_big_endian {
            array.reverse();
        }
        array
    }
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

/// Reads the elements in the file's order up to the wanted one, whose numbers it returns as f32, little endian.
/// Those before it are parsed to find their end.
fn walk(
    header: &Header,
    mut source: impl Source,
    wanted: &str,
    names: &[String],
) -> Result<Vec<u8>, Mismatch> {
    for element in header.elements() {
        // Without names every property is skipped.
        let names = if element.name == wanted { names } else { &[] };
        let values = element_values(element, &mut source, names)?;
        if element.name == wanted {
            return Ok(values);
        }
    }
    Err(mismatch("no such element", format_args!("element `{wanted}`")))
}

/// Checks that the file ends with the last row. More than white space after it means that rows are not what the
/// header says, and that all of them but the first would be read at the wrong place.
pub(super) fn check_end(header: &Header, file: &[u8]) -> Result<(), Mismatch> {
    let n_bytes = bytes_after(header, &file[header.payload..]).unwrap_or(0);
    if n_bytes == 0 {
        return Ok(());
    }
    let counts: Vec<String> = header.elements().map(|e| format!("{} {}", e.count, e.name)).collect();
    let n_rows = header.element("vertex").map_or(0, |vertex| vertex.count);
    let of_row = match n_bytes.checked_div(n_rows) {
        Some(of_row) if of_row > 0 && of_row * n_rows == n_bytes => {
            format!(", {of_row} for each of {n_rows} vertices, whose properties may be longer than they say")
        }
        _ => String::new(),
    };
    Err(mismatch(
        format_args!("{n_bytes} bytes after the last row{of_row}"),
        format_args!("the end of the file after {}", counts.join(", ")),
    ))
}

/// The number of bytes after the last row, 0 if they are white space. `None` if rows are broken, which is an
/// error of its own where they matter.
fn bytes_after(header: &Header, payload: &[u8]) -> Option<usize> {
    fn binary<const BIG_ENDIAN: bool>(header: &Header, bytes: &[u8]) -> Option<usize> {
        let mut source = Binary::<BIG_ENDIAN> { bytes };
        for element in header.elements() {
            match header.fixed_row(element) {
                Some(size) => source.skip(&ScalarType::UChar, size.checked_mul(element.count)?).ok()?,
                None => element_values(element, &mut source, &[]).map(drop).ok()?,
            }
        }
        Some(if source.bytes.trim_ascii().is_empty() { 0 } else { source.bytes.len() })
    }
    match header.encoding() {
        Encoding::BinaryLittleEndian => binary::<false>(header, payload),
        Encoding::BinaryBigEndian => binary::<true>(header, payload),
        Encoding::Ascii => {
            let text = std::str::from_utf8(payload).ok()?;
            let mut source = Ascii { words: text.split_ascii_whitespace() };
            for element in header.elements() {
                element_values(element, &mut source, &[]).ok()?;
            }
            let word = source.words.next()?;
            // Both are parts of one text.
            Some(text.trim_ascii_end().len() - (word.as_ptr().addr() - text.as_ptr().addr()))
        }
    }
}

/// Reads all rows of one element.
fn element_values(
    element: &ElementDef,
    source: &mut impl Source,
    names: &[String],
) -> Result<Vec<u8>, Mismatch> {
    expect_properties(element, names)?;
    // Type and target column of each property, in the file's order.
    let plan: Vec<(&PropertyType, Option<usize>)> = element
        .properties
        .values()
        .map(|property| (&property.data_type, names.iter().position(|name| *name == property.name)))
        .collect();
    let n_columns = names.len();
    // The count is safe to allocate for: the header's check gave every declared row at least a byte per
    // property.
    let mut values = Vec::with_capacity(element.count * n_columns * size_of::<f32>());
    let mut row = vec![0.0; n_columns];
    // Rows without properties take no bytes, so a small file can declare 10^18 of them.
    let n_rows = if plan.is_empty() { 0 } else { element.count };
    for i in 0..n_rows {
        read_row(&plan, source, &mut row).map_err(|Mismatch { found, expected }| {
            mismatch(format_args!("{found} in row {i} of {n_rows} of element `{}`", element.name), expected)
        })?;
        values.extend(row.iter().flat_map(|value| value.to_le_bytes()));
    }
    Ok(values)
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
        self.take(size_of_scalar(scalar)).map(|bytes| number(bytes, scalar, BIG_ENDIAN))
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
