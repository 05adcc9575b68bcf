//! The aim of a bake: the paintings as the loss network sees them.

use rayon::prelude::*;
use stylegaussian::{
    palette::Palette,
    random::Random,
    recolor::ColorMoments,
    work::{Canceled, Work},
};
use stylegaussian_encoder::{Image, StyleSize};

use crate::{
    error::BakeError,
    loss::{
        matching::{Keys, some_of},
        shapes,
        statistics::{Moments, Target},
    },
    luminance::{Tone, color_line},
    network::{Layer, LossNetwork, Size},
};

/// Pixels of all paintings from which colors are taken.
const N_COLORS: usize = 100_000;

/// A layer of all paintings.
pub(crate) struct LayerTarget {
    /// Means and deviations, mixed by weight.
    pub statistics: Target,
    /// Cells with which a picture's are matched, of each painting by its weight; none if the layer is not
    /// matched.
    pub keys: Keys,
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
}

impl Paintings {
    /// Looks at paintings with weights above 0 at about `side` x `side` pixels, and takes `keys` random cells
    /// of each layer that is matched.
    ///
    /// # Errors
    /// If no painting can be used, or `work` is canceled.
    pub fn new(
        paintings: &[(Image, f32)],
        side: u32,
        keys: usize,
        random: &mut Random,
        network: &LossNetwork,
        work: &Work,
    ) -> Result<Self, BakeError> {
        let used: Vec<&(Image, f32)> = paintings.iter().filter(|(_, weight)| *weight > 0.0).collect();
        if used.is_empty() || used.iter().any(|(_, weight)| !weight.is_finite()) {
            return Err(BakeError::NoPainting { found: used.len() });
        }
        let total: f64 = used.iter().map(|(_, weight)| f64::from(*weight)).sum();
        let shares: Vec<f32> = used.iter().map(|(_, weight)| (f64::from(*weight) / total) as f32).collect();
        // Each is shrunk by a part of the work that tells no progress: their number and sizes differ.
        let at = work.part(0.0, 0.0);
        let images =
            used.iter().map(|(image, _)| prepared(image, side, &at)).collect::<Result<Vec<_>, _>>()?;
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
        let mut layers = [(); 2].map(|()| network.layers().iter().map(Sum::new).collect::<Vec<_>>());
        let tone = Tone::of(&colors, 0..colors.len() / 3);
        for (image, share) in images.into_iter().zip(&shares) {
            let gray = Image { rgb: tone.gray(&image.rgb), ..image.clone() };
            let n_keys = (share * keys as f32).ceil() as usize;
            for (layers, image) in layers.iter_mut().zip([&image, &gray]) {
                add_painting(layers, image, (*share, n_keys), random, network, work)?;
            }
        }
        // Ten pixels of a hundred thousand: fewer are specks of dust.
        let palette = Palette::new(&colors, 10);
        let moments = ColorMoments::of_rgb(&colors);
        let mean = [mean(0), mean(1), mean(2)];
        let layers = layers.map(|layers| layers.into_par_iter().map(Sum::target).collect());
        Ok(Self {
            layers,
            tone,
            line: color_line(&colors),
            palette,
            colors: moments,
            mean,
            shapes: of_shapes,
        })
    }

    /// The aim of each layer, in color or as gray.
    pub fn layers(&self, gray: bool) -> &[LayerTarget] {
        &self.layers[usize::from(gray)]
    }
}

/// The painting at the size at which it is compared.
fn prepared(image: &Image, side: u32, work: &Work) -> Result<Image, BakeError> {
    let (width, height) = (image.width, image.height);
    let n_values = width as usize * height as usize * 3;
    let broken = |found: String| BakeError::Painting { width, height, found };
    if n_values == 0 || image.rgb.len() != n_values {
        return Err(broken(format!("{} values", image.rgb.len())));
    }
    if let Some(value) = image.rgb.iter().find(|value| !value.is_finite()) {
        return Err(broken(format!("the value {value}")));
    }
    let image = StyleSize::Area(side * side).resize_if_wanted(image, work)?;
    // So small a picture has no strokes, but each layer needs cells: two along each side at an eighth of the
    // size, since windows see the border as in a mirror.
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

/// A layer of some of the paintings.
struct Sum {
    statistics: Target,
    keys: Vec<f32>,
}

impl Sum {
    fn new(layer: &Layer) -> Self {
        let zeros = vec![0.0; layer.channels];
        Self { statistics: Target { mean: zeros.clone(), deviation: zeros }, keys: Vec::new() }
    }

    fn target(self) -> LayerTarget {
        let channels = self.statistics.mean.len();
        LayerTarget { statistics: self.statistics, keys: Keys::new(self.keys, channels) }
    }
}

/// Adds `share` of a painting's statistics to the layers' aims, and `n_keys` of its cells; all, if it has no
/// more.
///
/// # Errors
/// If `work` is canceled.
fn add_painting(
    layers: &mut [Sum],
    image: &Image,
    (share, n_keys): (f32, usize),
    random: &mut Random,
    network: &LossNetwork,
    work: &Work,
) -> Result<(), Canceled> {
    let size = Size { width: image.width as usize, height: image.height as usize };
    let features = network.forward(&network.sizes(size), &image.rgb, work)?;
    // Random numbers are drawn in order, before the layers are shared out among threads.
    let mut chosen = |layer: &Layer| {
        let cells: Vec<u32> = (0..(features.rows(layer).len() / layer.channels) as u32).collect();
        if layer.matching > 0.0 { some_of(&cells, n_keys, random) } else { Vec::new() }
    };
    let chosen: Vec<(&Layer, Vec<u32>)> =
        network.layers().iter().map(|layer| (layer, chosen(layer))).collect();
    let of_layers: Vec<Sum> = chosen
        .into_par_iter()
        .map(|(layer, chosen)| {
            let (rows, n) = (features.rows(layer), layer.channels);
            let moments = Moments::of(rows, n, 0..rows.len() / n);
            let deviation = moments.deviations();
            let keys = chosen.iter().flat_map(|&cell| &rows[cell as usize * n..][..n]).copied().collect();
            Sum { statistics: Target { mean: moments.mean, deviation }, keys }
        })
        .collect();
    for (layer, added) in layers.iter_mut().zip(of_layers) {
        let Target { mean, deviation } = &mut layer.statistics;
        mean.iter_mut().zip(added.statistics.mean).for_each(|(sum, value)| *sum += share * value);
        deviation.iter_mut().zip(added.statistics.deviation).for_each(|(sum, value)| *sum += share * value);
        layer.keys.extend(added.keys);
    }
    Ok(())
}
