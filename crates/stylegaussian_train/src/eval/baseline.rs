//! The 2D baseline: AdaIN on each view's own feature map, painted by a 2D decoder. It shows how strong a style
//! AdaIN can give if views need not agree.

use stylegaussian::{
    ChannelStatistics,
    fold::ChannelMap,
    splat::RenderedImage,
    statistics::{ContentStatistics, STD_DEV_EPSILON},
};
use stylegaussian_encoder::{Encoder, FeatureMap, Image};

use super::image_decoder::ImageDecoder;
use crate::{error::TrainError, nn::coverage::coverage_of_cells};

/// The feature maps of the unstyled views.
pub struct Baseline<'a> {
    decoder: &'a ImageDecoder,
    maps: Vec<FeatureMap>,
    /// Over all views, so that a style has the same effect in each.
    statistics: ContentStatistics,
}

impl<'a> Baseline<'a> {
    /// Encodes views over mid-gray.
    ///
    /// # Errors
    /// If the encoder fails.
    pub fn new(
        decoder: &'a ImageDecoder,
        encoder: &Encoder,
        views: &[RenderedImage],
    ) -> Result<Self, TrainError> {
        let encode = |view: &RenderedImage| {
            let pixels = view.color.iter().zip(&view.alpha);
            let rgb = pixels.flat_map(|(color, alpha)| color.map(|c| c + (1.0 - alpha) * 0.5)).collect();
            encoder.encode(&Image { width: view.size.x, height: view.size.y, rgb, alpha: None })
        };
        let maps = views.iter().map(encode).collect::<Result<Vec<FeatureMap>, _>>()?;
        let covered = maps.iter().zip(views).flat_map(|(map, view)| {
            let cells = [map.width as usize, map.height as usize];
            let coverage =
                coverage_of_cells(&view.alpha, [view.size.x as usize, view.size.y as usize], cells);
            map.values.chunks_exact(map.n_channels).zip(coverage)
        });
        let rows: Vec<&[f32]> = covered.filter(|(_, alpha)| *alpha > 0.5).map(|(row, _)| row).collect();
        Ok(Self { decoder, statistics: statistics_of(&rows, encoder.n_channels()), maps })
    }

    /// View `index` in a style, as it looks over mid-gray.
    ///
    /// # Errors
    /// If the style belongs to other features, or the decoder fails.
    pub fn paint(
        &self,
        index: usize,
        view: &RenderedImage,
        style: &ChannelStatistics,
    ) -> Result<RenderedImage, TrainError> {
        let map = ChannelMap::adain(&self.statistics, style)?;
        let mut features = self.maps[index].clone();
        for row in features.values.chunks_exact_mut(map.gain.len()) {
            for ((value, gain), shift) in row.iter_mut().zip(&map.gain).zip(&map.shift) {
                // Features after a ReLU are never below 0, and the decoder was trained on no others.
                *value = ((gain * f64::from(*value) + shift) as f32).max(0.0);
            }
        }
        // The features' size was rounded up, so the painted picture can be larger by up to three pixels.
        let painted = self.decoder.decode(&features)?.resized(view.size.x, view.size.y);
        let pixels = painted.rgb.chunks_exact(3).zip(&view.alpha);
        let color = pixels.map(|(c, alpha)| [c[0] * alpha, c[1] * alpha, c[2] * alpha]).collect();
        Ok(RenderedImage { color, ..view.clone() })
    }
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
