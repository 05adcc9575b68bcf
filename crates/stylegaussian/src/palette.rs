//! The colors of a painting, to which pictures are kept.

use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

/// Weights of red, green and blue in luminance, by Rec. 601, for display-referred colors.
pub const LUMINANCE: Vec3 = Vec3::new(0.299, 0.587, 0.114);

/// Cells of the color cube along each axis. A cell is 8 of a display's 256 steps.
const SIDE: usize = 32;

/// How much of a distance in luminance counts when colors are pulled. Chosen by eye between 0, at which bright
/// colors are paler, and 0.3, at which contrast is lost.
const LUMINANCE_PART: f32 = 0.1;

/// Distance from the nearest color within which a color is free: a cell.
const FREE: f32 = 1.0 / SIDE as f32;

/// The nearest of the painting's colors for every cell of the color cube.
#[derive(Clone)]
pub struct Palette {
    nearest: Vec<[f32; 3]>,
}

/// `color` made darker or brighter, as far as it must be to lie within 0..1, and clamped if that is not enough.
/// A yellow that is brighter than a display shows is compared with yellows and not with white.
fn within_range(color: Vec3) -> Vec3 {
    let over = (color.max_element() - 1.0).max(0.0);
    let under = (-color.min_element()).max(0.0);
    (color - over + under).clamp(Vec3::ZERO, Vec3::ONE)
}

/// The color in the middle of a cell.
fn middle(cell: usize) -> [f64; 3] {
    [cell / (SIDE * SIDE), cell / SIDE % SIDE, cell % SIDE].map(|i| (i as f64 + 0.5) / SIDE as f64)
}

fn cell(color: &[f32]) -> usize {
    let at = |value: f32| ((value * SIDE as f32) as usize).min(SIDE - 1);
    (at(color[0]) * SIDE + at(color[1])) * SIDE + at(color[2])
}

impl Palette {
    /// The palette of pixels `[n, 3]`, 0..1. A color counts if at least `least` pixels lie in its cell. Without
    /// pixels, every color counts.
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
        let rows: Vec<[f64; 3]> = colors.iter().map(|color| color.map(f64::from)).collect();
        let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&rows).ok().filter(|_| !rows.is_empty());
        let nearest = |i: usize| {
            let middle = middle(i);
            tree.as_ref().map_or(middle.map(|value| value as f32), |tree| {
                let found = tree.query(&middle).nearest_one::<SquaredEuclidean<f64>>().execute();
                colors[found.item as usize]
            })
        };
        let nearest = (0..SIDE * SIDE * SIDE).into_par_iter().map(nearest).collect();
        Self { nearest }
    }

    /// The colors of several palettes, of which there must be one.
    pub fn united(palettes: &[&Self]) -> Self {
        let nearest = |cell: usize| {
            let middle = Vec3::from(middle(cell).map(|value| value as f32));
            let apart = |color: &[f32; 3]| Vec3::from(*color).distance_squared(middle);
            let colors = palettes.iter().map(|palette| palette.nearest[cell]);
            colors.min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or_default()
        };
        Self { nearest: (0..SIDE * SIDE * SIDE).map(nearest).collect() }
    }

    /// The painting's color nearest to `color`, between those of the cells around it: a slow change of color
    /// gives a slow change.
    pub fn nearest(&self, color: Vec3) -> Vec3 {
        let at = (within_range(color) * SIDE as f32 - 0.5).clamp(Vec3::ZERO, Vec3::splat((SIDE - 1) as f32));
        let low = at.floor();
        let part = at - low;
        let corner = |i: usize| {
            let beyond = [i & 1, i >> 1 & 1, i >> 2];
            let (mut cell, mut share) = (0, 1.0);
            for axis in 0..3 {
                cell = cell * SIDE + (low[axis] as usize + beyond[axis]).min(SIDE - 1);
                share *= if beyond[axis] == 1 { part[axis] } else { 1.0 - part[axis] };
            }
            Vec3::from(self.nearest[cell]) * share
        };
        (0..8).map(corner).sum()
    }

    /// `color` on the way, by `share`, toward the hue and saturation of the nearest color of the painting.
    /// Luminance stays.
    pub fn toward(&self, color: Vec3, share: f32) -> Vec3 {
        color + share * gap(color, self.nearest(color), 0.0)
    }

    /// Moves colors `[n, 3]` by `share` of the way toward the hue and saturation of the nearest color of the
    /// painting, and by a tenth of that toward its luminance. Colors within a cell of it are left alone.
    /// Returns the mean squared distance before.
    ///
    /// Overlapping Gaussians blur one another, so some must be darker and some brighter than any color of the
    /// painting for pictures to have its contrast. Those that are far beyond have lost their color.
    pub fn pull(&self, colors: &mut [f32], share: f32) -> f32 {
        let mut sum = 0.0;
        let n = (colors.len() / 3).max(1);
        for color in colors.as_chunks_mut::<3>().0 {
            let found = Vec3::from(*color);
            let nearest = Vec3::from(self.nearest[cell(&within_range(found).to_array())]);
            let gap = gap(found, nearest, LUMINANCE_PART);
            let distance = gap.length();
            if distance > FREE {
                sum += f64::from(distance * distance);
                *color = (found + share * (1.0 - FREE / distance) * gap).to_array();
            }
        }
        (sum / n as f64) as f32
    }
}

