//! The start of a bake: the recolored scene, without the grain that the paintings lack.
//!
//! Steps add strokes quickly but take the scene's own grain away slowly, since each small Gaussian must find its neighbors'
//! mean by itself. So each band of detail on the surface is damped to the paintings' before the first step, and only those
//! bands in which the scene has more than the paintings. The contrast that goes with it is given back to what is coarser
//! than all bands: large lights and darks.

use std::collections::HashMap;

use glam::{IVec3, Vec3};
use rayon::prelude::*;
use stylegaussian::{Scene, random::Random, splat::blend_weights};

use crate::{
    cameras::Cameras, config::BakeConfig, luminance::luminance, network::Size, picture::Mask,
    target::Paintings,
};

/// Bands of detail: differences of averages over 1, 2, 4 and 8 pixels' deviation and what is finer.
const N_BANDS: usize = 4;
/// Crops in which the scene's detail is measured.
const N_CROPS: u32 = 12;
/// Largest gain of what is coarser than all bands.
const MOST_GAIN: f32 = 1.6;
/// Least gain of a band: a trace of all things stays.
const LEAST_GAIN: f32 = 0.15;
/// Rounds in which gains are found; each goes half the way, in logarithms.
const ROUNDS: usize = 24;

/// Deviations of a picture's luminance in each band, the finest first, and in what is coarser than all `[N_BANDS + 1]`.
pub(crate) type Bands = [f32; N_BANDS + 1];

/// The `recolored` scene `[N * 3]`, its bands of detail damped to the paintings'.
pub(crate) fn damped(
    config: &BakeConfig,
    scene: &Scene,
    cameras: &Cameras,
    paintings: &Paintings,
    recolored: &[f32],
) -> Vec<f32> {
    let bands = surface_bands(&scene.means, &cameras.pixels, recolored, cameras.pixel_size);
    let luminances: Vec<f32> =
        (0..scene.len()).flat_map(|i| bands.each_ref().map(|band| luminance(&band[i * 3..][..3]))).collect();
    let size = Size { width: config.crop as usize, height: config.crop as usize };
    let mut products = Products::default();
    for i in 0..N_CROPS {
        let mut random = Random::new(config.seed ^ u64::from(i + 1).wrapping_mul(0xA24B_AED4_963E_E407));
        let weights = blend_weights(scene, &cameras.sample(i, config.crop, &mut random, config.seed));
        let pixels = Mask::new(size, &weights.alpha()).cells(size);
        products.add(&weights.apply(&luminances, bands.len()), bands.len(), size.width, &pixels);
    }
    let gains = products.gains(&paintings.bands).map(|gain| gain.powf(config.damping));
    sum(&bands, &gains, paintings.mean)
}

/// A scene's colors as bands, each `[N * 3]`, the coarse rest last. They sum to the colors.
fn surface_bands(
    positions: &[Vec3],
    pixels: &[f32],
    colors: &[f32],
    pixel_size: f32,
) -> [Vec<f32>; N_BANDS + 1] {
    let mut finer = colors.to_vec();
    let mut bands = [const { Vec::new() }; N_BANDS + 1];
    for (level, band) in bands[..N_BANDS].iter_mut().enumerate() {
        let coarser = average(positions, pixels, colors, pixel_size * (1 << level) as f32);
        *band = finer.iter().zip(&coarser).map(|(fine, coarse)| fine - coarse).collect();
        finer = coarser;
    }
    bands[N_BANDS] = finer;
    bands
}

/// Sums of a cell of space.
#[derive(Clone, Copy, Default)]
struct Cell {
    weight: f32,
    position: Vec3,
    color: Vec3,
}

/// The mean of colors `[N * 3]` around every Gaussian, weighted by a normal distribution with deviation `radius`.
fn average(positions: &[Vec3], pixels: &[f32], colors: &[f32], radius: f32) -> Vec<f32> {
    let cell_of = |position: Vec3| (position / radius).floor().as_ivec3();
    let mut cells: HashMap<IVec3, Cell> = HashMap::new();
    for ((&position, &pixels), color) in positions.iter().zip(pixels).zip(colors.chunks_exact(3)) {
        let cell = cells.entry(cell_of(position)).or_default();
        // What hardly anything sees counts little, but where there is nothing else it counts.
        let weight = pixels + 1e-3;
        cell.weight += weight;
        cell.position += weight * position;
        cell.color += weight * Vec3::from_slice(color);
    }
    positions
        .par_iter()
        .flat_map_iter(|&position| {
            let (own, mut weight, mut color) = (cell_of(position), 0.0, Vec3::ZERO);
            for i in 0..27 {
                let offset = IVec3::new(i % 3, i / 3 % 3, i / 9) - 1;
                if let Some(cell) = cells.get(&(own + offset)) {
                    let apart = (cell.position / cell.weight - position) / radius;
                    let share = (-0.5 * apart.length_squared()).exp();
                    weight += share * cell.weight;
                    color += share * cell.color;
                }
            }
            (color / weight.max(f32::MIN_POSITIVE)).to_array()
        })
        .collect()
}

