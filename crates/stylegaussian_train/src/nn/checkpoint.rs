//! Checkpoints: the state from which an interrupted training resumes.

use std::{
    collections::HashMap,
    fs,
    path::{Path, PathBuf},
};

use burn::tensor::{Device, Tensor, TensorData};
use safetensors::{Dtype, tensor::TensorView};
use stylegaussian_files::write_atomically;

use super::{
    adam::Adam,
    average::Average,
    parameter::{Parameter, to_vec},
};
use crate::error::{Context, TrainError, ensure};

mod file;

use self::file::{File, entry_of};
pub use self::file::{Origin, check_checkpoint};

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

/// Writes parameters, moments, averages, history and origin atomically. `format` names the kind of training in
/// the file.
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
    write_atomically(path, |out| out.write_all(&bytes))?;
    Ok(())
}

/// Reads a checkpoint of this `format` into `parameters`, `adam` and `average`, whose shapes it must have.
/// Beside the history, returns the parts of the `origin` that the file does not name: files of earlier versions
/// name none.
///
/// # Errors
/// If the file cannot be read, has another format, belongs to another network or was started with other parts,
/// or holds a number that is not finite.
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
