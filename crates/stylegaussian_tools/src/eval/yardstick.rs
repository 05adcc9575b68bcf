//! AdaIN on each view's own feature map, painted by a 2D decoder: how strong a style AdaIN can give where nothing has to
//! agree between views.

use anyhow::Result;
use stylegaussian::{
    ChannelStatistics,
    fold::ChannelMap,
    splat::RenderedImage,
    statistics::{ContentStatistics, STD_DEV_EPSILON},
};
use stylegaussian_encoder::{Encoder, FeatureMap, Image};

use crate::{teacher::Teacher, train::step::coverage_of_cells};

/// The unstyled views as the 2D method sees them.
pub struct Yardstick {
    teacher: Teacher,
    maps: Vec<FeatureMap>,
    /// Over all views, so that a style means the same in each.
    statistics: ContentStatistics,
}

impl Yardstick {
    /// Encodes views over mid-gray.
    ///
    /// # Errors
    /// When the encoder fails.
    pub fn new(teacher: Teacher, encoder: &Encoder, views: &[RenderedImage]) -> Result<Self> {
        let encode = |view: &RenderedImage| {
            let pixels = view.color.iter().zip(&view.alpha);
            let rgb = pixels.flat_map(|(color, alpha)| color.map(|c| c + (1.0 - alpha) * 0.5)).collect();
            Ok(encoder.encode(&Image { width: view.size.x, height: view.size.y, rgb })?)
        };
        let maps = views.iter().map(encode).collect::<Result<Vec<FeatureMap>>>()?;
        let covered = maps.iter().zip(views).flat_map(|(map, view)| {
            let cells = [map.width as usize, map.height as usize];
            let coverage =
                coverage_of_cells(&view.alpha, [view.size.x as usize, view.size.y as usize], cells);
            map.values.chunks_exact(map.n_channels).zip(coverage)
        });
        let rows: Vec<&[f32]> = covered.filter(|(_, alpha)| *alpha > 0.5).map(|(row, _)| row).collect();
        Ok(Self { teacher, statistics: statistics_of(&rows, encoder.n_channels()), maps })
    }

    /// View `index` in a style, as it looks over mid-gray.
    ///
    /// # Errors
    /// When the style belongs to other features, or the decoder fails.
    pub fn paint(
        &self,
        index: usize,
        view: &RenderedImage,
        style: &ChannelStatistics,
    ) -> Result<RenderedImage> {
        let map = ChannelMap::adain(&self.statistics, style)?;
        let mut features = self.maps[index].clone();
        for row in features.values.chunks_exact_mut(map.gain.len()) {
            for ((value, gain), shift) in row.iter_mut().zip(&map.gain).zip(&map.shift) {
                // Rectified features are never below 0; the decoder has seen no others.
                *value = ((gain * f64::from(*value) + shift) as f32).max(0.0);
            }
        }
        let painted = self.teacher.decode(&features)?.resized(view.size.x, view.size.y);
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
