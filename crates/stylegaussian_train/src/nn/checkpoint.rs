//! Checkpoints: the state from which an interrupted training resumes.

use std::{
    collections::HashMap,
    fs,
    path::{Path, PathBuf},
};

use burn::tensor::{Device, Tensor, TensorData};
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use stylegaussian::file;

use super::{
    adam::Adam,
    average::Average,
    parameter::{Parameter, to_vec},
};
use crate::error::{Context, TrainError, ensure};

/// Steps taken and their losses.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Steps of the warm start taken.
    pub warm_steps: u32,
    /// Steps of the paper's loss taken.
    pub steps: u32,
    /// Two losses of every step. For a decoder: content and style; for an encoder: features and statistics.
    pub losses: Vec<[f32; 2]>,
}

/// The parts that a training was started with, and a fingerprint of each. A training does not continue with others.
pub type Origin = Vec<(&'static str, String)>;

/// A fingerprint of bytes: FNV-1a, 64 bits.
pub fn fingerprint(bytes: impl IntoIterator<Item = u8>) -> String {
    let hash = bytes.into_iter().fold(0xCBF2_9CE4_8422_2325, |hash: u64, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3)
    });
    format!("{hash:016x}")
}

/// A fingerprint of files. Names do not count, but their order does.
///
/// # Errors
/// If a file cannot be read.
pub fn fingerprint_of_files(paths: &[PathBuf]) -> Result<String, TrainError> {
    let of_file = |path: &PathBuf| fs::read(path).map(fingerprint).context(|| path.display().to_string());
    let parts = paths.iter().map(of_file).collect::<Result<String, _>>()?;
    Ok(fingerprint(parts.into_bytes()))
}

/// Writes parameters, moments, averages, history and origin atomically. `format` names the kind of training in the file.
///
/// # Errors
/// If a tensor cannot be read or the file cannot be written.
pub fn save(
    path: &Path,
    format: &str,
    parameters: &[Parameter],
    adam: &Adam,
    average: &Average,
    history: &History,
    origin: &Origin,
) -> Result<(), TrainError> {
    let mut tensors: Vec<(String, Vec<usize>, Vec<f32>)> = Vec::new();
    // Parameters have no names of their own, so their position names their tensors.
    for (i, (parameter, moments)) in parameters.iter().zip(&adam.moments).enumerate() {
        let [first, second] = moments;
        let kept = [("value", &parameter.values), ("first", first), ("second", second)];
        for (name, tensor) in kept.into_iter().chain([("mean", &average.means[i])]) {
            tensors.push((format!("{i}.{name}"), tensor.dims().to_vec(), to_vec(tensor)?));
        }
    }
    let losses: Vec<f32> = history.losses.iter().flatten().copied().collect();
    tensors.push(("losses".into(), vec![history.losses.len(), 2], losses));
    let views = tensors.iter().map(|(name, shape, values)| {
        let view = TensorView::new(Dtype::F32, shape.clone(), bytemuck::cast_slice(values))?;
        Ok((name.clone(), view))
    });
    let views = views.collect::<Result<Vec<_>, TrainError>>()?;
    let mut metadata = HashMap::from([
        ("format".to_owned(), format.to_owned()),
        ("adam_step".to_owned(), adam.step.to_string()),
        ("average_count".to_owned(), average.count.to_string()),
        ("warm_steps".to_owned(), history.warm_steps.to_string()),
        ("steps".to_owned(), history.steps.to_string()),
    ]);
    metadata.extend(origin.iter().map(|(part, found)| (entry_of(part), found.clone())));
    let bytes = safetensors::serialize(views, Some(metadata))?;
    file::write_atomically(path, |out| out.write_all(&bytes))?;
    Ok(())
}

/// The metadata entry of a part of the origin.
fn entry_of(part: &str) -> String {
    format!("origin.{part}")
}

/// A checkpoint in memory.
struct File<'a> {
    /// The file's name, for messages.
    name: String,
    entries: HashMap<String, String>,
    tensors: SafeTensors<'a>,
}

impl<'a> File<'a> {
    fn parse(bytes: &'a [u8], name: &str) -> Result<Self, TrainError> {
        let broken = || format!("{name}: no whole safetensors file");
        let (_, metadata) = SafeTensors::read_metadata(bytes).context(broken)?;
        let entries = metadata.metadata().clone().unwrap_or_default();
        let tensors = SafeTensors::deserialize(bytes).context(broken)?;
        Ok(Self { name: name.into(), entries, tensors })
    }

    fn text(&self, key: &str) -> &str {
        self.entries.get(key).map_or("", String::as_str)
    }

    fn number(&self, key: &str) -> Result<u32, TrainError> {
        let text = self.text(key);
        text.parse().context(|| format!("{}: `{key}` is `{text}`, expected a number", self.name))
    }

    /// The finite values of a tensor of this shape, or of any if it is `None`.
    fn values(&self, key: &str, shape: Option<&[usize]>) -> Result<Vec<f32>, TrainError> {
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
    fn expect_origin(&self, origin: &Origin) -> Result<Vec<&'static str>, TrainError> {
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

/// Reads a checkpoint of this `format` into `parameters`, `adam` and `average`, whose shapes it must have. Beside the
/// history, returns the parts of the `origin` that the file does not name: files of earlier versions name none.
///
/// # Errors
/// If the file cannot be read, has another format, belongs to another network or was started with other parts, or holds
/// a number that is not finite.
pub fn load(
    path: &Path,
    format: &str,
    parameters: &mut [Parameter],
    adam: &mut Adam,
    average: &mut Average,
    device: &Device,
    origin: &Origin,
) -> Result<(History, Vec<&'static str>), TrainError> {
    let name = path.display().to_string();
    let bytes = fs::read(path).context(|| format!("{name}: cannot read the checkpoint"))?;
    let file = File::parse(&bytes, &name)?;
    let found = file.text("format");
    ensure!(found == format, "{name}: its format is `{found}`, expected {format}");
    let unnamed = file.expect_origin(origin)?;
    for (i, (parameter, moments)) in parameters.iter_mut().zip(&mut adam.moments).enumerate() {
        let shape = parameter.values.dims();
        let tensor = |key: &str| -> Result<Tensor<2>, TrainError> {
            let values = file.values(&format!("{i}.{key}"), Some(&shape))?;
            Ok(Tensor::from_data(TensorData::new(values, shape), device))
        };
        // Values record gradients. Moments and means are plain tensors, of the backend without autodiff.
        parameter.values = tensor("value")?.require_grad();
        *moments = [tensor("first")?.inner(), tensor("second")?.inner()];
        average.means[i] = tensor("mean")?.inner();
    }
    adam.step = file.number("adam_step")?;
    average.count = file.number("average_count")?;
    let (warm_steps, steps) = (file.number("warm_steps")?, file.number("steps")?);
    let losses = file.values("losses", Some(&[steps as usize, 2]))?;
    let losses = losses.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect();
    Ok((History { warm_steps, steps, losses }, unnamed))
}

#[cfg(test)]
mod tests {
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
