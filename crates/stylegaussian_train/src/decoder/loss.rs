//! The losses of a step: decode, splat, and compare the picture through VGG-19.

use std::{
    ops::{Add, Mul},
    sync::Arc,
};

use burn::tensor::{
    Device, Tensor, TensorData,
    activation::{log_softmax, relu},
};
use stylegaussian::{fold::ChannelMap, recolor::Recoloring};

use super::{
    config::LossWeights,
    data::{PreparedScene, View},
    network::{FoldedInputs, Network},
    paintings::Style,
};
use crate::{
    error::TrainError,
    nn::{
        coverage::{coverage_of_cells, shares},
        loss_network::{LAYERS, LossNetwork, picture_tensor},
        ops::{row_statistics, splat},
        parameter::to_scalar,
    },
};

/// Side of the squares over which the color-transfer loss averages colors, in pixels. Strokes within a square
/// are free.
const SQUARE: usize = 16;

/// The difference of two style errors at which one painting is e times as likely as the other in the
/// contrastive loss: about the difference between similar paintings.
const TEMPERATURE: f64 = 0.5;

/// The losses of a step: numbers, or tensors before the gradients are computed. Losses that are switched off
/// are `None`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Losses<T = f32> {
    /// Mean squared distance of VGG-19's features from those of the unstyled view.
    pub content: T,
    /// Squared distance of the means and deviations of VGG-19's features from the painting's, summed over
    /// layers.
    pub style: T,
    /// Mean squared excess of decoded colors over the range that a display shows.
    pub range: T,
    /// Mean distance of colors from the recolored scene's, over squares of 16 pixels.
    pub color_transfer: Option<T>,
    /// Mean squared distance of decoded colors from the mean of their neighborhoods.
    pub roughness: Option<T>,
    /// Cross-entropy of matching the picture to its own painting among others.
    pub contrastive: Option<T>,
}

impl<T: Clone + Add<Output = T> + Mul<f32, Output = T>> Losses<T> {
    /// The weighted sum, which training minimizes.
    pub fn total(&self, weights: &LossWeights) -> T {
        let optional = [
            (&self.contrastive, weights.contrastive),
            (&self.roughness, weights.roughness),
            (&self.color_transfer, weights.color_transfer),
        ];
        let always =
            self.content.clone() + self.style.clone() * weights.style + self.range.clone() * weights.range;
        let available = optional.into_iter().filter_map(|(loss, weight)| Some(loss.clone()? * weight));
        available.fold(always, |sum, loss| sum + loss)
    }
}

impl Losses<Tensor<1>> {
    /// Reads the numbers.
    ///
    /// # Errors
    /// If the device fails.
    pub fn values(&self) -> Result<Losses, TrainError> {
        let optional = |loss: &Option<Tensor<1>>| loss.as_ref().map(to_scalar).transpose();
        Ok(Losses {
            content: to_scalar(&self.content)?,
            style: to_scalar(&self.style)?,
            range: to_scalar(&self.range)?,
            color_transfer: optional(&self.color_transfer)?,
            roughness: optional(&self.roughness)?,
            contrastive: optional(&self.contrastive)?,
        })
    }
}

/// Features of an unstyled view, and the cells in which losses are measured.
pub struct Content {
    /// One `[h * w, D]` for each content layer.
    features: Vec<Tensor<2>>,
    /// Coverage at each content layer's size `[h * w, 1]`. Pixels without scene have no content.
    coverage: Vec<Tensor<2>>,
    /// Coverage at every layer's size, summing to 1 `[h * w]`. The style loss compares statistics of the scene
    /// alone: otherwise a scene that fills a part of the picture would have to exaggerate its contrast to make
    /// up for the rest.
    style_coverage: Vec<Arc<Vec<f32>>>,
}

impl Content {
    /// Computes the features of a view's unstyled picture over mid-gray.
    pub fn new(view: &View, network: &LossNetwork, content_layers: &[usize]) -> Self {
        let gray: Vec<f32> = view
            .picture
            .chunks_exact(3)
            .zip(&view.alpha)
            // The picture is premultiplied, so only the background is weighted.
            .flat_map(|(c, alpha)| [0, 1, 2].map(|i| c[i] + (1.0 - alpha) * 0.5))
            .collect();
        let device = network.device();
        let features = network.features(picture_tensor(&gray, device), view.size());
        let cells: Vec<Vec<f32>> =
            features.iter().map(|map| coverage_of_cells(&view.alpha, view.size(), map.size)).collect();
        let column =
            |cells: &Vec<f32>| Tensor::from_data(TensorData::new(cells.clone(), [cells.len(), 1]), device);
        let coverage = content_layers.iter().map(|&layer| column(&cells[layer])).collect();
        // Of all layers, because the style loss compares all.
        let style_coverage = cells.iter().map(|cells| Arc::new(shares(cells))).collect();
        let features = content_layers.iter().map(|&layer| features[layer].rows.clone()).collect();
        Self { features, coverage, style_coverage }
    }
}

