//! The part of a painting that a style carries.

use glam::Vec3;

use crate::{decoder::product::dot, principal::leading_axes};

/// Most pixels of a painting: 512 x 512, as AdaIN sees it. In bytes it takes 768 KiB.
pub const MAX_PIXELS: usize = 512 * 512;

/// Side of a place, in pixels: the cells of relu3_1 are 4 pixels wide, and four of them make a place.
pub(super) const PLACE: usize = 8;

/// Dimensions in which features are compared. They hold most of the variance of a painting's normalized features.
const N_DIMENSIONS: usize = 16;

/// A painting's pixels, and features of its places.
#[derive(Clone, Debug, PartialEq)]
pub struct Paint {
    /// Columns.
    pub width: usize,
    /// Rows, from the top.
    pub height: usize,
    /// Display-referred RGB, row-major `[height, width, 3]`, at most [`MAX_PIXELS`] pixels.
    pub pixels: Vec<u8>,
    /// Features of its places, by which they are matched to surfaces. Without any, colors alone decide.
    pub features: Option<PaintFeatures>,
}

/// Features of a painting's places: squares of 8 pixels, row-major, those at the right and the bottom cut off.
///
/// They are the encoder's features with mean 0 and deviation 1 in each channel, which is what AdaIN makes equal between
/// scene and painting, in the directions of their largest variance.
#[derive(Clone, Debug, PartialEq)]
pub struct PaintFeatures {
    /// Unit vectors in the space of normalized channels `[C, D]`.
    pub axes: Vec<f32>,
    /// Coordinates of each place `[P, C]`.
    pub places: Vec<f32>,
    /// D, the number of the encoder's channels.
    pub n_channels: usize,
}

impl Paint {
    /// The columns and rows at which a painting of `width` x `height` pixels is kept: shrunk to at most [`MAX_PIXELS`] with
    /// its proportions, and never enlarged.
    pub fn size_of(width: u32, height: u32) -> (u32, u32) {
        let n_pixels = f64::from(width) * f64::from(height);
        let factor = (MAX_PIXELS as f64 / n_pixels).sqrt();
        if factor >= 1.0 {
            return (width, height);
        }
        // Rounded down, because two sides rounded up could exceed the limit. A line keeps one pixel of width.
        let shrink = |side: u32| ((f64::from(side) * factor) as u32).clamp(1, MAX_PIXELS as u32);
        (shrink(width), shrink(height))
    }

    /// A painting of display-referred RGB 0..1, row-major `[height, width, 3]`, without features.
    pub fn new(width: usize, height: usize, rgb: &[f32]) -> Self {
        // The cast saturates, and makes 0 of NaN.
        let pixels = rgb.iter().map(|value| (value * 255.0).round() as u8).collect();
        Self { width, height, pixels, features: None }
    }

    /// Its colors, 0..1 `[height * width]`.
    pub(super) fn colors(&self) -> Vec<Vec3> {
        self.pixels
            .chunks_exact(3)
            .map(|p| Vec3::new(p[0].into(), p[1].into(), p[2].into()) / 255.0)
            .collect()
    }

    /// Columns and rows of places.
    pub fn n_places(&self) -> (usize, usize) {
        (self.width.div_ceil(PLACE), self.height.div_ceil(PLACE))
    }

    /// The same paint with the features of a map `[rows, columns, D]` over the whole painting.
    ///
    /// # Panics
    /// If `values` does not hold `columns` x `rows` x `n_channels` numbers.
    pub fn with_features(self, values: &[f32], columns: usize, rows: usize, n_channels: usize) -> Self {
        assert_eq!(values.len(), columns * rows * n_channels, "features [rows, columns, D]");
        if values.is_empty() {
            return self;
        }
        let (n_x, n_y) = self.n_places();
        let mut places = Vec::with_capacity(n_x * n_y * n_channels);
        for place in 0..n_x * n_y {
            // The cells that a place covers: the ranges meet, and hold at least one cell.
            let cells = |at: usize, n: usize, n_cells: usize| {
                let start = (at * n_cells / n).min(n_cells - 1);
                start..((at + 1) * n_cells / n).max(start + 1)
            };
            let mut mean = vec![0.0; n_channels];
            let (xs, ys) = (cells(place % n_x, n_x, columns), cells(place / n_x, n_y, rows));
            let share = 1.0 / (xs.len() * ys.len()) as f32;
            for cell in ys.flat_map(|y| xs.clone().map(move |x| y * columns + x)) {
                let row = &values[cell * n_channels..(cell + 1) * n_channels];
                mean.iter_mut().zip(row).for_each(|(sum, value)| *sum += share * value);
            }
            places.extend(mean);
        }
        normalize(&mut places, n_channels);
        let axes = leading_axes(&places, n_channels, N_DIMENSIONS.min(n_channels));
        let coordinates =
            |place: &[f32]| axes.chunks_exact(n_channels).map(|axis| dot(axis, place)).collect();
        let places = places.chunks_exact(n_channels).flat_map(|place| -> Vec<f32> { coordinates(place) });
        let places = places.collect();
        Self { features: Some(PaintFeatures { axes, places, n_channels }), ..self }
    }
}

