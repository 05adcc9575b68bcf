//! One step with the paper's loss: decode, splat, look at the picture through VGG.

use std::sync::Arc;

use anyhow::Result;
use burn::tensor::{
    Device, Tensor, TensorData,
    activation::{log_softmax, relu},
};
use stylegaussian::fold::ChannelMap;

use super::{
    adam::Adam,
    data::{TrainingScene, View},
    loss_network::{LAYERS, LossNetwork},
    network::{FoldedInputs, Network},
    ops::{row_statistics, splat},
    paintings::{Style, picture_tensor},
};
use crate::recolor::Recoloring;

/// Side of the squares over which colors are averaged before they are compared with the recolored scene's, in pixels:
/// strokes within are free.
const SQUARE: usize = 16;

/// What a step weighs.
#[derive(Clone, Debug)]
pub struct LossWeights {
    /// Factor of the style loss (10 in the paper).
    pub style: f32,
    /// Factor of the penalty on colors outside 0..1, which no display shows (0 in the paper).
    pub range: f32,
    /// Factor of the distance from the recolored scene's colors, over squares of [`SQUARE`] pixels (0 in the paper).
    pub palette: f32,
    /// Factor of the mean squared distance of a Gaussian's color from its window's mean, before colors are averaged (0 in the
    /// paper).
    pub roughness: f32,
    /// Factor of the cross-entropy of telling the own painting among others (0 in the paper).
    pub recognition: f32,
    /// Which of [`LAYERS`] the content loss compares.
    pub content_layers: Vec<usize>,
}

/// The difference of two style errors that makes one painting e times as likely as the other: about what lies between
/// paintings that are alike.
const TEMPERATURE: f64 = 0.5;

/// Features of the unstyled picture that the content loss compares with, and where.
pub struct Content {
    /// One `[h * w, D]` for each content layer.
    features: Vec<Tensor<2>>,
    /// Coverage at each content layer's size `[h * w, 1]`: pixels without scene have no content.
    coverage: Vec<Tensor<2>>,
    /// Coverage at every layer's size, summing to 1 `[h * w]`: the style loss compares statistics of the scene alone. A
    /// scene that fills a part of the picture would otherwise have to exaggerate its contrast to make up for the rest.
    style_coverage: Vec<Arc<Vec<f32>>>,
}

impl Content {
    /// Looks at a view's unstyled picture.
    pub fn new(view: &View, network: &LossNetwork, weights: &LossWeights, device: &Device) -> Self {
        let gray: Vec<f32> = view
            .picture
            .chunks_exact(3)
            .zip(&view.alpha)
            .flat_map(|(c, alpha)| [0, 1, 2].map(|i| c[i] + (1.0 - alpha) * 0.5))
            .collect();
        let features = network.features(picture_tensor(&gray, device), view.size());
        let cells: Vec<Vec<f32>> =
            features.iter().map(|map| coverage_of_cells(&view.alpha, view.size(), map.size)).collect();
        let column =
            |cells: &Vec<f32>| Tensor::from_data(TensorData::new(cells.clone(), [cells.len(), 1]), device);
        let coverage = weights.content_layers.iter().map(|&layer| column(&cells[layer])).collect();
        let style_coverage = cells.iter().map(|cells| Arc::new(shares(cells))).collect();
        let features = weights.content_layers.iter().map(|&layer| features[layer].rows.clone()).collect();
        Self { features, coverage, style_coverage }
    }
}

/// The coverage in the middle of each of `cells` `[w, h]` that a feature map lays over a picture's `alpha`.
pub fn coverage_of_cells(alpha: &[f32], [width, height]: [usize; 2], [w, h]: [usize; 2]) -> Vec<f32> {
    let middle = |i: usize, n: usize, pixels: usize| (2 * i + 1) * pixels / (2 * n);
    (0..h * w).map(|i| alpha[middle(i / w, h, height) * width + middle(i % w, w, width)]).collect()
}

/// Values divided by their sum.
pub fn shares(values: &[f32]) -> Vec<f32> {
    let total = values.iter().sum::<f32>().max(1e-6);
    values.iter().map(|value| value / total).collect()
}

/// Index of a layer in [`LAYERS`].
///
/// # Errors
/// When there is no such layer, or the networks at hand do not give it.
pub fn content_layer(name: &str, network: &LossNetwork) -> Result<usize> {
    let available = &LAYERS[..network.n_layers()];
    available.iter().position(|layer| *layer == name).ok_or_else(|| {
        anyhow::anyhow!(
            "content layer `{name}`: expected one of {available:?} (relu4_1 needs weights that reach it)"
        )
    })
}

/// What is wrong with a stylized picture.
pub struct PerceptualLosses {
    /// Of its content.
    pub content: Tensor<1>,
    /// Of its style.
    pub style: Tensor<1>,
    /// Minus the logarithm of the share of the own painting among all, each with exp(-style error / [`TEMPERATURE`]); 0
    /// without others.
    pub recognition: Tensor<1>,
}

