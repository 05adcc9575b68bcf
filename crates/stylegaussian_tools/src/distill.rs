//! `stylegaussian distill`: training a small encoder to stand in for a large one.

mod args;
mod crops;
mod report;
mod student;

use std::{
    path::{Path, PathBuf},
    sync::{Arc, atomic::Ordering},
};

use anyhow::{Result, bail, ensure};
use burn::tensor::{Device, Tensor, TensorData};
use stylegaussian::file;
use stylegaussian_encoder::Encoder;

pub use args::DistillArgs;
pub use report::{Report, compare};

use crate::{
    cli::output::{print, warn},
    random::Random,
    train::{
        INTERRUPTED,
        adam::Adam,
        average::Average,
        bar, beside,
        checkpoint::{self, Progress},
        device,
        ops::row_statistics,
        paintings::list_images,
        report_step,
    },
};
use crops::{Crop, Crops, SIDE, deviations};
use student::{Grids, STEPS, Student, multiply_adds};

/// Crops in a step.
const BATCH: usize = 4;

/// A new crop is made every so many steps, so each is seen sixteen times on average, in different company: the teacher's
/// look at one costs about as much as the student's learning from three.
const STEPS_PER_CROP: u32 = 4;

/// Crops made before the first step. The teacher's deviations are measured on them.
const FIRST_CROPS: u64 = 128;

/// Factor of the statistics' loss: AdaIN sees nothing else of a painting, and an average of squared errors is smallest for
/// features that deviate too little.
const STATISTICS_WEIGHT: f32 = 1.0;

/// Steps between two checkpoints.
const CHECKPOINT_STEPS: u32 = 200;

/// What is written is the mean of the parameters over this share of the steps, the last ones, looked at every
/// [`AVERAGE_STEPS`].
const AVERAGED: f64 = 0.15;
const AVERAGE_STEPS: u32 = 20;

/// Of images without a held-out folder, every so many-th is held out.
const HELD_OUT_STRIDE: usize = 16;

/// Runs the command.
///
/// # Errors
/// The message names the file or the option at fault.
pub fn run(arguments: &DistillArgs) -> Result<()> {
    let teacher = Encoder::open(&arguments.teacher)?;
    warn(teacher.warning());
    if let (Some(path), Some(folder)) = (&arguments.judge, &arguments.held_out) {
        let report = report::compare(&teacher, &Encoder::open(path)?, &list_images(folder)?)?;
        return print(arguments.json, &report, || report.table());
    }
    let Some(output) = &arguments.output else { bail!("expected --output") };
    let (images, held_out) = images(arguments)?;
    let device = device(arguments.backend)?.autodiff();
    let mut distillation = Distillation::new(arguments, output, &teacher, &images, device)?;
    // A second handler in one process (tests) is refused; the first one serves.
    let _ = ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed));
    distillation.run()?;
    let report = report::compare(&teacher, &Encoder::open(output)?, &held_out)?;
    print(arguments.json, &report, || report.table())
}

/// Images to learn on, and images to compare on.
fn images(arguments: &DistillArgs) -> Result<(Vec<PathBuf>, Vec<PathBuf>)> {
    let mut images = Vec::new();
    for folder in &arguments.images {
        images.extend(list_images(folder)?);
    }
    if let Some(folder) = &arguments.held_out {
        return Ok((images, list_images(folder)?));
    }
    let n = images.len();
    ensure!(n > 1, "found {n} image, expected at least one to learn on and one to hold out");
    let stride = HELD_OUT_STRIDE.min(n);
    let (held_out, images): (Vec<_>, Vec<_>) =
        images.into_iter().enumerate().partition(|(i, _)| i % stride == stride - 1);
    let without_index = |list: Vec<(usize, PathBuf)>| list.into_iter().map(|(_, path)| path).collect();
    Ok((without_index(images), without_index(held_out)))
}

struct Distillation<'a> {
    arguments: &'a DistillArgs,
    output: &'a Path,
    teacher: &'a Encoder,
    device: Device,
    crops: Crops<'a>,
    grids: Grids,
    student: Student,
    adam: Adam,
    average: Average,
    progress: Progress,
}

