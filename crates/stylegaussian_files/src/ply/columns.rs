//! The rows of one element: chosen scalar properties as f32, coordinates also as f64.

use std::{
    borrow::Cow,
    ops::{Range, RangeInclusive},
};

use half::f16;
use ply_rs::ply::{ElementDef, Encoding, PropertyType, ScalarType};
use stylegaussian::{slices::SLICE, work::Work};

use super::{
    header::{Header, size_of_scalar},
    numbers::{Ascii, Binary, Source, number, wide_number},
};
use crate::error::{Mismatch, bytes_in_words, mismatch};

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
    /// NaN or beyond the column's `range`, and most of those that are not 0 have a size of `least` or more.
    pub(super) fn take_for_halves(
        &mut self,
        columns: &[usize],
        range: impl Fn(usize) -> RangeInclusive<f32>,
        least: f32,
    ) -> bool {
        let makes_sense = |&column: &usize| {
            let (mut n_wild, mut n_normal, mut n_tiny) = (0, 0, 0);
            let range = range(column);
            for i in 0..self.n_rows {
                let [value] = self.array(i, column);
                let value = half_of(value);
                if !range.contains(&value) {
                    n_wild += 1;
                } else if value.abs() >= least {
                    n_normal += 1;
                } else if value != 0.0 {
                    n_tiny += 1;
                }
            }
            100 * n_wild <= self.n_rows && n_tiny <= n_normal
        };
        let make_sense = columns.iter().all(makes_sense);
        if make_sense {
            self.halves.extend(columns);
        }
        make_sense
    }

    /// Whether most numbers make no sense, and would in the other byte order.
    fn are_swapped(&self) -> bool {
        /// Most rows that are looked at. Chance plays no part in as many.
        const N: usize = 1 << 10;
        /// The largest number that makes sense, and one over the least. With the bytes the wrong way around,
        /// the exponent of a float is its last bits: of 256 exponents, 80 lie within.
        const MOST: f64 = (1_u64 << 40) as f64;
        let makes_sense = |number: f64| (MOST.recip()..=MOST).contains(&number.abs());
        let (mut n, mut n_as_said, mut n_swapped) = (0_usize, 0, 0);
        for i in (0..self.n_rows).step_by(self.n_rows.div_ceil(N).max(1)) {
            let row = &self.bytes[self.start + i * self.stride..][..self.stride];
            for (at, scalar) in &self.fields {
                let number = |is_big_endian| wide_number(&row[*at..], scalar, is_big_endian);
                let as_said = number(self.is_big_endian);
                // 0 is the same in both.
                if matches!(scalar, ScalarType::Float | ScalarType::Double) && as_said != 0.0 {
                    n += 1;
                    n_as_said += usize::from(makes_sense(as_said));
                    n_swapped += usize::from(makes_sense(number(!self.is_big_endian)));
                }
            }
        }
        2 * n_as_said < n && 10 * n_swapped > 9 * n
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
            match self.halves.contains(&(first + column)) {
                true => half_of(number(&row[*at..], scalar, self.is_big_endian)).into(),
                false => wide_number(&row[*at..], scalar, self.is_big_endian),
            }
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
        self.halves.clear();
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
    work: &Work,
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
        let rows = Rows { bytes: file, start, stride, fields, is_big_endian, are_plain, halves, n_rows };
        if rows.are_swapped() {
            let (said, found) = if is_big_endian { ("big", "little") } else { ("little", "big") };
            return Err(mismatch(
                format_args!("numbers of `{wanted}` that make sense in {found} endian alone"),
                format_args!("{said} endian, as the header says"),
            ));
        }
        return Ok(rows);
    }
    let (fields, stride) = walked_fields(header, wanted, names);
    let payload = &file[header.payload..];
    let bytes = match header.encoding() {
        Encoding::Ascii => {
            let text = std::str::from_utf8(payload).map_err(|error| {
                mismatch(format_args!("bytes that are no text ({error})"), "ascii numbers")
            })?;
            walk(header, Ascii { words: text.split_ascii_whitespace() }, wanted, names, &fields, work)
        }
        encoding @ (Encoding::BinaryLittleEndian | Encoding::BinaryBigEndian) => {
            let is_big_endian = encoding == Encoding::BinaryBigEndian;
            walk(header, Binary { bytes: payload, is_big_endian }, wanted, names, &fields, work)
        }
    }?;
    Ok(Rows {
        n_rows: bytes.len().checked_div(stride).unwrap_or(0),
        bytes: bytes.into(),
        start: 0,
        stride,
        are_plain: fields.iter().all(|(_, scalar)| matches!(scalar, ScalarType::Float)),
        fields,
        is_big_endian: false,
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

/// Reads the elements in the file's order up to the wanted one, whose rows of `fields` it returns, little
/// endian. Those before it are parsed to find their end.
fn walk(
    header: &Header,
    mut source: impl Source,
    wanted: &str,
    names: &[String],
    fields: &[(usize, ScalarType)],
    work: &Work,
) -> Result<Vec<u8>, Mismatch> {
    for element in header.elements() {
        // Without names every property is skipped.
        let names = if element.name == wanted { names } else { &[] };
        let values = element_values(element, &mut source, names, fields, work)?;
        if element.name == wanted {
            return Ok(values);
        }
    }
    Err(mismatch("no such element", format_args!("element `{wanted}`")))
}

/// Checks that the file ends with the last row. More than white space after it means that rows are not what the
/// header says, and that all of them but the first would be read at the wrong place.
pub(super) fn check_end(header: &Header, file: &[u8], work: &Work) -> Result<(), Mismatch> {
    // Rows that are walked once more are no progress.
    let n_bytes = bytes_after(header, &file[header.payload..], &work.part(0.0, 0.0)).unwrap_or(0);
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
        format_args!("{} after the last row{of_row}", bytes_in_words(n_bytes as u64)),
        format_args!("the end of the file after {}", counts.join(", ")),
    ))
}

/// The number of bytes after the last row, 0 if they are white space. `None` if rows are broken, which is an
/// error of its own where they matter.
fn bytes_after(header: &Header, payload: &[u8], work: &Work) -> Option<usize> {
    match header.encoding() {
        encoding @ (Encoding::BinaryLittleEndian | Encoding::BinaryBigEndian) => {
            let is_big_endian = encoding == Encoding::BinaryBigEndian;
            let mut source = Binary { bytes: payload, is_big_endian };
            for element in header.elements() {
                match header.fixed_row(element) {
                    Some(size) => source.skip(&ScalarType::UChar, size.checked_mul(element.count)?).ok()?,
                    None => element_values(element, &mut source, &[], &[], work).map(drop).ok()?,
                }
            }
            Some(if source.bytes.trim_ascii().is_empty() { 0 } else { source.bytes.len() })
        }
        Encoding::Ascii => {
            let text = std::str::from_utf8(payload).ok()?;
            let mut source = Ascii { words: text.split_ascii_whitespace() };
            for element in header.elements() {
                element_values(element, &mut source, &[], &[], work).ok()?;
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
    fields: &[(usize, ScalarType)],
    work: &Work,
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
        if i.is_multiple_of(SLICE) {
            work.at(i as f32 / n_rows as f32)?;
        }
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
