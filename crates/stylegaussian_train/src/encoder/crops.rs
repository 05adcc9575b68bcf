//! Training data of the student: crops of images, and the teacher's features of each.

use std::path::{Path, PathBuf};

use half::f16;
use image::RgbImage;
use rayon::prelude::*;
use stylegaussian::random::Random;
use stylegaussian_encoder::{Encoder, Image};

use crate::error::{TrainError, ensure};

/// Side of a crop, in pixels: 32 cells of the teacher, a third of which see the border.
pub const SIDE: u32 = 128;

/// Number of crops kept, with the teacher's features: 2048 take 1.2 GB. New ones replace the oldest.
const KEPT: usize = 2048;

/// Shorter side to which a larger image is shrunk, in pixels.
const SHORTER_SIDE: u32 = 640;

/// Factors by which an image is scaled before it is cropped, least and largest. Strokes then have every scale,
/// from a whole painting in 256 pixels to somewhat above its own size.
const SCALES: [f32; 2] = [0.35, 1.3];

/// A picture and the teacher's features of it.
pub struct Crop {
    /// RGB, 8 bits `[SIDE, SIDE, 3]`.
    pub rgb: Vec<u8>,
    /// `[h * w, D]`.
    pub features: Vec<f16>,
}

/// Images to cut crops from, and the crops made so far.
pub struct Crops<'a> {
    teacher: &'a Encoder,
    images: Vec<RgbImage>,
    seed: u64,
    kept: Vec<Crop>,
    /// The index that the next new crop takes.
    next: usize,
}

impl<'a> Crops<'a> {
    /// Reads the images at `paths`.
    ///
    /// # Errors
    /// If one cannot be read or is too small for a crop.
    pub fn open(teacher: &'a Encoder, paths: &[PathBuf], seed: u64) -> Result<Self, TrainError> {
        let images = paths.par_iter().map(|path| open(path)).collect::<Result<Vec<_>, _>>()?;
        Ok(Self { teacher, images, seed, kept: Vec::new(), next: 0 })
    }

    /// Makes the crops with these numbers. A number always gives the same crop.
    ///
    /// # Errors
    /// If the teacher cannot encode one.
    pub fn make(&self, numbers: std::ops::Range<u64>) -> Result<Vec<Crop>, TrainError> {
        numbers.into_par_iter().map(|number| self.crop(number)).collect()
    }

    /// Keeps these crops and drops all others.
    pub fn replace(&mut self, crops: Vec<Crop>) {
        (self.kept, self.next) = (crops, 0);
    }

    /// Keeps crops. If there are enough already, they replace the oldest.
    pub fn keep(&mut self, crops: Vec<Crop>) {
        for crop in crops {
            if self.kept.len() < KEPT {
                self.kept.push(crop);
            } else {
                self.kept[self.next] = crop;
                self.next = (self.next + 1) % KEPT;
            }
        }
    }

    /// All crops that are kept.
    pub fn kept(&self) -> &[Crop] {
        &self.kept
    }

    fn crop(&self, number: u64) -> Result<Crop, TrainError> {
        // A sequence for each number, so crops can be made in any order and on any thread.
        let mut random = Random::new(self.seed ^ number.wrapping_mul(0x9E37_79B9_97F4_A7C1));
        let image = &self.images[random.below(self.images.len())];
        // Uniform in the logarithm, because scales are ratios: 0.35 to 0.7 is as likely as 0.65 to 1.3.
        let scale = SCALES[0] * (SCALES[1] / SCALES[0]).powf(random.uniform());
        let side = ((SIDE as f32 / scale) as u32).min(image.width()).min(image.height());
        let x = random.below((image.width() - side + 1) as usize) as u32;
        let y = random.below((image.height() - side + 1) as usize) as u32;
        let window = image::imageops::crop_imm(image, x, y, side, side).to_image();
        let mut crop = Image::from(&window).resized(SIDE, SIDE);
        turn(&mut crop.rgb, &mut random);
        recolor(&mut crop.rgb, &mut random);
        // The student sees the kept 8-bit crop, so the teacher must see that one too.
        let rgb: Vec<u8> = crop.rgb.iter().map(|value| (value * 255.0).round() as u8).collect();
        crop.rgb = rgb.iter().map(|value| f32::from(*value) / 255.0).collect();
        let features = self.teacher.encode(&crop)?;
        let quarter = SIDE / 4;
        ensure!(
            (features.width, features.height) == (quarter, quarter),
            "the teacher gives {}x{} cells for {SIDE}x{SIDE} pixels, expected {quarter}x{quarter}",
            features.width,
            features.height
        );
        // Half the memory of f32, with errors far below the student's.
        Ok(Crop { rgb, features: features.values.into_iter().map(f16::from_f32).collect() })
    }
}

