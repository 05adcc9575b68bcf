//! What the student learns from: crops of images, and what the teacher says of each.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use half::f16;
use image::RgbImage;
use rayon::prelude::*;
use stylegaussian_encoder::{Encoder, Image};

use crate::random::Random;

/// Side of a crop, in pixels: 32 cells of the teacher, of which those that see the border are a third.
pub const SIDE: u32 = 128;

/// Crops kept, with the teacher's features: 2048 are 1.2 GB. New ones take the place of the oldest.
const KEPT: usize = 2048;

/// Shorter side that a larger image is shrunk to, in pixels.
const SHORTER_SIDE: u32 = 640;

/// How much an image is shrunk, at most and at least, before it is cropped: strokes come in at every scale from a whole
/// painting in 256 pixels to its own size and somewhat beyond.
const SCALES: [f32; 2] = [0.35, 1.3];

/// A picture and the teacher's features of it.
pub struct Crop {
    /// RGB, 8 bits `[SIDE, SIDE, 3]`.
    pub rgb: Vec<u8>,
    /// `[h * w, D]`.
    pub features: Vec<f16>,
}

/// Images to cut crops from, and the crops at hand.
pub struct Crops<'a> {
    teacher: &'a Encoder,
    images: Vec<RgbImage>,
    seed: u64,
    kept: Vec<Crop>,
    /// Where the next one goes.
    next: usize,
}

impl<'a> Crops<'a> {
    /// Reads the images at `paths`.
    ///
    /// # Errors
    /// When one cannot be read or is smaller than a crop at the smallest.
    pub fn open(teacher: &'a Encoder, paths: &[PathBuf], seed: u64) -> Result<Self> {
        let images = paths.par_iter().map(|path| open(path)).collect::<Result<Vec<_>>>()?;
        Ok(Self { teacher, images, seed, kept: Vec::new(), next: 0 })
    }

    /// The crops of these numbers; a number stands for one crop for good.
    ///
    /// # Errors
    /// When the teacher cannot look at one.
    pub fn make(&self, numbers: std::ops::Range<u64>) -> Result<Vec<Crop>> {
        numbers.into_par_iter().map(|number| self.crop(number)).collect()
    }

    /// Keeps crops, in place of the oldest where there are enough.
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

    /// All crops at hand.
    pub fn kept(&self) -> &[Crop] {
        &self.kept
    }

    fn crop(&self, number: u64) -> Result<Crop> {
        let mut random = Random::new(self.seed ^ number.wrapping_mul(0x9E37_79B9_97F4_A7C1));
        let image = &self.images[random.below(self.images.len())];
        let scale = SCALES[0] * (SCALES[1] / SCALES[0]).powf(random.uniform());
        let side = ((SIDE as f32 / scale) as u32).min(image.width()).min(image.height());
        let x = random.below((image.width() - side + 1) as usize) as u32;
        let y = random.below((image.height() - side + 1) as usize) as u32;
        let window = image::imageops::crop_imm(image, x, y, side, side).to_image();
        let mut crop = Image::from(&window).resized(SIDE, SIDE);
        turn(&mut crop.rgb, &mut random);
        recolor(&mut crop.rgb, &mut random);
        // As from a file: what is kept is what the teacher saw.
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
        Ok(Crop { rgb, features: features.values.into_iter().map(f16::from_f32).collect() })
    }
}

/// Reads an image, shrunk where it is large.
fn open(path: &Path) -> Result<RgbImage> {
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

/// One of the square's eight symmetries; every second time the picture stays upright.
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

/// Other colors: a hundred paintings have too few. Of two crops one keeps its own; the other gets another contrast around
/// its mean, gamma, saturation, and every second time its channels in another order.
fn recolor(rgb: &mut [f32], random: &mut Random) {
    if random.below(2) == 0 {
        return;
    }
    let mut between = |low: f32, high: f32| low + (high - low) * random.uniform();
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

/// Standard deviation of each channel over all cells of some crops, none below a thousandth of the largest: in units of
/// it, all channels count the same.
///
/// # Errors
/// When the teacher's features are the same everywhere.
pub fn deviations(crops: &[Crop], n_channels: usize) -> Result<Vec<f32>> {
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
    let deviation = |[sum, squares]: &[f64; 2]| ((squares / n - (sum / n).powi(2)).max(0.0)).sqrt() as f32;
    let deviations: Vec<f32> = moments.iter().map(deviation).collect();
    let largest = deviations.iter().copied().fold(0.0, f32::max);
    let largest = Some(largest).filter(|largest| *largest > 0.0);
    let floor = 1e-3 * largest.context("the teacher gives the same features everywhere")?;
    Ok(deviations.into_iter().map(|deviation| deviation.max(floor)).collect())
}