impl<'a> Distillation<'a> {
    fn new(
        arguments: &'a DistillArgs,
        output: &'a Path,
        teacher: &'a Encoder,
        images: &[PathBuf],
        device: Device,
    ) -> Result<Self> {
        let is_onnx = output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("onnx"));
        ensure!(is_onnx, "{}: expected extension .onnx", output.display());
        let mut crops = Crops::open(teacher, images, arguments.seed)?;
        let first = crops.make(0..FIRST_CROPS)?;
        let deviations = deviations(&first, teacher.n_channels())?;
        let mut student = Student::new(STEPS, &deviations, &mut Random::new(arguments.seed), &device);
        let (mut adam, mut average) = (Adam::new(&student.parameters), Average::new(&student.parameters));
        let progress = match arguments.resume {
            true => {
                let (path, format) = (checkpoint_path(output), format(teacher));
                checkpoint::load(&path, &format, &mut student.parameters, &mut adam, &mut average, &device)?
            }
            false => Progress::default(),
        };
        let first = match new_crops(progress.steps) {
            FIRST_CROPS => first,
            next => crops.make(next - FIRST_CROPS..next)?,
        };
        crops.keep(first);
        eprintln!(
            "{} images; {:.0} million multiply-adds at 256x256 pixels",
            images.len(),
            multiply_adds(STEPS, teacher.n_channels(), [256; 2]) as f64 / 1e6
        );
        let grids = Grids::new(STEPS, [SIDE as usize; 2], BATCH);
        Ok(Self { arguments, output, teacher, device, crops, grids, student, adam, average, progress })
    }

    fn run(&mut self) -> Result<()> {
        let total = self.arguments.iterations;
        let bar = bar(total, "distilling");
        bar.set_position(u64::from(self.progress.steps));
        let mut mean = [f32::NAN; 2];
        while self.progress.steps < total {
            if INTERRUPTED.load(Ordering::Relaxed) {
                self.save()?;
                bail!(
                    "interrupted after {} steps; the encoder so far is written, --resume goes on",
                    self.progress.steps
                );
            }
            let losses = self.step()?;
            self.progress.losses.push(losses);
            self.progress.steps += 1;
            for (mean, loss) in mean.iter_mut().zip(losses) {
                *mean = if mean.is_nan() { loss } else { 0.99 * *mean + 0.01 * loss };
            }
            let done = self.progress.steps;
            report_step(&bar, done, &format!("features {:.4} statistics {:.4}", mean[0], mean[1]));
            if f64::from(done) > f64::from(total) * (1.0 - AVERAGED) && done.is_multiple_of(AVERAGE_STEPS) {
                self.average.add(&self.student.parameters);
            }
            if done.is_multiple_of(CHECKPOINT_STEPS) {
                self.save()?;
            }
        }
        bar.finish();
        self.save()
    }

    /// One step on crops at hand, while new ones are made.
    fn step(&mut self) -> Result<[f32; 2]> {
        let (done, total) = (self.progress.steps, self.arguments.iterations);
        let mut random = Random::new(self.arguments.seed ^ (u64::from(done) << 20) ^ 0x4449_5354);
        let kept = self.crops.kept();
        let batch: Vec<&Crop> = (0..BATCH).map(|_| &kept[random.below(kept.len())]).collect();
        let course = 0.5 * (1.0 + (std::f32::consts::PI * done as f32 / total.max(1) as f32).cos());
        let rate = self.arguments.learning_rate * course;
        let (crops, student, adam) = (&self.crops, &mut self.student, &mut self.adam);
        let (grids, device) = (&self.grids, &self.device);
        let (new, losses) = rayon::join(
            || crops.make(new_crops(done)..new_crops(done + 1)),
            || learn(student, adam, grids, &batch, rate, device),
        );
        self.crops.keep(new?);
        Ok(losses)
    }

    /// Keeps the state, and writes the encoder as it would be now.
    fn save(&self) -> Result<()> {
        let (path, format) = (checkpoint_path(self.output), format(self.teacher));
        let parameters = &self.student.parameters;
        checkpoint::save(&path, &format, parameters, &self.adam, &self.average, &self.progress)?;
        let values: Vec<Tensor<2>> = match self.average.count {
            0 => parameters.iter().map(|parameter| parameter.values.clone()).collect(),
            _ => self.average.means.clone(),
        };
        let notes = [("teacher", self.teacher.id().to_string()), ("steps", self.progress.steps.to_string())];
        let onnx = self.student.onnx(&values, &notes);
        file::write_atomically(self.output, |out| out.write_all(&onnx))?;
        Ok(())
    }
}

/// The number of the first crop to be made in a step.
fn new_crops(step: u32) -> u64 {
    FIRST_CROPS + u64::from(step / STEPS_PER_CROP)
}

fn checkpoint_path(output: &Path) -> PathBuf {
    beside(&output.with_extension(""), "checkpoint.safetensors")
}

/// What a checkpoint says it is: another teacher's is of no use.
fn format(teacher: &Encoder) -> String {
    format!("stylegaussian-distillation of {}", teacher.id())
}

/// Moves the student towards the teacher on some crops. Returns the mean squared error of the features and of their means
/// and deviations on each crop, in units of the teacher's deviations.
fn learn(
    student: &mut Student,
    adam: &mut Adam,
    grids: &Grids,
    batch: &[&Crop],
    rate: f32,
    device: &Device,
) -> [f32; 2] {
    let rgb: Vec<f32> = batch.iter().flat_map(|crop| &crop.rgb).map(|v| f32::from(*v) / 255.0).collect();
    let found = student.forward(Student::patches(&rgb, grids, device), grids);
    let [n_cells, n_channels] = found.dims();
    let truth: Vec<f32> = batch.iter().flat_map(|crop| &crop.features).map(|value| value.to_f32()).collect();
    let truth = Tensor::<2>::from_data(TensorData::new(truth, [n_cells, n_channels]), device);
    let truth = truth / student.deviations();
    let n = n_cells / batch.len();
    // A crop's channels side by side with the next one's: one operation finds the statistics of all.
    let by_crop = |rows: Tensor<2>| {
        rows.reshape([batch.len(), n, n_channels]).swap_dims(0, 1).reshape([n, batch.len() * n_channels])
    };
    let shares = Arc::new(vec![1.0 / n as f32; n]);
    let statistics = |rows: Tensor<2>| row_statistics(by_crop(rows), &shares);
    let features_loss = (found.clone() - truth.clone()).powi_scalar(2).mean();
    let statistics_loss = (statistics(found) - statistics(truth)).powi_scalar(2).mean();
    let loss = features_loss.clone() + statistics_loss.clone() * STATISTICS_WEIGHT;
    let gradients = loss.backward();
    adam.update(&mut student.parameters, &gradients, rate);
    [features_loss.into_scalar::<f32>(), statistics_loss.into_scalar::<f32>()]
}