/// Indices in [`LAYERS`] of the layers that the content loss compares. If no name is given: the deepest of
/// relu3_1 and relu4_1 that the network has.
///
/// # Errors
/// If there is no layer of a name, or the network does not compute it.
pub fn content_layers(names: &[String], network: &LossNetwork) -> Result<Vec<usize>, TrainError> {
    let available = &LAYERS[..network.n_layers()];
    if names.is_empty() {
        return Ok(vec![available.len() - 1]);
    }
    let index = |name: &String| {
        available.iter().position(|layer| layer == name).ok_or_else(|| {
            TrainError::Invalid(format!(
                "content layer `{name}`: expected one of {available:?} (relu4_1 needs weights that reach it)"
            ))
        })
    };
    names.iter().map(index).collect()
}

/// One view in one style, and everything that its losses depend on.
pub struct Sample<'a> {
    /// The scene.
    pub scene: &'a PreparedScene,
    /// The view of it.
    pub view: &'a View,
    /// Features of the unstyled view.
    pub content: &'a Content,
    /// The painting.
    pub style: &'a Style,
    /// Other paintings, for the contrastive loss.
    pub others: &'a [&'a Style],
}

impl Sample<'_> {
    /// Decodes the view, renders it and computes the losses that `weights` switch on.
    ///
    /// # Errors
    /// If the style belongs to other features.
    pub fn losses(
        &self,
        network: &Network,
        loss_network: &LossNetwork,
        content_layers: &[usize],
        weights: &LossWeights,
    ) -> Result<Losses<Tensor<1>>, TrainError> {
        let Self { scene, view, style, .. } = *self;
        let device = loss_network.device();
        let map = ChannelMap::adain(&scene.statistics, &style.statistics)?;
        let folded = FoldedInputs::new(&scene.features, &scene.mean_latent, &scene.statistics, &map, device);
        let rows =
            TensorData::new(scene.input_rows(&view.input_rows), [view.input_rows.len(), scene.n_inputs]);
        // The fold is part of the graph: gradients reach the first layer's weights through W A.
        let decoded = network.decode(Tensor::from_data(rows, device), &folded, &view.neighborhoods);
        let base_colors = view.output_rows.iter().flat_map(|&row| scene.base_colors[row as usize]);
        let base_colors = TensorData::new(base_colors.collect::<Vec<_>>(), [view.output_rows.len(), 3]);
        let base_colors = Tensor::from_data(base_colors, device);
        let colors = network.finished(decoded.clone(), base_colors, &view.neighborhoods);
        // Premultiplied colors without a background.
        let splats = splat(colors, &view.weights);
        let perceptual =
            self.perceptual(splats.clone() + self.background(device), loss_network, content_layers);
        Ok(Losses {
            content: perceptual.content,
            style: perceptual.style,
            contrastive: perceptual.contrastive,
            range: range_loss(&decoded, network.share()),
            roughness: network.roughness(decoded, &view.neighborhoods).filter(|_| weights.roughness > 0.0),
            color_transfer: (weights.color_transfer > 0.0).then(|| self.color_transfer(splats)),
        })
    }

    /// The painting's mean color where the scene does not cover the picture `[H * W, 3]`.
    fn background(&self, device: &Device) -> Tensor<2> {
        let Self { view, style, .. } = self;
        let color =
            view.alpha.iter().flat_map(|alpha| style.mean_color.map(|channel| (1.0 - alpha) * channel));
        Tensor::from_data(TensorData::new(color.collect::<Vec<_>>(), [view.alpha.len(), 3]), device)
    }

    /// Content, style and contrastive loss of a stylized picture `[H * W, 3]`.
    fn perceptual(&self, picture: Tensor<2>, network: &LossNetwork, content_layers: &[usize]) -> Perceptual {
        let Self { view, content, style, others, .. } = *self;
        let features = network.features(picture, view.size());
        let zero: Tensor<1> = Tensor::zeros([1], network.device());
        let mut content_loss = zero.clone();
        for ((&layer, target), coverage) in
            content_layers.iter().zip(&content.features).zip(&content.coverage)
        {
            let squares = (features[layer].rows.clone() - target.clone()).powi_scalar(2) * coverage.clone();
            content_loss = content_loss + squares.mean();
        }
        let mut style_loss = zero;
        let mut errors: Tensor<2> = Tensor::zeros([1 + others.len(), 1], network.device());
        // All tensors here are `[2, D]`: means, then deviations.
        let targets = style.targets.iter().zip(&content.style_coverage);
        for (layer, (features, (target, coverage))) in features.into_iter().zip(targets).enumerate() {
            let found = row_statistics(features.rows, coverage);
            // Twice: the mean squares of means and of deviations are to be added, not averaged.
            style_loss = style_loss + (found.clone() - target.clone()).powi_scalar(2).mean() * 2.0;
            if !others.is_empty() {
                let n_statistics = found.shape().num_elements();
                let row = |target: &Tensor<2>| target.clone().reshape([1, n_statistics]);
                // The painting itself first: the cross-entropy below takes row 0 as the right answer.
                let all = std::iter::once(style).chain(others.iter().copied());
                let all = Tensor::cat(all.map(|style| row(&style.targets[layer])).collect(), 0);
                errors = errors + (all - row(&found)).powi_scalar(2).mean_dim(1) * 2.0;
            }
        }
        // Row 0 is the painting itself.
        let cross_entropy = || -log_softmax(errors / -TEMPERATURE, 0).narrow(0, 0, 1).reshape([1]);
        let contrastive = (!others.is_empty()).then(cross_entropy);
        Perceptual { content: content_loss, style: style_loss, contrastive }
    }

    /// Mean distance of a premultiplied picture `[H * W, 3]` from the recolored view, over whole squares of
    /// [`SQUARE`] pixels, or over the whole picture if it is smaller.
    fn color_transfer(&self, splats: Tensor<2>) -> Tensor<1> {
        let Self { scene, view, style, .. } = self;
        let [width, height] = view.size();
        let recoloring = Recoloring::new(&scene.colors, &style.colors);
        // Premultiplied: the range of a display ends at alpha.
        let recolored = view.picture.chunks_exact(3).zip(&view.alpha).flat_map(|(c, alpha)| {
            recoloring.premultiplied([c[0], c[1], c[2]], *alpha).map(|channel| channel.clamp(0.0, *alpha))
        });
        let recolored = TensorData::new(recolored.collect::<Vec<_>>(), [width * height, 3]);
        let difference = splats.clone() - Tensor::from_data(recolored, &splats.device());
        let [side_x, side_y] = [SQUARE.min(width), SQUARE.min(height)];
        let [columns, rows] = [width / side_x, height / side_y];
        // Cut to whole squares, then two means: over the lines of a square, then over its columns. Rows are H,
        // W, 3, so a square's columns and its colors are side by side.
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
}

