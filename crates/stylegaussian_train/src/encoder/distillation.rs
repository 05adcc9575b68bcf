//! The distillation: one step after another, and the state between them.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use burn::tensor::{Device, Tensor, TensorData};
use stylegaussian::random::Random;
use stylegaussian_encoder::Encoder;

use super::{
    crops::{Crop, Crops, SIDE, deviations},
    student::{Grids, STEPS, Student, multiply_adds},
};
use crate::{
    error::TrainError,
    nn::{
        Processor,
        adam::Adam,
        average::Average,
        checkpoint::{self, History, Origin, fingerprint_of_files},
        ops::row_statistics,
        parameter::to_scalar,
        schedule::cosine,
    },
    watch::{Progress, RunningMeans, Stage, Watch},
};

/// Crops in a step.
const BATCH: usize = 4;

/// Steps for each new crop. Each crop is then seen sixteen times on average, together with different others.
/// Encoding a crop with the teacher costs about as much as three crops of the student's training.
const STEPS_PER_CROP: u32 = 4;

/// Crops made before the first step. The teacher's deviations are measured on them.
const FIRST_CROPS: u64 = 128;

/// Factor of the statistics' loss. AdaIN uses only the statistics of a painting, and squared errors alone are
/// smallest for features with too small deviations.
const STATISTICS_WEIGHT: f32 = 1.0;

/// Steps between two checkpoints.
const CHECKPOINT_STEPS: u32 = 200;

/// The share of the steps, the last ones, over which parameters are averaged, every [`AVERAGE_STEPS`].
const AVERAGED: f64 = 0.15;
const AVERAGE_STEPS: u32 = 20;

/// Weight of the newest step in the losses that are reported.
const REPORTED_RATE: f32 = 0.01;

/// Settings of a distillation. The defaults are those of the command line.
#[derive(Clone, Debug)]
pub struct DistillConfig {
    /// Steps, of four crops of 128x128 pixels each.
    pub iterations: u32,
    /// Adam's learning rate at the first step. It falls to 0 along a cosine.
    pub learning_rate: f32,
    /// Random seed.
    pub seed: u64,
    /// The device that the student is trained on. The teacher runs on the CPU.
    pub processor: Processor,
}

impl Default for DistillConfig {
    fn default() -> Self {
        Self { iterations: 16_000, learning_rate: 2e-3, seed: 0, processor: Processor::default() }
    }
}

/// Mean squared errors of a step, in units of the teacher's deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistillLosses {
    /// Error of the features.
    pub features: f32,
    /// Error of their mean and deviation on each crop.
    pub statistics: f32,
}

/// Trains a small encoder, the student, to give the features of a teacher.
pub struct Distillation<'a> {
    config: DistillConfig,
    teacher: &'a Encoder,
    device: Device,
    crops: Crops<'a>,
    grids: Grids,
    student: Student,
    adam: Adam,
    average: Average,
    history: History,
    origin: Origin,
}

impl<'a> Distillation<'a> {
    /// Reads the images and makes the first crops.
    ///
    /// # Errors
    /// If an image cannot be read or is too small, or the teacher fails or has another resolution than VGG's
    /// relu3_1.
    pub fn new(config: DistillConfig, teacher: &'a Encoder, images: &[PathBuf]) -> Result<Self, TrainError> {
        let device = config.processor.device();
        let origin = vec![("images", fingerprint_of_files(images)?), ("seed", config.seed.to_string())];
        let mut crops = Crops::open(teacher, images, config.seed)?;
        let first = crops.make(0..FIRST_CROPS)?;
        let deviations = deviations(&first, teacher.n_channels())?;
        crops.keep(first);
        let student = Student::new(STEPS, &deviations, &mut Random::new(config.seed), &device);
        Ok(Self {
            adam: Adam::new(&student.parameters),
            average: Average::new(&student.parameters),
            history: History::default(),
            origin,
            grids: Grids::new(STEPS, [SIDE as usize; 2], BATCH),
            config,
            teacher,
            device,
            crops,
            student,
        })
    }

    /// Multiply-adds of the student on a picture of `size` = [W, H].
    pub fn multiply_adds(&self, size: [usize; 2]) -> usize {
        multiply_adds(STEPS, self.teacher.n_channels(), size)
    }

    /// Steps that were taken.
    pub fn steps(&self) -> u32 {
        self.history.steps
    }

