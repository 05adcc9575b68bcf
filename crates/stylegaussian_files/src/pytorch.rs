//! PyTorch files: state dicts, and the reader below StyleGaussian's own checkpoints.
//!
//! Both containers of `torch.save` are read: the zip archive, and the older stream of pickles followed by the
//! storages (before version 1.6), in which torchvision still publishes VGG. Nothing in a file is executed. The
//! few globals that tensors need are known by name, and any other is an error. All sizes are checked against
//! the bytes of the file.
//!
//! ```no_run
//! use stylegaussian_files::pytorch::read_state_dict;
//!
//! let state = read_state_dict("vgg19-dcbb9e9d.pth".as_ref())?;
//! if let Some(kernel) = state.tensor("features.0.weight")? {
//!     assert_eq!(kernel.shape, [64, 3, 3, 3]);
//! }
//! # Ok::<(), stylegaussian_files::FileError>(())
//! ```

use std::path::{Path, PathBuf};

use super::{
    archive::Archive,
    bytes::read_bytes,
    error::{FileError, Mismatch, mismatch},
};

mod legacy;
pub(super) mod pickle;
mod storage;

use pickle::{Object, Pickle, TensorInfo, name_of};
use storage::Storages;

/// A tensor in memory, contiguous and row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Size of each dimension; empty for a scalar.
    pub shape: Vec<usize>,
    /// Elements, as many as the product of `shape`.
    pub values: Vec<f32>,
}

impl Tensor {
    /// Rows and columns of a matrix.
    pub(super) fn matrix(&self, name: &str) -> Result<[usize; 2], Mismatch> {
        match self.shape[..] {
            [rows, columns] => Ok([rows, columns]),
            _ => Err(mismatch(format_args!("`{name}` {:?}", self.shape), "a matrix")),
        }
    }
}

/// A state dict: tensors by name, each decoded when it is asked for.
#[derive(Debug)]
pub struct StateDict {
    path: PathBuf,
    file: PytorchFile<Vec<u8>>,
}

/// Reads the state dict that `torch.save(model.state_dict(), path)` wrote.
///
/// # Errors
/// If the file cannot be read, is no PyTorch file, is truncated, or holds another object at its root.
pub fn read_state_dict(path: &Path) -> Result<StateDict, FileError> {
    state_dict(read_bytes(path)?, path).map_err(|mismatch| mismatch.at(path))
}

/// Reads a state dict from the bytes of a file that [`read_state_dict`] takes. Errors call the file `name`.
///
/// # Errors
/// As [`read_state_dict`].
pub fn state_dict_from_bytes(bytes: Vec<u8>, name: &str) -> Result<StateDict, FileError> {
    state_dict(bytes, Path::new(name)).map_err(|mismatch| mismatch.at(Path::new(name)))
}

fn state_dict(bytes: Vec<u8>, path: &Path) -> Result<StateDict, Mismatch> {
    let file = PytorchFile::parse(bytes)?;
    match file.pickle.object(file.pickle.root) {
        Object::Dictionary(_) => Ok(StateDict { path: path.into(), file }),
        other => Err(mismatch(
            format_args!("a PyTorch file of {}", name_of(other)),
            "a state dict, which maps names to tensors",
        )),
    }
}

impl StateDict {
    /// Names of all tensors, in the order of the file.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors().map(|(name, _)| name)
    }

    /// Shape of the tensor `name`, or `None` if there is no such tensor.
    pub fn shape(&self, name: &str) -> Option<&[usize]> {
        self.find(name).map(|tensor| &tensor.shape[..])
    }

    /// The tensor `name` as f32, or `None` if there is no such tensor. Half and bfloat16 elements are widened
    /// exactly, doubles are rounded.
    ///
    /// # Errors
    /// If the elements are not floating-point numbers, or if the tensor reaches past its storage.
    pub fn tensor(&self, name: &str) -> Result<Option<Tensor>, FileError> {
        let read = |info| self.file.read(name, info).map_err(|mismatch| mismatch.at(&self.path));
        self.find(name).map(read).transpose()
    }

    /// If a name occurs twice, the later entry counts, as in Python.
    fn find(&self, name: &str) -> Option<&TensorInfo> {
        self.tensors().filter(|(key, _)| *key == name).last().map(|(_, tensor)| tensor)
    }

    fn tensors(&self) -> impl Iterator<Item = (&str, &TensorInfo)> {
        let pickle = &self.file.pickle;
        pickle.entries(pickle.root).filter_map(|(name, object)| match object {
            Object::Tensor(tensor) => Some((name, tensor)),
            _ => None,
        })
    }
}

/// A PyTorch file in memory: its pickled objects, and the positions of its storages.
#[derive(Debug)]
pub(super) struct PytorchFile<B> {
    bytes: B,
    pub(super) pickle: Pickle,
    storages: Storages,
}

impl<B: AsRef<[u8]>> PytorchFile<B> {
    /// Parses either container; the content decides, not the name.
    pub(super) fn parse(bytes: B) -> Result<Self, Mismatch> {
        let (pickle, storages) = match bytes.as_ref() {
            [] => return Err(mismatch("an empty file", EXPECTED)),
            [b'P', b'K', 3, 4, ..] => zipped(bytes.as_ref())?,
            other if other.starts_with(&legacy::MAGIC) => legacy::parse(other)?,
            other => {
                let start = other[..other.len().min(8)].escape_ascii();
                return Err(mismatch(format_args!("a file that starts with `{start}`"), EXPECTED));
            }
        };
        Ok(Self { bytes, pickle, storages })
    }

    /// Bytes of the file.
    pub(super) fn len(&self) -> usize {
        self.bytes.as_ref().len()
    }

    /// Reads a tensor of this file; `name` is for messages.
    pub(super) fn read(&self, name: &str, info: &TensorInfo) -> Result<Tensor, Mismatch> {
        self.storages.read(self.bytes.as_ref(), &self.pickle, name, info)
    }
}

/// The containers, for messages.
const EXPECTED: &str = "a PyTorch file: a zip archive, or the pickle stream of versions before 1.6";

/// The objects of a zip archive, and the positions of its storages.
fn zipped(bytes: &[u8]) -> Result<(Pickle, Storages), Mismatch> {
    let archive = Archive::open(bytes)?;
    let (name, prefix) = archive
        .names()
        .find_map(|name| {
            let prefix = name.strip_suffix("data.pkl")?;
            (prefix.is_empty() || prefix.ends_with('/')).then_some((name, prefix))
        })
        .ok_or_else(|| mismatch("a zip archive without `data.pkl`", "a PyTorch checkpoint"))?;
    let data = &bytes[archive.stored(name)?.unwrap_or_default()];
    Ok((Pickle::read(data)?, Storages::in_archive(bytes, &archive, prefix)?))
}

#[cfg(test)]
pub(super) mod tests;
