//! Stylizing for `stylize` and `render`: from `--style`, `--look`, `--content` and `--decoder` to one color for
//! each Gaussian, and strokes over them.

use std::{
    error::Error,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use clap::{ArgGroup, Args};
use serde::Serialize;
use stylegaussian::{
    ChannelStatistics, Decoder, Scene,
    fold::{ChannelMap, StylizeError},
    look::{MadeFrom, Painting},
    paint::{Canvas, Paint, Painted, Surface},
    restyle::{Decode, Recipe, RestyleError, Styles, WeightedLook, is_painted},
    work::Work,
};
use stylegaussian_encoder::{Encoder, StyleSize, painted_style, style_statistics};
use stylegaussian_files::{read_look, read_paint, read_style};

use crate::{
    arguments::{Backend, FRACTIONS, WeightedPath, within},
    choose::{self, NamedDecoder, check_encoders, open_encoder, open_painting},
    compute::Compute,
    hand::{Decided, HandArgs, usable_paint_of},
    knobs::StrokeArgs,
    terminal::{lossy, usage_error, warn},
};

/// Options of stylizing.
#[derive(Args, Debug)]
#[command(group(ArgGroup::new("restyling").args(["styles", "looks"]).multiple(true)))]
pub struct StylizationArgs {
    /// Style image or *.style.safetensors. Several give a mix, and their weights are normalized to sum 1.
    #[arg(long = "style", value_name = "S[:WEIGHT]", num_args = 1..)]
    styles: Vec<WeightedPath>,
    /// Look of this scene, *.look.safetensors. Several, or looks beside styles, give a mix; all weights
    /// together are normalized to sum 1.
    #[arg(long = "look", value_name = "FILE[:WEIGHT]", num_args = 1..)]
    looks: Vec<WeightedPath>,
    /// How much of the scene to keep, from 0 (full style) to 1 (no style): of its features in styles, of its
    /// base colors in looks.
    #[arg(
        long,
        value_name = "0..1",
        default_value = "0",
        allow_negative_numbers = true,
        value_parser = within(FRACTIONS),
    )]
    content: f64,
    /// The decoder, *.decoder.safetensors. Default: the scene's own, else the built-in one.
    #[arg(long, value_name = "FILE")]
    decoder: Option<PathBuf>,
    /// The encoder for style images, if a decoder chooses the colors: an ONNX file, or VGG-19 weights as
    /// safetensors or torchvision's .pth. Default: the file in STYLEGAUSSIAN_ENCODER, else the built-in
    /// encoder.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// Let the decoder alone choose the colors, as in the paper, for which the scene needs features. Without
    /// this, surfaces are painted with the painting's own strokes, unless --decoder is given, the scene has a
    /// decoder of its own, or a style file carries no paint.
    #[arg(long)]
    decoder_only: bool,
    #[command(flatten)]
    strokes: StrokeArgs,
    #[command(flatten)]
    hand: HandArgs,
    /// Where to compute. If `gpu` is given and there is no GPU, the command fails.
    #[arg(long, value_enum, default_value = "auto")]
    backend: Backend,
}

/// A stylized scene's colors and strokes, and the settings that gave them.
#[derive(Debug, Serialize)]
pub struct Stylization {
    /// Display-referred RGB `[N]`, not clamped, and the strokes over them.
    #[serde(skip)]
    pub shown: Painted,
    /// Each style's path and its share of the mix.
    styles: Vec<Share>,
    /// Each look's path and its share of the mix.
    looks: Vec<Share>,
    content: f64,
    /// The decoder's path, `scene` or `default`; nothing if surfaces are painted or there are only looks.
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

/// Inputs of the styles.
enum Prepared {
    Painted {
        canvases: Vec<Canvas>,
        surface: Box<Surface>,
        decided: Box<Decided>,
    },
    Decoded {
        statistics: Vec<ChannelStatistics>,
        decoder: NamedDecoder,
        warnings: Vec<String>,
    },
    /// All weight is that of looks.
    None,
}

/// A decoder on the backend that was asked for.
struct Decoding<'a> {
    decoder: &'a Decoder,
    compute: &'a mut Compute,
}

