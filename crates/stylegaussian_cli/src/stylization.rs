//! What `stylize` and `render` share: from `--style`, `--content` and `--decoder` to one color for each Gaussian.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::{Args, CommandFactory, error::ErrorKind};
use serde::Serialize;
use stylegaussian::{
    ChannelStatistics, Decoder, EncoderId, Scene, file,
    fold::{self, StylizeError},
};
use stylegaussian_encoder::StyleSize;

use super::{
    Cli,
    arguments::{Backend, WeightedPath, fraction},
    compute::Compute,
    output::warn,
    style::image_statistics,
};
use crate::encoder::open_encoder;

/// How to stylize.
#[derive(Args, Debug)]
pub struct StylizationArgs {
    /// Style image or *.style.safetensors, several for a mix; weights are normalized to sum 1.
    #[arg(long = "style", value_name = "S[:WEIGHT]", num_args = 1..)]
    styles: Vec<WeightedPath>,
    /// How much of the content's own features to keep: 0 (the style alone) to 1 (decodes the content).
    #[arg(long, value_name = "0..1", default_value = "0", allow_negative_numbers = true, value_parser = fraction)]
    content: f64,
    /// The decoder, *.decoder.safetensors. Otherwise the scene's own, otherwise the default one.
    #[arg(long, value_name = "FILE")]
    decoder: Option<PathBuf>,
    /// The encoder for style images: an ONNX file, or VGG-19 weights as safetensors or torchvision's .pth. Otherwise
    /// the one that STYLEGAUSSIAN_ENCODER names, otherwise the default one.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// What computes; `gpu` never falls back silently.
    #[arg(long, value_enum, default_value = "auto")]
    backend: Backend,
}

/// A stylized scene's colors, and what they were made of.
#[derive(Debug, Serialize)]
pub struct Stylization {
    /// Display-referred RGB `[N]`, not clamped.
    #[serde(skip)]
    pub colors: Vec<[f32; 3]>,
    /// Each style's path and normalized weight.
    styles: Vec<Share>,
    content: f64,
    /// The decoder's path, `scene` or `default`.
    decoder: String,
    /// What computed: `cpu` or `gpu`.
    backend: &'static str,
    /// The GPU's name.
    adapter: Option<String>,
    pub warnings: Vec<String>,
}

#[derive(Clone, Debug, Serialize)]
struct Share {
    path: PathBuf,
    weight: f64,
}

impl StylizationArgs {
    /// Whether a style is asked for.
    pub fn has_style(&self) -> bool {
        !self.styles.is_empty()
    }

    /// Checks what can be checked before any file is read, and opens the backend.
    ///
    /// # Errors
    /// A usage error where all weights are 0; an error where the GPU is asked for and there is none.
    pub fn open(&self) -> Result<Compute> {
        if self.has_style() && self.total_weight() <= 0.0 {
            let message = "the weights of the styles are all 0: at least one must be positive";
            return Err(Cli::command().error(ErrorKind::ValueValidation, message).into());
        }
        Compute::open(self.backend)
    }

    fn total_weight(&self) -> f64 {
        self.styles.iter().map(|style| style.weight).sum()
    }

    /// Stylizes `scene`, which `scene_path` names in errors, with what [`open`](Self::open) gave.
    ///
    /// # Errors
    /// When the scene has no features, a file cannot be read, or encoders differ.
    pub fn stylize(&self, scene: &Scene, scene_path: &Path, compute: &mut Compute) -> Result<Stylization> {
        // Before anything expensive.
        let features = scene.features.as_ref();
        let features =
            features.ok_or(StylizeError::NoFeatures).with_context(|| scene_path.display().to_string())?;
        let (decoder, decoder_name) = self.decoder(scene)?;
        let statistics = self.statistics()?;

        let mut parts = vec![
            (scene_path.display().to_string(), features.encoder.as_ref()),
            (format!("the decoder ({decoder_name})"), decoder.encoder.as_ref()),
        ];
        let styles = self.styles.iter().zip(&statistics);
        parts.extend(
            styles.map(|(style, statistics)| (style.path.display().to_string(), statistics.encoder.as_ref())),
        );
        let warnings = check_encoders(&parts)?;
        warn(&warnings);

        let total = self.total_weight();
        let weighted: Vec<_> = statistics
            .iter()
            .zip(&self.styles)
            .map(|(statistics, style)| (statistics, style.weight / total))
            .collect();
        let colors = fold::transfer(features, &weighted, self.content)
            .map_err(anyhow::Error::from)
            .and_then(|map| compute.stylize(scene, &decoder, &map))
            .with_context(|| format!("{} with decoder {decoder_name}", scene_path.display()))?;
        let share = |style: &WeightedPath| Share { path: style.path.clone(), weight: style.weight / total };
        Ok(Stylization {
            colors,
            styles: self.styles.iter().map(share).collect(),
            content: self.content,
            decoder: decoder_name,
            backend: compute.name(),
            adapter: compute.adapter(),
            warnings,
        })
    }

