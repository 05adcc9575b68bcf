//! Stylizing for `stylize` and `render`: from `--style`, `--look`, `--content` and `--decoder` to one color for
//! each Gaussian, and strokes over them.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::{ArgGroup, Args};
use serde::Serialize;
use stylegaussian::{
    ChannelStatistics, Scene, file,
    fold::{self, StylizeError},
    look::{self, LookError, MadeFrom, Painting},
    paint::{Canvas, Paint, Painted, Surface, lay},
    strokes::Strokes,
};
use stylegaussian_encoder::{Encoder, Image, StyleSize, paint_of, painted_style, style_statistics};

use crate::{
    arguments::{Backend, WeightedPath, fraction},
    choose::{self, NamedDecoder, check_encoders, open_encoder},
    compute::Compute,
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
        value_parser = fraction,
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

/// The styles without the looks.
struct Styled {
    shown: Painted,
    /// The decoder's name, if there was one.
    decoder: Option<String>,
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
    /// If a decoder is to choose the colors and the scene has no features, a look belongs to another scene, a
    /// file cannot be read, encoders differ, or the styles' numbers are so large that colors are not finite.
    pub fn stylize(&self, scene: &Scene, scene_path: &Path, compute: &mut Compute) -> Result<Stylization> {
        // Above 0: `open` has checked it.
        let total = self.total_weight();
        // Read before the expensive steps.
        let looks = self.looks.iter().map(|look| {
            let mut shown = read_look(&look.path, scene, scene_path)?;
            shown.strokes.fade(1.0 - self.content as f32);
            Ok((shown, look.weight / total))
        });
        let looks = looks.collect::<Result<Vec<_>>>()?;
        let style_share = weight_of(&self.styles) / total;
        // A style of no weight beside a look need not be computed.
        let styled = if style_share > 0.0 { Some(self.style(scene, scene_path, compute)?) } else { None };
        let painted = styled.as_ref().is_some_and(|styled| styled.decoder.is_none());
        let (styled, decoder, warnings) = match styled {
            Some(Styled { shown, decoder, warnings }) => (Some(shown), decoder, warnings),
            None => (None, None, Vec::new()),
        };
        let mut shown = match styled {
            Some(styled) if looks.is_empty() => styled,
            styled => self.mixed(scene, &looks, styled.as_ref().map(|styled| (styled, style_share)))?,
        };
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

    /// Looks with their shares, and a style with its own.
    fn mixed(
        &self,
        scene: &Scene,
        looks: &[(Painted, f64)],
        style: Option<(&Painted, f64)>,
    ) -> Result<Painted> {
        let colors: Vec<_> = looks.iter().map(|(look, share)| (look.colors.clone(), *share)).collect();
        let of_style = style.map(|(style, share)| (&style.colors[..], share));
        let colors = look::mix(&scene.base_colors(), self.content, &colors, of_style)?;
        let mut strokes = Strokes::default();
        let mut total = 0.0;
        let parts = style.into_iter().chain(looks.iter().map(|(look, share)| (look, *share)));
        for (part, share) in parts.filter(|(_, share)| *share > 0.0) {
            total += share;
            strokes.mix(&part.strokes, (share / total) as f32);
        }
        Ok(Painted { colors, strokes, ..Painted::default() })
    }

    /// The mix of the styles: painted, if nothing asks for a decoder.
    fn style(&self, scene: &Scene, scene_path: &Path, compute: &mut Compute) -> Result<Styled> {
        // A decoder that somebody trained for this scene, or asks for, is what they want to see.
        let wants_decoder = self.decoder_only || self.decoder.is_some() || scene.decoder.is_some();
        match if wants_decoder { None } else { self.read_paints()? } {
            Some(paints) => Ok(self.paint(scene, &paints)),
            None => self.decode(scene, scene_path, compute),
        }
    }

    /// The share of each style in their mix.
    fn weights(&self) -> impl Iterator<Item = f64> {
        // Above 0: the caller has checked it.
        let total = weight_of(&self.styles);
        self.styles.iter().map(move |style| style.weight / total)
    }

    /// Lays the paint of the styles on the scene.
    fn paint(&self, scene: &Scene, paints: &[Paint]) -> Styled {
        let canvases: Vec<(Canvas, f64)> =
            paints.iter().zip(self.weights()).map(|(paint, weight)| (Canvas::new(paint), weight)).collect();
        let canvases: Vec<(&Canvas, f64)> =
            canvases.iter().map(|(canvas, weight)| (canvas, *weight)).collect();
        let shown = lay(scene, &Surface::new(scene), &canvases, self.content);
        Styled { shown, decoder: None, warnings: Vec::new() }
    }

    /// Decodes the mix of the styles.
    fn decode(&self, scene: &Scene, scene_path: &Path, compute: &mut Compute) -> Result<Styled> {
        // Checked before the expensive steps.
        let features = scene.features.as_ref();
        let features =
            features.ok_or(StylizeError::NoFeatures).with_context(|| scene_path.display().to_string())?;
        let NamedDecoder { decoder, name } = choose::decoder(self.decoder.as_deref(), scene)?;
        let styles = self.read_statistics()?;
        let mut parts = vec![
            (scene_path.display().to_string(), features.encoder.as_ref()),
            (format!("the decoder ({name})"), decoder.encoder.as_ref()),
        ];
        let named = self.styles.iter().zip(&styles);
        parts.extend(
            named.map(|(style, statistics)| (style.path.display().to_string(), statistics.encoder.as_ref())),
        );
        let warnings = check_encoders(&parts)?;
        warn(&warnings);
        let weighted: Vec<_> = styles.iter().zip(self.weights()).collect();
        let colors = fold::transfer(features, &weighted, self.content)
            .map_err(anyhow::Error::from)
            .and_then(|map| compute.stylize(scene, &decoder, &map))
            .with_context(|| format!("{} with decoder {name}", scene_path.display()))?;
        let shown = Painted { colors, ..Painted::default() };
        Ok(Styled { shown, decoder: Some(name), warnings })
    }

    /// Paint of each style, in order, or `None` if a style file carries none.
    fn read_paints(&self) -> Result<Option<Vec<Paint>>> {
        let paint = |style: &WeightedPath| match is_file(&style.path) {
            true => Ok(file::read_paint(&style.path)?),
            false => Ok(Some(paint_of(&Image::open_painting(&style.path)?))),
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
                let image = Image::open_painting(path)?;
                let statistics = style_statistics(encoder, &image, StyleSize::default());
                statistics.with_context(|| path.display().to_string())
            }
            _ => Ok(file::read_style(path)?),
        };
        self.styles.iter().map(of_style).collect()
    }
}

/// Whether a style is a file of statistics and paint, and no image.
fn is_file(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("safetensors"))
}

/// Style statistics and paint of the image at `path`.
///
/// # Errors
/// If the image cannot be read or encoded.
pub fn image_style(encoder: &Encoder, path: &Path, size: StyleSize) -> Result<(ChannelStatistics, Paint)> {
    let image = Image::open_painting(path)?;
    painted_style(encoder, &image, size).with_context(|| path.display().to_string())
}

/// Colors and strokes of the look at `path`, in the order of `scene`, which `scene_path` names in errors.
///
/// # Errors
/// If the look cannot be read or belongs to another scene.
fn read_look(path: &Path, scene: &Scene, scene_path: &Path) -> Result<Painted> {
    let look = file::read_look(path)?;
    let shown = || {
        let (colors, strokes) = (look.colors_for(scene)?, look.strokes_for(scene)?);
        Ok(Painted { colors, strokes: strokes.unwrap_or_default(), ..Painted::default() })
    };
    let shown: Result<Painted, LookError> = shown();
    shown.with_context(|| format!("{} for {}", path.display(), scene_path.display()))
}

fn weight_of(styles: &[WeightedPath]) -> f64 {
    styles.iter().map(|style| style.weight).sum()
}
