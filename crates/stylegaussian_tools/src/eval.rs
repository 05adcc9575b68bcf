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
    Camera, Decoder, Features, Scene, file,
    fold::{stylize, transfer},
    splat::{Colors, RenderedImage, render},
};
use stylegaussian_encoder::{Encoder, Image, StyleSize, style_statistics};

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
    train::{paintings::list_images, scaled},
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
    /// Longer side of the views that consistency is measured on, in pixels. Where a pixel is coarser than the scene, it is
    /// the warp's sampling between pixels that differs most.
    #[arg(long, value_name = "PX", default_value_t = 512, value_parser = clap::value_parser!(u32).range(32..=2048))]
    consistency_size: u32,
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
    /// The encoder that the scene was embedded with: an ONNX file, or VGG-19 weights. Otherwise the one that
    /// STYLEGAUSSIAN_ENCODER names, otherwise the default one.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// VGG-19 weights (safetensors) for the errors, where the encoder is something else.
    #[arg(long, value_name = "FILE")]
    vgg: Option<PathBuf>,
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
    let evaluation = evaluate(arguments, &Gallery::open(arguments, &scene, &decoder, &views)?)?;
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
        let orbit_size = UVec2::splat(arguments.consistency_size);
        let on_orbit = || Ok::<_, anyhow::Error>((orbit(scene, N_ORBIT, orbit_size), Pairs::of_orbit()?));
        let Some(path) = &arguments.cameras else {
            let (cameras, pairs) = on_orbit()?;
            let consistency = Consistency::new(scene, &cameras, &pairs);
            return Ok(Self { cameras: choose_views(scene, n_views, size), consistency });
        };
        let all = read_cameras(path)?.cameras;
        let at = |size| all.iter().map(|posed| scaled(&posed.camera, size)).collect::<Vec<Camera>>();
        let stride = all.len().div_ceil(n_views).max(1);
        let consistency = match &arguments.pairs {
            Some(pairs) => {
                let pairs = Pairs::read(pairs, all.len())?;
                Consistency::new(scene, &at(arguments.consistency_size), &pairs)
            }
            None => {
                let (cameras, pairs) = on_orbit()?;
                Consistency::new(scene, &cameras, &pairs)
            }
        };
        Ok(Self { cameras: at(arguments.size).into_iter().step_by(stride).collect(), consistency })
    }
}

/// The scene's views as they are, the paintings, and who compares them.
struct Gallery<'a> {
    scene: &'a Scene,
    decoder: &'a Decoder,
    features: &'a Features,
    encoder: Encoder,
    judge: Judge,
    views: &'a Views,
    unstyled: Vec<RenderedImage>,
    unstyled_looks: Vec<Look>,
    colors: ColorMoments,
    paths: Vec<PathBuf>,
    paintings: Vec<Image>,
    /// The paintings' statistics.
    targets: Vec<Statistics>,
    /// For the views, and for those of the consistency.
    yardsticks: Option<[Yardstick; 2]>,
}

/// What one painting made of the scene, measured view by view.
struct Exhibit {
    stylized: Vec<Measures>,
    unstyled: Vec<Measures>,
    recolored: Vec<Measures>,
    adain_2d: Vec<Measures>,
    agreement: Agreement,
    adain_2d_agreement: Option<Agreement>,
    out_of_range: f64,
    pictures: Vec<RenderedImage>,
}

impl<'a> Gallery<'a> {
    fn open(arguments: &EvalArgs, scene: &'a Scene, decoder: &'a Decoder, views: &'a Views) -> Result<Self> {
        let features = scene.features.as_ref();
        let features = features
            .with_context(|| format!("{}: no features: embed it first", arguments.scene.display()))?;
        let encoder = open_encoder(arguments.encoder.as_deref())?;
        for (what, id) in [("scene", &features.encoder), ("decoder", &decoder.encoder)] {
            if let Some(id) = id {
                ensure!(id == encoder.id(), "the {what} belongs to encoder {id}, expected {}", encoder.id());
            }
        }
        let weights = loss_weights(arguments.vgg.as_deref(), arguments.encoder.as_deref())?;
        let judge = Judge::open(&weights, arguments.relu4.as_deref(), arguments.whole_picture)?;
        let paths = list_images(&arguments.styles)?;
        let paintings = paths.iter().map(|path| Image::open(path)).collect::<Result<Vec<_>, _>>()?;
        let unstyled: Vec<RenderedImage> =
            views.cameras.iter().map(|camera| render(scene, Colors::Captured, camera)).collect();
        let yardstick = |path: &Path| {
            let of = |views: &[RenderedImage]| Yardstick::new(Teacher::open(path)?, &encoder, views);
            Ok::<_, anyhow::Error>([of(&unstyled)?, of(views.consistency.unstyled())?])
        };
        Ok(Self {
            yardsticks: arguments.teacher.as_deref().map(yardstick).transpose()?,
            targets: paintings.iter().map(|image| judge.painting(image)).collect(),
            unstyled_looks: unstyled.iter().map(|view| judge.look(view)).collect(),
            colors: ColorMoments::of_views(&unstyled),
            scene,
            decoder,
            features,
            encoder,
            judge,
            views,
            unstyled,
            paths,
            paintings,
        })
    }