/// Least deviation of a channel as a share of the median deviation. A channel that hardly varies says little, and would
/// be magnified to as much as the others.
const LEAST_DEVIATION: f32 = 0.1;

/// `deviations` raised to [`LEAST_DEVIATION`] of their median, and above 0.
pub(super) fn floored(deviations: &mut [f32]) {
    let mut sorted = deviations.to_vec();
    sorted.sort_by(f32::total_cmp);
    let floor = LEAST_DEVIATION * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    deviations.iter_mut().for_each(|value| *value = value.max(floor).max(1e-6));
}

/// Brings every channel of `rows` `[P, D]` to mean 0 and deviation 1.
fn normalize(rows: &mut [f32], n_channels: usize) {
    let n = (rows.len() / n_channels) as f32;
    let mut mean = vec![0.0; n_channels];
    for row in rows.chunks_exact(n_channels) {
        mean.iter_mut().zip(row).for_each(|(sum, value)| *sum += value / n);
    }
    let mut deviations = vec![0.0; n_channels];
    for row in rows.chunks_exact_mut(n_channels) {
        for ((value, mean), square) in row.iter_mut().zip(&mean).zip(&mut deviations) {
            *value -= mean;
            *square += *value * *value / n;
        }
    }
    deviations.iter_mut().for_each(|variance| *variance = variance.sqrt());
    floored(&mut deviations);
    for row in rows.chunks_exact_mut(n_channels) {
        row.iter_mut().zip(&deviations).for_each(|(value, deviation)| *value /= deviation);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two channels that rise and fall together and a third that is constant: all variance lies along (1, 1, 0).
    #[test]
    fn features_keep_the_direction_of_their_variance() {
        let values: Vec<f32> = [1.0, 3.0, 5.0, 7.0].iter().flat_map(|x| [*x, 10.0 * x, 4.0]).collect();
        let paint = Paint { width: 32, height: 8, pixels: vec![0; 32 * 8 * 3], features: None };
        let features = paint.with_features(&values, 4, 1, 3).features.unwrap();
        let first = &features.axes[..3];
        assert!((first[0].abs() - 0.5_f32.sqrt()).abs() < 1e-4 && (first[0] - first[1]).abs() < 1e-4);
        assert!(first[2].abs() < 1e-4);
        // Normalized, each of the two has deviations -3, -1, 1, 3 over sqrt(5); together sqrt(2) times as much.
        let along: Vec<f32> =
            features.places.chunks_exact(3).map(|place| place[0] * first[0].signum()).collect();
        for (found, x) in along.iter().zip([-3.0, -1.0, 1.0, 3.0_f32]) {
            assert!((found - x * (2.0_f32 / 5.0).sqrt()).abs() < 1e-4, "{along:?}");
        }
    }

    #[test]
    fn paintings_are_kept_below_the_limit() {
        assert_eq!(Paint::size_of(512, 512), (512, 512));
        assert_eq!(Paint::size_of(2048, 512), (1024, 256));
        assert_eq!(Paint::size_of(3, 7), (3, 7));
        for (width, height) in [(16_000, 40), (1000, 741), (16_384, 4096), (1 << 20, 1), (1, 1 << 20)] {
            let (width, height) = Paint::size_of(width, height);
            assert!(
                width as usize * height as usize <= MAX_PIXELS && width.min(height) > 0,
                "{width}x{height}"
            );
        }
    }

    #[test]
    fn a_painting_of_one_pixel_has_one_place() {
        let paint = Paint { width: 1, height: 1, pixels: vec![9; 3], features: None };
        assert_eq!(paint.n_places(), (1, 1));
        let features = paint.with_features(&[1.0, 2.0], 1, 1, 2).features.unwrap();
        assert_eq!(features.places, [0.0, 0.0]);
    }
}