/// The way from `color` to `nearest`, of which luminance counts by `part`.
fn gap(color: Vec3, nearest: Vec3, part: f32) -> Vec3 {
    let gap = nearest - color;
    gap - (1.0 - part) * gap.dot(LUMINANCE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gray_palette_pulls_toward_gray() {
        let gray: Vec<f32> = (0..256).flat_map(|i| [i as f32 / 255.0; 3]).collect();
        let palette = Palette::new(&gray, 1);
        let mut colors = vec![0.9, 0.1, 0.1, 0.5, 0.5, 0.5];
        let first = palette.pull(&mut colors, 0.5);
        assert!(colors[0] < 0.9 && colors[1] > 0.1, "{colors:?}");
        assert_eq!(colors[3..], [0.5; 3], "a color of the painting stays");
        for _ in 0..20 {
            palette.pull(&mut colors, 0.5);
        }
        assert!(colors[0] - colors[1] < 0.06, "{colors:?}");
        assert!(palette.pull(&mut colors, 0.5) < 0.1 * first);
        assert!(
            (Vec3::from_slice(&colors).dot(LUMINANCE) - 0.3392).abs() < 0.01,
            "luminance nearly stays: {colors:?}"
        );
    }

    #[test]
    fn colors_may_be_darker_and_brighter_than_the_painting() {
        let dark_and_light = Palette::new(&[0.2, 0.2, 0.2, 0.8, 0.8, 0.8], 1);
        let mut colors = vec![0.95, 0.95, 0.95, 0.05, 0.05, 0.05, 1.6, 1.6, 1.6];
        dark_and_light.pull(&mut colors, 0.5);
        assert_eq!(colors[..6], [0.95, 0.95, 0.95, 0.05, 0.05, 0.05]);
        assert!(colors[6] < 1.6 && colors[6] > 1.5, "far beyond it, luminance is pulled as well: {colors:?}");
    }

    #[test]
    fn a_yellow_brighter_than_a_display_stays_yellow() {
        let palette = Palette::new(&[1.0, 0.9, 0.1, 1.0, 1.0, 1.0], 1);
        let mut colors = vec![1.3, 1.2, 0.4];
        for _ in 0..50 {
            palette.pull(&mut colors, 0.5);
        }
        assert!(colors[0] - colors[2] > 0.8, "{colors:?}");
    }

    #[test]
    fn the_nearest_color_changes_slowly() {
        let two = Palette::new(&[0.9, 0.2, 0.1, 0.1, 0.3, 0.8, 0.5, 0.5, 0.5], 1);
        for (color, expected) in [([1.2, 0.1, 0.0], [0.9, 0.2, 0.1]), ([0.0, 0.3, 1.0], [0.1, 0.3, 0.8])] {
            assert!(two.nearest(Vec3::from(color)).distance(Vec3::from(expected)) < 1e-5);
        }
        let along = |i: usize| {
            two.nearest(Vec3::new(0.9, 0.2, 0.1).lerp(Vec3::new(0.1, 0.3, 0.8), i as f32 / 1000.0))
        };
        let steps = (0..1000).map(|i| along(i).distance(along(i + 1)));
        assert!(steps.fold(0.0, f32::max) < 0.05, "a thousandth of the way");
        let any = Vec3::new(0.3, 0.6, 0.2);
        assert!(Palette::new(&[], 1).nearest(any).distance(any) < 1e-5);
    }
}
