//! The description of a decoder.

use std::path::Path;

use anyhow::Result;
use serde::Serialize;
use stylegaussian::{Decoder, EncoderId};
use stylegaussian_files::read_decoder;

use super::or_unknown;
use crate::terminal::{lossy, print};

#[derive(Serialize)]
struct FileInfo<'a> {
    #[serde(serialize_with = "lossy")]
    path: &'a Path,
    decoder: DecoderInfo,
}

/// The form of a decoder.
#[derive(Debug, Serialize)]
pub struct DecoderInfo {
    /// Inputs of the first layer, then outputs of each.
    widths: Vec<usize>,
    k: usize,
    activation: String,
    /// The share of the base color in the final color.
    residual: f32,
    /// Number of noise inputs.
    n_noise: usize,
    /// Smoothing passes over the decoded colors.
    smooth: usize,
    /// Whether the base color is an input.
    #[serde(rename = "own_color")]
    base_color: bool,
    /// Whether the style's statistics are inputs.
    statistics: bool,
    encoder: Option<String>,
}

/// Describes the decoder at `path`.
///
/// # Errors
/// If it cannot be read.
pub fn run(path: &Path, json: bool) -> Result<()> {
    let info = FileInfo { path, decoder: DecoderInfo::of(&read_decoder(path)?) };
    print(json, &info, || format!("{}\n  decoder     {}", path.display(), text_of(&info.decoder)))
}

impl DecoderInfo {
    /// The form of `decoder`.
    pub fn of(decoder: &Decoder) -> Self {
        let outputs = decoder.layers.iter().map(|layer| layer.d_out);
        Self {
            widths: std::iter::once(decoder.n_inputs()).chain(outputs).collect(),
            k: decoder.k,
            activation: decoder.activation.to_string(),
            residual: decoder.residual,
            n_noise: decoder.n_noise,
            smooth: decoder.smoothing_passes,
            base_color: decoder.base_color,
            statistics: !decoder.statistics_weight.is_empty(),
            encoder: decoder.encoder.as_ref().map(EncoderId::to_string),
        }
    }
}

/// The form of a decoder on one line.
pub fn text_of(decoder: &DecoderInfo) -> String {
    let widths: Vec<_> = decoder.widths.iter().map(ToString::to_string).collect();
    let marks = [
        (decoder.residual != 0.0, format!(", {} of the base color", decoder.residual)),
        (decoder.base_color, ", sees base colors".to_owned()),
        (decoder.n_noise > 0, format!(", {} channels of noise", decoder.n_noise)),
        (decoder.smooth > 0, format!(", {} smoothing passes", decoder.smooth)),
        (decoder.statistics, ", the style's statistics".to_owned()),
    ];
    let marks: String = marks.into_iter().filter(|(has, _)| *has).map(|(_, mark)| mark).collect();
    let encoder = or_unknown(&decoder.encoder);
    format!("{}, K = {}, {}{marks}, encoder {encoder}", widths.join(" > "), decoder.k, decoder.activation)
}
