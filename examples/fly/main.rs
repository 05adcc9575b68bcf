//! A flight through a world, without a window: what its frames cost, what memory it takes, and how its picture
//! is beside the same Gaussians as one scene, beside the coarsest level, and beside the full resolution.
//!
//! ```sh
//! cargo xtask world --gaussians 100000000 -o FOLDER    # a world of any size
//! cargo xtask fly FOLDER --style assets/styles/strokes.jpg
//! ```
//!
//! The camera and the game's time are the same on every machine. Frames are drawn one after the other, and each
//! is waited for. What is compared with the flight is drawn after it, so that its memory is not counted.

use std::{
    f32::consts::PI,
    fs,
    ops::Range,
    path::{Path as FilePath, PathBuf},
    time::Instant,
};

use anyhow::{Context, Result, anyhow, ensure};
use bevy::prelude::*;
use bevy_stylegaussian::{
    prelude::*,
    stylegaussian_files::{
        ReadOptions, read_scene, read_scene_with,
        world::{FILE, World as Levels},
    },
};
use clap::Parser;

mod figures;
mod path;
mod report;
mod stage;

use figures::{Picture, difference, holes, mean, percentile, popping, psnr};
use path::Path;
use report::Report;
use stage::{Clock, Stage, memory, milliseconds};

