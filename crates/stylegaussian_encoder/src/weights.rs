//! Convolution weights from safetensors files and PyTorch state dicts, checked when they are read.

use std::{
    fs,
    path::{Path, PathBuf},
};

use safetensors::{Dtype, SafeTensorError, SafeTensors};
use stylegaussian_files::{
    FileError,
    pytorch::{StateDict, state_dict_from_bytes},
};

use crate::chain::{ChainError, Kernel};

/// A weights file in memory.
pub struct Weights {
    path: PathBuf,
    source: Source,
}

enum Source {
    // The bytes and not the parsed header, which borrows them. Parsing it again for each tensor is cheap.
    Safetensors(Vec<u8>),
    Pytorch(StateDict),
}

/// A weights file could not be used.
#[derive(Debug, thiserror::Error)]
pub enum WeightsError {
    /// The file could not be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file is not in the format of safetensors.
    #[error("{}: not a readable safetensors file: {source}", path.display())]
    Safetensors {
        /// The file.
        path: PathBuf,
        /// The reader's error.
        source: SafeTensorError,
    },
    /// The file is no PyTorch state dict, or one of its tensors cannot be read.
    #[error(transparent)]
    Pytorch(#[from] FileError),
    /// A tensor is absent.
    #[error("{}: there is no tensor `{tensor}`; the file has {found}", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// The tensor's name.
        tensor: String,
        /// The first names in the file.
        found: String,
    },
    /// A tensor has another shape or type.
    #[error("{}: tensor `{tensor}` is {found}, expected {expected}", path.display())]
    Tensor {
        /// The file.
        path: PathBuf,
        /// The tensor's name.
        tensor: String,
        /// Its type and shape.
        found: String,
        /// The type and shape needed.
        expected: String,
    },
    /// A weight is infinite or not a number.
    #[error("{}: tensor `{tensor}` holds {found} at index {index}, expected finite numbers", path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// The tensor's name.
        tensor: String,
        /// The value.
        found: f32,
        /// Its position in the flattened tensor.
        index: usize,
    },
    /// The layers do not fit one another.
    #[error("{}: {source}", path.display())]
    Chain {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: ChainError,
    },
}

impl Weights {
    /// Opens a `.safetensors` file, or with any other extension a PyTorch state dict.
    ///
    /// # Errors
    /// If the file cannot be read, or if its container is broken.
    pub fn open(path: &Path) -> Result<Self, WeightsError> {
        let bytes = fs::read(path).map_err(|source| WeightsError::Read { path: path.into(), source })?;
        Self::from_bytes(path, bytes)
    }

    /// [`open`](Self::open) of a file that was read.
    ///
    /// # Errors
    /// If its container is broken.
    pub(crate) fn from_bytes(path: &Path, bytes: Vec<u8>) -> Result<Self, WeightsError> {
        let source = if path.extension().is_some_and(|extension| extension == "safetensors") {
            SafeTensors::deserialize(&bytes)
                .map_err(|source| WeightsError::Safetensors { path: path.into(), source })?;
            Source::Safetensors(bytes)
        } else {
            Source::Pytorch(state_dict_from_bytes(bytes, &path.display().to_string())?)
        };
        Ok(Self { path: path.into(), source })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether there is a tensor of this name.
    pub fn contains(&self, tensor: &str) -> bool {
        match &self.source {
            Source::Safetensors(bytes) => {
                SafeTensors::deserialize(bytes).is_ok_and(|file| file.tensor(tensor).is_ok())
            }
            Source::Pytorch(state) => state.shape(tensor).is_some(),
        }
    }

    /// `name.weight` of this shape `[out, in, height, width]` and `name.bias` `[out]`.
    ///
    /// # Errors
    /// If a tensor is missing, has another shape or holds a value that is not finite, or if its elements are
    /// not f32 (safetensors) or not floating-point numbers (PyTorch).
    pub fn kernel(&self, name: &str, shape: [usize; 4]) -> Result<Kernel, WeightsError> {
        let weight = self.tensor(&format!("{name}.weight"), &shape)?;
        let bias = self.tensor(&format!("{name}.bias"), &shape[..1])?;
        Ok(Kernel { shape, weight, bias })
    }

    /// A tensor `name` of this shape, flattened row-major; same errors as [`Self::kernel`].
    fn tensor(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, WeightsError> {
        let values = match &self.source {
            Source::Safetensors(bytes) => self.safetensors_tensor(bytes, name, shape)?,
            Source::Pytorch(state) => self.pytorch_tensor(state, name, shape)?,
        };
        // Found here, the error names the tensor. Later it would be a feature without a cause.
        match values.iter().position(|value| !value.is_finite()) {
            None => Ok(values),
            Some(index) => Err(WeightsError::NotFinite {
                path: self.path.clone(),
                tensor: name.into(),
                found: values[index],
                index,
            }),
        }
    }

    fn safetensors_tensor(
        &self,
        bytes: &[u8],
        name: &str,
        shape: &[usize],
    ) -> Result<Vec<f32>, WeightsError> {
        let file = SafeTensors::deserialize(bytes)
            .map_err(|source| WeightsError::Safetensors { path: self.path.clone(), source })?;
        let tensor = file.tensor(name).map_err(|_| self.missing(name))?;
        if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
            return Err(self.unexpected(name, &format!("{:?}", tensor.dtype()), tensor.shape(), shape));
        }
        Ok(tensor.data().as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect())
    }

    fn pytorch_tensor(
        &self,
        state: &StateDict,
        name: &str,
        shape: &[usize],
    ) -> Result<Vec<f32>, WeightsError> {
        let found = state.shape(name).ok_or_else(|| self.missing(name))?;
        // Before the values are read, so that a header of absurd size allocates nothing.
        if found != shape {
            return Err(self.unexpected(name, "a tensor", found, shape));
        }
        let tensor = state.tensor(name)?.ok_or_else(|| self.missing(name))?;
        Ok(tensor.values)
    }

    fn unexpected(&self, name: &str, element: &str, found: &[usize], expected: &[usize]) -> WeightsError {
        WeightsError::Tensor {
            path: self.path.clone(),
            tensor: name.into(),
            found: format!("{element} {found:?}"),
            expected: format!("F32 {expected:?}"),
        }
    }

    pub(crate) fn missing(&self, tensor: &str) -> WeightsError {
        WeightsError::Missing { path: self.path.clone(), tensor: tensor.into(), found: self.first_names() }
    }

    fn first_names(&self) -> String {
        const SHOWN: usize = 6;
        let mut names: Vec<String> = match &self.source {
            Source::Safetensors(bytes) => match SafeTensors::deserialize(bytes) {
                Ok(file) => file.names().into_iter().map(String::from).collect(),
                Err(_) => Vec::new(),
            },
            Source::Pytorch(state) => state.names().map(String::from).collect(),
        };
        // A safetensors header has no order.
        names.sort();
        let rest = names.len().saturating_sub(SHOWN);
        names.truncate(SHOWN);
        match (names.len(), rest) {
            (0, _) => "none".into(),
            (_, 0) => names.join(", "),
            _ => format!("{} and {rest} more", names.join(", ")),
        }
    }
}
