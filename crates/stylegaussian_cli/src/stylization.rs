//! Stylizing for `stylize` and `render`: from `--style`, `--content` and `--decoder` to one color for each Gaussian.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use serde::Serialize;
use stylegaussian::{
    ChannelStatistics, Scene, file,
    fold::{self, StylizeError},
    paint::{Brush, Paint, Surface, repaint},
};
use stylegaussian_encoder::{Encoder, Image, StyleSize, painted_style};

use crate::{
    arguments::{Backend, WeightedPath, fraction, stroke_scale},
    choose::{self, NamedDecoder, check_encoders, open_encoder},
    compute::Compute,
    terminal::{usage_error, warn},
};

/// Options of stylizing.
#[derive(Args, Debug)]
pub struct StylizationArgs {
    /// Style image or *.style.safetensors. Several give a mix, and their weights are normalized to sum 1.
    #[arg(long = "style", value_name = "S[:WEIGHT]", num_args = 1..)]
    styles: Vec<WeightedPath>,
    /// How much of the scene's own features to keep, from 0 (full style) to 1 (no style).
    #[arg(long, value_name = "0..1", default_value = "0", allow_negative_numbers = true, value_parser = fraction)]
    content: f64,
    /// The decoder, *.decoder.safetensors. Default: the scene's own, else the built-in one.
    #[arg(long, value_name = "FILE")]
    decoder: Option<PathBuf>,
    /// The encoder for style images: an ONNX file, or VGG-19 weights as safetensors or torchvision's .pth. Default:
    /// the file in STYLEGAUSSIAN_ENCODER, else the built-in encoder.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// Let the decoder alone choose the colors, as in the paper. Without this, surfaces are painted with the painting's
    /// own strokes, unless --decoder is given or a style file carries no paint.
    #[arg(long)]
    decoder_only: bool,
    /// Size of the strokes, as a factor. 1: as in the painting, if the scene is seen at 512 pixels.
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = stroke_scale)]
    stroke_scale: f32,
    /// Where to compute. If `gpu` is given and there is no GPU, the command fails.
    #[arg(long, value_enum, default_value = "auto")]
    backend: Backend,
}

/// A stylized scene's colors, and the settings that gave them.
#[derive(Debug, Serialize)]
pub struct Stylization {
    /// Display-referred RGB `[N]`, not clamped.
    #[serde(skip)]
    pub colors: Vec<[f32; 3]>,
    /// Each style's path and normalized weight.
    styles: Vec<Share>,
    content: f64,
    /// The decoder's path, `scene` or `default`. If surfaces are painted, only its encoder is checked.
    decoder: String,
    /// Whether surfaces are painted with the paintings' own strokes.
    painted: bool,
    /// The device: `cpu` or `gpu`.
    backend: &'static str,
    /// The GPU's name.
    adapter: Option<String>,
    /// Warnings that were printed.
    pub warnings: Vec<String>,
}

#[derive(Clone, Debug, Serialize)]
struct Share {
    path: PathBuf,
    weight: f64,
}

impl StylizationArgs {
    /// Whether any style is given.
    pub fn has_style(&self) -> bool {
        !self.styles.is_empty()
    }

    /// Checks the arguments before any file is read, and opens the backend.
    ///
    /// # Errors
    /// If all weights are 0 (a usage error), or if the GPU is asked for and there is none.
    pub fn open(&self) -> Result<Compute> {
        if self.has_style() && self.total_weight() <= 0.0 {
            return Err(usage_error("the weights of the styles are all 0: at least one must be positive"));
        }
        Compute::open(self.backend)
    }

    fn total_weight(&self) -> f64 {
        self.styles.iter().map(|style| style.weight).sum()
    }

    /// Stylizes `scene`, which `scene_path` names in errors, on the backend that [`open`](Self::open) gave.
    ///
    /// # Errors
    /// If the scene has no features, a file cannot be read, or encoders differ.
    pub fn stylize(&self, scene: &Scene, scene_path: &Path, compute: &mut Compute) -> Result<Stylization> {
        // Checked before the expensive steps.
        let features = scene.features.as_ref();
        let features =
            features.ok_or(StylizeError::NoFeatures).with_context(|| scene_path.display().to_string())?;
        let NamedDecoder { decoder, name: decoder_name } = choose::decoder(self.decoder.as_deref(), scene)?;
        let styles = self.read_styles()?;

        let mut parts = vec![
            (scene_path.display().to_string(), features.encoder.as_ref()),
            (format!("the decoder ({decoder_name})"), decoder.encoder.as_ref()),
        ];
        let named = self.styles.iter().zip(&styles);
        parts.extend(
            named.map(|(style, (statistics, _))| {
                (style.path.display().to_string(), statistics.encoder.as_ref())
            }),
        );
        let warnings = check_encoders(&parts)?;
        warn(&warnings);

        // Above 0: `open` has checked it.
        let total = self.total_weight();
        let weights = || self.styles.iter().map(|style| style.weight / total);
        let paints: Vec<_> = styles
            .iter()
            .zip(weights())
            .filter_map(|((_, paint), weight)| Some((paint.as_ref()?, weight)))
            .collect();
        let painted = !self.decoder_only && self.decoder.is_none() && paints.len() == styles.len();
        let colors = if painted {
            let surface = Surface::new(scene, self.stroke_scale);
            repaint(scene, &surface, &paints, self.content, Brush::default())
        } else {
            let weighted: Vec<_> = styles.iter().map(|(statistics, _)| statistics).zip(weights()).collect();
            fold::transfer(features, &weighted, self.content)
                .map_err(anyhow::Error::from)
                .and_then(|map| compute.stylize(scene, &decoder, &map))
                .with_context(|| format!("{} with decoder {decoder_name}", scene_path.display()))?
        };
        let share = |style: &WeightedPath| Share { path: style.path.clone(), weight: style.weight / total };
        Ok(Stylization {
            colors,
            styles: self.styles.iter().map(share).collect(),
            content: self.content,
            decoder: decoder_name,
            painted,
            // Paint is laid on by the CPU, wherever the pictures are drawn.
            backend: if painted { "cpu" } else { compute.name() },
            adapter: compute.adapter(),
            warnings,
        })
    }

    /// Statistics and paint of each style, in order. The encoder is opened only if an image needs it.
    fn read_styles(&self) -> Result<Vec<(ChannelStatistics, Option<Paint>)>> {
        let is_file = |path: &Path| {
            path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("safetensors"))
        };
        let encoder = match self.styles.iter().all(|style| is_file(&style.path)) {
            true => None,
            false => Some(open_encoder(self.encoder.as_deref())?),
        };
        let of_style = |style: &WeightedPath| match &encoder {
            Some(encoder) if !is_file(&style.path) => {
                let (statistics, paint) = image_style(encoder, &style.path, StyleSize::default())?;
                Ok((statistics, Some(paint)))
            }
            _ => Ok((file::read_style(&style.path)?, file::read_paint(&style.path)?)),
        };
        self.styles.iter().map(of_style).collect()
    }
}

/// Style statistics and paint of the image at `path`.
///
/// # Errors
/// If the image cannot be read or encoded.
pub fn image_style(encoder: &Encoder, path: &Path, size: StyleSize) -> Result<(ChannelStatistics, Paint)> {
    let image = Image::open(path)?;
    painted_style(encoder, &image, size).with_context(|| path.display().to_string())
}
