//! Pictures split into bands of detail, and how much each band holds.

use rayon::prelude::*;

use crate::decoder::product;

/// Number of bands: five of detail, from the finest, and the rest, which is larger than all of them.
pub(super) const N_BANDS: usize = 6;

/// The pixels of a picture that count, and tables for splitting it into bands.
pub(super) struct Mask {
    /// Size of the part that holds all that count.
    size: [usize; 2],
    /// Positions of the pixels that count, in that part.
    covered: Vec<u32>,
    /// Factors of the covered pixels of each blurred picture `[M]`: one over the blurred mask, which keeps
    /// pixels beside the scene out.
    shares: [Vec<f32>; N_BANDS - 1],
}

impl Mask {
    /// Those pixels of a picture of `size` (width and height) for which `counts` `[H * W]` holds.
    pub fn new(counts: &[bool], size: [usize; 2]) -> Self {
        let (mut min, mut end) = (size, [0, 0]);
        for (i, _) in counts.iter().enumerate().filter(|(_, counts)| **counts) {
            let at = [i % size[0], i / size[0]];
            min = [min[0].min(at[0]), min[1].min(at[1])];
            end = [end[0].max(at[0] + 1), end[1].max(at[1] + 1)];
        }
        let size_of = |axis: usize| end[axis].saturating_sub(min[axis]);
        let part = [size_of(0), size_of(1)];
        let rows = (min[1]..end[1]).map(|y| &counts[y * size[0]..][min[0]..min[0] + part[0]]);
        let counts: Vec<bool> = rows.flatten().copied().collect();
        let covered: Vec<u32> = (0..counts.len() as u32).filter(|&i| counts[i as usize]).collect();
        let mut share: Vec<f32> = counts.iter().map(|counts| f32::from(u8::from(*counts))).collect();
        let shares = std::array::from_fn(|band| {
            share = blurred(&share, part, 1 << band);
            covered.iter().map(|&i| one_over(share[i as usize])).collect()
        });
        Self { size: part, covered, shares }
    }

    /// All pixels of a picture of `size`.
    pub fn whole(size: [usize; 2]) -> Self {
        let steps: [usize; N_BANDS - 1] = std::array::from_fn(|band| 1 << band);
        let shares = std::array::from_fn(|band| {
            whole_blurred(size, &steps[..=band]).into_iter().map(one_over).collect()
        });
        Self { size, covered: (0..(size[0] * size[1]) as u32).collect(), shares }
    }

    /// The number of pixels that count, M.
    pub fn n_covered(&self) -> usize {
        self.covered.len()
    }

    /// The B finest bands of a picture's `values` at the covered pixels `[M]`, each `[M]`. All of them sum to
    /// the values without their mean.
    pub fn bands<const B: usize>(&self, values: &[f32]) -> [Vec<f32>; B] {
        let n = self.covered.len().max(1) as f64;
        let mean = (values.iter().map(|value| f64::from(*value)).sum::<f64>() / n) as f32;
        let mut picture = vec![0.0; self.size[0] * self.size[1]];
        self.covered.iter().zip(values).for_each(|(&i, value)| picture[i as usize] = value - mean);
        let mut finer: Vec<f32> = values.iter().map(|value| value - mean).collect();
        std::array::from_fn(|band| {
            if band == N_BANDS - 1 {
                return std::mem::take(&mut finer);
            }
            // Blurs add up.
            picture = blurred(&picture, self.size, 1 << band);
            let shares = self.covered.iter().zip(&self.shares[band]);
            let coarser: Vec<f32> = shares.map(|(&i, share)| picture[i as usize] * share).collect();
            finer.iter_mut().zip(&coarser).for_each(|(finer, coarser)| *finer -= coarser);
            std::mem::replace(&mut finer, coarser)
        })
    }
}

/// One over a share of the mask, and at most 1000.
fn one_over(share: f32) -> f32 {
    1.0 / share.max(1e-3)
}

