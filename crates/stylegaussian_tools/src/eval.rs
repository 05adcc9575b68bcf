//! `stylegaussian eval`: how good a stylization looks, in figures that need no taste.
//!
//! For every painting and view, the *style error* is the squared distance between the channel means and deviations of
//! VGG-19's relu1_1, relu2_1 and relu3_1 on the picture and on the painting, averaged over channels and summed over
//! layers: the paper's style loss without relu4_1. It can be lowered by painting everything in one contrasty way, so it
//! stands beside two others: how often it is smallest for the picture's own painting, and the *content error*, the mean
//! squared distance of relu3_1 from the unstyled view's. References are the unstyled scene; the scene recolored so that its
//! colors have the painting's mean and covariance, which takes no network; and, where a 2D decoder is at hand, AdaIN on
//! each view for itself.

mod yardstick;

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use anyhow::{Context, Result, ensure};
use burn::tensor::Device;
use clap::Args;
use glam::UVec2;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use stylegaussian::{
    Camera, Decoder, Scene, file,
    fold::{stylize, transfer},
    splat::{Colors, View, render},
};
use stylegaussian_encoder::{Image, StyleSize, style_statistics};

use crate::{
    cameras::read_cameras,
    cli::{
        default_decoder,
        output::{print, warn},
    },
    contact_sheet::contact_sheet,
    encoder::{loss_weights, open_encoder},
    picture::{Background, Picture},
    recolor::{ColorMoments, Recoloring},
    teacher::Teacher,
    train::{
        loss_network::{LossNetwork, RELU3_1},
        network::to_vec,
        ops::row_statistics,
        paintings::{list_images, picture_tensor},
        scaled,
        step::{coverage_of_cells, shares},
    },
    views::choose_views,
};
use yardstick::Yardstick;

/// Side of a contact sheet's cells, in pixels.
const CELL: u32 = 160;

/// Measure how well paintings the decoder has never seen can be told in a stylized scene.
///
/// Prints, for every painting, the style error of its pictures, that of the scene merely recolored, and in how many
/// views the painting is the nearest of all.
#[derive(Args, Clone, Debug)]
pub struct EvalArgs {
    /// An embedded scene (.sgs).
    scene: PathBuf,
    /// A folder of paintings (.jpg, .png) that the decoder was not trained on.
    #[arg(long, value_name = "DIR")]
    styles: PathBuf,
    /// Cameras: transforms.json, a COLMAP model, or 3DGS cameras.json.
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    /// This many views, chosen to suit the scene, or spread over the cameras.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    views: u32,
    /// Longer side of a view, in pixels.
    #[arg(long, value_name = "PX", default_value_t = 256, value_parser = clap::value_parser!(u32).range(32..=2048))]
    size: u32,
    /// The decoder, *.decoder.safetensors. Otherwise the scene's own, otherwise the default one.
    #[arg(long, value_name = "FILE")]
    decoder: Option<PathBuf>,
    /// Count pixels that the scene does not cover too, as mid-gray; by default a picture's statistics are those of the
    /// scene alone.
    #[arg(long)]
    whole_picture: bool,
    /// A decoder of 2D feature maps (safetensors, relu3_1 to RGB), for a yardstick: AdaIN on each view for itself.
    #[arg(long, value_name = "FILE")]
    teacher: Option<PathBuf>,
    /// Writes a contact sheet here (PNG): a row for each painting, the unstyled scene first.
    #[arg(long, value_name = "FILE")]
    sheet: Option<PathBuf>,
    /// The encoder that the scene was embedded with: an ONNX file, or VGG-19 weights. Otherwise the one that
    /// STYLEGAUSSIAN_ENCODER names.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// VGG-19 weights (safetensors) for the errors, where the encoder is something else.
    #[arg(long, value_name = "FILE")]
    vgg: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What `eval` found.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// The scene in the paintings' styles.
    pub stylized: Measures,
    /// The scene as it is.
    pub unstyled: Measures,
    /// The scene recolored to each painting's mean color and covariance.
    pub recolored: Measures,
    /// AdaIN on each view for itself, where a 2D decoder is named.
    pub adain_2d: Option<Measures>,
    /// Style error of `stylized` at relu2_1 and relu3_1 over that of `recolored`.
    pub deep_style_error_over_recolored: f64,
    /// Share of stylized color values outside 0..1, which no display shows.
    pub out_of_range: f64,
    /// Painting by painting.
    pub paintings: Vec<PaintingEvaluation>,
}

