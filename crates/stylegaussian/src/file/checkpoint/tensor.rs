//! Tensors of a checkpoint: strided views into storages, made contiguous f32.

use half::{bf16, f16};

use crate::file::{Mismatch, mismatch};

use super::{
    pickle::{Object, Pickle, StorageType, TensorInfo},
    zip::Archive,
};

/// A contiguous, row-major tensor.
#[derive(Debug)]
pub(super) struct Tensor {
    pub shape: Vec<usize>,
    pub values: Vec<f32>,
}

impl Tensor {
    /// The shape of a matrix.
    pub(super) fn matrix(&self, name: &str) -> Result<[usize; 2], Mismatch> {
        match self.shape[..] {
            [rows, columns] => Ok([rows, columns]),
            _ => Err(mismatch(format_args!("`{name}` {:?}", self.shape), "a matrix")),
        }
    }
}

/// The archive's entries under `data/`.
pub(super) struct Storages<'a> {
    archive: &'a Archive<'a>,
    prefix: &'a str,
    pickle: &'a Pickle,
    big_endian: bool,
}

impl<'a> Storages<'a> {
    pub(super) fn new(
        archive: &'a Archive<'a>,
        prefix: &'a str,
        pickle: &'a Pickle,
    ) -> Result<Self, Mismatch> {
        let big_endian = match archive.get(&format!("{prefix}byteorder")) {
            None | Some(b"little") => false,
            Some(b"big") => true,
            Some(other) => {
                let found = other[..other.len().min(20)].escape_ascii();
                return Err(mismatch(format_args!("byte order `{found}`"), "`little` or `big`"));
            }
        };
        Ok(Self { archive, prefix, pickle, big_endian })
    }

    /// Reads a tensor wherever it was saved from: storages of CUDA tensors are bytes like others.
    pub(super) fn read(&self, name: &str, info: &TensorInfo) -> Result<Tensor, Mismatch> {
        let Object::Storage(storage) = self.pickle.object(info.storage) else {
            return Err(mismatch(format_args!("`{name}` without a storage"), "one"));
        };
        let entry = format!("{}data/{}", self.prefix, storage.key);
        let bytes = self.archive.get(&entry).ok_or_else(|| {
            mismatch(format_args!("no entry `{entry}` for `{name}`"), "the tensor's storage")
        })?;
        let little = |bytes: &[u8]| -> [u8; 8] {
            let mut array = [0; 8];
            array[..bytes.len()].copy_from_slice(bytes);
            if self.big_endian {
                array[..bytes.len()].reverse();
            }
            array
        };
        let (width, decode): (usize, fn([u8; 8]) -> f32) = match storage.storage_type {
            StorageType::F16 => (2, |b| f16::from_le_bytes([b[0], b[1]]).to_f32()),
            StorageType::BF16 => (2, |b| bf16::from_le_bytes([b[0], b[1]]).to_f32()),
            StorageType::F32 => (4, |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            StorageType::F64 => (8, |b| f64::from_le_bytes(b) as f32),
            StorageType::Other => {
                return Err(mismatch(format_args!("`{name}` of integers"), "floats of 2, 4 or 8 bytes"));
            }
        };
        let n_stored = bytes.len() / width;
        if n_stored < storage.n_elements {
            return Err(mismatch(
                format_args!("entry `{entry}` of {} bytes", bytes.len()),
                format_args!("{} numbers of {width} bytes", storage.n_elements),
            ));
        }
        check_bounds(name, info, n_stored)?;
        let value = |index: usize| decode(little(&bytes[index * width..(index + 1) * width]));
        Ok(Tensor { shape: info.shape.clone(), values: gather(info, value) })
    }
}

/// Checks that a view lies within its storage and is no larger than it.
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
