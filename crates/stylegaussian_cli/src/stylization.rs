//! Stylizing for `stylize` and `render`: from `--style`, `--look`, `--content` and `--decoder` to one color for each
//! Gaussian.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::{ArgGroup, Args};
use serde::Serialize;
use stylegaussian::{
    ChannelStatistics, Scene, file,
    fold::{self, StylizeError},
    look::{self, MadeFrom, Painting},
    paint::{Brush, Paint, Surface, repaint},
};
use stylegaussian_encoder::{Encoder, Image, StyleSize, painted_style};

use crate::{
    arguments::{Backend, WeightedPath, fraction, stroke_scale},
    choose::{self, NamedDecoder, check_encoders, open_encoder},
    compute::Compute,
    terminal::{lossy, usage_error, warn},
};

/// Options of stylizing.
#[derive(Args, Debug)]
#[command(group(ArgGroup::new("restyling").args(["styles", "looks"]).multiple(true)))]
pub struct StylizationArgs {
    /// Style image or *.style.safetensors. Several give a mix, and their weights are normalized to sum 1.
    #[arg(long = "style", value_name = "S[:WEIGHT]", num_args = 1..)]
    styles: Vec<WeightedPath>,
    /// Look of this scene, *.look.safetensors. It needs no features. Several, or looks beside styles, give a mix of
    /// colors; all weights together are normalized to sum 1.
    #[arg(long = "look", value_name = "FILE[:WEIGHT]", num_args = 1..)]
    looks: Vec<WeightedPath>,
    /// How much of the scene to keep, from 0 (full style) to 1 (no style): of its features in styles, of its base
    /// colors in looks.
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
    /// Each style's path and its share of the mix.
    styles: Vec<Share>,
    /// Each look's path and its share of the mix.
    looks: Vec<Share>,
    content: f64,
    /// The decoder's path, `scene` or `default`; nothing if there are only looks. If surfaces are painted, only its
    /// encoder is checked.
    decoder: Option<String>,
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
    #[serde(serialize_with = "lossy")]
    path: PathBuf,
    weight: f64,
}

impl Stylization {
    /// The origin of a look in these colors: no step of optimization.
    pub fn made_from(&self) -> MadeFrom {
        let painting =
            |share: &Share| Painting { name: share.path.display().to_string(), weight: share.weight };
        let paintings = self.styles.iter().chain(&self.looks).map(painting).collect();
        MadeFrom { paintings, strength: 1.0 - self.content, ..MadeFrom::default() }
    }
}

/// Colors of the styles without the looks.
struct Decoded {
    colors: Vec<[f32; 3]>,
    decoder: String,
    painted: bool,
    warnings: Vec<String>,
}

impl StylizationArgs {
    /// Whether any style or look is given.
    pub fn is_given(&self) -> bool {
        !self.styles.is_empty() || !self.looks.is_empty()
    }

    /// Checks the arguments before any file is read, and opens the backend.
    ///
    /// # Errors
    /// If all weights are 0 (a usage error), or if the GPU is asked for and there is none.
    pub fn open(&self) -> Result<Compute> {
        if self.is_given() && self.total_weight() <= 0.0 {
            return Err(usage_error(
                "the weights of styles and looks are all 0: at least one must be positive",
            ));
        }
        Compute::open(self.backend)
    }

    fn total_weight(&self) -> f64 {
        weight_of(&self.styles) + weight_of(&self.looks)
    }

