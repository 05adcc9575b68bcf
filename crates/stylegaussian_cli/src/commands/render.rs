//! `stylegaussian render`: renders pictures or a film of a scene, unstyled or in a style.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, anyhow, bail, ensure};
use clap::Args;
use glam::UVec2;
use indicatif::ProgressBar;
use serde::Serialize;
use stylegaussian::{Camera, Scene, splat::Colors, strokes::StrokeKnobs, views::orbit};
use stylegaussian_train::{
    cameras::{CameraOptions, CameraSet, CamerasError, read_cameras_with},
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
    terminal::{Interrupt, bar, lossy, print, warn},
    video::{Film, Format},
};

mod levels;

use levels::LevelArgs;

/// Views of `--orbit` if neither cameras nor a number is given.
const DEFAULT_ORBIT: u32 = 8;
/// Views of a film if neither cameras nor a number is given: four seconds.
const DEFAULT_FRAMES: u32 = 120;
/// Size of the pictures of `--orbit` if `--size` is not given, in pixels.
const DEFAULT_SIZE: UVec2 = UVec2::new(800, 600);

/// Render a scene to a PNG file, to a folder of files 000000.png, 000001.png, ... in the order of cameras or of
/// time, or to a film.
#[derive(Args, Debug)]
#[command(mut_arg("content", |content| content.requires("restyling")))]
#[command(mut_arg("decoder", |decoder| decoder.requires("styles")))]
pub struct RenderArgs {
    /// A scene in any format: `stylegaussian --help` lists them.
    scene: PathBuf,
    #[command(flatten)]
    reading: ReadArgs,
    #[command(flatten)]
    levels: LevelArgs,
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
    /// Cameras: transforms.json, a COLMAP model, or 3DGS cameras.json. Of a film, each is a frame, unless
    /// --frames is given.
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
    /// with angles of view alone need it. Other proportions than a camera's squeeze its picture.
    #[arg(long, value_name = "WxH", value_parser = picture_size)]
    size: Option<UVec2>,
    /// Background of the scene: `transparent` or a color.
    #[arg(long, value_name = "transparent|RRGGBB", default_value = "transparent", value_parser = background)]
    background: Background,
    /// The folder for the pictures, which is created if it does not exist; or a PNG file, for one picture.
    #[arg(short, long, value_name = "DIR|OUT.png", required_unless_present = "video")]
    output: Option<PathBuf>,
    /// Write a film and no pictures: OUT.mp4 or OUT.webm, for which the program `ffmpeg` must be installed, or
    /// OUT.webp, an animated WebP without loss, for which nothing is needed. An .mp4 shows black where the
    /// background is transparent.
    #[arg(long, value_name = "OUT.mp4|.webm|.webp", conflicts_with = "output")]
    video: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Rendered<'a> {
    #[serde(serialize_with = "lossy")]
    scene: &'a Path,
    /// The pictures, or one film.
    pictures: Vec<RenderedPicture>,
    /// Number of frames of a film.
    #[serde(skip_serializing_if = "Option::is_none")]
    n_frames: Option<usize>,
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
///
/// # Errors
/// The message names the file or the option at fault.
pub fn run(arguments: &RenderArgs, interrupt: &Interrupt) -> Result<()> {
    let RenderArgs { scene: path, stylization, masking, json, .. } = arguments;
    let output = arguments.output();
    // Before anything is read, because it may be a usage error.
    let film = arguments.video.as_deref().map(Format::of).transpose()?;
    let mut compute = stylization.open()?;
    if film.is_some() || is_picture(output) {
        expect_files([output])?
    } else {
        expect_folder(output)?
    };
    let mut scene = arguments.levels.read(path, arguments.reading, || arguments.seeing())?;
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
    let mut pictures = Pictures::new(&mut drawing, &cameras);
    let written = match film {
        Some(format) => arguments.film(&mut pictures, format, interrupt)?,
        None => pictures.write(arguments.background, output)?,
    };
    pictures.finish(path);
    let (n_pictures, n_frames) = (written.len(), film.map(|_| cameras.len()));
    let (drawn_by, stylization) = (drawing.name(), stylized.as_ref());
    let rendered = Rendered { scene: path, pictures: written, n_frames, drawn_by, stylization };
    print(*json, &rendered, || match n_frames {
        Some(n) => format!("{}: {n} frames", output.display()),
        None if is_picture(output) => format!("{}: one picture", output.display()),
        None => format!("{n_pictures} pictures in {}", output.display()),
    })
}

/// Whether the output is one picture and no folder.
fn is_picture(output: &Path) -> bool {
    output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) && !output.is_dir()
}

