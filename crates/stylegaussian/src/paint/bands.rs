//! Pictures split into bands of detail, and how much each band holds.

use rayon::prelude::*;

/// Bands of detail, from the finest, and the rest: what is larger than all of them.
pub(super) const N_BANDS: usize = 6;

/// The pixels of a picture that count, and what splitting it needs.
pub(super) struct Mask {
    size: [usize; 2],
    /// Positions of the pixels that count, in the picture.
    pub covered: Vec<u32>,
    /// The mask `[H * W]`, blurred as each band is.
    shares: Vec<Vec<f32>>,
}

impl Mask {
    /// Those pixels of a picture of `size` (width and height) for which `counts` `[H * W]` holds.
    pub fn new(counts: &[bool], size: [usize; 2]) -> Self {
        let mut shares: Vec<Vec<f32>> =
            vec![counts.iter().map(|counts| f32::from(u8::from(*counts))).collect()];
        for level in 0..N_BANDS - 1 {
            shares.push(blurred(&shares[level], size, 1 << level));
        }
        let covered = (0..counts.len() as u32).filter(|&i| counts[i as usize]).collect();
        Self { size, covered, shares }
    }

    /// Bands of a picture's `values` at the covered pixels `[M]`, each `[M]`. They sum to the values without their mean.
    pub fn bands(&self, values: &[f32]) -> [Vec<f32>; N_BANDS] {
        let n = self.covered.len().max(1) as f64;
        let mean = (values.iter().map(|value| f64::from(*value)).sum::<f64>() / n) as f32;
        let mut picture = vec![0.0; self.size[0] * self.size[1]];
        self.covered.iter().zip(values).for_each(|(&i, value)| picture[i as usize] = value - mean);
        let mut finer: Vec<f32> = values.iter().map(|value| value - mean).collect();
        std::array::from_fn(|band| {
            if band == N_BANDS - 1 {
                return std::mem::take(&mut finer);
            }
            // Blurs add up. Dividing by the blurred mask keeps what lies beside the scene out.
            picture = blurred(&picture, self.size, 1 << band);
            let share = &self.shares[band + 1];
            let coarser: Vec<f32> =
                self.covered.iter().map(|&i| picture[i as usize] / share[i as usize].max(1e-3)).collect();
            let detail = finer.iter().zip(&coarser).map(|(finer, coarser)| finer - coarser).collect();
            finer = coarser;
            detail
        })
    }
}

/// The share of variance that each band of a picture `[H * W]` holds. They are all 0 if it has a single value.
pub(super) fn spectrum(picture: &[f32], size: [usize; 2]) -> [f64; N_BANDS] {
    let bands = Mask::new(&vec![true; picture.len()], size).bands(picture);
    let energies = bands.map(|band| dot(&band, &band));
    let total: f64 = energies.iter().sum();
    energies.map(|energy| if total > 1e-6 * picture.len() as f64 { energy / total } else { 0.0 })
}

/// The deviation of a picture's three finest bands around each pixel `[H * W]`, from the finest.
pub(super) fn energies(picture: &[f32], size: [usize; 2]) -> [Vec<f32>; 3] {
    let [a, b, c, ..] = Mask::new(&vec![true; picture.len()], size).bands(picture);
    let squares = [a, b, c].map(|band| band.iter().map(|value| value * value).collect());
    // Twice a deviation of 4 pixels is one of 5.7.
    let around = softened(squares, size, &[4, 4]);
    around.map(|square| square.into_iter().map(f32::sqrt).collect())
}

/// Pictures blurred one after another by deviations of `steps` pixels. Beyond their edges is nothing that they could mix with.
pub(super) fn softened(pictures: [Vec<f32>; 3], size: [usize; 2], steps: &[usize]) -> [Vec<f32>; 3] {
    let soft = |values: Vec<f32>| steps.iter().fold(values, |values, &step| blurred(&values, size, step));
    let share = soft(vec![1.0; pictures[0].len()]);
    pictures.map(|picture| {
        soft(picture).iter().zip(&share).map(|(value, share)| value / share.max(1e-3)).collect()
    })
}

/// The scalar product, in f64.
pub(super) fn dot(a: &[f32], b: &[f32]) -> f64 {
    // Blocks in f32, which the compiler makes vectors of, are summed in f64.
    let block = |(a, b): (&[f32], &[f32])| f64::from(super::painting::dot(a, b));
    a.chunks(256).zip(b.chunks(256)).map(block).sum()
}

/// A picture blurred by the weights 1, 4, 6, 4, 1 (over 16), `step` pixels apart: a deviation of `step` pixels. Beyond
/// its edges it is 0.
fn blurred(picture: &[f32], [width, height]: [usize; 2], step: usize) -> Vec<f32> {
    const WEIGHTS: [f32; 3] = [0.375, 0.25, 0.0625];
    let add = |sum: &mut [f32], values: &[f32], weight: f32| {
        sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
    };
    let mut rows = vec![0.0; picture.len()];
    rows.par_chunks_mut(width.max(1)).zip(picture.par_chunks(width.max(1))).for_each(|(sum, row)| {
        add(sum, row, WEIGHTS[0]);
        for (taps, weight) in [(step, WEIGHTS[1]), (2 * step, WEIGHTS[2])] {
            if taps < width {
                add(&mut sum[taps..], &row[..width - taps], weight);
                add(&mut sum[..width - taps], &row[taps..], weight);
            }
        }
    });
    let mut both = vec![0.0; picture.len()];
    both.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, sum)| {
        let row = |y: usize| &rows[y * width..(y + 1) * width];
        add(sum, row(y), WEIGHTS[0]);
        for (taps, weight) in [(step, WEIGHTS[1]), (2 * step, WEIGHTS[2])] {
            if y >= taps {
                add(sum, row(y - taps), weight);
            }
            if y + taps < height {
                add(sum, row(y + taps), weight);
            }
        }
    });
    both
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_sum_to_the_picture_and_know_fine_from_coarse() {
        let size = [64, 48];
        let stripes = |width: usize| -> Vec<f32> {
            (0..size[0] * size[1]).map(|i| f32::from(u8::from((i % 64 / width).is_multiple_of(2)))).collect()
        };
        let counts: Vec<bool> = (0..size[0] * size[1]).map(|i| i % 64 < 50).collect();
        let mask = Mask::new(&counts, size);
        let values: Vec<f32> = mask.covered.iter().map(|&i| stripes(3)[i as usize]).collect();
        let bands = mask.bands(&values);
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        for (i, value) in values.iter().enumerate() {
            let sum: f32 = bands.iter().map(|band| band[i]).sum();
            assert!((sum - (value - mean)).abs() < 1e-4);
        }
        let (fine, coarse) = (spectrum(&stripes(1), size), spectrum(&stripes(16), size));
        // The edges of wide stripes have some detail of any size.
        assert!(fine[0] > 0.9 && coarse[0] < 0.2 && coarse[3] + coarse[4] > 0.5, "{fine:?} {coarse:?}");
        assert_eq!(spectrum(&[0.5; 12], [4, 3]), [0.0; N_BANDS]);
    }

    #[test]
    fn what_is_beside_the_scene_makes_no_edge() {
        let size = [32, 32];
        let counts: Vec<bool> = (0..1024).map(|i| i % 32 < 16).collect();
        let mask = Mask::new(&counts, size);
        let bands = mask.bands(&vec![0.7; mask.covered.len()]);
        assert!(bands.iter().flatten().all(|value| value.abs() < 1e-5));
    }
}
