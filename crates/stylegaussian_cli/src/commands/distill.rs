//! `stylegaussian distill`: trains a small encoder to replace a large one.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use clap::Args;
use stylegaussian_encoder::Encoder;
use stylegaussian_files::write_atomically;
use stylegaussian_train::{
    Watch,
    encoder::{DistillConfig, Distillation, compare},
    images::{hold_out_every, list_images},
};

use crate::{
    arguments::{Backend, beside},
    choose::ENCODER_EXTENSION,
    compute::processor,
    outputs::expect_files,
    terminal::{Interrupt, ProgressLine, note, print, usage_error, warn, warn_of_unnamed},
};

/// If there is no held-out folder, every so many-th image is held out.
const HELD_OUT_STRIDE: usize = 16;

/// Train a small encoder to give the features of a large one.
///
/// The student sees random crops of the images, also in other sizes and colors, and learns the teacher's
/// features of each. At the end it is compared with the teacher on held-out images. The state is kept in
/// OUT.checkpoint.safetensors. Ctrl-C saves it and stops.
#[derive(Args, Debug)]
pub struct DistillArgs {
    /// The encoder to learn from: VGG-19 weights (.safetensors, .pth), an ONNX file or one of this command.
    #[arg(long, value_name = "FILE")]
    teacher: PathBuf,
    /// Folders of images (.jpg, .png and the like) to learn on.
    #[arg(long, value_name = "DIR", num_args = 1.., required_unless_present = "judge")]
    images: Vec<PathBuf>,
    /// A folder of images to compare on. Default: every 16th of `--images`, which is then not learned from.
    #[arg(long, value_name = "DIR")]
    held_out: Option<PathBuf>,
    /// The encoder to write.
    #[arg(short, long, value_name = "OUT.encoder.safetensors", required_unless_present = "judge")]
    output: Option<PathBuf>,
    /// Compare this encoder with the teacher on `--held-out`, and train nothing.
    #[arg(
        long,
        value_name = "ENCODER",
        requires = "held_out",
        conflicts_with_all = ["images", "output", "resume"],
    )]
    judge: Option<PathBuf>,
    /// Steps, of four crops of 128x128 pixels each.
    #[arg(long, value_name = "N", default_value_t = DistillConfig::default().iterations)]
    iterations: u32,
    /// Adam's learning rate at the first step. It falls to 0 along a cosine.
    #[arg(long, value_name = "RATE", default_value_t = DistillConfig::default().learning_rate)]
    learning_rate: f32,
    /// Random seed.
    #[arg(long, value_name = "S", default_value_t = DistillConfig::default().seed)]
    seed: u64,
    /// Resume from OUT.checkpoint.safetensors.
    #[arg(long)]
    resume: bool,
    /// Where to train. `gpu` needs a build with the `gpu` feature; if there is no GPU, the command fails.
    #[arg(long, value_enum, default_value = "auto")]
    backend: Backend,
    /// Print the comparison as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// The message names the file or the option at fault.
pub fn run(arguments: &DistillArgs, interrupt: &Interrupt) -> Result<()> {
    let teacher = Encoder::open(&arguments.teacher)?;
    warn(teacher.warning());
    if let (Some(path), Some(folder)) = (&arguments.judge, &arguments.held_out) {
        let comparison = compare(&teacher, &Encoder::open(path)?, &list_images(folder)?)?;
        return print(arguments.json, &comparison, || comparison.table());
    }
    let Some(output) = &arguments.output else { bail!("found no --output, expected a file for the encoder") };
    let (images, held_out) = arguments.images()?;
    train(arguments, &teacher, &images, output, interrupt)?;
    let comparison = compare(&teacher, &Encoder::open(output)?, &held_out)?;
    print(arguments.json, &comparison, || comparison.table())
}

fn train(
    arguments: &DistillArgs,
    teacher: &Encoder,
    images: &[PathBuf],
    output: &Path,
    interrupt: &Interrupt,
) -> Result<()> {
    let config = DistillConfig {
        iterations: arguments.iterations,
        learning_rate: arguments.learning_rate,
        seed: arguments.seed,
        processor: processor(arguments.backend)?,
    };
    let name = output.to_string_lossy();
    let Some(stem) = name.strip_suffix(ENCODER_EXTENSION) else {
        return Err(usage_error(format!("{name}: expected extension {ENCODER_EXTENSION}")));
    };
    let checkpoint = beside(stem.as_ref(), "checkpoint.safetensors");
    expect_files([output, &*checkpoint])?;
    let mut distillation = Distillation::new(config, teacher, images)?;
    if arguments.resume {
        warn_of_unnamed(&checkpoint, &distillation.resume(&checkpoint)?);
    }
    let millions = distillation.multiply_adds([256; 2]) as f64 / 1e6;
    note(format!("{} images; {millions:.0} million multiply-adds at 256x256 pixels", images.len()));

    let progress = ProgressLine::new();
    let watch = Watch { progress: &|now| progress.show(now), interrupted: interrupt.watch() };
    let is_complete = distillation.run(watch, |distillation| -> Result<()> {
        distillation.save(&checkpoint)?;
        let encoder = distillation.encoder()?;
        Ok(write_atomically(output, |out| out.write_all(&encoder))?)
    })?;
    progress.finish();
    let steps = distillation.steps();
    ensure!(
        is_complete,
        "interrupted after {steps} steps; the encoder so far is written, --resume continues"
    );
    Ok(())
}

impl DistillArgs {
    /// Images to learn on, and images to compare on.
    fn images(&self) -> Result<(Vec<PathBuf>, Vec<PathBuf>)> {
        let mut images = Vec::new();
        for folder in &self.images {
            images.extend(list_images(folder)?);
        }
        match &self.held_out {
            Some(folder) => Ok((images, list_images(folder)?)),
            None => Ok(hold_out_every(images, HELD_OUT_STRIDE)?),
        }
    }
}