/// A picture of ones `[H * W]`, blurred one after another by `steps`.
fn whole_blurred([width, height]: [usize; 2], steps: &[usize]) -> Vec<f32> {
    // Each axis by itself.
    let side = |n: usize| {
        steps.iter().fold(vec![1.0; n], |values: Vec<f32>, &step| {
            let mut wide = vec![0.0; n + 4 * step];
            wide[2 * step..2 * step + n].copy_from_slice(&values);
            let mut out = values;
            weighted(&mut out, std::array::from_fn(|tap| &wide[tap * step..]));
            out
        })
    };
    let (along, down) = (side(width), side(height));
    down.iter().flat_map(|y| along.iter().map(move |x| x * y)).collect()
}

/// The scalar product, in f64.
pub(super) fn dot(a: &[f32], b: &[f32]) -> f64 {
    // Blocks in f32, which the compiler makes vectors of, are summed in f64.
    let block = |(a, b): (&[f32], &[f32])| f64::from(product::dot(a, b));
    a.chunks(256).zip(b.chunks(256)).map(block).sum()
}

/// A picture blurred by the weights 1, 4, 6, 4, 1 (over 16), `step` pixels apart: a deviation of `step` pixels.
/// Beyond its edges it is 0.
fn blurred(picture: &[f32], [width, height]: [usize; 2], step: usize) -> Vec<f32> {
    let mut both = vec![0.0; picture.len()];
    let nothing = vec![0.0; width];
    let row = |y: usize| picture.get(y * width..(y + 1) * width).unwrap_or(&nothing);
    // A row blurred across rows, with zeros on both sides, in which it is then blurred along itself.
    let wide = || vec![0.0; width + 4 * step];
    both.par_chunks_mut(width.max(1)).enumerate().for_each_init(wide, |wide, (y, out)| {
        // Rows above the picture wrap around to where there is none.
        let rows = std::array::from_fn(|tap| row((y + tap * step).wrapping_sub(2 * step).min(height)));
        weighted(&mut wide[2 * step..2 * step + width], rows);
        weighted(out, std::array::from_fn(|tap| &wide[tap * step..]));
    });
    both
}

/// The sums of five values by the weights 1, 4, 6, 4, 1 (over 16).
fn weighted(sums: &mut [f32], values: [&[f32]; 5]) {
    let n = sums.len();
    let [a, b, c, d, e] = values.map(|values| &values[..n]);
    for i in 0..n {
        sums[i] = 0.375 * c[i] + 0.25 * (b[i] + d[i]) + 0.0625 * (a[i] + e[i]);
    }
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
        let values: Vec<f32> =
            stripes(3).into_iter().zip(&counts).filter(|(_, c)| **c).map(|(v, _)| v).collect();
        let bands: [_; N_BANDS] = mask.bands(&values);
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        for (i, value) in values.iter().enumerate() {
            let sum: f32 = bands.iter().map(|band| band[i]).sum();
            assert!((sum - (value - mean)).abs() < 1e-4);
        }
        let shares = |picture: &[f32]| {
            let energies = Mask::whole(size).bands(picture).map(|band: Vec<f32>| dot(&band, &band));
            energies.map(|energy: f64| energy / energies.iter().sum::<f64>())
        };
        let shares: [[f64; N_BANDS]; 2] = [shares(&stripes(1)), shares(&stripes(16))];
        let [fine, coarse] = shares;
        // The edges of wide stripes have some detail of any size.
        assert!(fine[0] > 0.9 && coarse[0] < 0.2 && coarse[3] + coarse[4] > 0.5, "{fine:?} {coarse:?}");
    }

    #[test]
    fn a_mask_of_all_pixels_is_the_whole() {
        let size = [37, 21];
        let (all, whole) = (Mask::new(&vec![true; 37 * 21], size), Mask::whole(size));
        assert_eq!((all.size, &all.covered), (whole.size, &whole.covered));
        for (a, b) in all.shares.iter().flatten().zip(whole.shares.iter().flatten()) {
            assert!((a / b - 1.0).abs() < 1e-4, "{a} and {b}");
        }
    }

    #[test]
    fn what_is_beside_the_scene_makes_no_edge() {
        let size = [32, 32];
        let counts: Vec<bool> = (0..1024).map(|i| i % 32 < 16).collect();
        let mask = Mask::new(&counts, size);
        let bands: [_; N_BANDS] = mask.bands(&vec![0.7; mask.n_covered()]);
        assert!(bands.iter().flatten().all(|value| value.abs() < 1e-5));
    }
}
