//! The painting's colors, to which pixels are kept.

use rayon::prelude::*;

/// Cells of the color cube along each axis. A cell is 8 of a display's 256 steps.
const SIDE: usize = 32;

/// Distance from the nearest color within which a color is free: a cell.
const FREE: f32 = 1.0 / SIDE as f32;

/// The nearest of the painting's colors for every cell of the color cube.
pub(crate) struct Palette {
    nearest: Vec<[f32; 3]>,
}

fn cell(color: &[f32]) -> usize {
    let at = |value: f32| ((value * SIDE as f32) as usize).min(SIDE - 1);
    (at(color[0]) * SIDE + at(color[1])) * SIDE + at(color[2])
}

impl Palette {
    /// The palette of pixels `[n, 3]`, 0..1. A color counts if at least `least` pixels lie in its cell.
    pub fn new(rgb: &[f32], least: usize) -> Self {
        let mut cells = vec![([0.0_f64; 3], 0_usize); SIDE * SIDE * SIDE];
        for color in rgb.chunks_exact(3) {
            let (sum, n) = &mut cells[cell(color)];
            sum.iter_mut().zip(color).for_each(|(sum, value)| *sum += f64::from(*value));
            *n += 1;
        }
        let most = cells.iter().map(|(_, n)| *n).max().unwrap_or(0);
        let least = least.clamp(1, most.max(1));
        let colors: Vec<[f32; 3]> = cells
            .iter()
            .filter(|(_, n)| *n >= least)
            .map(|(sum, n)| sum.map(|sum| (sum / *n as f64) as f32))
            .collect();
        let nearest = (0..SIDE * SIDE * SIDE)
            .into_par_iter()
            .map(|i| {
                let middle =
                    [i / (SIDE * SIDE), i / SIDE % SIDE, i % SIDE].map(|i| (i as f32 + 0.5) / SIDE as f32);
                let closer = |best: [f32; 3], color: &[f32; 3]| {
                    if distance(&middle, color) < distance(&middle, &best) { *color } else { best }
                };
                colors.iter().fold([f32::MAX; 3], closer)
            })
            .collect();
        Self { nearest }
    }

    /// Moves colors `[n, 3]` by `share` of the way toward the nearest color of the painting. Colors within a cell of it
    /// are left alone. Returns the mean squared distance before.
    pub fn pull(&self, colors: &mut [f32], share: f32) -> f32 {
        let mut sum = 0.0;
        let n = (colors.len() / 3).max(1);
        for color in colors.as_chunks_mut::<3>().0 {
            let nearest = self.nearest[cell(color)];
            let squared = distance(color, &nearest);
            if squared > FREE * FREE {
                sum += f64::from(squared);
                let share = share * (1.0 - FREE / squared.sqrt());
                color
                    .iter_mut()
                    .zip(nearest)
                    .for_each(|(value, nearest)| *value += share * (nearest - *value));
            }
        }
        (sum / n as f64) as f32
    }
}

fn distance(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}
