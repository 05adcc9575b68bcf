//! `stylegaussian bake`: optimizes the colors of one scene under a painting's brush strokes.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::atomic::Ordering,
    time::Instant,
};

use anyhow::{Context, Result, ensure};
use clap::Args;
use glam::UVec2;
use serde::Serialize;
use stylegaussian::{
    Camera, Scene,
    look::{Look, MadeFrom, Painting},
    merge::merge,
    paint::Painted,
    views::{choose_views, framing},
    work::Work,
};
use stylegaussian_bake::{BakeConfig, Baker, LossNetwork, Losses};
use stylegaussian_defaults::{ENCODER, ENCODER_NAME};
use stylegaussian_encoder::Image;
use stylegaussian_files::{
    part::{Part, read_coarsest, read_part},
    write_look,
};
use stylegaussian_train::{
    cameras::{CameraOptions, read_cameras_with, scaled},
    contact_sheet::contact_sheet,
    picture::{Background, Picture, draw},
};

use crate::{
    arguments::{WeightedPath, beside, is_named, within},
    choose::{FrameArgs, open_painting},
    outputs::expect_files,
    scenes::ReadArgs,
    terminal::{Interrupt, bar, lossy, note, print, usage_error, warn},
};

/// Steps between two checkpoints. One is written in milliseconds; a bake that is killed loses some seconds.
const CHECKPOINT_EVERY: u32 = 50;
/// Views on the contact sheet, and the side of its pictures, in pixels.
const SHEET_VIEWS: usize = 3;
const SHEET_SIDE: u32 = 320;
/// Most Gaussians of the scene in whose colors the chunks of a world begin. More would tell the same, and every
/// job paints it.
const WHOLE: usize = 100_000;

/// Paint a scene with a painting's own strokes, and write a look (*.look.safetensors) of it.
///
/// Strokes are laid on the scene, and the colors of the Gaussians under them are optimized on random views. The
/// state is kept in OUT.checkpoint.safetensors. Ctrl-C saves it, writes the look so far and stops; the same
/// command then goes on. A world is baked chunk by chunk (--chunk).
#[derive(Args, Debug)]
pub struct BakeArgs {
    /// A scene in any format: `stylegaussian --help` lists them. It needs no features.
    scene: PathBuf,
    #[command(flatten)]
    reading: ReadArgs,
    /// Bake one chunk of a world: SCENE is its folder or its lod-meta.json, and FILE the chunk's path there,
    /// such as 0_0/meta.json. What is around it is baked along and left out of the look.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["axes", "budget"])]
    chunk: Option<String>,
    /// How far around most of the chunk Gaussians are baked along, in scene units. Default: a quarter of its
    /// longest side.
    #[arg(long, value_name = "M", requires = "chunk", value_parser = distance)]
    halo: Option<f32>,
    /// Painting. Several give a mix, and their weights are normalized to sum 1.
    #[arg(long = "style", value_name = "S[:WEIGHT]", num_args = 1.., required = true)]
    styles: Vec<WeightedPath>,
    /// The look to write.
    #[arg(short, long, value_name = "OUT.look.safetensors")]
    output: PathBuf,
    /// Strength: 0 only recolors, 1 is the default, 2 is bold.
    #[arg(
        long,
        value_name = "0..2",
        default_value = "1",
        allow_negative_numbers = true,
        value_parser = within(0.0_f32..=2.0),
    )]
    strength: f32,
    #[arg(long, value_name = "N", help = steps_help())]
    steps: Option<u32>,
    /// Random seed.
    #[arg(long, value_name = "S", default_value_t = BakeConfig::DEFAULT.seed)]
    seed: u64,
    /// Compare through VGG-19 with these weights, in place of the built-in network. Takes about twice as long.
    #[arg(long, value_name = "FILE")]
    vgg: Option<PathBuf>,
    /// Cameras to look from: transforms.json, a COLMAP model, or 3DGS cameras.json. Default: those that
    /// the scene was embedded with, else chosen to suit the scene.
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    framing: FrameArgs,
    /// Write a contact sheet: the painting, then views of the start and of the end.
    #[arg(long, value_name = "OUT.png")]
    sheet: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Baked<'a> {
    #[serde(serialize_with = "lossy")]
    scene: &'a Path,
    #[serde(serialize_with = "lossy")]
    output: &'a Path,
    gaussians: usize,
    steps: u32,
    /// Since the start of this command, reading and writing included.
    seconds: f64,
    /// Losses of the last step; none if this run had no step to do.
    losses: Option<LastLosses>,
}

#[derive(Serialize)]
struct LastLosses {
    matching: f32,
    statistics: f32,
    /// The error of the last step that measured it: every other one compares luminance alone.
    shapes: Option<f32>,
    palette: f32,
}

impl From<Losses> for LastLosses {
    fn from(losses: Losses) -> Self {
        let Losses { matching, statistics, shapes, palette, .. } = losses;
        Self { matching, statistics, shapes, palette }
    }
}

/// The scene that is baked.
struct Subject {
    scene: Scene,
    /// If it is of a world: the chunk that its first Gaussians are, and the whole, coarse.
    of_world: Option<(Scene, Scene)>,
}

