//! The warm start: regression of the decoder on the scene recolored to each painting's mean color and covariance.
//!
//! From random weights the paper's loss needs tens of thousands of steps before the decoder knows what color a feature
//! is. Recolored Gaussians say so directly, for any painting and at no cost: no render and no VGG is in the loop, so a
//! step costs a fraction of one with the paper's loss, and every step can show another painting.

use std::sync::Arc;

use anyhow::Result;
use burn::tensor::{Device, Tensor, TensorData};
use stylegaussian::fold::ChannelMap;

use super::{
    adam::Adam,
    data::TrainingScene,
    network::{FoldedInputs, Network},
    ops::Windows,
    paintings::Style,
};
use crate::{random::Random, recolor::Recoloring};

/// Gaussians in a patch. Scenes are in Morton order, so a run of rows is compact; a neighbor outside is replaced by the
/// Gaussian itself.
const PATCH: usize = 6000;

/// One step on a random patch of `scene`; returns the mean absolute error of its colors.
///
/// # Errors
/// When the style belongs to other features.
pub fn step(
    network: &mut Network,
    adam: &mut Adam,
    scene: &TrainingScene,
    style: &Style,
    random: &mut Random,
    rate: f32,
    device: &Device,
) -> Result<f32> {
    let n = scene.base_colors.len();
    let len = n.min(PATCH);
    let start = random.below(n - len + 1);
    let rows = start..start + len;
    let windows = Arc::new(patch_windows(scene, start, len));
    let windows: Vec<_> = (0..network.n_neighborhoods()).map(|_| windows.clone()).collect();
    let inputs = scene.inputs[start * scene.n_inputs..][..len * scene.n_inputs].to_vec();
    let tensor =
        |values: Vec<f32>, columns| Tensor::<2>::from_data(TensorData::new(values, [len, columns]), device);
    let map = ChannelMap::adain(&scene.statistics, &style.statistics)?;
    let folded = FoldedInputs::new(&scene.features, &scene.mean_latent, &scene.statistics, &map, device);
    let own_colors = tensor(scene.base_colors[rows.clone()].iter().flatten().copied().collect(), 3);
    let colors = network.forward(tensor(inputs, scene.n_inputs), own_colors, &folded, &windows);

    let recoloring = Recoloring::new(&scene.colors, &style.colors);
    // What a display cannot show is not worth learning.
    let target =
        scene.base_colors[rows].iter().flat_map(|color| recoloring.color(*color).map(|c| c.clamp(0.0, 1.0)));
    let loss = (colors - tensor(target.collect(), 3)).abs().mean();
    let gradients = loss.backward();
    adam.update(&mut network.parameters, &gradients, rate);
    Ok(loss.into_scalar::<f32>())
}

fn patch_windows(scene: &TrainingScene, start: usize, len: usize) -> Windows {
    let k = scene.neighbors.k;
    let lists = scene.neighbors.indices[start * k..][..len * k].iter().enumerate();
    let local = |(i, &row): (usize, &u32)| {
        let row = (row as usize).wrapping_sub(start);
        (if row < len { row } else { i / k }) as u32
    };
    Windows::new(lists.map(local).collect(), k, len)
}
