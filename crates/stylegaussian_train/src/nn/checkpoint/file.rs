//! The file of a checkpoint, and the checks that all trainings share. Nothing here needs the training
//! framework, so that the fuzz target is built without it.

use std::collections::HashMap;

use safetensors::{Dtype, SafeTensors};

use crate::error::{Context, TrainError, ensure};

/// The parts that a training was started with, and a fingerprint of each. A training does not continue with
/// others.
pub type Origin = Vec<(&'static str, String)>;

/// The metadata entry of a part of the origin.
pub fn entry_of(part: &str) -> String {
    format!("origin.{part}")
}

/// A checkpoint in memory.
pub struct File<'a> {
    /// The file's name, for messages.
    pub name: String,
    entries: HashMap<String, String>,
    tensors: SafeTensors<'a>,
}

impl<'a> File<'a> {
    pub fn parse(bytes: &'a [u8], name: &str) -> Result<Self, TrainError> {
        let broken = || format!("{name}: no whole safetensors file");
        let (_, metadata) = SafeTensors::read_metadata(bytes).context(broken)?;
        let entries = metadata.metadata().clone().unwrap_or_default();
        let tensors = SafeTensors::deserialize(bytes).context(broken)?;
        Ok(Self { name: name.into(), entries, tensors })
    }

    pub fn text(&self, key: &str) -> &str {
        self.entries.get(key).map_or("", String::as_str)
    }

    pub fn number(&self, key: &str) -> Result<u32, TrainError> {
        let text = self.text(key);
        text.parse().context(|| format!("{}: `{key}` is `{text}`, expected a number", self.name))
    }

    /// The finite values of a tensor of this shape, or of any if it is `None`.
    pub fn values(&self, key: &str, shape: Option<&[usize]>) -> Result<Vec<f32>, TrainError> {
        let name = &self.name;
        let tensor = self.tensors.tensor(key).context(|| format!("{name}: no tensor `{key}`"))?;
        let expected = shape.unwrap_or(tensor.shape());
        ensure!(
            tensor.shape() == expected && tensor.dtype() == Dtype::F32,
            "{name}: `{key}` is {:?} {:?}, expected F32 {expected:?}: it belongs to another network",
            tensor.dtype(),
            tensor.shape()
        );
        let values: Vec<f32> = bytemuck::pod_collect_to_vec(tensor.data());
        let broken = values.iter().find(|value| !value.is_finite());
        ensure!(
            broken.is_none(),
            "{name}: `{key}` holds {}, expected finite numbers",
            broken.unwrap_or(&0.0)
        );
        Ok(values)
    }

    /// Checks that the training began with the same parts. Returns those that the file does not name.
    pub fn expect_origin(&self, origin: &Origin) -> Result<Vec<&'static str>, TrainError> {
        let found = |part: &str| self.entries.get(&entry_of(part));
        let parts = |differ: fn(Option<&String>, &String) -> bool| -> Vec<&'static str> {
            origin
                .iter()
                .filter(|(part, expected)| differ(found(part), expected))
                .map(|(part, _)| *part)
                .collect()
        };
        let others = parts(|found, expected| found.is_some_and(|found| found != expected));
        ensure!(
            others.is_empty(),
            "{}: found a training with other {}, expected the same; without --resume a new one begins",
            self.name,
            others.join(" and other ")
        );
        Ok(parts(|found, _| found.is_none()))
    }
}

/// Checks a checkpoint of any training, whatever its network: returns the number of steps.
///
/// # Errors
/// If the file is damaged, has no number of steps, or holds a number that is not finite.
pub fn check_checkpoint(bytes: &[u8], name: &str) -> Result<u32, TrainError> {
    let file = File::parse(bytes, name)?;
    for tensor in file.tensors.names() {
        file.values(tensor, None)?;
    }
    file.number("steps")
}

#[cfg(test)]
mod tests {
    use safetensors::tensor::TensorView;

    use super::*;

    fn bytes(value: f32, seed: &str) -> Vec<u8> {
        let values = [0.5, value].map(f32::to_le_bytes).concat();
        let view = TensorView::new(Dtype::F32, vec![1, 2], &values).unwrap();
        let entries = [("steps", "1"), ("origin.seed", seed), ("format", "f")];
        let metadata = entries.map(|(key, value)| (key.to_owned(), value.to_owned()));
        safetensors::serialize([("losses", view)], Some(metadata.into())).unwrap()
    }

    #[test]
    fn infinities_fail_when_they_are_read() {
        assert_eq!(check_checkpoint(&bytes(1.0, "7"), "c").unwrap(), 1);
        let error = check_checkpoint(&bytes(f32::INFINITY, "7"), "c").unwrap_err().to_string();
        assert_eq!(error, "c: `losses` holds inf, expected finite numbers");
        assert!(check_checkpoint(&bytes(1.0, "7")[..40], "c").is_err());
    }

    #[test]
    fn parts_that_differ_or_are_not_named() {
        let bytes = bytes(1.0, "7");
        let file = File::parse(&bytes, "c").unwrap();
        let origin = |seed: &str| vec![("scenes", "a".to_owned()), ("seed", seed.to_owned())];
        assert_eq!(file.expect_origin(&origin("7")).unwrap(), ["scenes"]);
        let error = file.expect_origin(&origin("8")).unwrap_err().to_string();
        assert!(error.starts_with("c: found a training with other seed, expected the same"), "{error}");
    }
}