/// Means over all pictures of one kind.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Measures {
    /// Share of the pictures whose style error is smallest for their own painting.
    pub own_painting_nearest: f64,
    /// Style error at relu1_1, relu2_1 and relu3_1.
    pub style_errors: [f64; 3],
    /// Their sum.
    pub style_error: f64,
    /// Mean squared distance of relu3_1 from the unstyled view's.
    pub content_error: f64,
}

/// What `eval` found for one painting, as means over the views.
#[derive(Clone, Debug, Serialize)]
pub struct PaintingEvaluation {
    path: PathBuf,
    /// The distance, in the measure of the style error, to the painting that is most like this one: what the style error
    /// has to stay well below.
    nearest_other: f64,
    stylized: Measures,
    recolored: Measures,
}

/// Channel means, then deviations, at each of VGG's layers.
type Statistics = Vec<Vec<f32>>;

/// Runs the command.
///
/// # Errors
/// The message names the file or the option at fault.
pub fn run(arguments: &EvalArgs) -> Result<()> {
    let loaded = file::read_scene(&arguments.scene)?;
    warn(&loaded.warnings);
    let scene = loaded.scene;
    let decoder = match (&arguments.decoder, &scene.decoder) {
        (Some(path), _) => file::read_decoder(path)?,
        (None, Some(decoder)) => decoder.clone(),
        (None, None) => default_decoder()?,
    };
    let cameras = cameras(arguments, &scene)?;
    let evaluation = evaluate(arguments, &scene, &decoder, &cameras)?;
    print(arguments.json, &evaluation, || evaluation.table())
}

fn cameras(arguments: &EvalArgs, scene: &Scene) -> Result<Vec<Camera>> {
    let n_views = arguments.views as usize;
    let Some(path) = &arguments.cameras else {
        return Ok(choose_views(scene, n_views, UVec2::splat(arguments.size)));
    };
    let all = read_cameras(path)?.cameras;
    let stride = all.len().div_ceil(n_views).max(1);
    Ok(all.iter().step_by(stride).map(|posed| scaled(&posed.camera, arguments.size)).collect())
}

fn evaluate(
    arguments: &EvalArgs,
    scene: &Scene,
    decoder: &Decoder,
    cameras: &[Camera],
) -> Result<Evaluation> {
    let features = scene.features.as_ref();
    let features =
        features.with_context(|| format!("{}: no features: embed it first", arguments.scene.display()))?;
    let encoder = open_encoder(arguments.encoder.as_deref())?;
    for (what, id) in [("scene", &features.encoder), ("decoder", &decoder.encoder)] {
        if let Some(id) = id {
            ensure!(id == encoder.id(), "the {what} belongs to encoder {id}, expected {}", encoder.id());
        }
    }
    let weights = loss_weights(arguments.vgg.as_deref(), arguments.encoder.as_deref())?;
    let judge = Judge::open(&weights, arguments.whole_picture)?;
    let paths = list_images(&arguments.styles)?;
    let images = paths.iter().map(|path| Image::open(path)).collect::<Result<Vec<_>, _>>()?;
    let targets: Vec<Statistics> = images.iter().map(|image| judge.painting(image)).collect();
    let unstyled: Vec<View> = cameras.iter().map(|camera| render(scene, Colors::Sh, camera)).collect();
    let unstyled_looks: Vec<Look> = unstyled.iter().map(|view| judge.look(view)).collect();

    let content_colors = ColorMoments::of_views(&unstyled);
    let bar = ProgressBar::new((images.len() * cameras.len()) as u64)
        .with_style(ProgressStyle::with_template("{bar:40} {pos}/{len} pictures, {eta} left")?);
    let yardstick = arguments.teacher.as_deref().map(Teacher::open).transpose()?;
    let yardstick = yardstick.map(|teacher| Yardstick::new(teacher, &encoder, &unstyled)).transpose()?;
    let mut kinds: [Vec<Measures>; 4] = Default::default();
    let (mut rows, mut out_of_range) = (Vec::new(), Vec::new());
    let mut sheet = vec![sheet_row(None, &unstyled)];
    for (own, image) in images.iter().enumerate() {
        let style = style_statistics(&encoder, image, StyleSize::default())?;
        let colors = stylize(scene, decoder, &transfer(features, &[(&style, 1.0)], 0.0)?)?;
        let recoloring = Recoloring::new(&content_colors, &ColorMoments::of_image(image));
        let mut views = Vec::new();
        for (i, (camera, before)) in cameras.iter().zip(&unstyled).enumerate() {
            let measure = |look: &Look| look.measures(&unstyled_looks[i], &targets, own);
            let view = render(scene, Colors::Rgb(&colors), camera);
            out_of_range.push(share_out_of_range(&view));
            kinds[0].push(measure(&judge.look(&view)));
            kinds[1].push(measure(&unstyled_looks[i]));
            kinds[2].push(measure(&judge.look(&recoloring.view(before))));
            if let Some(yardstick) = &yardstick {
                kinds[3].push(measure(&judge.look(&yardstick.paint(i, before, &style)?)));
            }
            views.push(view);
            bar.inc(1);
        }
        let of_painting = |kind: &[Measures]| Measures::mean(&kind[kind.len() - cameras.len()..]);
        rows.push(PaintingEvaluation {
            path: paths[own].clone(),
            nearest_other: nearest_other(&targets, own),
            stylized: of_painting(&kinds[0]),
            recolored: of_painting(&kinds[2]),
        });
        sheet.push(sheet_row(Some(image), &views));
    }
    bar.finish_and_clear();
    if let Some(path) = &arguments.sheet {
        contact_sheet(&sheet, UVec2::splat(CELL)).write_png(path)?;
    }
    let [stylized, unstyled, recolored, adain_2d] = kinds.each_ref().map(|kind| Measures::mean(kind));
    let deep = |measures: &Measures| measures.style_errors[1] + measures.style_errors[2];
    Ok(Evaluation {
        deep_style_error_over_recolored: deep(&stylized) / deep(&recolored).max(f64::MIN_POSITIVE),
        stylized,
        unstyled,
        recolored,
        adain_2d: yardstick.map(|_| adain_2d),
        out_of_range: out_of_range.iter().sum::<f64>() / out_of_range.len().max(1) as f64,
        paintings: rows,
    })
}