impl Decode for Decoding<'_> {
    fn decode(
        &mut self,
        scene: &Scene,
        map: &ChannelMap,
        _: &Work,
    ) -> Result<Vec<[f32; 3]>, Box<dyn Error + Send + Sync>> {
        Ok(self.compute.stylize(scene, self.decoder, map)?)
    }
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
    /// If a decoder is to choose the colors and the scene has no features, a look belongs to another scene, a
    /// file cannot be read, encoders differ, or the styles' numbers are so large that colors are not finite.
    pub fn stylize(&self, scene: &Scene, scene_path: &Path, compute: &mut Compute) -> Result<Stylization> {
        // Read before the expensive steps.
        let read = |look: &WeightedPath| {
            let name = format!("{} for {}", look.path.display(), scene_path.display());
            Ok((name, read_look(&look.path)?, look.weight))
        };
        let looks = self.looks.iter().map(read).collect::<Result<Vec<_>>>()?;
        let prepared = match weight_of(&self.styles) > 0.0 {
            true => self.prepare(scene, scene_path)?,
            false => Prepared::None,
        };
        let mut shown = {
            let mut decoding;
            let styles = match &prepared {
                Prepared::Painted { canvases, surface, decided } => {
                    Styles::Painted { paintings: self.weighted(canvases), surface, hand: decided.hand() }
                }
                Prepared::Decoded { statistics, decoder, .. } => {
                    decoding = Decoding { decoder: &decoder.decoder, compute: &mut *compute };
                    Styles::Decoded { styles: self.weighted(statistics), decode: &mut decoding }
                }
                Prepared::None => Styles::None,
            };
            let looks = looks.iter().map(|(name, look, weight)| WeightedLook { name, look, weight: *weight });
            let recipe = Recipe { looks: looks.collect(), styles, content: self.content };
            recipe.restyle(scene, &Work::default()).map_err(|error| match &prepared {
                Prepared::Decoded { decoder, .. } if !matches!(error, RestyleError::Look { .. }) => {
                    let context = format!("{} with decoder {}", scene_path.display(), decoder.name);
                    anyhow::Error::from(error).context(context)
                }
                _ => error.into(),
            })?
        };
        let painted = matches!(prepared, Prepared::Painted { .. });
        let (decoder, warnings) = match prepared {
            Prepared::Decoded { decoder, warnings, .. } => (Some(decoder.name), warnings),
            Prepared::Painted { .. } | Prepared::None => (None, Vec::new()),
        };
        // Above 0: `open` has checked it.
        let total = self.total_weight();
        self.strokes.apply(&mut shown.strokes);
        let is_broken = |color: &&[f32; 3]| color.iter().any(|channel| !channel.is_finite());
        let n_broken = shown.colors.iter().filter(is_broken).count();
        ensure!(
            n_broken == 0,
            "{}: the styles give {n_broken} of {} Gaussians colors that are not finite, expected numbers",
            scene_path.display(),
            shown.colors.len()
        );
        let share = |style: &WeightedPath| Share { path: style.path.clone(), weight: style.weight / total };
        Ok(Stylization {
            shown,
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

    /// Prepares the styles, painted or decoded.
    fn prepare(&self, scene: &Scene, scene_path: &Path) -> Result<Prepared> {
        let asks_for_decoder = self.decoder_only || self.decoder.is_some();
        // Files are read only if they may be used.
        let paints = if is_painted(scene, asks_for_decoder, true) { self.read_paints()? } else { None };
        if let Some(paints) = paints {
            let decided = Box::new(self.hand.read(scene)?);
            let canvases = paints.iter().map(Canvas::new).collect();
            let surface = Box::new(Surface::new(scene, &Work::default())?);
            return Ok(Prepared::Painted { canvases, surface, decided });
        }
        self.hand.expect_none()?;
        // Checked before the expensive steps.
        let features = scene.features.as_ref();
        let features =
            features.ok_or(StylizeError::NoFeatures).with_context(|| scene_path.display().to_string())?;
        let decoder = choose::decoder(self.decoder.as_deref(), scene)?;
        let statistics = self.read_statistics()?;
        let mut parts = vec![
            (scene_path.display().to_string(), features.encoder.as_ref()),
            (format!("the decoder ({})", decoder.name), decoder.decoder.encoder.as_ref()),
        ];
        let named = self.styles.iter().zip(&statistics);
        parts.extend(
            named.map(|(style, statistics)| (style.path.display().to_string(), statistics.encoder.as_ref())),
        );
        let warnings = check_encoders(&parts)?;
        warn(&warnings);
        Ok(Prepared::Decoded { statistics, decoder, warnings })
    }

    /// Inputs of the styles, in their order, with their weights.
    fn weighted<'a, T>(&self, given: &'a [T]) -> Vec<(&'a T, f64)> {
        given.iter().zip(self.styles.iter().map(|style| style.weight)).collect()
    }

    /// Paint of each style, in order, or `None` if a style file carries none.
    fn read_paints(&self) -> Result<Option<Vec<Paint>>> {
        let paint = |style: &WeightedPath| match is_file(&style.path) {
            true => {
                let paint = read_paint(&style.path)?;
                paint.map(|paint| self.hand.part_of(paint, &style.path)).transpose()
            }
            false => usable_paint_of(&self.hand.open_image(&style.path)?, &style.path).map(Some),
        };
        self.styles.iter().map(paint).collect()
    }

    /// Statistics of each style, in order. The encoder is opened only if an image needs it.
    fn read_statistics(&self) -> Result<Vec<ChannelStatistics>> {
        let encoder = match self.styles.iter().all(|style| is_file(&style.path)) {
            true => None,
            false => Some(open_encoder(self.encoder.as_deref())?),
        };
        let of_style = |WeightedPath { path, .. }: &WeightedPath| match &encoder {
            Some(encoder) if !is_file(path) => {
                let image = self.hand.open_image(path)?;
                let statistics = style_statistics(encoder, &image, StyleSize::default());
                statistics.with_context(|| path.display().to_string())
            }
            _ => Ok(read_style(path)?),
        };
        self.styles.iter().map(of_style).collect()
    }
}

/// Whether a style is a file of statistics and paint, and no image.
fn is_file(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("safetensors"))
}

/// Style statistics and paint of the image at `path`, or of an area of it: its left, top, right and bottom
/// edges as shares of the sides.
///
/// # Errors
/// If the image cannot be read or encoded, or has no pixel to paint from.
pub fn image_style(
    encoder: &Encoder,
    path: &Path,
    area: Option<[f32; 4]>,
    size: StyleSize,
) -> Result<(ChannelStatistics, Paint)> {
    let named = || path.display().to_string();
    let mut image = open_painting(path)?;
    if let Some(area) = area {
        image = image.cropped(area).with_context(named)?;
    }
    // Before the encoder, which takes a while.
    usable_paint_of(&image, path)?;
    painted_style(encoder, &image, size).with_context(named)
}

fn weight_of(styles: &[WeightedPath]) -> f64 {
    styles.iter().map(|style| style.weight).sum()
}
