//! VGG-19 as a judge of pictures: style errors, texture, and content errors.

use std::{path::Path, sync::Arc};

use burn::tensor::Device;
use stylegaussian::splat::RenderedImage;
use stylegaussian_encoder::{Image, StyleSize};

use super::{
    nearest_features::Directions,
    report::Measures,
    texture::{covered, grain, luminance, whole_cells},
};
use crate::{
    error::TrainError,
    nn::{
        coverage::{coverage_of_cells, shares},
        loss_network::{FeatureRows, LossNetwork, RELU3_1, picture_tensor},
        ops::row_statistics,
        parameter::to_vec,
    },
};

#[cfg(test)]
mod tests;

/// Channel means, then deviations, at each of VGG's layers.
pub type Statistics = Vec<Vec<f32>>;

/// VGG-19 as a judge of pictures.
pub struct Judge {
    pub(super) network: LossNetwork,
    whole_picture: bool,
}

/// A painting that pictures are compared with.
pub struct Target {
    statistics: Statistics,
    /// Statistics of its luminance, up to relu3_1.
    texture: Statistics,
    grain: f64,
    /// At relu2_1 and relu3_1.
    directions: [Directions; 2],
}

/// Features and statistics of a picture.
pub struct Look {
    statistics: Statistics,
    /// Statistics of its luminance, up to relu3_1.
    texture: Statistics,
    grain: f64,
    /// At relu2_1 and relu3_1.
    directions: [Directions; 2],
    /// relu3_1 `[h * w, D]`, and the coverage of its cells, summing to 1.
    content: Vec<f32>,
    coverage: Vec<f32>,
}

/// Index of relu2_1 in the layers; relu3_1 follows.
const RELU2_1: usize = RELU3_1 - 1;

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

    /// A painting, at the size at which AdaIN sees it.
    ///
    /// # Errors
    /// If the device fails.
    pub(super) fn painting(&self, image: &Image) -> Result<Target, TrainError> {
        let image = StyleSize::default().resize(image);
        let size = [image.width as usize, image.height as usize];
        let maps = self.features(&image.rgb, size);
        let directions = |map: &FeatureRows| -> Result<_, TrainError> {
            Ok(Directions::of_painting(&to_vec(&map.rows)?, map.size[0] * map.size[1]))
        };
        let all = vec![true; size[0] * size[1]];
        Ok(Target {
            directions: [directions(&maps[RELU2_1])?, directions(&maps[RELU3_1])?],
            statistics: maps.iter().map(|map| to_vec(&map.statistics())).collect::<Result<_, _>>()?,
            texture: self.texture(&image.rgb, &all, size)?,
            grain: grain(&image.rgb, &all, size),
        })
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
        let counts = match self.whole_picture {
            true => vec![true; view.alpha.len()],
            false => covered(&view.alpha),
        };
        let maps = self.features(&rgb, size);
        let directions = |layer: usize| -> Result<_, TrainError> {
            let FeatureRows { rows, size: cells } = &maps[layer];
            Ok(Directions::of_picture(&to_vec(rows)?, &whole_cells(&counts, size, 1 << layer, *cells)))
        };
        let mut look = Look {
            statistics: Vec::new(),
            texture: self.texture(&rgb, &counts, size)?,
            grain: grain(&rgb, &counts, size),
            directions: [directions(RELU2_1)?, directions(RELU3_1)?],
            content: Vec::new(),
            coverage: Vec::new(),
        };
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

    /// Features of a picture `[H * W * 3]` at each layer.
    fn features(&self, rgb: &[f32], size: [usize; 2]) -> Vec<FeatureRows> {
        self.network.features(picture_tensor(rgb, self.network.device()), size)
    }

    /// Statistics of a picture's luminance up to relu3_1, over the cells that see only pixels that count.
    fn texture(&self, rgb: &[f32], counts: &[bool], size: [usize; 2]) -> Result<Statistics, TrainError> {
        let gray = picture_tensor(&luminance(rgb, counts), self.network.device());
        let statistics = |(layer, map): (usize, FeatureRows)| {
            let whole = whole_cells(counts, size, 1 << layer, map.size);
            let whole: Vec<f32> = whole.into_iter().map(|whole| f32::from(u8::from(whole))).collect();
            to_vec(&row_statistics(map.rows, &Arc::new(shares(&whole))))
        };
        self.network
            .features_to_relu3_1(gray, size)
            .into_iter()
            .take(RELU3_1 + 1)
            .enumerate()
            .map(statistics)
            .collect()
    }
}

impl Look {
    /// Errors of this picture against the painting `own` among all, and against the unstyled view `before`.
    pub fn measures(&self, before: &Self, targets: &[Target], own: usize) -> Measures {
        let target = &targets[own];
        let style_errors = style_errors(&self.statistics, &target.statistics);
        let relu4_1 = self.statistics.get(RELU3_1 + 1).zip(target.statistics.get(RELU3_1 + 1));
        let by_color = rank(&self.statistics, targets.iter().map(|target| &target.statistics), own);
        let by_texture = rank(&self.texture, targets.iter().map(|target| &target.texture), own);
        let is_first = |rank: usize| f64::from(u8::from(rank == 1));
        Measures {
            own_painting_nearest: is_first(by_color),
            style_error: style_errors.iter().sum(),
            style_errors,
            relu4_1_style_error: relu4_1.map(|(found, target)| layer_error(found, target)),
            texture_own_painting_nearest: is_first(by_texture),
            texture_rank: by_texture as f64,
            texture_error: sum(&self::style_errors(&self.texture, &target.texture)),
            nearest_feature_distances: [0, 1].map(|i| self.directions[i].distance_to(&target.directions[i])),
            grain: self.grain / target.grain.max(f64::MIN_POSITIVE),
            content_error: self.content_error(before),
        }
    }

    /// Mean squared distance of relu3_1 from another picture of the same view, weighted by the scene's
    /// coverage.
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

/// The rank of `own` if the paintings are sorted by their style error to `found`: 1 if it is the nearest. Of
/// equal ones the first comes first.
fn rank<'a>(found: &Statistics, targets: impl Iterator<Item = &'a Statistics>, own: usize) -> usize {
    let errors: Vec<f64> = targets.map(|target| sum(&style_errors(found, target))).collect();
    let is_nearer = |i: usize| errors[i] < errors[own] || (errors[i] == errors[own] && i < own);
    1 + (0..errors.len()).filter(|&i| is_nearer(i)).count()
}

/// The style error between one of `targets` and the most similar other one.
pub fn nearest_other(targets: &[Target], own: usize) -> f64 {
    let others = targets.iter().enumerate().filter(|(i, _)| *i != own);
    let error = |other: &Target| sum(&style_errors(&targets[own].statistics, &other.statistics));
    others.map(|(_, other)| error(other)).fold(f64::INFINITY, f64::min)
}

fn sum(errors: &[f64]) -> f64 {
    errors.iter().sum()
}
