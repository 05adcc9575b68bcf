//! One step with the paper's loss: decode, splat, look at the picture through VGG.

use anyhow::Result;
use burn::tensor::{Device, Tensor, TensorData, activation::relu};
use stylegaussian::fold::ChannelMap;

use super::{
    adam::Adam,
    data::{TrainingScene, View},
    loss_network::{LAYERS, LossNetwork, channel_statistics},
    network::{FoldedInputs, Network},
    ops::splat,
    paintings::{Style, picture_tensor},
};

/// What a step weighs.
#[derive(Clone, Debug)]
pub struct LossWeights {
    /// Factor of the style loss (10 in the paper).
    pub style: f32,
    /// Factor of the penalty on colors outside 0..1, which no display shows (0 in the paper).
    pub range: f32,
    /// Which of [`LAYERS`] the content loss compares.
    pub content_layers: Vec<usize>,
}

/// Features of the unstyled picture that the content loss compares with, and where.
pub struct Content {
    /// One `[1, D, h, w]` for each content layer.
    features: Vec<Tensor<4>>,
    /// Coverage at each content layer's size `[1, 1, h, w]`: pixels without scene have no content.
    coverage: Vec<Tensor<4>>,
    /// Coverage at every layer's size, summing to 1 `[1, h * w]`: the style loss compares statistics of the scene alone. A
    /// scene that fills a part of the picture would otherwise have to exaggerate its contrast to make up for the rest.
    style_coverage: Vec<Tensor<2>>,
}

impl Content {
    /// Looks at a view's unstyled picture.
    pub fn new(view: &View, network: &LossNetwork, weights: &LossWeights, device: &Device) -> Self {
        let [width, height] = view.size();
        let gray: Vec<f32> = view
            .picture
            .chunks_exact(3)
            .zip(&view.alpha)
            .flat_map(|(c, alpha)| [0, 1, 2].map(|i| c[i] + (1.0 - alpha) * 0.5))
            .collect();
        let features = network.features(picture_tensor(&gray, view.size(), device));
        let cells: Vec<([usize; 2], Vec<f32>)> = features
            .iter()
            .map(|map| {
                let [_, _, h, w] = map.dims();
                let middle = |i: usize, n: usize, pixels: usize| (2 * i + 1) * pixels / (2 * n);
                let cell = |i: usize| view.alpha[middle(i / w, h, height) * width + middle(i % w, w, width)];
                ([h, w], (0..h * w).map(cell).collect())
            })
            .collect();
        let coverage = weights.content_layers.iter().map(|&layer| {
            let ([h, w], cells) = &cells[layer];
            Tensor::from_data(TensorData::new(cells.clone(), [1, 1, *h, *w]), device)
        });
        let style_coverage = cells.iter().map(|([h, w], cells)| {
            let total = cells.iter().sum::<f32>().max(1e-6);
            let shares: Vec<f32> = cells.iter().map(|cell| cell / total).collect();
            Tensor::from_data(TensorData::new(shares, [1, h * w]), device)
        });
        let (coverage, style_coverage) = (coverage.collect(), style_coverage.collect());
        let features = weights.content_layers.iter().map(|&layer| features[layer].clone()).collect();
        Self { features, coverage, style_coverage }
    }
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

/// Content and style loss of a stylized picture `[1, 3, H, W]`.
pub fn perceptual_losses(
    picture: Tensor<4>,
    content: &Content,
    style: &Style,
    network: &LossNetwork,
    weights: &LossWeights,
) -> (Tensor<1>, Tensor<1>) {
    let features = network.features(picture);
    let mut content_loss = Tensor::zeros([1], &features[0].device());
    for ((&layer, target), coverage) in
        weights.content_layers.iter().zip(&content.features).zip(&content.coverage)
    {
        let squares = (features[layer].clone() - target.clone()).powi_scalar(2) * coverage.clone();
        content_loss = content_loss + squares.mean();
    }
    let mut style_loss = Tensor::zeros([1], &features[0].device());
    let targets = style.targets.iter().zip(&content.style_coverage);
    for (features, ((mean, std_dev), coverage)) in features.into_iter().zip(targets) {
        let (found_mean, found_std_dev) = channel_statistics(features, Some(coverage));
        let squares =
            (found_mean - mean.clone()).powi_scalar(2) + (found_std_dev - std_dev.clone()).powi_scalar(2);
        style_loss = style_loss + squares.mean();
    }
    (content_loss, style_loss)
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
    loss_network: &LossNetwork,
    weights: &LossWeights,
    rate: f32,
    device: &Device,
) -> Result<[f32; 2]> {
    let map = ChannelMap::adain(&scene.statistics, &style.statistics)?;
    let folded = FoldedInputs::new(&scene.features, &scene.mean_low, &map, device);
    let rows = TensorData::new(scene.input_rows(&view.input_rows), [view.input_rows.len(), scene.n_inputs]);
    let colors = network.forward(Tensor::from_data(rows, device), &folded, &view.windows);
    let excess = relu(colors.clone() - 1.0) + relu(-colors.clone());
    let range_loss = excess.powi_scalar(2).mean();

    let behind = view.alpha.iter().flat_map(|alpha| style.mean_color.map(|channel| (1.0 - alpha) * channel));
    let behind = TensorData::new(behind.collect::<Vec<_>>(), [view.alpha.len(), 3]);
    let [width, height] = view.size();
    let picture = splat(colors, &view.weights) + Tensor::from_data(behind, device);
    let picture = picture.transpose().reshape([1, 3, height, width]);

    let (content_loss, style_loss) = perceptual_losses(picture, content, style, loss_network, weights);
    let loss = content_loss.clone() + style_loss.clone() * weights.style + range_loss * weights.range;
    let gradients = loss.backward();
    adam.update(network, &gradients, rate);
    Ok([content_loss.into_scalar::<f32>(), style_loss.into_scalar::<f32>()])
}
