//! Storages: the bytes behind tensors. A tensor is a strided view into one, made contiguous f32 when it is
//! read.

use std::{collections::HashMap, ops::Range};

use half::{bf16, f16};

use crate::{
    archive::Archive,
    error::{Mismatch, bytes_in_words, mismatch},
};

use super::{
    Tensor,
    pickle::{Object, Pickle, StorageType, TensorInfo},
};

/// Positions of a file's storages.
#[derive(Debug)]
pub(super) struct Storages {
    /// Bytes of each storage within the file, by the storage's key.
    ranges: HashMap<String, Range<usize>>,
    /// Text before each key in messages: the folder within the archive.
    prefix: String,
    big_endian: bool,
}

impl Storages {
    /// The archive's entries under `{prefix}data/`.
    pub(super) fn in_archive(bytes: &[u8], archive: &Archive, prefix: &str) -> Result<Self, Mismatch> {
        // Written since PyTorch 2.0; all older archives are little-endian.
        let order = archive.stored(&format!("{prefix}byteorder"))?;
        let big_endian = match order.and_then(|range| bytes.get(range)) {
            None | Some(b"little") => false,
            Some(b"big") => true,
            Some(other) => {
                let found = other[..other.len().min(20)].escape_ascii();
                return Err(mismatch(format_args!("byte order `{found}`"), "`little` or `big`"));
            }
        };
        let prefix = format!("{prefix}data/");
        let mut ranges = HashMap::new();
        for name in archive.names() {
            if let (Some(key), Some(range)) = (name.strip_prefix(&prefix), archive.stored(name)?) {
                ranges.insert(key.to_owned(), range);
            }
        }
        Ok(Self { ranges, prefix, big_endian })
    }

    /// Storages at these positions of a file without an archive.
    pub(super) fn in_stream(ranges: HashMap<String, Range<usize>>) -> Self {
        Self { ranges, prefix: String::new(), big_endian: false }
    }

    /// Reads a tensor of the file `bytes`. The device that it was saved from does not matter: storages of CUDA
    /// tensors are bytes like others.
    pub(super) fn read(
        &self,
        bytes: &[u8],
        pickle: &Pickle,
        name: &str,
        info: &TensorInfo,
    ) -> Result<Tensor, Mismatch> {
        let Object::Storage(storage) = pickle.object(info.storage) else {
            return Err(mismatch(format_args!("`{name}` without a storage"), "one"));
        };
        let entry = format!("{}{}", self.prefix, storage.key);
        let stored = self.ranges.get(&storage.key).and_then(|range| bytes.get(range.clone()));
        let stored = stored.ok_or_else(|| {
            mismatch(format_args!("no entry `{entry}` for `{name}`"), "the tensor's storage")
        })?;
        let Some((width, decode)) = decoder(storage.storage_type) else {
            return Err(mismatch(format_args!("`{name}` of integers"), "floats of 2, 4 or 8 bytes"));
        };
        let n_stored = stored.len() / width;
        if n_stored < storage.n_elements {
            return Err(mismatch(
                format_args!("entry `{entry}` of {}", bytes_in_words(stored.len() as u64)),
                format_args!("{} numbers of {width} bytes", storage.n_elements),
            ));
        }
        check_bounds(name, info, n_stored)?;
        let value = |index: usize| decode(self.little(&stored[index * width..(index + 1) * width]));
        Ok(Tensor { shape: info.shape.clone(), values: gather(info, value) })
    }

    /// One element in little-endian order, followed by zeros.
    fn little(&self, element: &[u8]) -> [u8; 8] {
        let mut array = [0; 8];
        array[..element.len()].copy_from_slice(element);
        if self.big_endian {
            array[..element.len()].reverse();
        }
        array
    }
}

/// Decodes one element from its little-endian bytes, followed by zeros.
type Decode = fn([u8; 8]) -> f32;

/// Bytes of one element and their decoding, or `None` if the elements are no floating-point numbers.
fn decoder(storage_type: StorageType) -> Option<(usize, Decode)> {
    let decode: Decode = match storage_type {
        StorageType::F16 => |b| f16::from_le_bytes([b[0], b[1]]).to_f32(),
        StorageType::BF16 => |b| bf16::from_le_bytes([b[0], b[1]]).to_f32(),
        StorageType::F32 => |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
        StorageType::F64 => |b| f64::from_le_bytes(b) as f32,
        StorageType::Integer { .. } | StorageType::Unknown => return None,
    };
    Some((storage_type.width()?, decode))
}

/// Checks that a view lies within its storage and has no more elements than it. A stride of 0 repeats elements:
/// without the second check, a few bytes could ask for terabytes.
fn check_bounds(name: &str, info: &TensorInfo, n_stored: usize) -> Result<(), Mismatch> {
    let outside = || {
        mismatch(
            format_args!("`{name}` {:?} with strides {:?} at {}", info.shape, info.strides, info.offset),
            format_args!("a view into the {n_stored} numbers stored"),
        )
    };
    if info.shape.len() != info.strides.len() {
        return Err(outside());
    }
    let n_values = info.shape.iter().try_fold(1, |n: usize, &size| n.checked_mul(size));
    if n_values.ok_or_else(outside)? == 0 {
        return Ok(());
    }
    // No size is 0 here, so that `size - 1` does not wrap. Strides are not negative, so the last element is the
    // farthest.
    let last = info
        .shape
        .iter()
        .zip(&info.strides)
        .try_fold(info.offset, |last, (&size, &stride)| last.checked_add(stride.checked_mul(size - 1)?));
    match last {
        Some(last) if last < n_stored && n_values <= Some(n_stored) => Ok(()),
        _ => Err(outside()),
    }
}

/// The values of a view in row-major order.
fn gather(info: &TensorInfo, value: impl Fn(usize) -> f32) -> Vec<f32> {
    let n_values: usize = info.shape.iter().product();
    let mut values = Vec::with_capacity(n_values);
    let (Some((&columns, outer)), Some((&stride, outer_strides))) =
        (info.shape.split_last(), info.strides.split_last())
    else {
        values.push(value(info.offset));
        return values;
    };
    // The number of a row, split into its outer coordinates. The last one varies fastest.
    for row in 0..n_values.checked_div(columns).unwrap_or(0) {
        let mut rest = row;
        let mut start = info.offset;
        for (&size, &stride) in outer.iter().zip(outer_strides).rev() {
            start += rest % size * stride;
            rest /= size;
        }
        values.extend((0..columns).map(|column| value(start + column * stride)));
    }
    values
}
