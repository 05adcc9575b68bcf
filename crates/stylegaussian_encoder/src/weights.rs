//! Convolution weights from safetensors files and PyTorch checkpoints, checked at the door.

use std::{
    fs,
    path::{Path, PathBuf},
};

use pytorch_reader::{PytorchError, PytorchReader};
use safetensors::{Dtype, SafeTensorError, SafeTensors};

use crate::onnx::Convolution;

/// A weights file whose bytes are at hand.
pub struct Weights {
    path: PathBuf,
    source: Source,
}

enum Source {
    Safetensors(Vec<u8>),
    Pytorch(PytorchReader),
}

/// A weights file is not what it should be.
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
    /// The file is no safetensors file.
    #[error("{}: not a readable safetensors file: {source}", path.display())]
    Safetensors {
        /// The file.
        path: PathBuf,
        /// What the reader found.
        source: SafeTensorError,
    },
    /// The file is no PyTorch checkpoint of tensors.
    #[error("{}: not a readable PyTorch state dict: {source}", path.display())]
    Pytorch {
        /// The file.
        path: PathBuf,
        /// What the reader found.
        source: PytorchError,
    },
    /// A tensor is absent.
    #[error("{}: there is no tensor `{tensor}`; the file has {found}", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// The tensor's name.
        tensor: String,
        /// The first names that the file has.
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
        /// The type and shape that are needed.
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
        /// Where it is in the flattened tensor.
        index: usize,
    },
}

impl Weights {
    /// Opens a `.safetensors` file, or a PyTorch checkpoint (zip, legacy or tar container) of any other extension.
    ///
    /// # Errors
    /// When the file cannot be read or its container is broken.
    pub fn open(path: &Path) -> Result<Self, WeightsError> {
        let source = if path.extension().is_some_and(|extension| extension == "safetensors") {
            let bytes = fs::read(path).map_err(|source| WeightsError::Read { path: path.into(), source })?;
            SafeTensors::deserialize(&bytes)
                .map_err(|source| WeightsError::Safetensors { path: path.into(), source })?;
            Source::Safetensors(bytes)
        } else {
            let reader = PytorchReader::new(path)
                .map_err(|source| WeightsError::Pytorch { path: path.into(), source })?;
            Source::Pytorch(reader)
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
            Source::Pytorch(reader) => reader.get(tensor).is_some(),
        }
    }

    /// `name.weight` of this shape `[out, in, height, width]` and `name.bias` `[out]`.
    ///
    /// # Errors
    /// When a tensor is missing, has another shape, is not f32, or holds a value that is not finite.
    pub fn convolution(&self, name: &str, shape: [usize; 4]) -> Result<Convolution, WeightsError> {
        let weight = self.tensor(&format!("{name}.weight"), &shape)?;
        let bias = self.tensor(&format!("{name}.bias"), &shape[..1])?;
        Ok(Convolution { shape, weight, bias })
    }

    /// A tensor `name` of this shape, flattened row-major; same errors as [`Self::convolution`].
    fn tensor(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, WeightsError> {
        let values = match &self.source {
            Source::Safetensors(bytes) => self.safetensors_tensor(bytes, name, shape)?,
            Source::Pytorch(reader) => self.pytorch_tensor(reader, name, shape)?,
        };
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
        self.check(
            name,
            tensor.dtype() == Dtype::F32,
            format!("{:?}", tensor.dtype()),
            tensor.shape(),
            shape,
        )?;
        Ok(tensor.data().as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect())
    }

    fn pytorch_tensor(
        &self,
        reader: &PytorchReader,
        name: &str,
        shape: &[usize],
    ) -> Result<Vec<f32>, WeightsError> {
        let tensor = reader.get(name).ok_or_else(|| self.missing(name))?;
        let is_f32 = tensor.dtype() == pytorch_reader::DType::F32;
        self.check(name, is_f32, format!("{:?}", tensor.dtype()), tensor.shape(), shape)?;
        let bytes = tensor.read().map_err(|source| WeightsError::Read { path: self.path.clone(), source })?;
        Ok(bytes.as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect())
    }

    fn check(
        &self,
        name: &str,
        is_f32: bool,
        dtype: String,
        found: &[usize],
        expected: &[usize],
    ) -> Result<(), WeightsError> {
        if is_f32 && found == expected {
            return Ok(());
        }
        Err(WeightsError::Tensor {
            path: self.path.clone(),
            tensor: name.into(),
            found: format!("{dtype} {found:?}"),
            expected: format!("F32 {expected:?}"),
        })
    }

    pub(crate) fn missing(&self, tensor: &str) -> WeightsError {
        WeightsError::Missing { path: self.path.clone(), tensor: tensor.into(), found: self.first_names() }
    }

    fn first_names(&self) -> String {
        const SHOWN: usize = 6;
        let mut names = match &self.source {
            Source::Safetensors(bytes) => match SafeTensors::deserialize(bytes) {
                Ok(file) => file.names().into_iter().map(String::from).collect(),
                Err(_) => Vec::new(),
            },
            Source::Pytorch(reader) => reader.tensors().values().map(|tensor| tensor.name.clone()).collect(),
        };
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