impl Subject {
    /// The scene that the look is of.
    fn shown(&self) -> &Scene {
        self.of_world.as_ref().map_or(&self.scene, |(chunk, _)| chunk)
    }

    /// The look of a bake so far.
    fn look(&self, baker: &Baker, made_from: MadeFrom) -> Look {
        let (shown, colors, strokes) = (self.shown(), baker.colors(), baker.strokes());
        let look = Look::new(shown, &colors[..shown.len()], made_from);
        match self.of_world {
            None => look.with_strokes(shown, strokes),
            Some(_) => {
                let indices: Vec<u32> = (0..shown.len() as u32).collect();
                look.with_strokes(shown, &strokes.subset(&indices))
            }
        }
    }
}

/// Runs the command.
///
/// # Errors
/// The message names the file or the option at fault, or says how to go on after an interruption.
pub fn run(arguments: &BakeArgs, interrupt: &Interrupt) -> Result<()> {
    let began = Instant::now();
    let BakeArgs { scene: path, output, .. } = arguments;
    if !is_named(output, "look") {
        return Err(usage_error(format!("{}: expected extension .look.safetensors", output.display())));
    }
    let checkpoint = checkpoint_of(output);
    expect_files([&**output, &*checkpoint].into_iter().chain(arguments.sheet.as_deref()))?;
    let paintings = arguments.paintings()?;
    let subject = arguments.subject()?;
    let scene = &subject.scene;
    let cameras = arguments.cameras(scene)?;
    if cameras.is_empty() && scene.cameras.is_empty() && subject.of_world.is_none() {
        arguments.framing.warn(scene, path);
    }
    let config = arguments.config(scene.len());
    let (network, work) = (arguments.network()?, Work::default());
    let baker = match &subject.of_world {
        None => Baker::new(config, scene, &cameras, &paintings, network, &work),
        Some((_, whole)) => Baker::of_part(config, (scene, whole), &cameras, &paintings, network, &work),
    };
    let mut baker = baker.with_context(|| path.display().to_string())?;
    let (colors, strokes) = (baker.colors().to_vec(), baker.strokes().clone());
    let start = Painted { colors, strokes, ..Painted::default() };
    if checkpoint.exists() {
        baker.resume(&checkpoint)?;
        note(format!("going on after step {} of {}", baker.steps(), config.steps));
    }
    // Before the first step, so that a full disk is found at once.
    baker.save(&checkpoint)?;
    let losses = bake(&mut baker, scene, config.steps, &checkpoint, interrupt);
    let look = subject.look(&baker, arguments.made_from(baker.steps()));
    let kept =
        || format!("what was saved of the bake is in {}; the same command goes on", checkpoint.display());
    write_look(output, &look).with_context(kept)?;
    ensure!(
        baker.is_complete(),
        "interrupted after {} steps; the look so far is written, and {}",
        baker.steps(),
        kept()
    );
    if let Some(sheet) = &arguments.sheet {
        let end = Painted { colors: baker.colors().to_vec(), ..start.clone() };
        write_sheet(sheet, scene, &cameras, &paintings, [&start, &end])?;
    }
    // Last, since it is what a failure above could be repaired from.
    if let Err(error) = fs::remove_file(&checkpoint) {
        warn([format!("{}: {error}; it is of no more use", checkpoint.display())]);
    }
    let baked = Baked {
        scene: path,
        output,
        gaussians: subject.shown().len(),
        steps: baker.steps(),
        seconds: began.elapsed().as_secs_f64(),
        losses: losses.map(LastLosses::from),
    };
    print(arguments.json, &baked, || {
        format!("{}: {} steps in {:.0} s", output.display(), baked.steps, baked.seconds)
    })
}

/// Does the steps that are left, or those until Ctrl-C, and saves the state. Returns the last step's losses.
fn bake(
    baker: &mut Baker,
    scene: &Scene,
    steps: u32,
    checkpoint: &Path,
    interrupt: &Interrupt,
) -> Option<Losses> {
    let interrupted = interrupt.watch();
    let progress = bar(u64::from(steps), "{bar:40} {pos}/{len} steps, {eta} left");
    let mut losses: Option<Losses> = None;
    while !baker.is_complete() && !interrupted.load(Ordering::Relaxed) {
        progress.set_position(u64::from(baker.steps()));
        let now = baker.step(scene);
        let shapes = now.shapes.or_else(|| losses.and_then(|before| before.shapes));
        losses = Some(Losses { shapes, ..now });
        if baker.steps().is_multiple_of(CHECKPOINT_EVERY) {
            save_or_warn(baker, checkpoint);
        }
    }
    progress.finish_and_clear();
    save_or_warn(baker, checkpoint);
    losses
}

/// Saves the state. If it cannot, because the disk has become full, the bake goes on: the look is smaller by
/// far, and the state saved before stays.
fn save_or_warn(baker: &Baker, checkpoint: &Path) {
    if let Err(error) = baker.save(checkpoint) {
        warn([format!("{error:#}: not saved, going on")]);
    }
}

