//! The warm start: regression of the decoder on the scene recolored to each painting's mean color and
//! covariance.
//!
//! From random weights, the paper's loss needs tens of thousands of steps before the decoder knows which color
//! a feature has. Recolored Gaussians say so directly, for any painting and at no cost: a step needs neither a
//! render nor VGG, so it costs a fraction of a step with the paper's loss, and every step can show another
//! painting.

use std::{iter, sync::Arc};

use burn::tensor::{Device, Tensor, TensorData};
use stylegaussian::{fold::ChannelMap, random::Random, recolor::Recoloring};

use super::{
    data::PreparedScene,
    network::{FoldedInputs, Neighborhoods, Network},
    paintings::Style,
};
use crate::{error::TrainError, nn::ops::Windows};

/// Gaussians in a patch. Scenes are in Morton order, so a run of rows is compact. A neighbor outside of the
/// patch is replaced by the Gaussian itself.
const PATCH: usize = 6000;

/// The mean absolute error of the colors of a random patch of `scene`.
///
/// # Errors
/// If the style belongs to other features.
pub fn loss(
    network: &Network,
    scene: &PreparedScene,
    style: &Style,
    random: &mut Random,
    device: &Device,
) -> Result<Tensor<1>, TrainError> {
    let n = scene.base_colors.len();
    let len = n.min(PATCH);
    // A whole patch always fits.
    let start = random.below(n - len + 1);
    let rows = start..start + len;
    let windows = Arc::new(patch_windows(scene, start, len));
    // Every stage works on the whole patch, so all share one list. Lists restricted to each stage's rows, as
    // views have them, would have to be made for every patch.
    let repeated = |n: usize| iter::repeat_n(windows.clone(), n).collect();
    let neighborhoods = Neighborhoods {
        layers: repeated(network.n_layers()),
        smoothing: repeated(network.smoothing_passes()),
    };
    let inputs = scene.inputs[start * scene.n_inputs..][..len * scene.n_inputs].to_vec();
    let tensor =
        |values: Vec<f32>, columns| Tensor::<2>::from_data(TensorData::new(values, [len, columns]), device);
    let map = ChannelMap::adain(&scene.statistics, &style.statistics)?;
    let folded = FoldedInputs::new(&scene.features, &scene.mean_latent, &scene.statistics, &map, device);
    let base_colors = tensor(scene.base_colors[rows.clone()].iter().flatten().copied().collect(), 3);
    let decoded = network.decode(tensor(inputs, scene.n_inputs), &folded, &neighborhoods);
    let colors = network.finished(decoded, base_colors, &neighborhoods);

    let recoloring = Recoloring::new(&scene.colors, &style.colors);
    // Colors that a display cannot show are not worth learning.
    let target =
        scene.base_colors[rows].iter().flat_map(|color| recoloring.color(*color).map(|c| c.clamp(0.0, 1.0)));
    Ok((colors - tensor(target.collect(), 3)).abs().mean())
}

fn patch_windows(scene: &PreparedScene, start: usize, len: usize) -> Windows {
    let k = scene.neighbors.k;
    let lists = scene.neighbors.indices[start * k..][..len * k].iter().enumerate();
    let local = |(i, &row): (usize, &u32)| {
        // Wraps for rows before the patch, which makes them larger than `len` too.
        let row = (row as usize).wrapping_sub(start);
        // `i` counts entries; `i / k` is the Gaussian whose neighborhood it is in.
        (if row < len { row } else { i / k }) as u32
    };
    Windows::new(lists.map(local).collect(), k, len)
}
