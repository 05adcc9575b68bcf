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
pub(super) struct Binary<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) is_big_endian: bool,
}

impl<'a> Binary<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], Mismatch> {
        let (taken, rest) = self
            .bytes
            .split_at_checked(n)
            .ok_or_else(|| mismatch("the end of the file", format_args!("{n} bytes")))?;
        self.bytes = rest;
        Ok(taken)
    }
}

impl Source for Binary<'_> {
    #[inline]
    fn number(&mut self, scalar: &ScalarType) -> Result<f32, Mismatch> {
        self.wide_number(scalar).map(|number| number as f32)
    }

    #[inline]
    fn wide_number(&mut self, scalar: &ScalarType) -> Result<f64, Mismatch> {
        self.take(size_of_scalar(scalar)).map(|bytes| wide_number(bytes, scalar, self.is_big_endian))
    }

    fn length(&mut self, scalar: &ScalarType) -> Result<usize, Mismatch> {
        if matches!(scalar, ScalarType::Float | ScalarType::Double) {
            return Err(mismatch("a list length that is no integer", "a count"));
        }
        match self.wide_number(scalar)? {
            length if length < 0.0 => Err(mismatch(format_args!("list length {length}"), "a count")),
            length => Ok(length as usize),
        }
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

/// A scalar at the beginning of `bytes`, not rounded to f32. No type has numbers that f64 rounds.
#[inline]
pub(super) fn wide_number(bytes: &[u8], scalar: &ScalarType, is_big_endian: bool) -> f64 {
    match scalar {
        ScalarType::Char => bytes[0].cast_signed().into(),
        ScalarType::UChar => bytes[0].into(),
        ScalarType::Short => i16::from_le_bytes(array(bytes, is_big_endian)).into(),
        ScalarType::UShort => u16::from_le_bytes(array(bytes, is_big_endian)).into(),
        ScalarType::Int => i32::from_le_bytes(array(bytes, is_big_endian)).into(),
        ScalarType::UInt => u32::from_le_bytes(array(bytes, is_big_endian)).into(),
        ScalarType::Float => f32::from_le_bytes(array(bytes, is_big_endian)).into(),
        ScalarType::Double => f64::from_le_bytes(array(bytes, is_big_endian)),
    }
}

/// A scalar at the beginning of `bytes`.
#[inline]
pub(super) fn number(bytes: &[u8], scalar: &ScalarType, is_big_endian: bool) -> f32 {
    wide_number(bytes, scalar, is_big_endian) as f32
}