/// OUT.checkpoint.safetensors for OUT.look.safetensors.
fn checkpoint_of(output: &Path) -> PathBuf {
    beside(&output.with_extension("").with_extension(""), "checkpoint.safetensors")
}

/// The help of `--steps`, with the number that is the default.
fn steps_help() -> String {
    let steps = BakeConfig::DEFAULT.steps;
    format!("Steps: one view each. Default: {steps}, and up to eight times as many beyond 70,000 Gaussians")
}

/// A finite distance, 0 or more.
fn distance(text: &str) -> Result<f32, String> {
    let number = text.parse().ok().filter(|number: &f32| number.is_finite() && *number >= 0.0);
    number.ok_or_else(|| "expected a number of 0 or more".into())
}

impl BakeArgs {
    /// Reads what is baked, and says what its cameras frame.
    fn subject(&self) -> Result<Subject> {
        let Some(file) = &self.chunk else {
            let mut scene = self.reading.read(&self.scene)?.scene;
            self.framing.tell(&mut scene);
            return Ok(Subject { scene, of_world: None });
        };
        let Part { chunk, with_halo: mut scene, mut warnings } = read_part(&self.scene, file, self.halo)?;
        let (whole, of_whole) = read_coarsest(&self.scene)?;
        let others: Vec<String> =
            of_whole.into_iter().filter(|warning| !warnings.contains(warning)).collect();
        warnings.extend(others);
        warn(&warnings);
        self.framing.tell(&mut scene);
        // The halo is for the pictures at the border.
        scene.frame = scene.frame.or_else(|| framing(&chunk).map(|framing| framing.frame));
        let whole = if whole.len() > WHOLE { merge(&whole, WHOLE, &Work::default())? } else { whole };
        Ok(Subject { scene, of_world: Some((chunk, whole)) })
    }

    fn config(&self, n_gaussians: usize) -> BakeConfig {
        let default = BakeConfig::for_scene(n_gaussians);
        let config = BakeConfig { steps: self.steps.unwrap_or(default.steps), seed: self.seed, ..default };
        config.with_strength(self.strength)
    }

    fn paintings(&self) -> Result<Vec<(Image, f32)>> {
        self.styles.iter().map(|style| Ok((open_painting(&style.path)?, style.weight as f32))).collect()
    }

    fn network(&self) -> Result<LossNetwork> {
        Ok(match &self.vgg {
            Some(path) => LossNetwork::vgg(path)?,
            None => LossNetwork::distilled(ENCODER_NAME, ENCODER)?,
        })
    }

    /// The capture's cameras; none if none are given.
    fn cameras(&self, scene: &Scene) -> Result<Vec<Camera>> {
        let Some(path) = &self.cameras else { return Ok(Vec::new()) };
        let options = CameraOptions { offset: scene.offset, ..CameraOptions::default() };
        let set = read_cameras_with(path, options)?;
        warn(&set.warnings);
        Ok(set.cameras.into_iter().map(|posed| posed.camera).collect())
    }

    fn made_from(&self, steps: u32) -> MadeFrom {
        let total: f64 = self.styles.iter().map(|style| style.weight).sum();
        let painting = |style: &WeightedPath| Painting {
            name: style.path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            weight: style.weight / total,
        };
        MadeFrom {
            paintings: self.styles.iter().map(painting).collect(),
            strength: f64::from(self.strength),
            steps: u64::from(steps),
            seed: self.seed,
        }
    }
}

/// A row for the start of the bake and one for its end, behind the paintings.
fn write_sheet(
    path: &Path,
    scene: &Scene,
    cameras: &[Camera],
    paintings: &[(Image, f32)],
    looks: [&Painted; 2],
) -> Result<()> {
    let cameras = match cameras {
        [] => choose_views(scene, SHEET_VIEWS, UVec2::splat(SHEET_SIDE)),
        given => {
            let stride = given.len().div_ceil(SHEET_VIEWS);
            given
                .iter()
                .step_by(stride)
                .map(|camera| scaled(&camera.near_among(&scene.means), SHEET_SIDE))
                .collect()
        }
    };
    let picture = |look: &Painted, camera: &Camera| {
        Picture::of(&draw(scene, look, camera), Background::Color([255; 3]))
    };
    let mut rows: Vec<Vec<Picture>> =
        vec![paintings.iter().map(|(image, _)| Picture::of_image(image)).collect()];
    rows.extend(looks.map(|look| cameras.iter().map(|camera| picture(look, camera)).collect()));
    contact_sheet(&rows, UVec2::splat(SHEET_SIDE)).write_png(path)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checkpoints_lie_beside_looks() {
        assert_eq!(checkpoint_of(Path::new("a/b.look.safetensors")), Path::new("a/b.checkpoint.safetensors"));
    }

    #[test]
    fn halos_begin_at_0() {
        assert_eq!((distance("0"), distance("2.5")), (Ok(0.0), Ok(2.5)));
        for text in ["-1", "nan", "inf", ""] {
            assert!(distance(text).is_err(), "{text}");
        }
    }
}