    /// Stylizes `scene`, which `scene_path` names in errors, on the backend that [`open`](Self::open) gave.
    ///
    /// # Errors
    /// If a style is given and the scene has no features, a look belongs to another scene, a file cannot be read,
    /// encoders differ, or the styles' numbers are so large that colors are not finite.
    pub fn stylize(&self, scene: &Scene, scene_path: &Path, compute: &mut Compute) -> Result<Stylization> {
        // Above 0: `open` has checked it.
        let total = self.total_weight();
        // Read before the expensive steps.
        let looks = self.looks.iter().map(|look| {
            let colors = look_colors(&look.path, scene, scene_path)?;
            Ok((colors, look.weight / total))
        });
        let looks = looks.collect::<Result<Vec<_>>>()?;
        let style_share = weight_of(&self.styles) / total;
        // A style of no weight beside a look need not be decoded.
        let decoded = match style_share > 0.0 {
            true => Some(self.decode(scene, scene_path, compute)?),
            false => None,
        };
        let (decoded, decoder, painted, warnings) = match decoded {
            Some(Decoded { colors, decoder, painted, warnings }) => {
                (Some(colors), Some(decoder), painted, warnings)
            }
            None => (None, None, false, Vec::new()),
        };
        let colors = match decoded {
            Some(colors) if looks.is_empty() => colors,
            decoded => {
                let styled = decoded.as_deref().map(|colors| (colors, style_share));
                look::mix(&scene.base_colors(), self.content, &looks, styled)?
            }
        };
        let n_broken = colors.iter().filter(|color| color.iter().any(|channel| !channel.is_finite())).count();
        ensure!(
            n_broken == 0,
            "{}: the styles give {n_broken} of {} Gaussians colors that are not finite, expected numbers",
            scene_path.display(),
            colors.len()
        );
        let share = |style: &WeightedPath| Share { path: style.path.clone(), weight: style.weight / total };
        Ok(Stylization {
            colors,
            styles: self.styles.iter().map(share).collect(),
            looks: self.looks.iter().map(share).collect(),
            content: self.content,
            decoder,
            painted,
            // Paint is laid on by the CPU, wherever the pictures are drawn.
            backend: if painted { "cpu" } else { compute.name() },
            adapter: compute.adapter(),
            warnings,
        })
    }

    /// Decodes the mix of the styles.
    fn decode(&self, scene: &Scene, scene_path: &Path, compute: &mut Compute) -> Result<Decoded> {
        // Checked before the expensive steps.
        let features = scene.features.as_ref();
        let features =
            features.ok_or(StylizeError::NoFeatures).with_context(|| scene_path.display().to_string())?;
        let NamedDecoder { decoder, name } = choose::decoder(self.decoder.as_deref(), scene)?;
        let styles = self.read_styles()?;

        let mut parts = vec![
            (scene_path.display().to_string(), features.encoder.as_ref()),
            (format!("the decoder ({name})"), decoder.encoder.as_ref()),
        ];
        let named = self.styles.iter().zip(&styles);
        parts.extend(
            named.map(|(style, (statistics, _))| {
                (style.path.display().to_string(), statistics.encoder.as_ref())
            }),
        );
        let warnings = check_encoders(&parts)?;
        warn(&warnings);

        // Above 0: the caller has checked it.
        let total = weight_of(&self.styles);
        let weights = || self.styles.iter().map(|style| style.weight / total);
        let paints = styles.iter().zip(weights());
        let paints: Option<Vec<_>> =
            paints.map(|((_, paint), weight)| Some((paint.as_ref()?, weight))).collect();
        // A decoder that somebody trained for this scene, or asks for, is what they want to see.
        let is_default = self.decoder.is_none() && scene.decoder.is_none();
        let colors = match paints.filter(|_| is_default && !self.decoder_only) {
            Some(paints) => {
                let surface = Surface::new(scene, self.stroke_scale);
                let colors = repaint(scene, &surface, &paints, self.content, Brush::default());
                return Ok(Decoded { colors, decoder: name, painted: true, warnings });
            }
            None => {
                let weighted: Vec<_> =
                    styles.iter().map(|(statistics, _)| statistics).zip(weights()).collect();
                fold::transfer(features, &weighted, self.content)
                    .map_err(anyhow::Error::from)
                    .and_then(|map| compute.stylize(scene, &decoder, &map))
                    .with_context(|| format!("{} with decoder {name}", scene_path.display()))?
            }
        };
        Ok(Decoded { colors, decoder: name, painted: false, warnings })
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
    let image = Image::open_painting(path)?;
    painted_style(encoder, &image, size).with_context(|| path.display().to_string())
}

/// Colors `[N]` of the look at `path`, in the order of `scene`, which `scene_path` names in errors.
///
/// # Errors
/// If the look cannot be read or belongs to another scene.
pub fn look_colors(path: &Path, scene: &Scene, scene_path: &Path) -> Result<Vec<[f32; 3]>> {
    let look = file::read_look(path)?;
    look.colors_for(scene).with_context(|| format!("{} for {}", path.display(), scene_path.display()))
}

fn weight_of(styles: &[WeightedPath]) -> f64 {
    styles.iter().map(|style| style.weight).sum()
}
