//! `stylegaussian eval`: how good a stylization looks, in figures that need no taste.
//!
//! For every painting and view, the *style error* is the squared distance between the channel means and deviations of
//! VGG-19's relu1_1, relu2_1 and relu3_1 on the picture and on the painting, averaged over channels and summed over
//! layers: the paper's style loss without relu4_1. It can be lowered by painting everything in one contrasty way, so it
//! stands beside two others: how often it is smallest for the picture's own painting, and the *content error*, the mean
//! squared distance of relu3_1 from the unstyled view's. References are the unstyled scene; the scene recolored so that its
//! colors have the painting's mean and covariance, which takes no network; and, where a 2D decoder is at hand, AdaIN on
//! each view for itself. Whether the views agree is the matter of `consistency`.

mod consistency;
mod judge;
mod report;
mod yardstick;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use glam::UVec2;
use indicatif::{ProgressBar, ProgressStyle};
use stylegaussian::{
    Camera, Decoder, Scene, file,
    fold::{stylize, transfer},
    splat::{Colors, View, render},
};
use stylegaussian_encoder::{Image, StyleSize, resolve, style_statistics};

use crate::{
    cameras::read_cameras,
    cli::{
        default_decoder,
        output::{print, warn},
    },
    contact_sheet::contact_sheet,
    picture::{Background, Picture},
    recolor::{ColorMoments, Recoloring},
    teacher::Teacher,
    train::{encoder_path, paintings::list_images, scaled},
    views::{choose_views, orbit},
};
use consistency::{Agreement, Consistency, N_ORBIT, Pairs};
use judge::{Judge, Look, Statistics, nearest_other};
use report::{Evaluation, Measures, PaintingEvaluation};
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
    /// Pairs of the cameras whose views should agree, as JSON: {"short": [[0, 1], ...], "long": [[0, 7], ...]}. Otherwise
    /// pairs on an orbit of 36 views.
    #[arg(long, value_name = "FILE", requires = "cameras")]
    pairs: Option<PathBuf>,
    /// A decoder of 2D feature maps (safetensors, relu3_1 to RGB), for a yardstick: AdaIN on each view for itself.
    #[arg(long, value_name = "FILE")]
    teacher: Option<PathBuf>,
    /// Weights that stand in for VGG-19 at relu4_1, to tell the style error there too.
    #[arg(long, value_name = "FILE")]
    relu4: Option<PathBuf>,
    /// Writes a contact sheet here (PNG): a row for each painting, the unstyled scene first.
    #[arg(long, value_name = "FILE")]
    sheet: Option<PathBuf>,
    /// VGG-19 weights (safetensors), for AdaIN and the errors.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

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
    let views = Views::of(arguments, &scene)?;
    let evaluation = evaluate(arguments, &scene, &decoder, &views)?;
    print(arguments.json, &evaluation, || evaluation.table())
}

/// Where the scene is looked at from.
struct Views {
    /// For style and content.
    cameras: Vec<Camera>,
    /// For consistency.
    consistency: Consistency,
}

impl Views {
    fn of(arguments: &EvalArgs, scene: &Scene) -> Result<Self> {
        let (n_views, size) = (arguments.views as usize, UVec2::splat(arguments.size));
        let on_orbit = || Ok::<_, anyhow::Error>((orbit(scene, N_ORBIT, size), Pairs::of_orbit()?));
        let Some(path) = &arguments.cameras else {
            let (cameras, pairs) = on_orbit()?;
            let consistency = Consistency::new(scene, &cameras, &pairs);
            return Ok(Self { cameras: choose_views(scene, n_views, size), consistency });
        };
        let all = read_cameras(path)?.cameras;
        let all: Vec<Camera> = all.iter().map(|posed| scaled(&posed.camera, arguments.size)).collect();
        let stride = all.len().div_ceil(n_views).max(1);
        let consistency = match &arguments.pairs {
            Some(pairs) => Consistency::new(scene, &all, &Pairs::read(pairs, all.len())?),
            None => {
                let (cameras, pairs) = on_orbit()?;
                Consistency::new(scene, &cameras, &pairs)
            }
        };
        Ok(Self { cameras: all.into_iter().step_by(stride).collect(), consistency })
    }
}

fn evaluate(arguments: &EvalArgs, scene: &Scene, decoder: &Decoder, views: &Views) -> Result<Evaluation> {
    let features = scene.features.as_ref();
    let features =
        features.with_context(|| format!("{}: no features: embed it first", arguments.scene.display()))?;
    let encoder = resolve(arguments.encoder.as_deref())?;
    for (what, id) in [("scene", &features.encoder), ("decoder", &decoder.encoder)] {
        if let Some(id) = id {
            ensure!(id == encoder.id(), "the {what} belongs to encoder {id}, expected {}", encoder.id());
        }
    }
    let weights = encoder_path(arguments.encoder.as_deref());
    let judge = Judge::open(&weights, arguments.relu4.as_deref(), arguments.whole_picture)?;
    let paths = list_images(&arguments.styles)?;
    let images = paths.iter().map(|path| Image::open(path)).collect::<Result<Vec<_>, _>>()?;
    let targets: Vec<Statistics> = images.iter().map(|image| judge.painting(image)).collect();
    let Views { cameras, consistency } = views;
    let unstyled: Vec<View> = cameras.iter().map(|camera| render(scene, Colors::Sh, camera)).collect();
    let unstyled_looks: Vec<Look> = unstyled.iter().map(|view| judge.look(view)).collect();
    let neighboring: Vec<View> = consistency.unstyled().cloned().collect();

    let content_colors = ColorMoments::of_views(&unstyled);
    let bar = ProgressBar::new((images.len() * cameras.len()) as u64)
        .with_style(ProgressStyle::with_template("{bar:40} {pos}/{len} pictures, {eta} left")?);
    let yardstick = |views: &[View]| {
        let open = |path: &Path| Yardstick::new(Teacher::open(path)?, &encoder, views);
        arguments.teacher.as_deref().map(open).transpose()
    };
    let (yardstick, neighboring_yardstick) = (yardstick(&unstyled)?, yardstick(&neighboring)?);
    let mut kinds: [Vec<Measures>; 4] = Default::default();
    let (mut agreements, mut yardstick_agreements) = (Vec::new(), Vec::new());
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
        let along: Vec<View> =
            consistency.cameras().map(|camera| render(scene, Colors::Rgb(&colors), camera)).collect();
        agreements.push(consistency.measure(&judge, &along));
        if let Some(yardstick) = &neighboring_yardstick {
            let paint = |(i, before)| yardstick.paint(i, before, &style);
            let along = neighboring.iter().enumerate().map(paint).collect::<Result<Vec<_>>>()?;
            yardstick_agreements.push(consistency.measure(&judge, &along));
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
        consistency: Agreement::mean(&agreements),
        unstyled_consistency: consistency.measure(&judge, &neighboring),
        adain_2d_consistency: neighboring_yardstick.map(|_| Agreement::mean(&yardstick_agreements)),
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
