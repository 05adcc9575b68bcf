//! `stylegaussian eval`: measures how well a stylized scene shows its paintings.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use clap::Args;
use stylegaussian::{
    Camera, Scene,
    paint::{Canvas, Hand, Painted, Surface},
    restyle::{Recipe, Styles, WeightedLook, is_painted},
    work::Work,
};
use stylegaussian_encoder::{Image, paint_of};
use stylegaussian_files::read_look;
use stylegaussian_train::{
    TrainError, Watch,
    cameras::{CameraOptions, read_cameras_with},
    eval::{ImageDecoder, Judge, Outcome, Painter, Pairs, Subject, Views, decoded, evaluate},
    images::list_images,
};

use crate::{
    arguments::{SPLITS, within},
    choose::{self, FrameArgs, loss_weights, open_encoder, open_painting},
    hand::usable_paint_of,
    outputs::expect_files,
    scenes::ReadArgs,
    terminal::{Interrupt, ProgressLine, print, warn},
};

/// Measure how well a scene shows paintings: in their own paint, in the colors of a decoder that has never seen
/// them, or in baked looks. Strokes are drawn as they are seen.
///
/// Prints for every painting the style error of its pictures, that of the scene merely recolored, and the share
/// of views in which the painting is the nearest of all: by color and texture, and by texture alone.
#[derive(Args, Debug)]
pub struct EvalArgs {
    /// A scene in any format. A decoder needs an embedded one (.sgs).
    scene: PathBuf,
    #[command(flatten)]
    reading: ReadArgs,
    /// A folder of paintings (.jpg, .png and the like) that the decoder was not trained on.
    #[arg(long, value_name = "DIR")]
    styles: PathBuf,
    /// Cameras: transforms.json, a COLMAP model, or 3DGS cameras.json.
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    framing: FrameArgs,
    /// Number of views, spread over the cameras, or chosen to suit the scene if there are none.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    views: u32,
    /// Longer side of a view, in pixels. Paintings are seen at 512 x 512 pixels, or as many in their
    /// proportions.
    #[arg(
        long,
        value_name = "PX",
        default_value_t = 512,
        value_parser = clap::value_parser!(u32).range(32..=2048),
    )]
    size: u32,
    /// Longer side of the views for consistency, in pixels. If pixels are coarser than the scene, sampling
    /// between pixels dominates the difference.
    #[arg(
        long,
        value_name = "PX",
        default_value_t = 512,
        value_parser = clap::value_parser!(u32).range(32..=2048),
    )]
    consistency_size: u32,
    /// The decoder, *.decoder.safetensors. Default: the scene's own, else the built-in one.
    #[arg(long, value_name = "FILE")]
    decoder: Option<PathBuf>,
    /// Evaluate baked looks and not a decoder: a folder with NAME.look.safetensors for each painting NAME.jpg
    /// or NAME.png.
    #[arg(long, value_name = "DIR", conflicts_with = "decoder")]
    looks: Option<PathBuf>,
    /// Evaluate the decoder alone, as in the paper. Without this, --decoder or --looks, surfaces are painted
    /// with the paintings' own strokes, as `stylize` does.
    #[arg(long, conflicts_with = "looks")]
    decoder_only: bool,
    /// Paint with all paintings of the folder as one collection, and compare the same pictures with each.
    #[arg(long, conflicts_with_all = ["looks", "decoder", "decoder_only"])]
    collection: bool,
    /// Also paint a mesh beside the scene, a ball in the scene's colors, and judge it likewise.
    #[arg(long, conflicts_with_all = ["looks", "decoder", "decoder_only", "collection", "split_paint"])]
    mesh: bool,
    /// Also count pixels that the scene does not cover, as mid-gray. By default a picture's statistics are
    /// those of the scene alone.
    #[arg(long)]
    whole_picture: bool,
    /// Evaluate scenes as `stylize --split-paint` writes them: split, and drawn without strokes [default: 4 if
    /// no N is given].
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "4", value_parser = within(SPLITS))]
    split_paint: Option<f64>,
    /// Pairs of cameras whose views should agree, as JSON: {"short": [[0, 1], ...], "long": [[0, 7], ...]}.
    /// Default: pairs on an orbit of 36 views.
    #[arg(long, value_name = "FILE", requires = "cameras")]
    pairs: Option<PathBuf>,
    /// A decoder of 2D feature maps (safetensors, relu3_1 to RGB). Adds a baseline: AdaIN on each view
    /// separately.
    #[arg(long, value_name = "FILE")]
    teacher: Option<PathBuf>,
    /// Weights that replace VGG-19 at relu4_1. Adds the style error at that layer.
    #[arg(long, value_name = "FILE")]
    relu4: Option<PathBuf>,
    /// Write a contact sheet (PNG): a row for each painting, the unstyled scene first.
    #[arg(long, value_name = "FILE")]
    sheet: Option<PathBuf>,
    /// The encoder that the scene was embedded with: a file of `distill`, VGG-19 weights or an ONNX file.
    /// Default: the file in STYLEGAUSSIAN_ENCODER, else the built-in encoder.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// VGG-19 weights (safetensors) for the errors, if the encoder is not VGG-19.
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
pub fn run(arguments: &EvalArgs, interrupt: &Interrupt) -> Result<()> {
    expect_files(arguments.sheet.as_deref())?;
    let mut scene = arguments.reading.read(&arguments.scene)?.scene;
    arguments.framing.tell(&mut scene);
    let encoder_file = arguments.encoder.as_deref();
    let encoder = open_encoder(encoder_file)?;
    let weights = loss_weights(arguments.vgg.as_deref(), encoder_file)?;
    let judge = Judge::open(&weights, arguments.relu4.as_deref(), arguments.whole_picture)?;
    let decoder_2d = arguments.teacher.as_deref().map(ImageDecoder::open).transpose()?;
    let views = arguments.views(&scene)?;
    let name = arguments.scene.display().to_string();
    let named;
    // As `stylize` decides: a decoder that was trained for the scene, or is asked for, is what should be seen.
    let asks_for_decoder = arguments.decoder_only || arguments.decoder.is_some();
    let is_instant =
        arguments.looks.is_none() && !arguments.collection && is_painted(&scene, asks_for_decoder, true);
    ensure!(
        !arguments.mesh || is_instant,
        "{name}: found a decoder of its own, expected a scene that is painted, for --mesh"
    );
    let surface = is_instant.then(|| Surface::new(&scene, &Work::default())).transpose()?;
    let painter: Box<Painter> = match (&arguments.looks, &surface) {
        (Some(folder), _) => Box::new(|painting: &Path, _: &Image| baked(folder, painting, &scene)),
        (None, _) if arguments.collection => {
            let painted = collected(&list_images(&arguments.styles)?, &scene)?;
            Box::new(move |_: &Path, _: &Image| Ok(painted.clone()))
        }
        (None, Some(surface)) => Box::new(|_: &Path, image: &Image| {
            let canvas = Canvas::new(&paint_of(image));
            let painted = Recipe::painting(&canvas, surface).restyle(&scene, &Work::default());
            painted.map_err(|error| TrainError::Caused(error.into()))
        }),
        (None, None) => {
            named = choose::decoder(arguments.decoder.as_deref(), &scene)?;
            Box::new(decoded(&name, &scene, &named.decoder, &encoder)?)
        }
    };
    let split = arguments.split_paint;
    let mesh = surface.as_ref().filter(|_| arguments.mesh);
    let subject = Subject { scene: &scene, painter: &*painter, split, mesh, encoder: &encoder };

    let progress = ProgressLine::new();
    let watch = Watch { progress: &|now| progress.show(now), interrupted: interrupt.watch() };
    let paintings = list_images(&arguments.styles)?;
    let Outcome { evaluation, sheet } =
        evaluate(subject, &views, judge, paintings, decoder_2d.as_ref(), watch)?;
    progress.finish();
    if let Some(path) = &arguments.sheet {
        sheet.write_png(path)?;
    }
    print(arguments.json, &evaluation, || evaluation.table())
}