/// Reads an image, and shrinks it if it is large.
fn open(path: &Path) -> Result<RgbImage, TrainError> {
    let image = Image::open(path)?;
    let shorter = image.width.min(image.height);
    ensure!(
        shorter >= SIDE / 2,
        "{}: the image is {}x{}, expected at least {} pixels on a side",
        path.display(),
        image.width,
        image.height,
        SIDE / 2
    );
    let shrunk = |side: u32| (u64::from(side) * u64::from(SHORTER_SIDE) / u64::from(shorter)) as u32;
    Ok(match shorter > SHORTER_SIDE {
        true => RgbImage::from(&image.resized(shrunk(image.width), shrunk(image.height))),
        false => RgbImage::from(&image),
    })
}

/// Applies one of the square's eight symmetries. Half of the pictures stay upright.
fn turn(rgb: &mut Vec<f32>, random: &mut Random) {
    let side = SIDE as usize;
    let [mirror, turn] = [random.below(2) == 1, random.below(2) == 1];
    let [upside_down, transpose] = [turn && random.below(2) == 1, turn && random.below(2) == 1];
    let source = |i: usize| {
        let (x, y) = (i % side, i / side);
        let (x, y) = if transpose { (y, x) } else { (x, y) };
        let x = if mirror { side - 1 - x } else { x };
        let y = if upside_down { side - 1 - y } else { y };
        y * side + x
    };
    *rgb = (0..side * side).flat_map(|i| &rgb[source(i) * 3..][..3]).copied().collect();
}

/// Changes colors, because a hundred paintings have too few. Of two crops one keeps its colors. The other gets
/// another contrast around its mean, another gamma and saturation, and, half of the time, its channels in
/// another order.
fn recolor(rgb: &mut [f32], random: &mut Random) {
    if random.below(2) == 0 {
        return;
    }
    let mut between = |low: f32, high: f32| low + (high - low) * random.uniform();
    // Exponentials, so that a factor and its inverse are equally likely.
    let gamma = between(-0.7, 0.7).exp();
    let contrast = between(-0.5, 0.5).exp();
    let saturation = between(0.0, 1.8);
    let tint = [between(0.85, 1.15), between(0.85, 1.15), between(0.85, 1.15)];
    let order = if random.below(2) == 0 { vec![0, 1, 2] } else { random.permutation(3) };
    let mean = rgb.iter().sum::<f32>() / rgb.len() as f32;
    for pixel in rgb.chunks_exact_mut(3) {
        let gray = pixel.iter().sum::<f32>() / 3.0;
        let changed = |channel: usize| {
            let value = gray + (pixel[channel] - gray) * saturation;
            let value = (mean + (value - mean) * contrast) * tint[channel];
            value.clamp(0.0, 1.0).powf(gamma)
        };
        let changed = [changed(order[0]), changed(order[1]), changed(order[2])];
        pixel.copy_from_slice(&changed);
    }
}

/// Standard deviation of each channel over all cells of some crops, at least a thousandth of the largest. In
/// these units all channels have the same weight in the loss.
///
/// # Errors
/// If the teacher's features are the same everywhere.
pub fn deviations(crops: &[Crop], n_channels: usize) -> Result<Vec<f32>, TrainError> {
    let mut moments = vec![[0.0_f64; 2]; n_channels];
    let mut n = 0.0_f64;
    for cell in crops.iter().flat_map(|crop| crop.features.chunks_exact(n_channels)) {
        n += 1.0;
        for ([sum, squares], value) in moments.iter_mut().zip(cell) {
            let value = value.to_f64();
            *sum += value;
            *squares += value * value;
        }
    }
    // Rounding can make the variance of a constant channel negative.
    let deviation = |[sum, squares]: &[f64; 2]| ((squares / n - (sum / n).powi(2)).max(0.0)).sqrt() as f32;
    let deviations: Vec<f32> = moments.iter().map(deviation).collect();
    let largest = deviations.iter().copied().fold(0.0, f32::max);
    ensure!(largest > 0.0, "the teacher gives the same features everywhere");
    // A dead channel would otherwise weigh infinitely much.
    Ok(deviations.into_iter().map(|deviation| deviation.max(1e-3 * largest)).collect())
}