impl RenderArgs {
    /// The film, the picture or the folder that is written.
    fn output(&self) -> &Path {
        // Clap has checked that one of them is given.
        self.video.as_deref().or(self.output.as_deref()).unwrap_or(Path::new(""))
    }

    /// Writes a film of all views.
    fn film(
        &self,
        pictures: &mut Pictures,
        format: Format,
        interrupt: &Interrupt,
    ) -> Result<Vec<RenderedPicture>> {
        let path = self.output();
        let Some(size) = pictures.cameras.first().map(|(camera, _)| camera.size) else {
            bail!("{}: found no camera, expected at least one", path.display());
        };
        if let Some(other) =
            pictures.cameras.iter().map(|(camera, _)| camera.size).find(|other| *other != size)
        {
            bail!(
                "{}: found pictures of {}x{} and of {}x{} pixels, expected one size; --size gives it",
                path.display(),
                size.x,
                size.y,
                other.x,
                other.y
            );
        }
        let background = format.background(self.background);
        let (frames_per_second, n_frames) = (self.moving.fps, pictures.cameras.len());
        let is_transparent = background == Background::Transparent;
        Film { path, format, size, frames_per_second, n_frames, is_transparent }
            .write(interrupt.watch(), |i| pictures.draw(i, background))?;
        Ok(vec![RenderedPicture { path: path.into(), size: size.to_array() }])
    }

    /// The cameras of the file at the size of the pictures, before a scene is read. A world has no offset.
    fn seeing(&self) -> Result<Vec<Camera>> {
        let Some(path) = &self.cameras else { return Ok(Vec::new()) };
        let options = CameraOptions { size: self.size, ..CameraOptions::default() };
        let cameras = set_of_file(path, options)?.cameras.into_iter().map(|posed| posed.camera);
        Ok(cameras.map(|camera| self.resized(camera)).collect())
    }

    /// A camera at the size that is asked for.
    fn resized(&self, camera: Camera) -> Camera {
        self.size.map_or(camera.clone(), |size| camera.resized(size))
    }

    /// Warns if the size that is asked for has other proportions than cameras of the file at `path`.
    fn warn_of_squeezed(&self, path: &Path, cameras: &[Camera]) {
        let Some(to) = self.size else { return };
        let sizes = cameras.iter().map(|camera| camera.size);
        let squeezed: Vec<UVec2> = sizes.filter(|from| is_squeezed(*from, to)).collect();
        if let Some(from) = squeezed.first() {
            let height = u64::from(to.x) * u64::from(from.y) / u64::from(from.x).max(1);
            warn([format!(
                "{}: {} of {} pictures are squeezed, the first from {}x{} to {}x{}; --size {}x{} would keep \
                 its proportions",
                path.display(),
                squeezed.len(),
                cameras.len(),
                from.x,
                from.y,
                to.x,
                to.y,
                to.x,
                height.max(1)
            )]);
        }
    }

