//! The decoder that a training starts from: a new one with random weights, or a changed copy of a trained one.

use std::path::{Path, PathBuf};

use stylegaussian::{Activation, Decoder, EncoderId, Layer, random::Random};
use stylegaussian_files::read_decoder;

use super::config::NewDecoder;
use crate::error::{TrainError, ensure};

impl NewDecoder {
    /// A decoder with He-normal weights for the activation, and zero biases except for the last layer's, which
    /// give mid-gray.
    pub(super) fn with_random_weights(
        self,
        n_channels: usize,
        n_extra: usize,
        encoder: Option<EncoderId>,
        seed: u64,
    ) -> Decoder {
        let Self { k, activation, residual, base_color, n_noise, smoothing_passes, .. } = self;
        let n_statistics = if self.statistics { 2 * n_channels } else { 0 };
        let mut random = Random::new(seed);
        let mut d_in = n_channels + n_extra + n_noise + if base_color { 3 } else { 0 };
        let mut layers = Vec::new();
        for (i, d_out) in Decoder::WIDTHS.into_iter().enumerate() {
            let is_last = i + 1 == Decoder::WIDTHS.len();
            // A sum of k d_in products of unit variance has deviation sqrt(k d_in).
            let deviation = gain(activation, i, is_last) / ((k * d_in) as f32).sqrt();
            let weight: Vec<f32> = (0..d_out * k * d_in).map(|_| deviation * random.normal()).collect();
            let center = |row: &[f32]| match activation {
                // A sigmoid's outputs have mean 1/2: the bias takes that part away.
                Activation::Sigmoid if i > 0 => -0.5 * row.iter().sum::<f32>(),
                _ => 0.0,
            };
            let mut bias: Vec<f32> = weight.chunks_exact(k * d_in).map(center).collect();
            if is_last {
                // The residual's share of the base color gives the rest of the gray on average.
                bias.iter_mut().for_each(|b| *b += 0.5 * (1.0 - residual));
            }
            layers.push(Layer { weight, bias, d_in, d_out });
            d_in = d_out;
        }
        // Statistics have no influence before anything is learned about them.
        let statistics_weight = vec![0.0; Decoder::WIDTHS[0] * n_statistics];
        Decoder {
            layers,
            k,
            activation,
            residual,
            base_color,
            n_noise,
            smoothing_passes,
            statistics_weight,
            encoder,
        }
    }
}

/// The factor on a layer's He-normal weights.
fn gain(activation: Activation, layer: usize, is_last: bool) -> f32 {
    if is_last {
        // Small, so that the first pictures are near the bias' gray, in the range of a display.
        return 0.1;
    }
    if layer == 0 {
        return 1.0;
    }
    match activation {
        // A unit-normal input leaves the sigmoid with deviation 0.21.
        Activation::Sigmoid => 1.0 / 0.21,
        // He et al. 2015: a normal input keeps (1 + slope^2) / 2 of its mean square.
        Activation::LeakyRelu { slope } => (2.0 / (1.0 + slope * slope)).sqrt(),
    }
}

/// Changes to a trained decoder before it is trained further. `None` keeps the decoder's value.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DecoderChanges {
    /// Smoothing passes.
    pub smoothing_passes: Option<usize>,
    /// The share of the base color, at least 0 and less than 1. The last layer is scaled to give the rest.
    pub residual: Option<f32>,
    /// Number of noise inputs. If it is smaller than the decoder's, the last ones are dropped.
    pub n_noise: Option<usize>,
}

impl DecoderChanges {
    /// Changes `decoder`, which `name` names in errors.
    ///
    /// # Errors
    /// If more noise inputs are asked for than the decoder has.
    pub fn apply(self, decoder: &mut Decoder, name: &str) -> Result<(), TrainError> {
        decoder.smoothing_passes = self.smoothing_passes.unwrap_or(decoder.smoothing_passes);
        if let Some(residual) = self.residual {
            set_residual(decoder, residual);
        }
        if let Some(n) = self.n_noise {
            let found = decoder.n_noise;
            ensure!(n <= found, "{name}: sees {found} channels of noise, expected {n} at least");
            drop_noise(decoder, n);
        }
        Ok(())
    }
}

/// The weighted mean of the parameters of decoders of one kind. A decoder between two states of one training
/// can be better than both.
///
/// # Errors
/// If a file cannot be read, the decoders differ in more than their parameters, or no weight is positive.
pub fn mean_decoder(files: &[(PathBuf, f64)]) -> Result<Decoder, TrainError> {
    let total: f64 = files.iter().map(|(_, weight)| weight).sum();
    ensure!(total > 0.0, "found no decoder with a weight above 0, expected at least one");
    let mut mean: Option<(Decoder, &Path)> = None;
    for (path, weight) in files {
        let mut decoder = read_decoder(path)?;
        let share = (weight / total) as f32;
        // Scaled before it is compared: the comparison leaves out parameters.
        parameters(&mut decoder).into_iter().flatten().for_each(|value| *value *= share);
        let Some((sum, first)) = &mut mean else {
            mean = Some((decoder, path));
            continue;
        };
        ensure!(
            is_alike(sum, &decoder),
            "{}: found a decoder unlike {}, expected one of its kind",
            path.display(),
            first.display()
        );
        for (sum, values) in parameters(sum).into_iter().zip(parameters(&mut decoder)) {
            sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += *value);
        }
    }
    let nothing = || TrainError::Invalid("found no decoder, expected at least one".into());
    mean.map(|(decoder, _)| decoder).ok_or_else(nothing)
}

/// Everything that is trained, in one order.
fn parameters(decoder: &mut Decoder) -> Vec<&mut Vec<f32>> {
    let layers = decoder.layers.iter_mut().flat_map(|layer| [&mut layer.weight, &mut layer.bias]);
    layers.chain(std::iter::once(&mut decoder.statistics_weight)).collect()
}

/// Whether two decoders differ only in their parameters.
fn is_alike(a: &Decoder, b: &Decoder) -> bool {
    let widths = |decoder: &Decoder| -> Vec<_> {
        decoder.layers.iter().map(|layer| (layer.d_in, layer.d_out)).collect()
    };
    let kind =
        |decoder: &Decoder| Decoder { layers: Vec::new(), statistics_weight: Vec::new(), ..decoder.clone() };
    widths(a) == widths(b) && a.statistics_weight.len() == b.statistics_weight.len() && kind(a) == kind(b)
}

/// Makes `residual` the share of the base color, and scales the last layer to give the rest.
fn set_residual(decoder: &mut Decoder, residual: f32) {
    let factor = (1.0 - residual) / (1.0 - decoder.residual);
    // A decoder with residual 1 has no share to scale. `Network::new` refuses it later, with a message.
    if let Some(last) = decoder.layers.last_mut().filter(|_| factor.is_finite()) {
        last.weight.iter_mut().chain(&mut last.bias).for_each(|value| *value *= factor);
        decoder.residual = residual;
    }
}

/// Drops all noise inputs but `n`. They are the first layer's last inputs, before the base color.
fn drop_noise(decoder: &mut Decoder, n: usize) {
    let after = if decoder.base_color { 3 } else { 0 };
    let n_dropped = decoder.n_noise - n;
    let Some(first) = decoder.layers.first_mut() else { return };
    // A neighbor's inputs in order: features, extra, noise, base color.
    let kept = first.d_in - after - n_dropped;
    let without = |row: &[f32]| [&row[..kept], &row[kept + n_dropped..]].concat();
    first.weight = first.weight.chunks_exact(first.d_in).flat_map(without).collect();
    first.d_in -= n_dropped;
    decoder.n_noise = n;
}