    /// The scene in the style of painting `own`; `report` hears of every view.
    fn exhibit(&self, own: usize, report: impl Fn()) -> Result<Exhibit> {
        let image = &self.paintings[own];
        let style = style_statistics(&self.encoder, image, StyleSize::default())?;
        let colors = stylize(self.scene, self.decoder, &transfer(self.features, &[(&style, 1.0)], 0.0)?)?;
        let recoloring = Recoloring::new(&self.colors, &ColorMoments::of_image(image));
        let draw = |camera: &Camera| render(self.scene, Colors::Rgb(&colors), camera);
        let consistency = &self.views.consistency;
        let mut exhibit = Exhibit {
            agreement: consistency.measure(&self.judge, &consistency.cameras().map(draw).collect::<Vec<_>>()),
            adain_2d_agreement: None,
            stylized: Vec::new(),
            unstyled: Vec::new(),
            recolored: Vec::new(),
            adain_2d: Vec::new(),
            out_of_range: 0.0,
            pictures: self.views.cameras.iter().map(draw).collect(),
        };
        for (i, (before, view)) in self.unstyled.iter().zip(&exhibit.pictures).enumerate() {
            let measure = |look: &Look| look.measures(&self.unstyled_looks[i], &self.targets, own);
            exhibit.stylized.push(measure(&self.judge.look(view)));
            exhibit.unstyled.push(measure(&self.unstyled_looks[i]));
            exhibit.recolored.push(measure(&self.judge.look(&recoloring.view(before))));
            if let Some([yardstick, _]) = &self.yardsticks {
                exhibit.adain_2d.push(measure(&self.judge.look(&yardstick.paint(i, before, &style)?)));
            }
            exhibit.out_of_range += share_out_of_range(view) / self.unstyled.len() as f64;
            report();
        }
        if let Some([_, yardstick]) = &self.yardsticks {
            let paint = |(i, before)| yardstick.paint(i, before, &style);
            let painted = consistency.unstyled().iter().enumerate().map(paint).collect::<Result<Vec<_>>>()?;
            exhibit.adain_2d_agreement = Some(consistency.measure(&self.judge, &painted));
        }
        Ok(exhibit)
    }

    fn row(&self, own: usize, exhibit: &Exhibit) -> PaintingEvaluation {
        PaintingEvaluation {
            path: self.paths[own].clone(),
            nearest_other: nearest_other(&self.targets, own),
            stylized: Measures::mean(&exhibit.stylized),
            recolored: Measures::mean(&exhibit.recolored),
        }
    }
}

fn evaluate(arguments: &EvalArgs, gallery: &Gallery) -> Result<Evaluation> {
    let bar = ProgressBar::new((gallery.paintings.len() * gallery.unstyled.len()) as u64)
        .with_style(ProgressStyle::with_template("{bar:40} {pos}/{len} pictures, {eta} left")?);
    let mut sheet = vec![sheet_row(None, &gallery.unstyled)];
    let mut exhibits = Vec::new();
    for (own, painting) in gallery.paintings.iter().enumerate() {
        let mut exhibit = gallery.exhibit(own, || bar.inc(1))?;
        sheet.push(sheet_row(Some(painting), &std::mem::take(&mut exhibit.pictures)));
        exhibits.push(exhibit);
    }
    bar.finish_and_clear();
    if let Some(path) = &arguments.sheet {
        contact_sheet(&sheet, UVec2::splat(CELL)).write_png(path)?;
    }
    let mean = |kind: fn(&Exhibit) -> &Vec<Measures>| {
        Measures::mean(&exhibits.iter().flat_map(kind).copied().collect::<Vec<_>>())
    };
    let agreement = |of: &dyn Fn(&Exhibit) -> Option<Agreement>| {
        exhibits.iter().map(of).collect::<Option<Vec<_>>>().map(|all| Agreement::mean(&all))
    };
    let (stylized, recolored) = (mean(|e| &e.stylized), mean(|e| &e.recolored));
    let deep = |measures: &Measures| measures.style_errors[1] + measures.style_errors[2];
    let consistency = &gallery.views.consistency;
    Ok(Evaluation {
        deep_style_error_over_recolored: deep(&stylized) / deep(&recolored).max(f64::MIN_POSITIVE),
        stylized,
        unstyled: mean(|e| &e.unstyled),
        recolored,
        adain_2d: gallery.yardsticks.as_ref().map(|_| mean(|e| &e.adain_2d)),
        consistency: agreement(&|e| Some(e.agreement)).unwrap_or_default(),
        unstyled_consistency: consistency.measure(&gallery.judge, consistency.unstyled()),
        adain_2d_consistency: agreement(&|e| e.adain_2d_agreement),
        out_of_range: exhibits.iter().map(|e| e.out_of_range).sum::<f64>() / exhibits.len().max(1) as f64,
        paintings: exhibits.iter().enumerate().map(|(own, exhibit)| gallery.row(own, exhibit)).collect(),
    })
}

/// Of the color values where the scene covers more than half of a pixel.
fn share_out_of_range(view: &RenderedImage) -> f64 {
    let covered = || view.color.iter().zip(&view.alpha).filter(|(_, alpha)| **alpha > 0.5);
    let outside = covered().flat_map(|(color, alpha)| color.map(|c| c < -0.01 || c > alpha + 0.01));
    outside.filter(|outside| *outside).count() as f64 / (3 * covered().count().max(1)) as f64
}

fn sheet_row(painting: Option<&Image>, views: &[RenderedImage]) -> Vec<Picture> {
    let first = painting.map_or_else(|| Picture::filled(UVec2::ONE, [255; 4]), Picture::of_image);
    let views = views.iter().map(|view| Picture::of(view, Background::Color([255; 3])));
    std::iter::once(first).chain(views).collect()
}
