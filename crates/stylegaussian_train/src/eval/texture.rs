//! Texture apart from palette: pictures as luminance of equal mean and deviation, and the energy of their fine
//! detail.
//!
//! VGG-19's statistics of such pictures tell brushwork, not color: recoloring a scene scores at chance.

/// Deviation of [`luminance`]'s pictures around 0.5. Most pictures then stay within 0..1.
const DEVIATION: f64 = 0.18;

/// Keeps a picture of one color from dividing by 0. Far below the 1/255 that a display can show.
const LEAST_DEVIATION: f64 = 1e-6;

/// A pixel counts as covered if its alpha is above this. At the fringes of a scene the background shines
/// through.
const COVERED: f32 = 0.9;

/// Which pixels of a view show the scene, from its alpha `[H * W]`.
pub fn covered(alpha: &[f32]) -> Vec<bool> {
    alpha.iter().map(|alpha| *alpha > COVERED).collect()
}

/// The luminance (Rec. 601) of each pixel of a picture `[H * W * 3]`.
fn luma(rgb: &[f32]) -> Vec<f64> {
    let weighted = |p: &[f32]| 0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2]);
    rgb.chunks_exact(3).map(weighted).collect()
}

/// Mean and deviation of those values whose pixels count.
fn moments(values: &[f64], counts: &[bool]) -> (f64, f64) {
    let counted = || values.iter().zip(counts).filter(|(_, counts)| **counts).map(|(value, _)| *value);
    let n = counted().count().max(1) as f64;
    let mean = counted().sum::<f64>() / n;
    (mean, (counted().map(|value| (value - mean).powi(2)).sum::<f64>() / n).sqrt())
}

/// A gray picture `[H * W * 3]` of equal mean (0.5) and deviation (0.18) whatever the colors of `rgb`
/// `[H * W * 3]`, clamped to 0..1. Pixels that do not count are 0.5.
pub fn luminance(rgb: &[f32], counts: &[bool]) -> Vec<f32> {
    let luma = luma(rgb);
    let (mean, deviation) = moments(&luma, counts);
    let gray = |(value, counts): (f64, &bool)| match counts {
        true => ((value - mean) / (deviation + LEAST_DEVIATION) * DEVIATION + 0.5).clamp(0.0, 1.0) as f32,
        false => 0.5,
    };
    luma.into_iter().zip(counts).flat_map(|pixel| [gray(pixel); 3]).collect()
}

/// How much fine texture a picture `[H * W * 3]` of `[W, H]` pixels has: the deviation of its luminance's
/// Laplacian over that of the luminance itself. Only pixels that count and whose four neighbors do are seen; 0
/// if there are none.
pub fn grain(rgb: &[f32], counts: &[bool], [width, height]: [usize; 2]) -> f64 {
    let luma = luma(rgb);
    let (mut laplacians, mut inner) = (Vec::new(), Vec::new());
    for y in 1..height.saturating_sub(1) {
        for x in 1..width.saturating_sub(1) {
            let at = y * width + x;
            let around = [at - width, at + width, at - 1, at + 1];
            if counts[at] && around.iter().all(|&i| counts[i]) {
                laplacians.push(4.0 * luma[at] - around.iter().map(|&i| luma[i]).sum::<f64>());
                inner.push(luma[at]);
            }
        }
    }
    let all = vec![true; inner.len()];
    moments(&laplacians, &all).1 / (moments(&inner, &all).1 + LEAST_DEVIATION)
}

/// Which cells of a feature map of `[w, h]` cells, each `side` x `side` pixels, see only pixels that count. A
/// cell at the end of a picture whose side is no multiple of `side` lacks pixels, and does not count.
pub fn whole_cells(
    counts: &[bool],
    [width, height]: [usize; 2],
    side: usize,
    [w, h]: [usize; 2],
) -> Vec<bool> {
    let is_whole = |cell: usize| {
        let (left, top) = (cell % w * side, cell / w * side);
        let fits = left + side <= width && top + side <= height;
        fits && (top..top + side).all(|y| counts[y * width + left..][..side].iter().all(|counts| *counts))
    };
    (0..w * h).map(is_whole).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 4 x 4 pixels: dark on the left, bright on the right, one pixel of another color that does not count.
    fn picture() -> (Vec<f32>, Vec<bool>) {
        let rgb = (0..16).flat_map(|i| if i == 5 { [1.0, 0.0, 0.0] } else { [(i % 4 / 2) as f32; 3] });
        (rgb.collect(), (0..16).map(|i| i != 5).collect())
    }

    #[test]
    fn luminance_has_one_mean_and_one_deviation() {
        let (rgb, counts) = picture();
        let gray = luminance(&rgb, &counts);
        assert_eq!(gray[15..18], [0.5; 3]);
        // Of 15 pixels 8 are 1: mean 8/15, deviation sqrt(8 * 7) / 15.
        let bright = 0.5 + 0.18 * (7.0 / 15.0) / (56.0_f64.sqrt() / 15.0);
        assert!((f64::from(gray[6]) - bright).abs() < 1e-6, "{} {bright}", gray[6]);
        // Another contrast and another brightness make no difference.
        let faint: Vec<f32> = rgb.iter().map(|value| 0.3 + 0.1 * value).collect();
        let difference =
            luminance(&faint, &counts).iter().zip(&gray).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(difference < 1e-4, "{difference}");
    }

    #[test]
    fn grain_sees_detail_among_pixels_that_count() {
        let stripes: Vec<f32> = (0..64).flat_map(|i| [(i % 2) as f32; 3]).collect();
        let all = [true; 64];
        // Inner pixels alternate between 0 and 1, their Laplacians between -2 and 2: deviations 0.5 and 2.
        assert!((grain(&stripes, &all, [8, 8]) - 4.0).abs() < 1e-4);
        assert!((grain(&[0.25; 192], &all, [8, 8])).abs() < 1e-9);
        assert_eq!(grain(&stripes, &[false; 64], [8, 8]), 0.0);
        assert_eq!(grain(&[0.5; 3], &[true], [1, 1]), 0.0);
    }

    #[test]
    fn a_cell_counts_if_all_its_pixels_do() {
        let (_, counts) = picture();
        assert_eq!(whole_cells(&counts, [4, 4], 2, [2, 2]), [false, true, true, true]);
        assert_eq!(whole_cells(&counts, [4, 4], 1, [4, 4]), counts);
        // 5 x 4 pixels with a hole at (3, 1). The map has 3 x 2 cells, the last column of one pixel in width.
        let counts: Vec<bool> = (0..20).map(|i| i != 8).collect();
        assert_eq!(whole_cells(&counts, [5, 4], 2, [3, 2]), [true, false, false, true, true, false]);
        // Not by dividing 5 pixels among 2 cells: a cell of relu3_1 has 4.
        assert_eq!(whole_cells(&[true; 20], [5, 4], 4, [2, 1]), [true, false]);
    }
}
