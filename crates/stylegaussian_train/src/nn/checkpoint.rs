//! Checkpoints: the state from which an interrupted training resumes.

use std::{collections::HashMap, fs, path::Path};

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

/// Writes parameters, moments, averages and history atomically. `format` names the kind of training in the file.
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
    let metadata = HashMap::from([
        ("format".to_owned(), format.to_owned()),
        ("adam_step".to_owned(), adam.step.to_string()),
        ("average_count".to_owned(), average.count.to_string()),
        ("warm_steps".to_owned(), history.warm_steps.to_string()),
        ("steps".to_owned(), history.steps.to_string()),
    ]);
    let bytes = safetensors::serialize(views, Some(metadata))?;
    file::write_atomically(path, |out| out.write_all(&bytes))?;
    Ok(())
}

/// Reads a checkpoint of this `format` into `parameters`, `adam` and `average`, whose shapes it must have.
///
/// # Errors
/// If the file cannot be read, has another format, or belongs to another network.
pub fn load(
    path: &Path,
    format: &str,
    parameters: &mut [Parameter],
    adam: &mut Adam,
    average: &mut Average,
    device: &Device,
) -> Result<History, TrainError> {
    let name = path.display();
    let bytes = fs::read(path).context(|| format!("{name}: cannot read the checkpoint"))?;
    let (_, metadata) =
        SafeTensors::read_metadata(&bytes).context(|| format!("{name}: no safetensors file"))?;
    let entries = metadata.metadata().clone().unwrap_or_default();
    let found = entries.get("format").map_or("nothing", String::as_str);
    ensure!(found == format, "{name}: its format is {found}, expected {format}");
    let number = |key: &str| -> Result<u32, TrainError> {
        let text = entries.get(key).map_or("", String::as_str);
        text.parse().context(|| format!("{name}: `{key}` is `{text}`, expected a number"))
    };
    let tensors = SafeTensors::deserialize(&bytes)?;
    let read = |key: &str, shape: &[usize]| -> Result<Vec<f32>, TrainError> {
        let tensor = tensors.tensor(key).context(|| format!("{name}: no tensor `{key}`"))?;
        ensure!(
            tensor.shape() == shape && tensor.dtype() == Dtype::F32,
            "{name}: `{key}` is {:?} {:?}, expected F32 {shape:?}: it belongs to another network",
            tensor.dtype(),
            tensor.shape()
        );
        Ok(bytemuck::pod_collect_to_vec(tensor.data()))
    };
    for (i, (parameter, moments)) in parameters.iter_mut().zip(&mut adam.moments).enumerate() {
        let shape = parameter.values.dims();
        let tensor = |key: &str| -> Result<Tensor<2>, TrainError> {
            let values = read(&format!("{i}.{key}"), &shape)?;
            Ok(Tensor::from_data(TensorData::new(values, shape), device))
        };
        // Values record gradients. Moments and means are plain tensors, of the backend without autodiff.
        parameter.values = tensor("value")?.require_grad();
        *moments = [tensor("first")?.inner(), tensor("second")?.inner()];
        average.means[i] = tensor("mean")?.inner();
    }
    adam.step = number("adam_step")?;
    average.count = number("average_count")?;
    let steps = number("steps")?;
    let losses = read("losses", &[steps as usize, 2])?;
    let losses = losses.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect();
    Ok(History { warm_steps: number("warm_steps")?, steps, losses })
}