/// Inner products of the bands of the surface in each band of a picture `[N_BANDS + 1]`, and their number of pixels.
///
/// Rendering and blurring are linear, so the picture's bands follow from these for any gains.
#[derive(Clone, Debug, Default)]
struct Products {
    of_band: [[[f64; N_BANDS + 1]; N_BANDS + 1]; N_BANDS + 1],
    sums: [f64; N_BANDS + 1],
    n: f64,
}

impl Products {
    /// Adds a picture's `parts`, the luminance of each band of the surface `[h * w, n]`, where it is `covered`.
    pub fn add(&mut self, parts: &[f32], n: usize, width: usize, covered: &[u32]) {
        let n_pixels = parts.len() / n;
        let mut mask = vec![0.0; n_pixels];
        covered.iter().for_each(|&pixel| mask[pixel as usize] = 1.0);
        let part = |i: usize| -> Vec<f32> {
            parts.iter().skip(i).step_by(n).zip(&mask).map(|(value, mask)| value * mask).collect()
        };
        let mut finer: Vec<Vec<f32>> = (0..n).map(part).collect();
        let whole = finer.clone();
        for level in 0..=N_BANDS {
            let bands: Vec<Vec<f32>> = match level {
                N_BANDS => finer.clone(),
                _ => {
                    let radius = (1 << level) as f32;
                    let counted = blurred(&mask, width, radius);
                    let coarser: Vec<Vec<f32>> = (whole.par_iter())
                        .map(|part| {
                            let sums = blurred(part, width, radius);
                            sums.iter().zip(&counted).map(|(sum, n)| sum / n.max(1e-3)).collect()
                        })
                        .collect();
                    let pairs = finer.iter().zip(&coarser);
                    let band = pairs.map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect();
                    finer = coarser;
                    band
                }
            };
            for (i, row) in self.of_band[level].iter_mut().enumerate().take(n) {
                for (j, product) in row.iter_mut().enumerate().take(n) {
                    let value = |&pixel: &u32| f64::from(bands[i][pixel as usize] * bands[j][pixel as usize]);
                    *product += covered.iter().map(value).sum::<f64>();
                }
            }
            if level == N_BANDS {
                for (sum, band) in self.sums.iter_mut().zip(&bands) {
                    *sum += covered.iter().map(|&pixel| f64::from(band[pixel as usize])).sum::<f64>();
                }
            }
        }
        self.n += covered.len() as f64;
    }

    /// Deviations of the picture's bands with `gains` on the surface's.
    pub fn bands(&self, gains: &Bands) -> Bands {
        let n = self.n.max(1.0);
        let mean: f64 = self.sums.iter().zip(gains).map(|(sum, gain)| sum * f64::from(*gain) / n).sum();
        std::array::from_fn(|level| {
            let rows = self.of_band[level].iter().zip(gains);
            let of_row = |row: &[f64; N_BANDS + 1]| -> f64 {
                row.iter().zip(gains).map(|(product, gain)| product * f64::from(*gain)).sum()
            };
            let square: f64 = rows.map(|(row, gain)| f64::from(*gain) * of_row(row)).sum::<f64>() / n;
            let of_mean = if level == N_BANDS { mean * mean } else { 0.0 };
            (square - of_mean).max(0.0).sqrt() as f32
        })
    }

    /// The gains of the surface's bands that lead to the bands of the paintings.
    pub fn gains(&self, paintings: &Bands) -> Bands {
        let mut gains = [1.0; N_BANDS + 1];
        if self.n == 0.0 {
            return gains;
        }
        for _ in 0..ROUNDS {
            let found = self.bands(&gains);
            for level in 0..=N_BANDS {
                let [least, most] = if level == N_BANDS { [1.0, MOST_GAIN] } else { [LEAST_GAIN, 1.0] };
                let ratio = paintings[level] / found[level].max(1e-6);
                gains[level] = (gains[level] * ratio.sqrt()).clamp(least, most);
            }
        }
        gains
    }
}