/// Of the color values where the scene covers more than half of a pixel.
fn share_out_of_range(view: &View) -> f64 {
    let covered = || view.color.iter().zip(&view.alpha).filter(|(_, alpha)| **alpha > 0.5);
    let outside = covered().flat_map(|(color, alpha)| color.map(|c| c < -0.01 || c > alpha + 0.01));
    outside.filter(|outside| *outside).count() as f64 / (3 * covered().count().max(1)) as f64
}

fn sheet_row(painting: Option<&Image>, views: &[View]) -> Vec<Picture> {
    let first = painting.map_or_else(|| Picture::filled(UVec2::ONE, [255; 4]), Picture::of_image);
    let views = views.iter().map(|view| Picture::of(view, Background::Color([255; 3])));
    std::iter::once(first).chain(views).collect()
}

/// VGG-19 as a judge.
struct Judge {
    network: LossNetwork,
    device: Device,
    whole_picture: bool,
}

/// What the judge saw of a picture.
struct Look {
    statistics: Statistics,
    /// relu3_1 `[h * w, D]`, and the coverage of its cells, summing to 1.
    content: Vec<f32>,
    coverage: Vec<f32>,
}

impl Judge {
    fn open(weights: &Path, whole_picture: bool) -> Result<Self> {
        let device = Device::flex();
        Ok(Self { network: LossNetwork::open(weights, None, &device)?, device, whole_picture })
    }

    /// Statistics of a painting, as large as AdaIN sees it.
    fn painting(&self, image: &Image) -> Statistics {
        let image = StyleSize::default().resize(image);
        let size = [image.width as usize, image.height as usize];
        let maps = self.network.features(picture_tensor(&image.rgb, &self.device), size);
        maps.iter().take(RELU3_1 + 1).map(|map| to_vec(&map.statistics())).collect()
    }

    /// Looks at a view as a display shows it, over mid-gray.
    fn look(&self, view: &View) -> Look {
        let size = [view.size.x as usize, view.size.y as usize];
        let pixels = view.color.iter().zip(&view.alpha);
        let rgb: Vec<f32> =
            pixels.flat_map(|(color, a)| color.map(|c| (c + (1.0 - a) * 0.5).clamp(0.0, 1.0))).collect();
        let maps = self.network.features(picture_tensor(&rgb, &self.device), size);
        let mut look = Look { statistics: Vec::new(), content: Vec::new(), coverage: Vec::new() };
        for (layer, map) in maps.into_iter().take(RELU3_1 + 1).enumerate() {
            let coverage = Arc::new(shares(&coverage_of_cells(&view.alpha, size, map.size)));
            look.statistics.push(match self.whole_picture {
                true => to_vec(&map.statistics()),
                false => to_vec(&row_statistics(map.rows.clone(), &coverage)),
            });
            if layer == RELU3_1 {
                look.content = to_vec(&map.rows);
                look.coverage = coverage.to_vec();
            }
        }
        look
    }
}

