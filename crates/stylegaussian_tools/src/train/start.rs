//! The decoder that a training starts from.

use anyhow::{Result, bail, ensure};
use stylegaussian::{Decoder, file};
use stylegaussian_encoder::Encoder;

use super::{args::TrainArgs, network::Network};
use crate::cli::WeightedPath;

/// What the arguments ask for: a random one for scenes of `n_extra` extra inputs, or those of `--init`, changed as told.
///
/// # Errors
/// Files that cannot be read or do not fit together, more noise than they see, another encoder.
pub fn decoder(arguments: &TrainArgs, encoder: &Encoder, n_extra: usize) -> Result<Decoder> {
    let Some(first) = arguments.init.first() else {
        let id = Some(encoder.id().clone());
        return Ok(Network::random(arguments, encoder.n_channels(), n_extra, id));
    };
    let path = first.path.display();
    let mut decoder = mean(&arguments.init)?;
    decoder.smoothing_passes = arguments.smooth.unwrap_or(decoder.smoothing_passes);
    if let Some(residual) = arguments.residual {
        set_residual(&mut decoder, residual);
    }
    if let Some(n) = arguments.noise {
        let found = decoder.n_noise;
        ensure!(n <= found, "{path}: sees {found} channels of noise, expected {n} at least");
        forget_noise(&mut decoder, n);
    }
    if let Some(found) = &decoder.encoder {
        ensure!(found == encoder.id(), "{path}: belongs to {found}, expected {}", encoder.id());
    }
    Ok(decoder)
}

/// The weighted mean of decoders, which differ in their parameters alone.
fn mean(paths: &[WeightedPath]) -> Result<Decoder> {
    let total: f64 = paths.iter().map(|one| one.weight).sum();
    ensure!(total > 0.0, "--init: found weights of 0, expected one of more at least");
    let mut mean: Option<Decoder> = None;
    for WeightedPath { path, weight } in paths {
        let mut decoder = file::read_decoder(path)?;
        let share = (weight / total) as f32;
        parameters(&mut decoder).into_iter().flatten().for_each(|value| *value *= share);
        let Some(sum) = &mut mean else {
            mean = Some(decoder);
            continue;
        };
        if !is_alike(sum, &decoder) {
            bail!(
                "{}: found a decoder unlike {}, expected one of its kind",
                path.display(),
                paths[0].path.display()
            );
        }
        for (sum, values) in parameters(sum).into_iter().zip(parameters(&mut decoder)) {
            sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += *value);
        }
    }
    mean.ok_or_else(|| anyhow::anyhow!("--init: found no decoder, expected one at least"))
}

/// Everything that is trained, in one order.
fn parameters(decoder: &mut Decoder) -> Vec<&mut Vec<f32>> {
    let layers = decoder.layers.iter_mut().flat_map(|layer| [&mut layer.weight, &mut layer.bias]);
    layers.chain(std::iter::once(&mut decoder.statistics_weight)).collect()
}

/// Whether two decoders differ in their parameters alone.
fn is_alike(a: &Decoder, b: &Decoder) -> bool {
    let widths = |decoder: &Decoder| -> Vec<_> {
        decoder.layers.iter().map(|layer| (layer.d_in, layer.d_out)).collect()
    };
    let kind =
        |decoder: &Decoder| Decoder { layers: Vec::new(), statistics_weight: Vec::new(), ..decoder.clone() };
    widths(a) == widths(b) && a.statistics_weight.len() == b.statistics_weight.len() && kind(a) == kind(b)
}

/// Makes `residual` the unstyled scene's share of the colors: the last layer gives what is left.
fn set_residual(decoder: &mut Decoder, residual: f32) {
    let factor = (1.0 - residual) / (1.0 - decoder.residual);
    if let Some(last) = decoder.layers.last_mut().filter(|_| factor.is_finite()) {
        last.weight.iter_mut().chain(&mut last.bias).for_each(|value| *value *= factor);
        decoder.residual = residual;
    }
}

/// Takes the inputs that are noise away, all but `n`: they are the first layer's last ones, but for the own color.
fn forget_noise(decoder: &mut Decoder, n: usize) {
    let after = if decoder.base_color { 3 } else { 0 };
    let n_forgotten = decoder.n_noise - n;
    let Some(first) = decoder.layers.first_mut() else { return };
    let kept = first.d_in - after - n_forgotten;
    let without = |row: &[f32]| [&row[..kept], &row[kept + n_forgotten..]].concat();
    first.weight = first.weight.chunks_exact(first.d_in).flat_map(without).collect();
    first.d_in -= n_forgotten;
    decoder.n_noise = n;
}