/// Losses of a stylized picture `[H * W, 3]`, `size` = [W, H].
pub fn perceptual_losses(
    picture: Tensor<2>,
    size: [usize; 2],
    content: &Content,
    style: &Style,
    others: &[&Style],
    network: &LossNetwork,
    weights: &LossWeights,
) -> PerceptualLosses {
    let features = network.features(picture, size);
    let mut content_loss = Tensor::zeros([1], &features[0].rows.device());
    for ((&layer, target), coverage) in
        weights.content_layers.iter().zip(&content.features).zip(&content.coverage)
    {
        let squares = (features[layer].rows.clone() - target.clone()).powi_scalar(2) * coverage.clone();
        content_loss = content_loss + squares.mean();
    }
    let mut style_loss = Tensor::zeros([1], &features[0].rows.device());
    let mut errors: Tensor<2> = Tensor::zeros([1 + others.len(), 1], &style_loss.device());
    let targets = style.targets.iter().zip(&content.style_coverage);
    for (layer, (features, (target, coverage))) in features.into_iter().zip(targets).enumerate() {
        let found = row_statistics(features.rows, coverage);
        // Means and deviations: their mean squares are to be added, not averaged.
        style_loss = style_loss + (found.clone() - target.clone()).powi_scalar(2).mean() * 2.0;
        if !others.is_empty() {
            let n_statistics = found.shape().num_elements();
            let row = |target: &Tensor<2>| target.clone().reshape([1, n_statistics]);
            let all = std::iter::once(style).chain(others.iter().copied());
            let all = Tensor::cat(all.map(|style| row(&style.targets[layer])).collect(), 0);
            errors = errors + (all - row(&found)).powi_scalar(2).mean_dim(1) * 2.0;
        }
    }
    let recognition = -log_softmax(errors / -TEMPERATURE, 0).narrow(0, 0, 1).reshape([1]);
    PerceptualLosses { content: content_loss, style: style_loss, recognition }
}

/// One step on one view in one style; returns content and style loss.
///
/// # Errors
/// When the style belongs to other features.
#[expect(clippy::too_many_arguments, reason = "a step joins everything that training holds")]
pub fn step(
    network: &mut Network,
    adam: &mut Adam,
    scene: &TrainingScene,
    view: &View,
    content: &Content,
    style: &Style,
    others: &[&Style],
    loss_network: &LossNetwork,
    weights: &LossWeights,
    rate: f32,
    device: &Device,
) -> Result<[f32; 2]> {
    let map = ChannelMap::adain(&scene.statistics, &style.statistics)?;
    let folded = FoldedInputs::new(&scene.features, &scene.mean_latent, &scene.statistics, &map, device);
    let rows = TensorData::new(scene.input_rows(&view.input_rows), [view.input_rows.len(), scene.n_inputs]);
    let decoded = network.decode(Tensor::from_data(rows, device), &folded, &view.windows);
    let own_colors = view.output_rows.iter().flat_map(|&row| scene.base_colors[row as usize]);
    let own_colors = TensorData::new(own_colors.collect::<Vec<_>>(), [view.output_rows.len(), 3]);
    let colors = network.finished(decoded.clone(), Tensor::from_data(own_colors, device), &view.windows);
    // Of what is averaged, too: otherwise the decoder would make up for that by exaggerating.
    let excess = relu(decoded.clone() - network.share()) + relu(-decoded.clone());
    let range_loss = excess.powi_scalar(2).mean();

    let behind = view.alpha.iter().flat_map(|alpha| style.mean_color.map(|channel| (1.0 - alpha) * channel));
    let behind = TensorData::new(behind.collect::<Vec<_>>(), [view.alpha.len(), 3]);
    let splats = splat(colors, &view.weights);
    let palette_loss = (weights.palette > 0.0)
        .then(|| palette_distance(splats.clone(), scene, view, style) * weights.palette);
    let picture = splats + Tensor::from_data(behind, device);
    let PerceptualLosses { content: content_loss, style: style_loss, recognition } =
        perceptual_losses(picture, view.size(), content, style, others, loss_network, weights);
    let loss = content_loss.clone() + style_loss.clone() * weights.style + range_loss * weights.range;
    let loss = if others.is_empty() { loss } else { loss + recognition * weights.recognition };
    let roughness = network.roughness(decoded, &view.windows).filter(|_| weights.roughness > 0.0);
    let loss = match roughness {
        Some(roughness) => loss + roughness * weights.roughness,
        None => loss,
    };
    let loss = match palette_loss {
        Some(palette_loss) => loss + palette_loss,
        None => loss,
    };
    let gradients = loss.backward();
    adam.update(&mut network.parameters, &gradients, rate);
    Ok([content_loss.into_scalar::<f32>(), style_loss.into_scalar::<f32>()])
}

/// Mean distance of a premultiplied picture `[H * W, 3]` from the recolored view, over whole squares of [`SQUARE`] pixels
/// (or the whole picture, where it is smaller).
fn palette_distance(splats: Tensor<2>, scene: &TrainingScene, view: &View, style: &Style) -> Tensor<1> {
    let [width, height] = view.size();
    let recoloring = Recoloring::new(&scene.colors, &style.colors);
    let recolored = view.picture.chunks_exact(3).zip(&view.alpha).flat_map(|(c, alpha)| {
        recoloring.premultiplied([c[0], c[1], c[2]], *alpha).map(|channel| channel.clamp(0.0, *alpha))
    });
    let recolored = TensorData::new(recolored.collect::<Vec<_>>(), [width * height, 3]);
    let difference = splats.clone() - Tensor::from_data(recolored, &splats.device());
    let [side_x, side_y] = [SQUARE.min(width), SQUARE.min(height)];
    let [columns, rows] = [width / side_x, height / side_y];
    let squares = difference
        .reshape([height, width, 3])
        .narrow(0, 0, rows * side_y)
        .narrow(1, 0, columns * side_x)
        .reshape([rows, side_y, columns, side_x * 3])
        .mean_dim(1)
        .reshape([rows * columns, side_x, 3])
        .mean_dim(1);
    squares.abs().mean()
}