impl Look {
    /// How this picture of a view fares against the painting `own` among all, and against the view `before`.
    fn measures(&self, before: &Self, targets: &[Statistics], own: usize) -> Measures {
        let style_errors = style_errors(&self.statistics, &targets[own]);
        Measures {
            own_painting_nearest: f64::from(u8::from(nearest_target(self, targets) == Some(own))),
            style_error: style_errors.iter().sum(),
            style_errors,
            content_error: self.content_error(before),
        }
    }

    /// Mean squared distance of relu3_1 from another picture of the same view, where the scene covers it.
    fn content_error(&self, other: &Self) -> f64 {
        let n_channels = self.content.len() / self.coverage.len().max(1);
        let cell = |((a, b), share): ((&[f32], &[f32]), &f32)| -> f64 {
            let squares = a.iter().zip(b).map(|(a, b)| f64::from((a - b) * (a - b)));
            f64::from(*share) * squares.sum::<f64>() / n_channels as f64
        };
        let cells =
            self.content.chunks_exact(n_channels.max(1)).zip(other.content.chunks_exact(n_channels.max(1)));
        cells.zip(&self.coverage).map(cell).sum()
    }
}

/// For each layer, the mean over channels of the squared distances of mean and of deviation.
fn style_errors(found: &Statistics, target: &Statistics) -> [f64; 3] {
    let layer = |(found, wanted): (&Vec<f32>, &Vec<f32>)| {
        let squares = found.iter().zip(wanted).map(|(a, b)| f64::from((a - b) * (a - b)));
        squares.sum::<f64>() / (found.len() / 2) as f64
    };
    [0, 1, 2].map(|i| layer((&found[i], &target[i])))
}

/// Which painting's statistics are nearest.
fn nearest_target(look: &Look, targets: &[Statistics]) -> Option<usize> {
    let error = |target| sum(&style_errors(&look.statistics, target));
    (0..targets.len()).min_by(|&a, &b| error(&targets[a]).total_cmp(&error(&targets[b])))
}

fn nearest_other(targets: &[Statistics], own: usize) -> f64 {
    let others = targets.iter().enumerate().filter(|(i, _)| *i != own);
    others.map(|(_, other)| sum(&style_errors(&targets[own], other))).fold(f64::INFINITY, f64::min)
}

fn sum(errors: &[f64]) -> f64 {
    errors.iter().sum()
}

impl Evaluation {
    fn table(&self) -> String {
        let mut text = format!(
            "{:<40} {:>8} {:>8} {:>8} {:>10} {:>8}\n",
            "painting", "nearest", "style", "content", "recolored", "other"
        );
        for row in &self.paintings {
            let name = row.path.file_name().unwrap_or_default().to_string_lossy();
            text += &format!(
                "{:<40} {:>7.0}% {:>8.3} {:>8.3} {:>10.3} {:>8.3}\n",
                name.chars().take(40).collect::<String>(),
                100.0 * row.stylized.own_painting_nearest,
                row.stylized.style_error,
                row.stylized.content_error,
                row.recolored.style_error,
                row.nearest_other,
            );
        }
        text += &format!(
            "\n{:<10} {:>8} {:>8} {:>8}   relu1_1, relu2_1, relu3_1\n",
            "mean", "nearest", "style", "content"
        );
        let kinds = [("stylized", Some(self.stylized)), ("unstyled", Some(self.unstyled))];
        let references = [("recolored", Some(self.recolored)), ("2D AdaIN", self.adain_2d)];
        for (name, measures) in kinds.into_iter().chain(references) {
            let Some(found) = measures else { continue };
            text += &format!(
                "{name:<10} {:>7.0}% {:>8.3} {:>8.3}   {:.3?}\n",
                100.0 * found.own_painting_nearest,
                found.style_error,
                found.content_error,
                found.style_errors
            );
        }
        text + &format!(
            "style error at relu2_1 and relu3_1 over that of recoloring: {:.3}; colors out of range: {:.1}%",
            self.deep_style_error_over_recolored,
            100.0 * self.out_of_range
        )
    }
}

impl Measures {
    fn mean(all: &[Self]) -> Self {
        let n = all.len().max(1) as f64;
        let mean = |part: &dyn Fn(&Self) -> f64| all.iter().map(part).sum::<f64>() / n;
        Self {
            own_painting_nearest: mean(&|measures| measures.own_painting_nearest),
            style_errors: [0, 1, 2].map(|layer| mean(&|measures| measures.style_errors[layer])),
            style_error: mean(&|measures| measures.style_error),
            content_error: mean(&|measures| measures.content_error),
        }
    }
}
