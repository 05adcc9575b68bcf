//! Numbers of rows, one by one, in each of the encodings.

use std::str::{FromStr, SplitAsciiWhitespace};

use ply_rs::ply::ScalarType;

use super::header::size_of_scalar;
use crate::error::{Mismatch, mismatch};

/// A sequence of numbers in one of the encodings.
pub(super) trait Source {
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
pub(super) struct Ascii<'a> {
    pub(super) words: SplitAsciiWhitespace<'a>,
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
pub(super) struct Binary<'a, const BIG_ENDIAN: bool> {
    pub(super) bytes: &'a [u8],
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

/// The first `N` of `bytes` as little endian.
fn array<const N: usize>(bytes: &[u8], is_big_endian: bool) -> [u8; N] {
    let mut array = std::array::from_fn(|i| bytes[i]);
    if is_big_endian {
        array.reverse();
    }
    array
}

/// A scalar at the beginning of `bytes`, not rounded to f32.
pub(super) fn wide_number(bytes: &[u8], scalar: &ScalarType, is_big_endian: bool) -> f64 {
    match scalar {
        ScalarType::Int => i32::from_le_bytes(array(bytes, is_big_endian)).into(),
        ScalarType::UInt => u32::from_le_bytes(array(bytes, is_big_endian)).into(),
        ScalarType::Double => f64::from_le_bytes(array(bytes, is_big_endian)),
        _ => number(bytes, scalar, is_big_endian).into(),
    }
}

/// A scalar at the beginning of `bytes`.
pub(super) fn number(bytes: &[u8], scalar: &ScalarType, is_big_endian: bool) -> f32 {
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