/// The losses that VGG-19 sees.
struct Perceptual {
    content: Tensor<1>,
    style: Tensor<1>,
    /// `None` without other paintings.
    contrastive: Option<Tensor<1>>,
}

/// Mean squared excess of decoded colors `[N, 3]` over 0..`share`, the decoder's part of the range 0..1. It is
/// measured before smoothing: otherwise the decoder would exaggerate to make up for the smoothing.
fn range_loss(decoded: &Tensor<2>, share: f32) -> Tensor<1> {
    // Only one of the two is above 0.
    let excess = relu(decoded.clone() - share) + relu(-decoded.clone());
    excess.powi_scalar(2).mean()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_total_weighs_what_is_switched_on() {
        let weights =
            LossWeights { style: 10.0, range: 2.0, color_transfer: 3.0, roughness: 5.0, contrastive: 7.0 };
        let paper = Losses {
            content: 1.0,
            style: 0.5,
            range: 0.25,
            color_transfer: None,
            roughness: None,
            contrastive: None,
        };
        assert_eq!(paper.total(&weights), 1.0 + 5.0 + 0.5);
        assert_eq!(paper.total(&LossWeights::default()), 6.0);
        let all = Losses { color_transfer: Some(1.0), roughness: Some(0.5), contrastive: Some(2.0), ..paper };
        assert_eq!(all.total(&weights), 6.5 + 3.0 + 2.5 + 14.0);
    }
}
