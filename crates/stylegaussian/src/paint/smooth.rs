//! Colors of the scene without their finer detail.

use std::collections::HashMap;

use glam::{IVec3, Vec3};

/// Standard deviation of averaging over a grid twice, in cells: each time, values are spread over a cell's corners
/// (variance 1/6 along an axis) and read back likewise.
const DEVIATION: f32 = 0.816;

/// Added to weights, so that what is never seen has a color as well.
const UNSEEN: f32 = 1e-3;

/// `values` `[N]` at `means`, averaged in space around each by about `sigma` scene units, weighted.
pub(super) fn smooth(means: &[Vec3], values: &[Vec3], weights: &[f32], sigma: f32) -> Vec<Vec3> {
    let mut cells: HashMap<IVec3, u32> = HashMap::new();
    let mut corners = |mean: &Vec3| -> [(u32, f32); 8] {
        let at = *mean / (sigma / DEVIATION);
        let (cell, part) = (at.floor().as_ivec3(), at - at.floor());
        std::array::from_fn(|corner| {
            let beyond = IVec3::new(corner as i32 & 1, corner as i32 >> 1 & 1, corner as i32 >> 2);
            let n = cells.len() as u32;
            let index = *cells.entry(cell.saturating_add(beyond)).or_insert(n);
            let share = |beyond: i32, part: f32| if beyond == 1 { part } else { 1.0 - part };
            (index, share(beyond.x, part.x) * share(beyond.y, part.y) * share(beyond.z, part.z))
        })
    };
    let corners: Vec<[(u32, f32); 8]> = means.iter().map(&mut corners).collect();
    let mut values = values.to_vec();
    for _ in 0..2 {
        let mut sums = vec![(Vec3::ZERO, 0.0_f32); cells.len()];
        for ((corners, value), weight) in corners.iter().zip(&values).zip(weights) {
            for (cell, share) in corners {
                let (sum, total) = &mut sums[*cell as usize];
                *sum += *value * (share * (weight + UNSEEN));
                *total += share * (weight + UNSEEN);
            }
        }
        for (value, corners) in values.iter_mut().zip(&corners) {
            let (mut sum, mut total) = (Vec3::ZERO, 0.0);
            for (cell, share) in corners {
                sum += sums[*cell as usize].0 * *share;
                total += sums[*cell as usize].1 * share;
            }
            // Above 0 unless positions are not finite.
            if total > 0.0 {
                *value = sum / total;
            }
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fine_stripes_go_and_slow_changes_stay() {
        let means: Vec<Vec3> = (0..400).map(|i| Vec3::new(i as f32 * 0.25, 0.1, 0.3)).collect();
        let slow = |i: usize| i as f32 / 400.0;
        let values: Vec<Vec3> = (0..400).map(|i| Vec3::splat(slow(i) + (i % 2) as f32 * 0.4)).collect();
        let smoothed = smooth(&means, &values, &[1.0; 400], 3.0);
        for (i, value) in smoothed.iter().enumerate().take(360).skip(40) {
            assert!((value.x - slow(i) - 0.2).abs() < 0.02, "{i}: {value}");
        }
        let weighted: Vec<f32> = (0..400).map(|i| (i % 2) as f32).collect();
        assert!((smooth(&means, &values, &weighted, 3.0)[200].x - slow(200) - 0.4).abs() < 0.02);
    }
}