    /// Writes a checkpoint atomically.
    ///
    /// # Errors
    /// If the device fails or the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), TrainError> {
        let Self { student, adam, average, history, origin, .. } = self;
        checkpoint::save(path, &self.format(), &student.parameters, adam, average, history, origin)
    }

    /// Continues from a checkpoint of the same distillation. Returns the parts of the distillation that the
    /// file does not name, such as `images`: they may be others.
    ///
    /// # Errors
    /// If the file cannot be read or belongs to another teacher, other images or another seed.
    pub fn resume(&mut self, path: &Path) -> Result<Vec<&'static str>, TrainError> {
        let format = self.format();
        let Self { student, adam, average, device, origin, .. } = self;
        let parameters = &mut student.parameters;
        let (history, unnamed) = checkpoint::load(path, &format, parameters, adam, average, device, origin)?;
        self.history = history;
        let next = new_crops(self.history.steps);
        // Not all crops that were kept: encoding them takes long, and new ones soon follow.
        if next > FIRST_CROPS {
            self.crops.replace(self.crops.make(next - FIRST_CROPS..next)?);
        }
        Ok(unnamed)
    }

    /// The student as an ONNX file: the mean over the last part of the training, or the current state before
    /// that.
    ///
    /// # Errors
    /// If the device fails.
    pub fn encoder(&self) -> Result<Vec<u8>, TrainError> {
        let values = self.average.values_or_current(&self.student.parameters);
        let notes = [("teacher", self.teacher.id().to_string()), ("steps", self.history.steps.to_string())];
        Ok(self.student.chain(&values)?.to_bytes(None, &notes))
    }

    /// The format of the checkpoint. It names the teacher, because a checkpoint is useless with another one.
    fn format(&self) -> String {
        format!("stylegaussian-distillation of {}", self.teacher.id())
    }

    /// Takes a step on some of the crops, while new crops are made on other threads.
    ///
    /// # Errors
    /// If the teacher or the device fails.
    pub fn step(&mut self) -> Result<DistillLosses, TrainError> {
        let (done, config) = (self.history.steps, &self.config);
        // A sequence for each step; the last number is `DIST` in ASCII.
        let mut random = Random::new(config.seed ^ (u64::from(done) << 20) ^ 0x4449_5354);
        let kept = self.crops.kept();
        let batch: Vec<&Crop> = (0..BATCH).map(|_| &kept[random.below(kept.len())]).collect();
        let rate = cosine(config.learning_rate, 0.0, done, config.iterations);
        let (crops, student, adam) = (&self.crops, &mut self.student, &mut self.adam);
        let (grids, device) = (&self.grids, &self.device);
        let (new, losses) = rayon::join(
            || crops.make(new_crops(done)..new_crops(done + 1)),
            || learn(student, adam, grids, &batch, rate, device),
        );
        // The new crops are kept after the step, so the batch does not depend on which of the two ends first.
        let losses = losses?;
        self.crops.keep(new?);
        self.history.losses.push([losses.features, losses.statistics]);
        self.history.steps += 1;
        let done = self.history.steps;
        let is_late = f64::from(done) > f64::from(self.config.iterations) * (1.0 - AVERAGED);
        if is_late && done.is_multiple_of(AVERAGE_STEPS) {
            self.average.add(&self.student.parameters);
        }
        Ok(losses)
    }

    /// Takes all steps that are left. Calls `save` every 200 steps and when it stops. Returns whether all steps
    /// were taken, which is false if `watch` interrupted.
    ///
    /// # Errors
    /// If a step or `save` fails.
    pub fn run<E: From<TrainError>>(
        &mut self,
        watch: Watch,
        mut save: impl FnMut(&Self) -> Result<(), E>,
    ) -> Result<bool, E> {
        let mut means = RunningMeans::new(["features", "statistics"], REPORTED_RATE);
        let total = self.config.iterations;
        while self.history.steps < total && !watch.is_interrupted() {
            let DistillLosses { features, statistics } = self.step()?;
            means.add([features, statistics]);
            let done = self.history.steps;
            (watch.progress)(Progress { stage: Stage::Distillation, done, total, losses: means.losses() });
            if done.is_multiple_of(CHECKPOINT_STEPS) && done < total {
                save(self)?;
            }
        }
        save(self)?;
        Ok(self.history.steps >= total)
    }
}

/// The number of the first crop that is made in a step.
fn new_crops(step: u32) -> u64 {
    FIRST_CROPS + u64::from(step / STEPS_PER_CROP)
}

/// Moves the student toward the teacher on some crops.
fn learn(
    student: &mut Student,
    adam: &mut Adam,
    grids: &Grids,
    batch: &[&Crop],
    rate: f32,
    device: &Device,
) -> Result<DistillLosses, TrainError> {
    let rgb: Vec<f32> = batch.iter().flat_map(|crop| &crop.rgb).map(|v| f32::from(*v) / 255.0).collect();
    let found = student.forward(Student::patches(&rgb, grids, device), grids);
    let [n_cells, n_channels] = found.dims();
    let truth: Vec<f32> = batch.iter().flat_map(|crop| &crop.features).map(|value| value.to_f32()).collect();
    let truth = Tensor::<2>::from_data(TensorData::new(truth, [n_cells, n_channels]), device);
    // In these units each channel has the same weight, whatever its scale.
    let truth = truth / student.deviations();
    let n = n_cells / batch.len();
    // With the channels of all crops side by side, one operation computes the statistics of all.
    let by_crop = |rows: Tensor<2>| {
        rows.reshape([batch.len(), n, n_channels]).swap_dims(0, 1).reshape([n, batch.len() * n_channels])
    };
    let shares = Arc::new(vec![1.0 / n as f32; n]);
    let statistics = |rows: Tensor<2>| row_statistics(by_crop(rows), &shares);
    let features_loss = (found.clone() - truth.clone()).powi_scalar(2).mean();
    let statistics_loss = (statistics(found) - statistics(truth)).powi_scalar(2).mean();
    let loss = features_loss.clone() + statistics_loss.clone() * STATISTICS_WEIGHT;
    adam.update(&mut student.parameters, &loss.backward(), rate)?;
    Ok(DistillLosses { features: to_scalar(&features_loss)?, statistics: to_scalar(&statistics_loss)? })
}
