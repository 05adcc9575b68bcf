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
use stylegaussian::{
    fold::ChannelMap,
    statistics::{ContentStatistics, STD_DEV_EPSILON},
};
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

/// Views of a scene that the teacher paints, spread over all of them: their colors are averaged, so a few suffice.
const PAINTED_VIEWS: usize = 6;

/// What the teacher knows of a scene.
pub struct Content {
    /// View indices and features of the unstyled views.
    maps: Vec<(usize, FeatureMap)>,
    /// Statistics of these features where the scene covers them. Those of the Gaussians would not do: embedded features
    /// vary less than a picture's, and the teacher's colors would be far out of range.
    statistics: ContentStatistics,
}

impl Content {
    /// Encodes views of a scene.
    ///
    /// # Errors
    /// When the encoder fails.
    pub fn new(scene: &TrainingScene, encoder: &Encoder) -> Result<Self> {
        let stride = scene.views.len().div_ceil(PAINTED_VIEWS);
        let chosen: Vec<usize> = (0..scene.views.len()).step_by(stride).collect();
        let encode = |&view: &usize| Ok((view, encode(&scene.views[view], encoder)?));
        let maps = chosen.par_iter().map(encode).collect::<Result<Vec<_>>>()?;
        let covered: Vec<&[f32]> =
            maps.iter().flat_map(|(view, map)| covered_cells(&scene.views[*view], map)).collect();
        Ok(Self { statistics: statistics_of(&covered, encoder.n_channels()), maps })
    }
}

fn encode(view: &View, encoder: &Encoder) -> Result<FeatureMap> {
    let [width, height] = view.size();
    let pixels = view.picture.chunks_exact(3).zip(&view.alpha);
    let rgb = pixels.flat_map(|(c, alpha)| [0, 1, 2].map(|i| c[i] + (1.0 - alpha) * BACKGROUND)).collect();
    Ok(encoder.encode(&Image { width: width as u32, height: height as u32, rgb })?)
}

/// The cells of a feature map whose middle the scene covers.
fn covered_cells<'a>(view: &View, map: &'a FeatureMap) -> Vec<&'a [f32]> {
    let [width, height] = view.size();
    let (columns, rows) = (map.width as usize, map.height as usize);
    let is_covered = |&(cell, _): &(usize, &[f32])| {
        let x = (2 * (cell % columns) + 1) * width / (2 * columns);
        let y = (2 * (cell / columns) + 1) * height / (2 * rows);
        view.alpha[y * width + x] > 0.5
    };
    let cells = map.values.chunks_exact(map.n_channels).enumerate();
    cells.filter(is_covered).map(|(_, features)| features).collect()
}

fn statistics_of(rows: &[&[f32]], n_channels: usize) -> ContentStatistics {
    let n = rows.len().max(1) as f64;
    let mut mean = vec![0.0; n_channels];
    let mut squares = vec![0.0; n_channels];
    for row in rows {
        mean.iter_mut().zip(*row).for_each(|(sum, value)| *sum += f64::from(*value) / n);
    }
    for row in rows {
        for ((sum, value), mean) in squares.iter_mut().zip(*row).zip(&mean) {
            *sum += (f64::from(*value) - mean).powi(2) / n;
        }
    }
    let std_dev = squares.into_iter().map(|variance: f64| variance.sqrt() + STD_DEV_EPSILON).collect();
    ContentStatistics { mean, std_dev }
}

impl Target {
    /// Lets the teacher paint the views and lifts the result.
    ///
    /// # Errors
    /// When the teacher fails, or the style belongs to another encoder.
    pub fn new(scene: &TrainingScene, content: &Content, style: &Style, teacher: &Teacher) -> Result<Self> {
        let teacher_map = ChannelMap::adain(&content.statistics, &style.statistics)?;
        let paint = |(view, features): &(usize, FeatureMap)| -> Result<(usize, Vec<f32>, Vec<f32>)> {
            let mut mapped = features.clone();
            for row in mapped.values.chunks_exact_mut(teacher_map.gain.len()) {
                for ((value, gain), shift) in row.iter_mut().zip(&teacher_map.gain).zip(&teacher_map.shift) {
                    // Rectified features of a picture are never below 0; the teacher has seen no others.
                    *value = ((gain * f64::from(*value) + shift) as f32).max(0.0);
                }
            }
            let mut picture = teacher.decode(&mapped)?;
            picture.rgb.iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
            let weights = &scene.views[*view].weights;
            let ones = vec![1.0; weights.starts.len() - 1];
            Ok((*view, weights.apply_transposed(&picture.rgb, 3), weights.apply_transposed(&ones, 1)))
        };
        let n = scene.base_colors.len();
        let (mut colors, mut evidence) = (vec![0.0; n * 3], vec![0.0; n]);
        let painted: Result<Vec<_>> = content.maps.par_iter().map(paint).collect();
        for (view, sums, weights) in painted? {
            for (i, &row) in scene.views[view].output_rows.iter().enumerate() {
                evidence[row as usize] += weights[i];
                (0..3).for_each(|c| colors[row as usize * 3 + c] += sums[i * 3 + c]);
            }
        }
        for (color, weight) in colors.chunks_exact_mut(3).zip(&evidence) {
            color.iter_mut().for_each(|c| *c /= weight.max(MIN_EVIDENCE));
        }
        let is_seen = evidence.iter().map(|&weight| f32::from(u8::from(weight >= MIN_EVIDENCE))).collect();
        Ok(Self { map: ChannelMap::adain(&scene.statistics, &style.statistics)?, colors, is_seen })
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
