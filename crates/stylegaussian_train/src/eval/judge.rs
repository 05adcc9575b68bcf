//! VGG-19 as a judge of pictures: style errors and content errors.

use std::{path::Path, sync::Arc};

use burn::tensor::Device;
use stylegaussian::splat::RenderedImage;
use stylegaussian_encoder::{Image, StyleSize};

use super::report::Measures;
use crate::{
    error::TrainError,
    nn::{
        coverage::{coverage_of_cells, shares},
        loss_network::{LossNetwork, RELU3_1, picture_tensor},
        ops::row_statistics,
        parameter::to_vec,
    },
};

/// Channel means, then deviations, at each of VGG's layers.
pub type Statistics = Vec<Vec<f32>>;

/// VGG-19 as a judge of pictures.
pub struct Judge {
    pub(super) network: LossNetwork,
    whole_picture: bool,
}

/// Features and statistics of a picture.
pub struct Look {
    statistics: Statistics,
    /// relu3_1 `[h * w, D]`, and the coverage of its cells, summing to 1.
    content: Vec<f32>,
    coverage: Vec<f32>,
}

impl Judge {
    /// VGG-19 from `weights`, with a substitute for relu4_1 if one is given. If `whole_picture` is set, pixels
    /// without scene count too.
    ///
    /// # Errors
    /// If the weights cannot be read.
    pub fn open(weights: &Path, relu4: Option<&Path>, whole_picture: bool) -> Result<Self, TrainError> {
        // Nothing is trained here, so the device need not record gradients.
        Ok(Self { network: LossNetwork::open_on(weights, relu4, &Device::flex())?, whole_picture })
    }

    /// Statistics of a painting, at the size at which AdaIN sees it.
    ///
    /// # Errors
    /// If the device fails.
    pub(super) fn painting(&self, image: &Image) -> Result<Statistics, TrainError> {
        let image = StyleSize::default().resize(image);
        let size = [image.width as usize, image.height as usize];
        let maps = self.network.features(picture_tensor(&image.rgb, self.network.device()), size);
        maps.iter().map(|map| to_vec(&map.statistics())).collect()
    }

    /// Features and statistics of a view as a display shows it, over mid-gray.
    ///
    /// # Errors
    /// If the device fails.
    pub(super) fn look(&self, view: &RenderedImage) -> Result<Look, TrainError> {
        let size = [view.size.x as usize, view.size.y as usize];
        let pixels = view.color.iter().zip(&view.alpha);
        let rgb: Vec<f32> =
            pixels.flat_map(|(color, a)| color.map(|c| (c + (1.0 - a) * 0.5).clamp(0.0, 1.0))).collect();
        let maps = self.network.features(picture_tensor(&rgb, self.network.device()), size);
        let mut look = Look { statistics: Vec::new(), content: Vec::new(), coverage: Vec::new() };
        for (layer, map) in maps.into_iter().enumerate() {
            let coverage = Arc::new(shares(&coverage_of_cells(&view.alpha, size, map.size)));
            look.statistics.push(match self.whole_picture {
                true => to_vec(&map.statistics())?,
                false => to_vec(&row_statistics(map.rows.clone(), &coverage))?,
            });
            if layer == RELU3_1 {
                look.content = to_vec(&map.rows)?;
                look.coverage = coverage.to_vec();
            }
        }
        Ok(look)
    }
}

impl Look {
    /// Errors of this picture against the painting `own` among all, and against the unstyled view `before`.
    pub fn measures(&self, before: &Self, targets: &[Statistics], own: usize) -> Measures {
        let style_errors = style_errors(&self.statistics, &targets[own]);
        let relu4_1 = self.statistics.get(RELU3_1 + 1).zip(targets[own].get(RELU3_1 + 1));
        Measures {
            own_painting_nearest: f64::from(u8::from(nearest_target(self, targets) == Some(own))),
            style_error: style_errors.iter().sum(),
            style_errors,
            relu4_1_style_error: relu4_1.map(|(found, target)| layer_error(found, target)),
            content_error: self.content_error(before),
        }
    }

    /// Mean squared distance of relu3_1 from another picture of the same view, weighted by the scene's coverage.
    fn content_error(&self, other: &Self) -> f64 {
        let n_channels = self.content.len() / self.coverage.len().max(1);
        let cell = |((a, b), share): ((&[f32], &[f32]), &f32)| -> f64 {
            let squares = a.iter().zip(b).map(|(a, b)| f64::from((a - b) * (a - b)));
            f64::from(*share) * squares.sum::<f64>() / n_channels as f64
        };
        let cells =
            self.content.chunks_exact(n_channels.max(1)).zip(other.content.chunks_exact(n_channels.max(1)));
        cells.zip(&self.coverage).map(cell).sum()
    }
}

/// The mean over channels of the squared distances of mean and of deviation, at relu1_1, relu2_1 and relu3_1.
fn style_errors(found: &Statistics, target: &Statistics) -> [f64; 3] {
    [0, 1, 2].map(|i| layer_error(&found[i], &target[i]))
}

fn layer_error(found: &[f32], target: &[f32]) -> f64 {
    let squares = found.iter().zip(target).map(|(a, b)| f64::from((a - b) * (a - b)));
    squares.sum::<f64>() / (found.len() / 2) as f64
}

/// The painting with the nearest statistics.
fn nearest_target(look: &Look, targets: &[Statistics]) -> Option<usize> {
    let error = |target| sum(&style_errors(&look.statistics, target));
    (0..targets.len()).min_by(|&a, &b| error(&targets[a]).total_cmp(&error(&targets[b])))
}

/// The style error between one of `targets` and the most similar other one.
pub fn nearest_other(targets: &[Statistics], own: usize) -> f64 {
    let others = targets.iter().enumerate().filter(|(i, _)| *i != own);
    others.map(|(_, other)| sum(&style_errors(&targets[own], other))).fold(f64::INFINITY, f64::min)
}

fn sum(errors: &[f64]) -> f64 {
    errors.iter().sum()
}
