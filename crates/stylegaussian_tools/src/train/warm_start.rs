//! The warm start: regression of the decoder on what a 2D teacher makes of the same features.
//!
//! For each scene and style the teacher (AdaIN with scene-wide content statistics, then a decoder of feature maps)
//! paints every view; the pictures are lifted to one color per Gaussian, the mean over the pixels it reaches weighted
//! by its blending weights, and the decoder learns these colors with an L1 loss. No render and no VGG is in the loop,
//! so a step costs a fraction of one with the paper's loss.

use std::sync::Arc;

use anyhow::Result;
use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;
use stylegaussian::fold::ChannelMap;
use stylegaussian_encoder::{Encoder, FeatureMap, Image};

use super::{
    adam::Adam,
    data::{TrainingScene, View},
    network::{FoldedInputs, Network},
    ops::Windows,
    paintings::Style,
};
use crate::{random::Random, teacher::Teacher};

/// Gaussians in a patch. Scenes are in Morton order, so a run of rows is compact; a neighbor outside is replaced by the
/// Gaussian itself.
const PATCH: usize = 6000;

/// A Gaussian whose blending weights sum to less than this over all views has no color worth learning.
const MIN_EVIDENCE: f32 = 0.5;

/// Gray behind the scene where the encoder looks at it.
const BACKGROUND: f32 = 0.5;

/// Lifted colors of one scene in one style.
pub struct Target {
    map: ChannelMap,
    /// `[N, 3]`.
    colors: Vec<f32>,
    /// 1 where there is evidence, 0 elsewhere `[N]`.
    is_seen: Vec<f32>,
}

/// Features of the unstyled views of a scene.
///
/// # Errors
/// When the encoder fails.
pub fn content_maps(scene: &TrainingScene, encoder: &Encoder) -> Result<Vec<FeatureMap>> {
    let encode = |view: &View| {
        let [width, height] = view.size();
        let pixels = view.picture.chunks_exact(3).zip(&view.alpha);
        let rgb =
            pixels.flat_map(|(c, alpha)| [0, 1, 2].map(|i| c[i] + (1.0 - alpha) * BACKGROUND)).collect();
        Ok(encoder.encode(&Image { width: width as u32, height: height as u32, rgb })?)
    };
    scene.views.par_iter().map(encode).collect()
}

impl Target {
    /// Lets the teacher paint the views and lifts the result.
    ///
    /// # Errors
    /// When the teacher fails, or the style belongs to another encoder.
    pub fn new(
        scene: &TrainingScene,
        content: &[FeatureMap],
        style: &Style,
        teacher: &Teacher,
    ) -> Result<Self> {
        let map = ChannelMap::adain(&scene.statistics, &style.statistics)?;
        let paint = |(view, content): (&View, &FeatureMap)| -> Result<(Vec<f32>, Vec<f32>)> {
            let mut mapped = content.clone();
            for row in mapped.values.chunks_exact_mut(map.gain.len()) {
                for ((value, gain), shift) in row.iter_mut().zip(&map.gain).zip(&map.shift) {
                    // Rectified features of a picture are never below 0; the teacher has seen no others.
                    *value = ((gain * f64::from(*value) + shift) as f32).max(0.0);
                }
            }
            let picture = teacher.decode(&mapped)?;
            let ones = vec![1.0; view.alpha.len()];
            Ok((view.weights.apply_transposed(&picture.rgb, 3), view.weights.apply_transposed(&ones, 1)))
        };
        let n = scene.base_colors.len();
        let (mut colors, mut evidence) = (vec![0.0; n * 3], vec![0.0; n]);
        let painted: Result<Vec<_>> = scene.views.par_iter().zip(content).map(paint).collect();
        for (view, (sums, weights)) in scene.views.iter().zip(painted?) {
            for (i, &row) in view.output_rows.iter().enumerate() {
                evidence[row as usize] += weights[i];
                (0..3).for_each(|c| colors[row as usize * 3 + c] += sums[i * 3 + c]);
            }
        }
        for (color, weight) in colors.chunks_exact_mut(3).zip(&evidence) {
            color.iter_mut().for_each(|c| *c /= weight.max(MIN_EVIDENCE));
        }
        let is_seen = evidence.iter().map(|&weight| f32::from(u8::from(weight >= MIN_EVIDENCE))).collect();
        Ok(Self { map, colors, is_seen })
    }
}

/// One step on a random patch of `scene`; returns the mean absolute error of its colors.
pub fn step(
    network: &mut Network,
    adam: &mut Adam,
    scene: &TrainingScene,
    target: &Target,
    random: &mut Random,
    rate: f32,
    device: &Device,
) -> f32 {
    let n = target.is_seen.len();
    let len = n.min(PATCH);
    let start = random.below(n - len + 1);
    let windows = Arc::new(patch_windows(scene, start, len));
    let windows: Vec<_> = (0..network.n_layers()).map(|_| windows.clone()).collect();
    let inputs = scene.inputs[start * scene.n_inputs..][..len * scene.n_inputs].to_vec();
    let tensor =
        |values: Vec<f32>, columns| Tensor::<2>::from_data(TensorData::new(values, [len, columns]), device);
    let folded = FoldedInputs::new(&scene.features, &scene.mean_low, &target.map, device);
    let colors = network.forward(tensor(inputs, scene.n_inputs), &folded, &windows);
    let is_seen = tensor(target.is_seen[start..start + len].to_vec(), 1);
    let n_seen = target.is_seen[start..start + len].iter().sum::<f32>().max(1.0);
    let error = colors - tensor(target.colors[start * 3..][..len * 3].to_vec(), 3);
    let loss = (error.abs() * is_seen).sum() / (3.0 * n_seen);
    let gradients = loss.backward();
    adam.update(network, &gradients, rate);
    loss.into_scalar::<f32>()
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
