//! The aim of a bake: the paintings as the loss network sees them.

use rayon::prelude::*;
use stylegaussian::{palette::Palette, random::Random, recolor::ColorMoments};
use stylegaussian_encoder::{Image, StyleSize};

use crate::{
    error::BakeError,
    loss::{
        matching::normalized,
        shapes,
        statistics::{Moments, Target},
    },
    luminance::{Tone, color_line},
    network::{LossNetwork, Size},
};

/// Pixels of all paintings from which colors are taken.
const N_COLORS: usize = 100_000;

/// A layer of all paintings.
pub(crate) struct LayerTarget {
    /// Means and deviations, mixed by weight.
    pub statistics: Target,
    /// Rows of length 1 of each painting `[cells, C]`; empty if the layer is not matched.
    rows: Vec<Vec<f32>>,
    channels: usize,
}

/// The paintings.
pub(crate) struct Paintings {
    /// One for each layer of the network, of the paintings in color and as gray.
    layers: [Vec<LayerTarget>; 2],
    /// The luminance that is stretched to the common mean and deviation.
    pub tone: Tone,
    /// The change of color that goes with luminance.
    pub line: [f32; 3],
    pub palette: Palette,
    /// Moments of the colors.
    pub colors: ColorMoments,
    /// The mean color.
    pub mean: [f32; 3],
    /// The contrast between large shapes.
    pub shapes: f32,
    /// Weights, which sum to 1.
    shares: Vec<f32>,
}

impl Paintings {
    /// Looks at paintings with weights above 0 at about `side` x `side` pixels.
    pub fn new(paintings: &[(Image, f32)], side: u32, network: &LossNetwork) -> Result<Self, BakeError> {
        let used: Vec<&(Image, f32)> = paintings.iter().filter(|(_, weight)| *weight > 0.0).collect();
        if used.is_empty() || used.iter().any(|(_, weight)| !weight.is_finite()) {
            return Err(BakeError::NoPainting { found: used.len() });
        }
        let total: f64 = used.iter().map(|(_, weight)| f64::from(*weight)).sum();
        let shares: Vec<f32> = used.iter().map(|(_, weight)| (f64::from(*weight) / total) as f32).collect();
        let images = used.iter().map(|(image, _)| prepared(image, side)).collect::<Result<Vec<_>, _>>()?;
        let colors = colors(&images, &shares);
        let mean = |channel: usize| {
            let sum: f64 = colors.iter().skip(channel).step_by(3).map(|value| f64::from(*value)).sum();
            (sum / (colors.len() / 3) as f64) as f32
        };
        let of_shapes = |image: &Image| shapes::of_picture(&image.rgb, image.width as usize);
        let of_shapes = images
            .iter()
            .zip(&shares)
            .map(|(image, share)| share * shapes::contrast([of_shapes(image)].into_iter()))
            .sum();
        let mut layers = [Vec::new(), Vec::new()];
        let tone = Tone::of(&colors, 0..colors.len() / 3);
        for (image, share) in images.into_iter().zip(&shares) {
            let gray = Image { rgb: tone.gray(&image.rgb), ..image.clone() };
            add_painting(&mut layers[0], &image, *share, network);
            add_painting(&mut layers[1], &gray, *share, network);
        }
        // Ten pixels of a hundred thousand: specks of dust are no color of the painting's.
        let palette = Palette::new(&colors, 10);
        let moments = ColorMoments::of_rgb(&colors);
        let mean = [mean(0), mean(1), mean(2)];
        Ok(Self {
            layers,
            tone,
            line: color_line(&colors),
            palette,
            colors: moments,
            mean,
            shapes: of_shapes,
            shares,
        })
    }

    /// The aim of each layer, in color or as gray.
    pub fn layers(&self, gray: bool) -> &[LayerTarget] {
        &self.layers[usize::from(gray)]
    }

    /// `n` random rows of a layer `[n, C]`, of each painting by its weight.
    pub fn keys(&self, layer: &LayerTarget, n: usize, random: &mut Random) -> Vec<f32> {
        let LayerTarget { rows, channels, .. } = layer;
        let mut keys = Vec::with_capacity(n * channels);
        for (rows, share) in rows.iter().zip(&self.shares) {
            let n_rows = rows.len() / channels;
            let wanted = ((share * n as f32).ceil() as usize).min(n_rows);
            for _ in 0..wanted {
                keys.extend_from_slice(&rows[random.below(n_rows) * channels..][..*channels]);
            }
        }
        keys
    }
}

/// The painting at the size at which it is compared.
fn prepared(image: &Image, side: u32) -> Result<Image, BakeError> {
    let (width, height) = (image.width, image.height);
    let n_values = width as usize * height as usize * 3;
    let broken = |found: String| BakeError::Painting { width, height, found };
    if n_values == 0 || image.rgb.len() != n_values {
        return Err(broken(format!("{} values", image.rgb.len())));
    }
    if let Some(value) = image.rgb.iter().find(|value| !value.is_finite()) {
        return Err(broken(format!("the value {value}")));
    }
    let image = StyleSize::Area(side * side).resize(image);
    // So small a picture has no strokes, but each layer needs cells: two along each side at an eighth of the size, since
    // windows see the border as in a mirror.
    let least = |side: u32| side.max(16);
    Ok(image.resized(least(image.width), least(image.height)))
}

/// Pixels of the paintings by weight `[n, 3]`.
fn colors(images: &[Image], shares: &[f32]) -> Vec<f32> {
    let mut colors = Vec::new();
    for (image, share) in images.iter().zip(shares) {
        let n = image.rgb.len() / 3;
        let wanted = (share * N_COLORS as f32).ceil() as usize;
        for i in 0..wanted {
            colors.extend_from_slice(&image.rgb[i * n / wanted * 3..][..3]);
        }
    }
    colors
}

fn add_painting(layers: &mut Vec<LayerTarget>, image: &Image, share: f32, network: &LossNetwork) {
    let size = Size { width: image.width as usize, height: image.height as usize };
    let features = network.forward(&network.grids(size, false), &image.rgb);
    let of_layer: Vec<(Target, Vec<f32>, usize)> = network
        .layers()
        .par_iter()
        .map(|layer| {
            let rows = features.rows(layer);
            let moments = Moments::of(rows, layer.channels, 0..rows.len() / layer.channels);
            let deviation = moments.deviations();
            let keys = if layer.matching > 0.0 { normalized(rows, layer.channels) } else { Vec::new() };
            (Target { mean: moments.mean, deviation }, keys, layer.channels)
        })
        .collect();
    if layers.is_empty() {
        let empty = |(_, _, channels): &(Target, Vec<f32>, usize)| LayerTarget {
            statistics: Target { mean: vec![0.0; *channels], deviation: vec![0.0; *channels] },
            rows: Vec::new(),
            channels: *channels,
        };
        layers.extend(of_layer.iter().map(empty));
    }
    for (layer, (target, keys, _)) in layers.iter_mut().zip(of_layer) {
        let Target { mean, deviation } = &mut layer.statistics;
        mean.iter_mut().zip(target.mean).for_each(|(sum, value)| *sum += share * value);
        deviation.iter_mut().zip(target.deviation).for_each(|(sum, value)| *sum += share * value);
        layer.rows.push(keys);
    }
}
