//! The state of a bake as a file, `*.checkpoint.safetensors`.

use std::{fs, path::Path};

use stylegaussian_files::{
    FileError, Mismatch,
    tensors::{Dimension, Reader, Writer},
    write_atomically,
};

use crate::error::BakeError;

/// Metadata `format` of the files.
const FORMAT: &str = "stylegaussian-bake";

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
        let mut file = Writer::new(FORMAT);
        file.set("steps", self.steps);
        file.set("identity", &self.identity);
        for (name, values) in &self.values {
            file.f32(name, &[values.len()], values);
        }
        Ok(write_atomically(path, |out| file.write(out))?)
    }

    /// Reads the file of the bake `identity`, whose values have the given names and lengths.
    pub fn read(path: &Path, identity: &str, lengths: &[(String, Dimension)]) -> Result<Self, BakeError> {
        let bytes = fs::read(path).map_err(|source| FileError::Io { path: path.into(), source })?;
        let at = |mismatch: Mismatch| mismatch.at(path);
        let file = Reader::new(&bytes).map_err(at)?;
        file.expect_value("format", FORMAT).map_err(at)?;
        if file.metadata("identity") != Some(identity) {
            return Err(BakeError::File(FileError::Unexpected {
                path: path.into(),
                found: "a bake with another scene, painting or setting".into(),
                expected: "the same; remove the file to begin anew".into(),
            }));
        }
        let steps = file.required("steps", "a number of steps").map_err(at)?;
        let list = |(name, length): &(String, Dimension)| {
            file.floats(name, &[*length]).map(|values| (name.clone(), values)).map_err(at)
        };
        let values = lengths.iter().map(list).collect::<Result<_, FileError>>()?;
        Ok(Self { steps, identity: identity.into(), values })
    }
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
