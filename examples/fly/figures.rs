//! The figures of a flight, from what its frames took and showed.

/// Red, green, blue and alpha of each pixel, row by row. Colors are premultiplied.
pub type Picture = Vec<[u8; 4]>;

/// Alpha above which the coarsest level covers a pixel, and below which a cut leaves it open: a half and a
/// quarter.
const COVERED: u8 = 127;
const OPEN: u8 = 64;

/// The least of the values that are not below a `share` of all of them (nearest rank), or NaN if there are
/// none. The share 0.5 gives the median, and 1 the largest.
pub fn percentile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied().unwrap_or(f64::NAN)
}

/// The mean, or NaN if there are no values.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The share of the pixels that the coarsest level covers and that the cut leaves open: 0 without holes.
pub fn holes(coarsest: &[[u8; 4]], cut: &[[u8; 4]]) -> f64 {
    let is_hole = |(coarsest, cut): &(&[u8; 4], &[u8; 4])| coarsest[3] > COVERED && cut[3] < OPEN;
    coarsest.iter().zip(cut).filter(is_hole).count() as f64 / coarsest.len().max(1) as f64
}

/// The mean absolute difference of the colors of two pictures, 0..1.
pub fn difference(a: &[[u8; 4]], b: &[[u8; 4]]) -> f64 {
    let of_pixel = |(a, b): (&[u8; 4], &[u8; 4])| (0..3).map(|i| u32::from(a[i].abs_diff(b[i]))).sum::<u32>();
    let sum: f64 = a.iter().zip(b).map(of_pixel).map(f64::from).sum();
    sum / (3 * 255 * a.len().max(1)) as f64
}

/// The ratio of the mean difference of frames in which levels change to that of frames in which none does, or
/// NaN if there are none of either.
pub fn popping(differences: &[f64], is_switch: &[bool]) -> f64 {
    let mean_where = |wanted: bool| {
        let frames = differences.iter().zip(is_switch).filter(|(_, is_switch)| **is_switch == wanted);
        mean(&frames.map(|(difference, _)| *difference).collect::<Vec<_>>())
    };
    mean_where(true) / mean_where(false)
}

/// The peak signal-to-noise ratio of the colors of two pictures in dB: infinite if they are equal.
pub fn psnr(a: &[[u8; 4]], b: &[[u8; 4]]) -> f64 {
    let square = |(a, b): (&[u8; 4], &[u8; 4])| {
        (0..3).map(|i| (f64::from(a[i].abs_diff(b[i])) / 255.0).powi(2)).sum::<f64>()
    };
    let sum: f64 = a.iter().zip(b).map(square).sum();
    -10.0 * (sum / (3 * a.len().max(1)) as f64).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_values() {
        let values = [5.0, 1.0, 4.0, 2.0, 3.0];
        assert_eq!(
            [0.0, 0.2, 0.5, 0.99, 1.0].map(|share| percentile(&values, share)),
            [1.0, 1.0, 3.0, 5.0, 5.0]
        );
        let many: Vec<f64> = (1..=600).map(f64::from).collect();
        assert_eq!((percentile(&many, 0.5), percentile(&many, 0.99)), (300.0, 594.0));
        assert!(percentile(&[], 0.5).is_nan() && mean(&[]).is_nan());
        assert_eq!(mean(&values), 3.0);
    }

    #[test]
    fn a_hole_is_open_where_the_coarsest_level_covers() {
        let of = |alphas: [u8; 4]| -> Picture { alphas.map(|alpha| [0, 0, 0, alpha]).into() };
        let coarsest = of([255, 255, 128, 60]);
        assert_eq!(holes(&coarsest, &of([255, 64, 128, 0])), 0.0);
        assert_eq!(holes(&coarsest, &of([0, 255, 63, 0])), 0.5);
        assert_eq!(holes(&Picture::new(), &Picture::new()), 0.0);
    }

    #[test]
    fn differences_are_of_colors_alone() {
        let (a, b): (Picture, Picture) =
            (vec![[0, 0, 0, 0], [255, 0, 51, 255]], vec![[0, 0, 0, 255], [0, 0, 0, 9]]);
        // (255 + 51) / (6 x 255)
        assert!((difference(&a, &b) - 0.2).abs() < 1e-12);
        assert_eq!((difference(&a, &a), psnr(&a, &a)), (0.0, f64::INFINITY));
        // A mean square of (1 + 0.04) / 6.
        assert!((psnr(&a, &b) - 7.6111).abs() < 1e-3, "{}", psnr(&a, &b));
    }

    #[test]
    fn popping_is_what_switches_add() {
        let differences = [0.1, 0.3, 0.1, 0.1, 0.2];
        assert!((popping(&differences, &[false, true, false, false, true]) - 2.5).abs() < 1e-12);
        assert!(popping(&differences, &[true; 5]).is_nan() && popping(&[], &[]).is_nan());
    }
}