    /// The decoder and a name for it: the one asked for, else the scene's own, else the default one.
    fn decoder(&self, scene: &Scene) -> Result<(Decoder, String)> {
        match (&self.decoder, &scene.decoder) {
            (Some(path), _) => Ok((file::read_decoder(path)?, path.display().to_string())),
            (None, Some(decoder)) => Ok((decoder.clone(), "scene".into())),
            (None, None) => Ok((default_decoder()?, "default".into())),
        }
    }

    /// Statistics of each style, in order. The encoder is opened only where an image needs it.
    fn statistics(&self) -> Result<Vec<ChannelStatistics>> {
        let is_file = |path: &Path| {
            path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("safetensors"))
        };
        let encoder = match self.styles.iter().all(|style| is_file(&style.path)) {
            true => None,
            false => Some(open_encoder(self.encoder.as_deref())?),
        };
        let of_style = |style: &WeightedPath| match &encoder {
            Some(encoder) if !is_file(&style.path) => {
                image_statistics(encoder, &style.path, StyleSize::default())
            }
            _ => Ok(file::read_style(&style.path)?),
        };
        self.styles.iter().map(of_style).collect()
    }
}

/// The default decoder, which serves every scene that brings none.
pub fn default_decoder() -> Result<Decoder> {
    Ok(file::decoder_from_bytes(stylegaussian_defaults::DECODER, "the default decoder")?)
}

/// Names the parts that do not name their encoder.
///
/// # Errors
/// When two parts name different encoders.
fn check_encoders(parts: &[(String, Option<&EncoderId>)]) -> Result<Vec<String>> {
    let known = |(part, encoder): &(String, Option<&EncoderId>)| {
        encoder.map(|encoder| (part.clone(), encoder.clone()))
    };
    let mut named = parts.iter().filter_map(known);
    if let Some((first, expected)) = named.next() {
        for (part, found) in named {
            ensure!(
                found == expected,
                "{part} belongs to encoder {found}, {first} to {expected}: one encoder must have made both"
            );
        }
    }
    let unnamed = parts.iter().filter(|(_, encoder)| encoder.is_none());
    Ok(unnamed
        .map(|(part, _)| format!("{part} does not name its encoder, so it may not fit the rest"))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encoder(hash: &str) -> EncoderId {
        EncoderId { name: "vgg".into(), hash: hash.into() }
    }

    #[test]
    fn two_encoders_are_an_error_that_names_both() {
        let (a, b) = (encoder("aa"), encoder("bb"));
        let error =
            check_encoders(&[("x.sgs".into(), None), ("d".into(), Some(&a)), ("s.png".into(), Some(&b))]);
        let message = error.unwrap_err().to_string();
        for part in ["s.png", "vgg@bb", "d to", "vgg@aa"] {
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn a_missing_encoder_is_a_warning() {
        let a = encoder("aa");
        let warnings = check_encoders(&[("x.sgs".into(), None), ("d".into(), Some(&a))]).unwrap();
        assert_eq!(warnings.len(), 1);
        assert!(warnings[0].starts_with("x.sgs "));
        assert!(check_encoders(&[("d".into(), Some(&a)), ("e".into(), Some(&a))]).unwrap().is_empty());
    }
}
