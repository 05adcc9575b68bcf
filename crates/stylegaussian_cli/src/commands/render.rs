//! `stylegaussian render`: renders pictures of a scene, unstyled or in a style.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, anyhow, ensure};
use clap::Args;
use glam::UVec2;
use serde::Serialize;
use stylegaussian::{Camera, Scene, splat::Colors, strokes::StrokeKnobs, views::orbit};
use stylegaussian_train::{
    cameras::{CameraOptions, CamerasError, read_cameras_with},
    picture::{Background, Picture},
};

use crate::{
    arguments::{MAX_PIXELS, MAX_SIDE, background, is_drawable, picture_size},
    choose::{FrameArgs, expect_seen},
    compute::Drawing,
    masks::MaskArgs,
    motion::MotionArgs,
    outputs::{expect_files, expect_folder},
    relief::ReliefArgs,
    scenes::ReadArgs,
    stylization::{Stylization, StylizationArgs},
    terminal::{bar, lossy, print, warn},
};

/// Views of `--orbit` if neither cameras nor a number is given.
const DEFAULT_ORBIT: u32 = 8;
/// Size of the pictures of `--orbit` if `--size` is not given, in pixels.
const DEFAULT_SIZE: UVec2 = UVec2::new(800, 600);

/// Render a scene to a PNG file, or to a folder of files 000000.png, 000001.png, ... in the order of cameras or
/// of time.
#[derive(Args, Debug)]
#[command(mut_arg("content", |content| content.requires("restyling")))]
#[command(mut_arg("decoder", |decoder| decoder.requires("styles")))]
pub struct RenderArgs {
    /// A scene in any format: `stylegaussian --help` lists them.
    scene: PathBuf,
    #[command(flatten)]
    reading: ReadArgs,
    #[command(flatten)]
    stylization: StylizationArgs,
    #[command(flatten)]
    masking: MaskArgs,
    /// Number of views on a circle around the scene. Default: the frames, or 8, or 1 for a PNG file, unless
    /// cameras are given.
    #[arg(
        long,
        value_name = "N",
        conflicts_with = "cameras",
        value_parser = clap::value_parser!(u32).range(1..=999_999),
    )]
    orbit: Option<u32>,
    /// Cameras: transforms.json, a COLMAP model, or 3DGS cameras.json.
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    framing: FrameArgs,
    #[command(flatten)]
    moving: MotionArgs,
    #[command(flatten)]
    relief: ReliefArgs,
    /// Let strokes keep their size on screen, whatever the distance.
    #[arg(long, requires = "restyling")]
    screen_stable: bool,
    /// Size of the pictures in pixels. Default: each camera's own, and 800x600 for an orbit. Files of cameras
    /// with angles of view alone need it.
    #[arg(long, value_name = "WxH", value_parser = picture_size)]
    size: Option<UVec2>,
    /// Background of the scene: `transparent` or a color.
    #[arg(long, value_name = "transparent|RRGGBB", default_value = "transparent", value_parser = background)]
    background: Background,
    /// The folder for the pictures, which is created if it does not exist; or a PNG file, for one picture.
    #[arg(short, long, value_name = "DIR|OUT.png")]
    output: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Rendered<'a> {
    #[serde(serialize_with = "lossy")]
    scene: &'a Path,
    pictures: Vec<RenderedPicture>,
    /// The device that drew: `cpu` or `gpu`.
    drawn_by: &'static str,
    #[serde(flatten)]
    stylization: Option<&'a Stylization>,
}

#[derive(Serialize)]
struct RenderedPicture {
    #[serde(serialize_with = "lossy")]
    path: PathBuf,
    /// Width and height, in pixels.
    size: [u32; 2],
}

