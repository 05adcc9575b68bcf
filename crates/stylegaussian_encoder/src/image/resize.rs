//! Resizing in two passes, down and across, with the weights of the `image` crate. It runs on the threads of
//! rayon's pool, and stops soon if nobody waits for the result.

use std::{
    f32::consts::PI,
    sync::atomic::{AtomicUsize, Ordering},
};

use rayon::prelude::*;
use stylegaussian::work::{Canceled, Work};

/// A filter. Where an image shrinks, it covers as many old pixels more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Filter {
    /// Lanczos of 3 lobes.
    Lanczos3,
    /// A triangle over two pixels.
    Triangle,
}

impl Filter {
    /// Distance beyond which the weight is 0, in pixels.
    fn reach(self) -> f32 {
        match self {
            Self::Lanczos3 => 3.0,
            Self::Triangle => 1.0,
        }
    }

    /// Weight at a distance in pixels, before weights are divided by their sum.
    fn weight(self, x: f32) -> f32 {
        if x.abs() >= self.reach() {
            return 0.0;
        }
        match self {
            Self::Lanczos3 => sinc(x) * sinc(x / 3.0),
            Self::Triangle => 1.0 - x.abs(),
        }
    }
}

fn sinc(x: f32) -> f32 {
    let x = x * PI;
    if x == 0.0 { 1.0 } else { x.sin() / x }
}

/// The old lines that a new one is made of: the number of the first one, and their weights, which sum to 1.
struct Lines {
    first: usize,
    weights: Vec<f32>,
}

/// The old lines of each of `to` new ones, of `from`, which is at least 1.
fn lines(from: usize, to: usize, filter: Filter) -> Vec<Lines> {
    let ratio = from as f32 / to as f32;
    let scale = ratio.max(1.0);
    let reach = filter.reach() * scale;
    let line = |i: usize| {
        let center = (i as f32 + 0.5) * ratio;
        let first = ((center - reach).floor() as i64).clamp(0, from as i64 - 1);
        let end = ((center + reach).ceil() as i64).clamp(first + 1, from as i64);
        // The middle of line k lies at k + 0.5.
        let center = center - 0.5;
        let mut weights: Vec<f32> =
            (first..end).map(|k| filter.weight((k as f32 - center) / scale)).collect();
        let sum: f32 = weights.iter().sum();
        weights.iter_mut().for_each(|weight| *weight /= sum);
        Lines { first: first as usize, weights }
    };
    (0..to).map(line).collect()
}

/// `values` `[height, width, channels]` at another size (width, height). Neither has a side of 0. Values beyond
/// those of the image may appear at edges.
///
/// # Errors
/// If `work` is canceled.
pub(super) fn resized(
    values: &[f32],
    channels: usize,
    [width, height]: [usize; 2],
    to: [usize; 2],
    filter: Filter,
    work: &Work,
) -> Result<Vec<f32>, Canceled> {
    let [columns, rows] = [lines(width, to[0], filter), lines(height, to[1], filter)];
    let line = width * channels;
    let mut resized = vec![0.0; to[0] * to[1] * channels];
    let n_done = AtomicUsize::new(0);
    resized.par_chunks_mut(to[0] * channels).zip(&rows).try_for_each(|(new, row)| {
        work.check()?;
        let mut sums = vec![0.0_f32; line];
        for (old, weight) in values[row.first * line..].chunks_exact(line).zip(&row.weights) {
            sums.iter_mut().zip(old).for_each(|(sum, value)| *sum += value * weight);
        }
        for (new, column) in new.chunks_exact_mut(channels).zip(&columns) {
            let old = sums[column.first * channels..].chunks_exact(channels);
            for (old, weight) in old.zip(&column.weights) {
                new.iter_mut().zip(old).for_each(|(sum, value)| *sum += value * weight);
            }
        }
        work.at((n_done.fetch_add(1, Ordering::Relaxed) + 1) as f32 / rows.len() as f32)
    })?;
    Ok(resized)
}

#[cfg(test)]
mod tests {
    use image::{
        ImageBuffer, Rgb,
        imageops::{self, FilterType},
    };
    use stylegaussian::random::Random;

    use super::*;

    #[test]
    fn pixels_are_those_of_the_image_crate() {
        let mut random = Random::new(1);
        for ([width, height], to) in
            [([40, 23], [13, 30]), ([9, 8], [9, 3]), ([64, 2], [5, 1]), ([1, 7], [3, 2])]
        {
            let values: Vec<f32> = (0..3 * width * height).map(|_| random.uniform()).collect();
            let other =
                ImageBuffer::<Rgb<f32>, Vec<f32>>::from_raw(width as u32, height as u32, values.clone());
            let other = other.unwrap();
            for (filter, of_crate) in
                [(Filter::Lanczos3, FilterType::Lanczos3), (Filter::Triangle, FilterType::Triangle)]
            {
                let expected = imageops::resize(&other, to[0] as u32, to[1] as u32, of_crate).into_raw();
                let found = resized(&values, 3, [width, height], to, filter, &Work::default()).unwrap();
                assert_eq!(found.len(), expected.len());
                for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
                    let found = found.clamp(0.0, 1.0);
                    assert!(
                        (found - expected).abs() < 1e-5,
                        "{filter:?} {to:?} [{i}]: {found} for {expected}"
                    );
                }
            }
        }
    }
}