/// The bands of a picture RGB `[h * w, 3]`.
pub(crate) fn picture_bands(rgb: &[f32], width: usize) -> Bands {
    let all: Vec<f32> = rgb.chunks_exact(3).map(luminance).collect();
    let every: Vec<u32> = (0..all.len() as u32).collect();
    let mut products = Products::default();
    products.add(&all, 1, width, &every);
    products.bands(&[1.0, 0.0, 0.0, 0.0, 0.0])
}

/// A picture averaged with a normal distribution of `radius` pixels' deviation. Beyond the border nothing counts.
fn blurred(values: &[f32], width: usize, radius: f32) -> Vec<f32> {
    let height = values.len() / width;
    let reach = (3.0 * radius).ceil() as isize;
    let kernel: Vec<f32> = (-reach..=reach).map(|i| (-0.5 * (i as f32 / radius).powi(2)).exp()).collect();
    let along = |values: &[f32], n: usize, stride: usize| -> Vec<f32> {
        let value = |i: usize| {
            let at = (i / stride % n) as isize;
            let (mut sum, mut weight) = (0.0, 0.0);
            for (share, offset) in kernel.iter().zip(-reach..) {
                if (0..n as isize).contains(&(at + offset)) {
                    sum += share * values[(i as isize + offset * stride as isize) as usize];
                    weight += share;
                }
            }
            sum / weight
        };
        (0..values.len()).into_par_iter().map(value).collect()
    };
    along(&along(values, width, 1), height, width)
}

/// The sum of `bands` with `gains`; the coarse rest about its mean, which is `mean`.
fn sum(bands: &[Vec<f32>; N_BANDS + 1], gains: &Bands, mean: [f32; 3]) -> Vec<f32> {
    (0..bands[0].len())
        .map(|i| {
            let fine: f32 = (0..N_BANDS).map(|band| gains[band] * bands[band][i]).sum();
            mean[i % 3] + gains[N_BANDS] * (bands[N_BANDS][i] - mean[i % 3]) + fine
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stripes_are_fine_and_halves_are_coarse() {
        let picture = |value: fn(usize) -> f32| -> Bands {
            let rgb: Vec<f32> = (0..64 * 64).flat_map(|i| [value(i % 64); 3]).collect();
            picture_bands(&rgb, 64)
        };
        let stripes = picture(|x| (x % 2) as f32);
        assert!(stripes[0] > 0.45 && stripes[1..].iter().all(|band| *band < 0.05), "{stripes:?}");
        let halves = picture(|x| (x / 32) as f32);
        assert!(halves[N_BANDS] > 0.4 && halves[0] < 0.1, "{halves:?}");
        assert!(picture(|_| 0.7).iter().all(|band| *band < 1e-3));
    }

    #[test]
    fn bands_of_the_surface_sum_to_its_colors() {
        let positions: Vec<Vec3> =
            (0..100).map(|i| Vec3::new((i % 10) as f32, (i / 10) as f32, 0.0)).collect();
        let colors: Vec<f32> = (0..300).map(|i| (i * 37 % 11) as f32 / 11.0).collect();
        let bands = surface_bands(&positions, &[1.0; 100], &colors, 1.0);
        let summed = sum(&bands, &[1.0; N_BANDS + 1], [0.4; 3]);
        assert!(summed.iter().zip(&colors).all(|(a, b)| (a - b).abs() < 1e-5));
        let spread = |values: &[f32]| values.iter().map(|value| (value - 0.45).abs()).sum::<f32>();
        assert!(spread(&bands[N_BANDS]) < 0.3 * spread(&colors));
    }

    #[test]
    fn gains_take_away_what_is_too_much_and_never_add_detail() {
        // Parts of the picture are stripes and a ramp; as if they were the finest and the coarsest of the surface's.
        let value = |i: usize| [(i % 2) as f32 - 0.5, 0.0, 0.0, 0.0, (i % 64) as f32 / 64.0];
        let parts: Vec<f32> = (0..64 * 64).flat_map(value).collect();
        let mut products = Products::default();
        products.add(&parts, N_BANDS + 1, 64, &(0..64 * 64).collect::<Vec<u32>>());
        let found = products.bands(&[1.0; N_BANDS + 1]);
        let wanted: Bands = std::array::from_fn(|i| if i == 0 { 0.5 * found[0] } else { found[i] });
        let gains = products.gains(&wanted);
        assert!((gains[0] - 0.5).abs() < 0.02 && (gains[N_BANDS] - 1.0).abs() < 0.02, "{gains:?}");
        assert!(products.gains(&found.map(|band| 3.0 * band))[0] <= 1.0);
        // Nothing seen, nothing known.
        assert_eq!(Products::default().gains(&found), [1.0; N_BANDS + 1]);
    }
}