/// Runs the command.
pub fn run(arguments: &RenderArgs) -> Result<()> {
    let RenderArgs { scene: path, stylization, masking, output, json, .. } = arguments;
    let mut compute = stylization.open()?;
    if is_picture(output) {
        expect_files([&**output])?
    } else {
        expect_folder(output)?
    };
    let mut scene = arguments.reading.read(path)?.scene;
    let mask = masking.open(&scene, path)?;
    arguments.framing.tell(&mut scene);
    let cameras = arguments.cameras(&scene)?;
    let mut stylized =
        if stylization.is_given() { Some(stylization.stylize(&scene, path, &mut compute)?) } else { None };
    if let Some(stylized) = &mut stylized {
        masking.limit(&scene, &mut stylized.shown.strokes, mask.as_ref());
    }
    let styled = stylized.as_ref().map(|stylized| &stylized.shown.colors[..]);
    let mixed = styled.and_then(|styled| masking.mixed(&scene, styled, mask.as_ref()));
    let colors = match (&mixed, styled) {
        (Some(mixed), _) => Colors::Mixed(mixed),
        (None, Some(styled)) => Colors::Rgb(styled),
        (None, None) => Colors::Captured,
    };
    masking.hide(&mut scene, mask.as_ref());
    let strokes = stylized.as_ref().map(|stylized| &stylized.shown.strokes);
    let knobs = StrokeKnobs { screen_stable: arguments.screen_stable, ..arguments.relief.knobs(&scene) };
    let mut drawing = compute.drawing(&scene, colors, strokes, knobs, arguments.moving.motion())?;
    let pictures = render_all(&mut drawing, &cameras, arguments.background, output)?;
    let n_pictures = pictures.len();
    let drawn_by = drawing.name();
    let rendered = Rendered { scene: path, pictures, drawn_by, stylization: stylized.as_ref() };
    print(*json, &rendered, || match is_picture(output) {
        true => format!("{}: one picture", output.display()),
        false => format!("{n_pictures} pictures in {}", output.display()),
    })
}

/// Whether the output is one picture and no folder.
fn is_picture(output: &Path) -> bool {
    output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) && !output.is_dir()
}

impl RenderArgs {
    /// The camera of each picture, at its size, and the time in seconds.
    fn cameras(&self, scene: &Scene) -> Result<Vec<(Camera, f64)>> {
        let cameras = match &self.cameras {
            Some(path) => {
                let options = CameraOptions { size: self.size, offset: scene.offset };
                let cameras = cameras_of_file(path, options)?;
                cameras.into_iter().map(|camera| camera.near_among(&scene.means)).collect()
            }
            None => {
                let usual = if is_picture(&self.output) { 1 } else { DEFAULT_ORBIT };
                let n = self.orbit.or(self.moving.frames).unwrap_or(usual);
                let size = self.size.unwrap_or(DEFAULT_SIZE);
                let cameras = expect_seen(orbit(scene, n as usize, size), scene, &self.scene)?;
                self.framing.warn(scene, &self.scene);
                cameras
            }
        };
        let cameras = self.moving.timed(cameras);
        let n = cameras.len();
        ensure!(
            n == 1 || !is_picture(&self.output),
            "{}: found {n} views, expected one for a PNG file; name a folder for more",
            self.output.display()
        );
        // An orbit's cameras have this size already, and stay as they are.
        let resize = |camera: Camera| self.size.map_or(camera.clone(), |size| camera.resized(size));
        Ok(cameras.into_iter().map(|(camera, seconds)| (resize(camera), seconds)).collect())
    }
}

fn render_all(
    drawing: &mut Drawing,
    cameras: &[(Camera, f64)],
    background: Background,
    output: &Path,
) -> Result<Vec<RenderedPicture>> {
    let is_picture = is_picture(output);
    if !is_picture {
        fs::create_dir_all(output)
            .with_context(|| format!("{}: cannot make the folder", output.display()))?;
    }
    let progress = bar(cameras.len() as u64, "{bar:40} {pos}/{len} pictures, {eta} left");
    let mut pictures = Vec::with_capacity(cameras.len());
    let mut n_empty = 0;
    for (i, (camera, seconds)) in cameras.iter().enumerate() {
        let path = if is_picture { output.into() } else { output.join(format!("{i:06}.png")) };
        let view = drawing.view(camera, *seconds)?;
        n_empty += usize::from(view.alpha.iter().all(|&alpha| alpha <= 0.0));
        Picture::of(&view, background).write_png(&path)?;
        pictures.push(RenderedPicture { path, size: camera.size.to_array() });
        progress.inc(1);
    }
    progress.finish_and_clear();
    if n_empty > 0 {
        warn([format!("{n_empty} of {} pictures show nothing of the scene", pictures.len())]);
    }
    Ok(pictures)
}

/// Cameras of a file, checked for the size of their pictures, which is that of the options if they have one.
fn cameras_of_file(path: &Path, options: CameraOptions) -> Result<Vec<Camera>> {
    let set = read_cameras_with(path, options).map_err(|error| match error {
        CamerasError::PhotoSize { .. } => anyhow!("{error}; --size gives it"),
        error => error.into(),
    })?;
    warn(&set.warnings);
    for posed in &set.cameras {
        let size = options.size.unwrap_or(posed.camera.size);
        ensure!(
            is_drawable(size),
            "{}: camera {}: found {}x{} pixels, expected 1 to {MAX_SIDE} on a side and at most \
             {MAX_PIXELS} together; --size gives others",
            path.display(),
            posed.name,
            size.x,
            size.y
        );
    }
    Ok(set.cameras.into_iter().map(|posed| posed.camera).collect())
}