/// The scene in all paintings as one collection.
fn collected(paintings: &[PathBuf], scene: &Scene) -> Result<Painted> {
    let canvas = |path: &PathBuf| Ok(Canvas::new(&usable_paint_of(&open_painting(path)?, path)?));
    let canvases = paintings.iter().map(canvas).collect::<Result<Vec<_>>>()?;
    let surface = Surface::new(scene, &Work::default())?;
    let styles = Styles::Painted {
        paintings: canvases.iter().map(|canvas| (canvas, 1.0)).collect(),
        surface: &surface,
        hand: Hand { is_collection: true, ..Hand::default() },
    };
    Ok(Recipe { looks: Vec::new(), styles, content: 0.0 }.restyle(scene, &Work::default())?)
}

/// The look in `folder` that has the name of `painting`.
fn baked(folder: &Path, painting: &Path, scene: &Scene) -> Result<Painted, TrainError> {
    let name = painting.file_stem().unwrap_or_default().to_string_lossy();
    let path = folder.join(format!("{name}.look.safetensors"));
    let look = read_look(&path).map_err(|error| TrainError::Invalid(error.to_string()))?;
    let name = path.display().to_string();
    let looks = vec![WeightedLook { name: &name, look: &look, weight: 1.0 }];
    let recipe = Recipe { looks, styles: Styles::None, content: 0.0 };
    recipe.restyle(scene, &Work::default()).map_err(|error| TrainError::Caused(error.into()))
}

impl EvalArgs {
    fn views(&self, scene: &Scene) -> Result<Views> {
        let n = self.views as usize;
        let Some(path) = &self.cameras else {
            self.framing.warn(scene, &self.scene);
            return Ok(Views::choose(scene, n, self.size, self.consistency_size)?);
        };
        let options = CameraOptions { offset: scene.offset, ..CameraOptions::default() };
        let set = read_cameras_with(path, options)?;
        warn(&set.warnings);
        let cameras: Vec<Camera> = set.cameras.into_iter().map(|posed| posed.camera).collect();
        let pairs = self.pairs.as_deref().map(|path| Pairs::read(path, cameras.len())).transpose()?;
        let sizes = [self.size, self.consistency_size];
        Ok(Views::of_cameras(scene, &cameras, n, sizes, pairs.as_ref())?)
    }
}
