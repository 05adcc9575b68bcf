//! The state of a bake as a file, `*.checkpoint.safetensors`.

use std::{collections::HashMap, fs, path::Path};

use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use stylegaussian_files::write_atomically;

use crate::error::BakeError;

/// Metadata `format` of the files.
const FORMAT: &str = "stylegaussian-bake";

/// The number of values in a list.
#[derive(Clone, Copy)]
pub(crate) enum Length {
    /// Exactly so many.
    Is(usize),
    /// So many, or none before the step that brings them.
    IsOrNone(usize),
}

impl Length {
    fn admits(self, shape: &[usize]) -> bool {
        match self {
            Self::Is(n) => shape == [n],
            Self::IsOrNone(n) => shape == [n] || shape == [0],
        }
    }

    fn text(self) -> String {
        match self {
            Self::Is(n) => n.to_string(),
            Self::IsOrNone(n) => format!("{n} or 0"),
        }
    }
}

/// Everything that changes from step to step, as named lists of numbers.
pub(crate) struct State {
    /// Steps so far.
    pub steps: u32,
    /// Scene, paintings, network and settings, as a hash. Another bake's state is of no use.
    pub identity: String,
    /// Values by name.
    pub values: Vec<(String, Vec<f32>)>,
}

impl State {
    /// Writes the file, whole or not at all.
    pub fn write(&self, path: &Path) -> Result<(), BakeError> {
        let bytes: Vec<(&String, usize, Vec<u8>)> = self
            .values
            .iter()
            .map(|(name, values)| (name, values.len(), values.iter().flat_map(|v| v.to_le_bytes()).collect()))
            .collect();
        let mut views = Vec::new();
        for (name, n, bytes) in &bytes {
            let view = TensorView::new(Dtype::F32, vec![*n], bytes).map_err(std::io::Error::other);
            views.push((name.as_str(), view.map_err(|source| io_error(path, source))?));
        }
        let metadata = HashMap::from([
            ("format".into(), FORMAT.into()),
            ("steps".into(), self.steps.to_string()),
            ("identity".into(), self.identity.clone()),
        ]);
        let file = safetensors::serialize(views, Some(metadata)).map_err(std::io::Error::other);
        let file = file.map_err(|source| io_error(path, source))?;
        Ok(write_atomically(path, |out| out.write_all(&file))?)
    }

    /// Reads the file of the bake `identity`, whose values have the given names and lengths.
    pub fn read(path: &Path, identity: &str, lengths: &[(String, Length)]) -> Result<Self, BakeError> {
        let bytes = fs::read(path).map_err(|source| BakeError::Read { path: path.into(), source })?;
        let invalid =
            |found: String, expected: String| BakeError::Checkpoint { path: path.into(), found, expected };
        let broken = |error| invalid(format!("a broken file ({error})"), "a checkpoint of `bake`".into());
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(broken)?;
        let metadata = header.metadata().clone().unwrap_or_default();
        if metadata.get("format").is_none_or(|format| format != FORMAT) {
            return Err(invalid("another file".into(), "a checkpoint of `bake`".into()));
        }
        if metadata.get("identity").is_none_or(|found| found != identity) {
            let expected = "the same; remove the file to begin anew".into();
            return Err(invalid("a bake with another scene, painting or setting".into(), expected));
        }
        let steps = metadata.get("steps").and_then(|steps| steps.parse().ok());
        let steps = steps.ok_or_else(|| invalid("no number of steps".into(), "one".into()))?;
        let file = SafeTensors::deserialize(&bytes).map_err(broken)?;
        let mut values = Vec::new();
        for (name, length) in lengths {
            let expected = format!("tensor `{name}` of {} finite f32", length.text());
            let tensor =
                file.tensor(name).map_err(|_| invalid(format!("no tensor `{name}`"), expected.clone()))?;
            if tensor.dtype() != Dtype::F32 || !length.admits(tensor.shape()) {
                return Err(invalid(format!("{:?} {:?}", tensor.dtype(), tensor.shape()), expected));
            }
            let found: Vec<f32> =
                tensor.data().as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
            if found.iter().any(|value| !value.is_finite()) {
                return Err(invalid(format!("`{name}` with a value that is not finite"), expected));
            }
            values.push((name.clone(), found));
        }
        Ok(Self { steps, identity: identity.into(), values })
    }
}

fn io_error(path: &Path, source: std::io::Error) -> BakeError {
    BakeError::Read { path: path.into(), source }
}

/// A hash of texts and numbers (FNV-1a, 64 bits).
pub(crate) struct Identity(u64);

impl Identity {
    pub fn new() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }

    pub fn add(&mut self, bytes: impl IntoIterator<Item = u8>) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }

    pub fn add_floats(&mut self, values: &[f32]) {
        self.add(values.iter().flat_map(|value| value.to_le_bytes()));
    }

    pub fn text(&self) -> String {
        format!("{:016x}", self.0)
    }
}