    /// The camera of each picture, at its size, and the time in seconds.
    fn cameras(&self, scene: &Scene) -> Result<Vec<(Camera, f64)>> {
        let cameras = match &self.cameras {
            Some(path) => {
                let options =
                    CameraOptions { size: self.size, offset: scene.offset, ..CameraOptions::default() };
                let cameras = cameras_of_file(path, options)?;
                self.warn_of_squeezed(path, &cameras);
                cameras.into_iter().map(|camera| camera.near_among(&scene.means)).collect()
            }
            None => {
                let usual = match &self.video {
                    Some(_) => DEFAULT_FRAMES,
                    None if is_picture(self.output()) => 1,
                    None => DEFAULT_ORBIT,
                };
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
            n == 1 || self.video.is_some() || !is_picture(self.output()),
            "{}: found {n} views, expected one for a PNG file; name a folder for more",
            self.output().display()
        );
        // An orbit's cameras have this size already, and stay as they are.
        Ok(cameras.into_iter().map(|(camera, seconds)| (self.resized(camera), seconds)).collect())
    }
}

/// Pictures from all cameras at their times in seconds, drawn one after another.
struct Pictures<'a, 'b> {
    drawing: &'a mut Drawing<'b>,
    cameras: &'a [(Camera, f64)],
    progress: ProgressBar,
    /// Number of those that show nothing.
    n_empty: usize,
}

impl<'a, 'b> Pictures<'a, 'b> {
    fn new(drawing: &'a mut Drawing<'b>, cameras: &'a [(Camera, f64)]) -> Self {
        let progress = bar(cameras.len() as u64, "{bar:40} {pos}/{len} pictures, {eta} left");
        Self { drawing, cameras, progress, n_empty: 0 }
    }

    /// Picture `i`.
    fn draw(&mut self, i: usize, background: Background) -> Result<Picture> {
        let (camera, seconds) = &self.cameras[i];
        let view = self.drawing.view(camera, *seconds)?;
        self.n_empty += usize::from(view.alpha.iter().all(|&alpha| alpha <= 0.0));
        self.progress.set_position(i as u64 + 1);
        Ok(Picture::of(&view, background))
    }

    /// Writes all to PNG files.
    fn write(&mut self, background: Background, output: &Path) -> Result<Vec<RenderedPicture>> {
        let is_picture = is_picture(output);
        if !is_picture {
            fs::create_dir_all(output)
                .with_context(|| format!("{}: cannot make the folder", output.display()))?;
        }
        let mut written = Vec::with_capacity(self.cameras.len());
        for i in 0..self.cameras.len() {
            let path = if is_picture { output.into() } else { output.join(format!("{i:06}.png")) };
            self.draw(i, background)?.write_png(&path)?;
            written.push(RenderedPicture { path, size: self.cameras[i].0.size.to_array() });
        }
        Ok(written)
    }

    /// Removes the bar, and tells of pictures that show nothing of the scene at `path`.
    fn finish(self, path: &Path) {
        self.progress.finish_and_clear();
        if self.n_empty > 0 {
            let (n_empty, n) = (self.n_empty, self.cameras.len());
            warn([format!("{}: {n_empty} of {n} pictures show nothing of the scene", path.display())]);
        }
    }
}

/// Whether pictures of the size `from` have other proportions at the size `to`: by more than a hundredth, and
/// by more than a pixel, since sides of scaled pictures are rounded.
fn is_squeezed(from: UVec2, to: UVec2) -> bool {
    let scale = to.as_dvec2() / from.as_dvec2();
    let off = (scale.min_element() / scale.max_element() - 1.0).abs();
    off > 0.01 && off * f64::from(to.max_element()) > 1.0
}

/// Reads a file of cameras.
fn set_of_file(path: &Path, options: CameraOptions) -> Result<CameraSet> {
    read_cameras_with(path, options).map_err(|error| match error {
        CamerasError::PhotoSize { .. } => anyhow!("{error}; --size gives it"),
        error => error.into(),
    })
}

/// Cameras of a file, checked for the size of their pictures, which is that of the options if they have one.
fn cameras_of_file(path: &Path, options: CameraOptions) -> Result<Vec<Camera>> {
    let set = set_of_file(path, options)?;
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
