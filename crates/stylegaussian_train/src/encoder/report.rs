//! Comparison of two encoders on images that neither was fitted to.

use std::{path::PathBuf, time::Instant};

use serde::Serialize;
use stylegaussian_encoder::{Encoder, FeatureMap, Image, StyleSize, style_features, style_statistics};

use crate::error::{TrainError, ensure};

/// Side of the image on which encoding is timed, in pixels, and the number of runs, of which the fastest
/// counts.
const TIMED_SIDE: u32 = 256;
const TIMED_RUNS: usize = 5;

/// Agreement of a student with its teacher.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Number of images, each at the size at which a style image is encoded.
    pub n_images: usize,
    /// Correlation of each channel over all cells of all images: its median over the channels.
    pub correlation_median: f64,
    /// Its 10th percentile.
    pub correlation_10th: f64,
    /// Its least.
    pub correlation_least: f64,
    /// Median over channels and images of |mean - true mean| / true mean.
    pub mean_error: f64,
    /// The same of the standard deviations.
    pub std_dev_error: f64,
    /// Mean squared error in units of each channel's variance, averaged over channels.
    pub unexplained: f64,
    /// Milliseconds from a 256x256 image to its statistics.
    pub milliseconds: f64,
    /// The same for the teacher.
    pub teacher_milliseconds: f64,
}

/// Sums over cells of one channel: true value t and found value f.
#[derive(Clone, Copy, Default)]
struct Moments {
    t: f64,
    f: f64,
    tt: f64,
    ff: f64,
    tf: f64,
}

impl Moments {
    fn add(&mut self, t: f64, f: f64) {
        // In f64, because the differences of these sums nearly cancel.
        self.t += t;
        self.f += f;
        self.tt += t * t;
        self.ff += f * f;
        self.tf += t * f;
    }

    /// Correlation over `n` cells; `None` if the true channel is constant.
    fn correlation(&self, n: f64) -> Option<f64> {
        let covariance = self.tf / n - self.t / n * (self.f / n);
        let variances =
            [(self.tt, self.t), (self.ff, self.f)].map(|(squares, sum)| squares / n - (sum / n).powi(2));
        let [true_variance, variance] = variances;
        // A student's constant channel gives 0 instead of 0 / 0.
        (true_variance > 1e-12).then(|| covariance / (true_variance * variance.max(1e-12)).sqrt())
    }

    fn unexplained(&self, n: f64) -> f64 {
        let variance = self.tt / n - (self.t / n).powi(2);
        (self.tt - 2.0 * self.tf + self.ff) / n / variance.max(1e-12)
    }
}

/// Compares `student` with `teacher` on the images at `paths`.
///
/// # Errors
/// If an image cannot be read or encoded, or the two give features of different shapes.
pub fn compare(teacher: &Encoder, student: &Encoder, paths: &[PathBuf]) -> Result<Comparison, TrainError> {
    ensure!(
        student.n_channels() == teacher.n_channels(),
        "{}: gives {} channels, expected the teacher's {}",
        student.id(),
        student.n_channels(),
        teacher.n_channels()
    );
    let mut moments = vec![Moments::default(); teacher.n_channels()];
    let (mut n, mut mean_errors, mut std_dev_errors) = (0.0, Vec::new(), Vec::new());
    for path in paths {
        let image = Image::open_painting(path)?;
        let size = StyleSize::default();
        let [t, f] = [style_features(teacher, &image, size)?, style_features(student, &image, size)?];
        let shape = |map: &FeatureMap| (map.width, map.height);
        ensure!(
            shape(&t) == shape(&f),
            "{}: found {:?} cells for {}, expected the teacher's {:?}",
            student.id(),
            shape(&f),
            path.display(),
            shape(&t)
        );
        let cells = t.values.chunks_exact(t.n_channels).zip(f.values.chunks_exact(t.n_channels));
        for (t, f) in cells {
            n += 1.0;
            let channels = moments.iter_mut().zip(t.iter().zip(f));
            channels.for_each(|(moments, (t, f))| moments.add(f64::from(*t), f64::from(*f)));
        }
        let [t, f] = [t.statistics(), f.statistics()];
        mean_errors.extend(relative_errors(&t.mean, &f.mean));
        std_dev_errors.extend(relative_errors(&t.std_dev, &f.std_dev));
    }
    let mut correlations: Vec<f64> = moments.iter().filter_map(|moments| moments.correlation(n)).collect();
    ensure!(!correlations.is_empty(), "the teacher gives the same features everywhere");
    let unexplained =
        moments.iter().map(|moments| moments.unexplained(n)).sum::<f64>() / moments.len() as f64;
    Ok(Comparison {
        n_images: paths.len(),
        correlation_median: quantile(&mut correlations, 0.5),
        correlation_10th: quantile(&mut correlations, 0.1),
        correlation_least: quantile(&mut correlations, 0.0),
        mean_error: quantile(&mut mean_errors, 0.5),
        std_dev_error: quantile(&mut std_dev_errors, 0.5),
        unexplained,
        milliseconds: milliseconds(student)?,
        teacher_milliseconds: milliseconds(teacher)?,
    })
}

fn relative_errors<'a>(truth: &'a [f32], found: &'a [f32]) -> impl Iterator<Item = f64> + 'a {
    let pairs = truth.iter().zip(found).filter(|(truth, _)| **truth > 0.0);
    pairs.map(|(truth, found)| f64::from((found - truth).abs() / truth))
}

/// The value below which this share of the values lies, or 0 if there are none.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    values.get((last as f64 * share).round() as usize).copied().unwrap_or(0.0)
}

fn milliseconds(encoder: &Encoder) -> Result<f64, TrainError> {
    let n = TIMED_SIDE as usize * TIMED_SIDE as usize * 3;
    let rgb = (0..n).map(|i| (i * 7 % 256) as f32 / 255.0).collect();
    let image = Image { width: TIMED_SIDE, height: TIMED_SIDE, rgb, alpha: None };
    let mut fastest = f64::INFINITY;
    for _ in 0..TIMED_RUNS {
        let start = Instant::now();
        style_statistics(encoder, &image, StyleSize::default())?;
        // The fastest run is the one that other work disturbed least.
        fastest = fastest.min(start.elapsed().as_secs_f64() * 1e3);
    }
    Ok(fastest)
}

impl Comparison {
    /// A table for people.
    pub fn table(&self) -> String {
        let percent = |share: f64| format!("{:.1}%", 100.0 * share);
        [
            ("images", self.n_images.to_string()),
            ("correlation, median channel", format!("{:.3}", self.correlation_median)),
            ("correlation, 10th percentile", format!("{:.3}", self.correlation_10th)),
            ("correlation, least", format!("{:.3}", self.correlation_least)),
            ("error of means, median", percent(self.mean_error)),
            ("error of deviations, median", percent(self.std_dev_error)),
            ("variance not explained", percent(self.unexplained)),
            ("256x256 to statistics", format!("{:.0} ms", self.milliseconds)),
            ("the same with the teacher", format!("{:.0} ms", self.teacher_milliseconds)),
        ]
        .map(|(what, value)| format!("{what:<30} {value:>8}\n"))
        .concat()
    }
}