/// Flies through a world without a window, and prints what its frames cost, what memory it takes, and how its
/// picture is.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask fly")]
struct Arguments {
    /// The folder of the world (`lod-meta.json`), whose y axis points down, as in captures.
    folder: PathBuf,
    /// Frames of the flight, each a thirtieth of a second, 100 at least.
    #[arg(long, value_name = "N", default_value_t = 600, value_parser = clap::value_parser!(u32).range(100..))]
    frames: u32,
    /// The most Gaussians that are shown.
    #[arg(long, value_name = "N", default_value_t = GaussianBudget::default().gaussians)]
    budget: usize,
    /// Width and height of the picture in pixels.
    #[arg(long, value_name = "WxH", default_value = "480x270", value_parser = size)]
    size: UVec2,
    /// An image in whose style the world is painted during the flight.
    #[arg(long, value_name = "IMAGE")]
    style: Option<PathBuf>,
    /// The frame in which the style changes, after the middle of the flight, where the world is in view
    /// [default: the first one that is not compared].
    #[arg(long, value_name = "FRAME", requires = "style")]
    style_at: Option<u32>,
    /// Also compare with the full resolution. All of it must fit in memory.
    #[arg(long)]
    against_full: bool,
    /// Run the main thread's systems one after another, and measure its CPU time in place of wall time, which
    /// counts waiting for a core as well. Linux alone tells it.
    #[arg(long)]
    cpu_time: bool,
    /// Also write the figures to this file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Frames in which the world stands still before the flight.
const IDLE: usize = 60;

/// Places of the flight at which its picture is compared with the coarsest level.
const CHECKS: usize = 20;

/// Places at which the settled picture is compared with the full resolution.
const HALTS: usize = 5;

/// Frames around the middle of the flight that are compared with a fixed scene, as a share of all.
const COMPARED: f32 = 0.1;

/// Frames of the compared scene that are not counted, in which it settles.
const WARM_UP: usize = 3;

/// Milliseconds over the idle median beyond which a frame's main-thread part is counted: a quarter of a frame
/// at 60 Hz.
const OVER_IDLE: f64 = 4.0;

/// Bytes of a megabyte.
const MB: f64 = 1e6;

/// Measurements of the frames of a flight.
#[derive(Default)]
struct Flown {
    /// Main-thread times of a world that stands still, in milliseconds.
    idle: Vec<f64>,
    wall: Vec<f64>,
    main: Vec<f64>,
    shown: Vec<f64>,
    /// Bytes of this process and on the GPU, as far as they are known.
    resident: Vec<f64>,
    on_gpu: Vec<f64>,
    /// The most bytes of this process since its start.
    most_resident: Option<f64>,
    /// The difference of each frame from the one before, and whether levels changed.
    differences: Vec<f64>,
    is_switch: Vec<bool>,
    /// Pictures by their frames.
    checks: Vec<(usize, Picture)>,
    /// Milliseconds from the change of style until all in view is painted, and until everything is.
    painted: [Option<f64>; 2],
    /// The most parts that are in view without paint after that.
    n_unpainted: usize,
}

/// Measurements of a fixed scene, which the flight is compared with.
#[derive(Default)]
struct Fixed {
    n_gaussians: usize,
    wall: Vec<f64>,
    differences: Vec<f64>,
    /// Milliseconds from the style to its paint.
    painted: Option<f64>,
}

/// A flight that is to be.
struct Flight {
    stage: Stage,
    path: Path,
    n_frames: usize,
    world: Entity,
    /// Captures have y down.
    place: Transform,
    /// The style, and the frame in which it comes.
    style: Option<(StyleSource, usize)>,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let folder = fs::canonicalize(&arguments.folder);
    let manifest = folder.with_context(|| arguments.folder.display().to_string())?.join(FILE);
    let bytes = fs::read(&manifest).with_context(|| manifest.display().to_string())?;
    let levels = Levels::read(&bytes).map_err(|mismatch| mismatch.at(&manifest))?;
    let mut flight = Flight::new(&arguments, &manifest, &levels)?;
    let flown = flight.fly()?;
    let halts = if arguments.against_full { flight.halt()? } else { Vec::new() };
    let fixed = flight.beside_fixed()?;
    let holes = flight.beside_coarsest(&manifest, &flown.checks)?;
    let psnr = if arguments.against_full { flight.beside_full(&manifest, &halts)? } else { Vec::new() };
    let mut report = Report::default();
    report.add("frames", flown.wall.len() as f64, "");
    report.add("budget", arguments.budget as f64, "Gaussians");
    report.add("files that could not be had", flight.stage.failed.len() as f64, "");
    flown.tell(&mut report);
    fixed.tell(&flown, flight.compared(), &mut report);
    report.add("holes: mean share of pixels", mean(&holes), "");
    report.add("holes: largest share of pixels", percentile(&holes, 1.0), "");
    report.add("settled beside the full resolution: mean PSNR", mean(&psnr), "dB");
    report.add("settled beside the full resolution: least PSNR", percentile(&psnr, 0.0), "dB");
    print!("{}", report.table());
    flight.stage.failed.iter().for_each(|error| eprintln!("{error}"));
    if let Some(path) = &arguments.json {
        fs::write(path, report.json()).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// Parses `WxH`.
fn size(text: &str) -> Result<UVec2, String> {
    let sides = text.split_once('x').and_then(|(x, y)| Some(UVec2::new(x.parse().ok()?, y.parse().ok()?)));
    // 8192 is what every adapter can draw.
    let sides = sides.filter(|sides| sides.min_element() > 0 && sides.max_element() <= 8192);
    sides.ok_or_else(|| format!("found `{text}`, expected two numbers of 1 to 8192, as in 480x270"))
}

/// The box of a world's part, up being y.
fn upright([low, high]: [Vec3; 2]) -> [Vec3; 2] {
    [Vec3::new(low.x, -high.y, -high.z), Vec3::new(high.x, -low.y, -low.z)]
}

impl Flight {
    fn new(arguments: &Arguments, manifest: &FilePath, levels: &Levels) -> Result<Self> {
        let boxes: Vec<[Vec3; 2]> = levels.nodes.iter().map(|node| upright(node.bounds)).collect();
        let path = Path::over(&boxes).with_context(|| format!("{}: no parts", manifest.display()))?;
        let clock = if arguments.cpu_time { Clock::MainThread } else { Clock::Wall(Instant::now()) };
        let mut stage = Stage::new(arguments.size, path.lens(), clock)?;
        stage.move_to(path.pose(0.0));
        let place = Transform::from_rotation(Quat::from_rotation_x(PI));
        let budget = GaussianBudget::new(arguments.budget);
        let app = stage.app.insert_resource(budget).world_mut();
        let assets = app.resource::<AssetServer>().clone();
        let world = app.spawn((GaussianWorld(assets.load(manifest.to_path_buf())), place)).id();
        let mut flight = Self { stage, path, n_frames: arguments.frames as usize, world, place, style: None };
        if let Some(path) = &arguments.style {
            let free = flight.compared().end..flight.n_frames;
            let at = arguments.style_at.map_or(free.start, |at| at as usize);
            ensure!(free.contains(&at), "--style-at {at}: expected {} to {}", free.start, free.end - 1);
            let path = fs::canonicalize(path).with_context(|| path.display().to_string())?;
            let image: Handle<Image> = assets.load(path.clone());
            flight.stage.until("the style's image", |app| {
                let server = app.resource::<AssetServer>();
                server.is_loaded(&image) || server.load_state(&image).is_failed()
            })?;
            let is_there = flight.stage.app.world().resource::<Assets<Image>>().contains(&image);
            ensure!(is_there, "{}: cannot be read, expected a .jpg or .png image", path.display());
            flight.style = Some((StyleSource::image(image), at));
        }
        Ok(flight)
    }

    /// The camera in a frame of the flight.
    fn pose(&self, frame: usize) -> Transform {
        self.path.pose(frame as f32 / (self.n_frames - 1) as f32)
    }

    /// The frames that are compared with a fixed scene.
    fn compared(&self) -> Range<usize> {
        let middle = self.n_frames / 2;
        let half = (0.5 * COMPARED * self.n_frames as f32) as usize;
        middle - half..middle + half
    }

    fn state(&self) -> WorldState {
        self.stage.app.world().get::<WorldState>(self.world).copied().unwrap_or_default()
    }

    /// Waits until all parts are as the camera asks for.
    fn settle(&mut self) -> Result<()> {
        let world = self.world;
        let settled = self.stage.until("a settled world", |app| {
            let state = app.get::<WorldState>(world);
            state.is_some_and(|state| state.is_settled() && state.arriving == 0 && state.loading == 0)
        });
        settled.map_err(|error| anyhow!("{error:#}: {:?}, {}", self.state(), self.stage.failed.join(", ")))
    }

    /// Flies.
    fn fly(&mut self) -> Result<Flown> {
        eprintln!("the first view");
        self.settle()?;
        let mut flown = Flown::default();
        for _ in 0..IDLE {
            flown.idle.push(self.stage.step()?.main);
        }
        let (mut before, mut runs) = (self.stage.picture()?, self.stage.runs(self.world).shown);
        let mut changed: Option<Instant> = None;
        let mut was_arriving = false;
        eprintln!("the flight");
        for frame in 0..self.n_frames {
            if let Some((style, at)) = &self.style
                && *at == frame
            {
                self.stage.app.world_mut().entity_mut(self.world).insert(style.clone());
                changed = Some(Instant::now());
            }
            self.stage.move_to(self.pose(frame));
            let times = self.stage.step()?;
            flown.wall.push(times.wall);
            flown.main.push(times.main);
            flown.resident.extend(memory("VmRSS").map(|bytes| bytes as f64));
            flown.on_gpu.extend(self.stage.gpu_bytes().map(|bytes| bytes as f64));
            let (state, picture) = (self.state(), self.stage.picture()?);
            flown.shown.push(state.shown as f64);
            flown.differences.push(difference(&before, &picture));
            let now = self.stage.runs(self.world);
            // Levels fade while others are in memory beside them.
            let is_arriving = state.arriving > 0;
            flown.is_switch.push(now.shown != runs || is_arriving || was_arriving);
            flown.note_paint(changed, now.n_unpainted, state.unstyled);
            if frame.is_multiple_of(self.n_frames.div_ceil(CHECKS)) {
                flown.checks.push((frame, picture.clone()));
            }
            (before, runs, was_arriving) = (picture, now.shown, is_arriving);
        }
        flown.most_resident = memory("VmHWM").map(|bytes| bytes as f64);
        if changed.is_some() {
            eprintln!("the paint");
        }
        while let Some(begun) = changed.filter(|_| flown.painted.contains(&None)) {
            self.stage.step()?;
            let (n_unpainted, state) = (self.stage.runs(self.world).n_unpainted, self.state());
            flown.note_paint(changed, n_unpainted, state.unstyled);
            ensure!(begun.elapsed() < stage::LIMIT, "not painted: {state:?}");
        }
        self.stage.app.world_mut().entity_mut(self.world).remove::<StyleSource>();
        Ok(flown)
    }

    /// Settled pictures at some places.
    fn halt(&mut self) -> Result<Vec<(usize, Picture)>> {
        eprintln!("the settled pictures");
        let mut pictures = Vec::new();
        for halt in 0..HALTS {
            let frame = (self.n_frames - 1) * halt / (HALTS - 1);
            self.stage.move_to(self.pose(frame));
            // The next cut is a few frames later.
            (0..IDLE).try_for_each(|_| self.stage.step().map(drop))?;
            self.settle()?;
            pictures.push((frame, self.stage.picture()?));
        }
        Ok(pictures)
    }

    /// Flies over the Gaussians that the world shows in the middle of the flight, as one scene. The world goes.
    fn beside_fixed(&mut self) -> Result<Fixed> {
        eprintln!("the fixed scene");
        let compared = self.compared();
        self.stage.move_to(self.pose(self.n_frames / 2));
        (0..IDLE).try_for_each(|_| self.stage.step().map(drop))?;
        self.settle()?;
        let scene = self.stage.gathered(self.world);
        let mut fixed = Fixed { n_gaussians: scene.len(), ..Fixed::default() };
        self.stage.app.world_mut().entity_mut(self.world).despawn();
        let entity = self.stage.show(scene, self.place)?;
        self.stage.move_to(self.pose(compared.start - 1));
        (0..WARM_UP).try_for_each(|_| self.stage.step().map(drop))?;
        let mut before = self.stage.picture()?;
        for frame in compared {
            self.stage.move_to(self.pose(frame));
            fixed.wall.push(self.stage.step()?.wall);
            let picture = self.stage.picture()?;
            fixed.differences.push(difference(&before, &picture));
            before = picture;
        }
        if let Some((style, _)) = self.style.clone() {
            let begun = Instant::now();
            self.stage.app.world_mut().entity_mut(entity).insert(style);
            self.stage.until("a painted scene", |app| app.get::<AppliedStyle>(entity).is_some())?;
            fixed.painted = Some(milliseconds(begun.elapsed()));
        }
        self.stage.app.world_mut().entity_mut(entity).despawn();
        Ok(fixed)
    }

    /// Shares of holes beside the coarsest level alone.
    fn beside_coarsest(&mut self, manifest: &FilePath, checks: &[(usize, Picture)]) -> Result<Vec<f64>> {
        eprintln!("the coarsest level");
        // The coarsest level is read however small the budget is.
        let coarsest = read_scene_with(manifest, ReadOptions { budget: Some(0), ..ReadOptions::default() })?;
        let entity = self.stage.show(coarsest.scene, self.place)?;
        let mut shares = Vec::new();
        for (frame, cut) in checks {
            shares.push(holes(&self.stage.picture_from(self.pose(*frame))?, cut));
        }
        self.stage.app.world_mut().entity_mut(entity).despawn();
        Ok(shares)
    }

    /// PSNR of settled pictures beside the full resolution, in dB.
    fn beside_full(&mut self, manifest: &FilePath, halts: &[(usize, Picture)]) -> Result<Vec<f64>> {
        eprintln!("the full resolution");
        self.stage.show(read_scene(manifest)?.scene, self.place)?;
        let mut found = Vec::new();
        for (frame, cut) in halts {
            found.push(psnr(&self.stage.picture_from(self.pose(*frame))?, cut));
        }
        Ok(found)
    }
}

impl Flown {
    /// Notes what is painted in a frame after the change of style.
    fn note_paint(&mut self, changed: Option<Instant>, n_unpainted: usize, n_unstyled: usize) {
        let Some(passed) = changed.map(|changed| milliseconds(changed.elapsed())) else { return };
        match self.painted[0] {
            None if n_unpainted == 0 => self.painted[0] = Some(passed),
            None => {}
            Some(_) => self.n_unpainted = self.n_unpainted.max(n_unpainted),
        }
        if n_unstyled == 0 {
            self.painted[1].get_or_insert(passed);
        }
    }

    /// Adds the figures of the flight alone.
    fn tell(&self, report: &mut Report) {
        let idle = percentile(&self.idle, 0.5);
        let n_over = self.main.iter().filter(|main| **main > idle + OVER_IDLE).count();
        report.add("frame: median", percentile(&self.wall, 0.5), "ms");
        report.add("frame: 99 %", percentile(&self.wall, 0.99), "ms");
        report.add("main thread: median of a still world", idle, "ms");
        report.add("main thread: median", percentile(&self.main, 0.5), "ms");
        report.add("main thread: 99 %", percentile(&self.main, 0.99), "ms");
        report.add("main thread: longest", percentile(&self.main, 1.0), "ms");
        report.add("main thread: frames 4 ms over a still world", n_over as f64, "");
        report.add("shown: median", percentile(&self.shown, 0.5), "Gaussians");
        report.add("shown: most", percentile(&self.shown, 1.0), "Gaussians");
        let [in_memory, on_gpu] = [&self.resident, &self.on_gpu].map(|bytes| ends(bytes));
        report.add("memory: first frame", in_memory[0] / MB, "MB");
        report.add("memory: most in a frame", in_memory[1] / MB, "MB");
        report.add("memory: last frame", in_memory[2] / MB, "MB");
        report.add("memory: most since the start", self.most_resident.unwrap_or(f64::NAN) / MB, "MB");
        report.add("GPU: first frame", on_gpu[0] / MB, "MB");
        report.add("GPU: most in a frame", on_gpu[1] / MB, "MB");
        report.add("GPU: last frame", on_gpu[2] / MB, "MB");
        report.add("popping: switches beside other frames", popping(&self.differences, &self.is_switch), "");
        let [in_view, all] = self.painted.map(|painted| painted.unwrap_or(f64::NAN));
        report.add("style: until all in view is painted", in_view, "ms");
        report.add("style: until everything is painted", all, "ms");
        // Without a style, nothing arrives painted.
        let unpainted = self.painted[0].map_or(f64::NAN, |_| self.n_unpainted as f64);
        report.add("style: most unpainted parts in view after that", unpainted, "");
    }
}

impl Fixed {
    /// Adds the figures of the fixed scene, and those of the flight in the frames that were compared.
    fn tell(&self, flown: &Flown, compared: Range<usize>, report: &mut Report) {
        let (wall, differences) = (&flown.wall[compared.clone()], &flown.differences[compared]);
        let [own, flight] = [&self.wall[..], wall].map(|wall| percentile(wall, 0.5));
        let ratios: Vec<f64> = differences.iter().zip(&self.differences).map(|(a, b)| a / b).collect();
        report.add("fixed scene", self.n_gaussians as f64, "Gaussians");
        report.add("fixed scene: median frame", own, "ms");
        report.add("fixed scene: median frame of the flight there", flight, "ms");
        report.add("fixed scene: ratio of frames", flight / own, "");
        report.add("fixed scene: ratio of popping", mean(differences) / mean(&self.differences), "");
        report.add("fixed scene: largest ratio of popping", percentile(&ratios, 1.0), "");
        report.add("fixed scene: until it is painted", self.painted.unwrap_or(f64::NAN), "ms");
    }
}

/// The first value, the largest and the last, or NaN if there are none.
fn ends(values: &[f64]) -> [f64; 3] {
    let end = |value: Option<&f64>| value.copied().unwrap_or(f64::NAN);
    [end(values.first()), percentile(values, 1.0), end(values.last())]
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn arguments_are_read() {
        Arguments::command().debug_assert();
        assert_eq!(size("480x270"), Ok(UVec2::new(480, 270)));
        assert!(["480", "0x4", "480x9000", "axb"].iter().all(|text| size(text).is_err()));
        assert!(Arguments::try_parse_from(["fly", "city", "--frames", "99"]).is_err());
    }

    #[test]
    fn boxes_stand_upright() {
        let [low, high] = upright([Vec3::new(0.0, 1.0, 2.0), Vec3::new(3.0, 5.0, 7.0)]);
        assert_eq!((low, high), (Vec3::new(0.0, -5.0, -7.0), Vec3::new(3.0, -1.0, -2.0)));
    }

    #[test]
    fn paint_is_noted_once_and_what_is_unpainted_later_is_counted() {
        let (mut flown, begun) = (Flown::default(), Instant::now());
        flown.note_paint(None, 0, 0);
        assert_eq!(flown.painted, [None; 2]);
        flown.note_paint(Some(begun), 2, 5);
        flown.note_paint(Some(begun), 0, 4);
        let first = flown.painted[0];
        assert!(first.is_some() && flown.painted[1].is_none());
        flown.note_paint(Some(begun), 3, 1);
        flown.note_paint(Some(begun), 1, 0);
        assert!(flown.painted[0] == first && flown.painted[1].is_some());
        assert_eq!(flown.n_unpainted, 3);
    }
}
