//! The colors of a painting, or of a few given ones, apart from where they lie.

use glam::Vec3;

use super::tone::Tones;
use crate::{
    palette::{LUMINANCE, Palette},
    recolor::ColorMoments,
};

/// Pixels of a painting per pixel that a cell of the color cube must hold to count as a color. Fewer are specks
/// of dust.
const RARE: usize = 10_000;

/// Least number of given colors: of a single one, nothing would be left but flat shades.
const LEAST: usize = 2;

/// Most given colors, so that a list is a palette and no picture.
pub const MAX_COLORS: usize = 256;

/// The colors that a scene is painted in: those of a painting, or given ones.
#[derive(Clone)]
pub struct Tints {
    pub(super) palette: Palette,
    /// Moments and tones with and without detail.
    pub(super) whole: (ColorMoments, Tones),
    pub(super) low: (ColorMoments, Tones),
    /// Mean color.
    pub(super) mean: Vec3,
}

/// A list of colors that is no palette.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TintsError {
    /// There are too few or too many.
    #[error("found {found} colors, expected {LEAST} to {MAX_COLORS} for a palette")]
    Count {
        /// Their number.
        found: usize,
    },
    /// A color is not displayed.
    #[error("found the color {0:?}, expected red, green and blue of 0 to 1")]
    Color([f32; 3]),
}

impl Tints {
    /// The colors of the pixels of a painting, and of some of them without detail.
    pub(super) fn new(pixels: &[Vec3], low: &[Vec3]) -> Self {
        let flat: Vec<f32> = pixels.iter().flat_map(|color| color.to_array()).collect();
        let of = |colors: &[Vec3]| {
            let moments = ColorMoments::of_weighted(colors.iter().map(|color| (*color, 1.0)));
            (moments, Tones::new(colors.iter().map(|color| color.dot(LUMINANCE)).collect()))
        };
        Self {
            palette: Palette::new(&flat, 1 + pixels.len() / RARE),
            whole: of(pixels),
            low: of(low),
            mean: pixels.iter().sum::<Vec3>() / pixels.len() as f32,
        }
    }

    /// A palette of 2 to 256 display-referred colors, 0..1, each as frequent as the others. A color that is
    /// given twice is twice as frequent.
    ///
    /// # Errors
    /// If there are fewer or more, or if one is outside of 0..1.
    pub fn of_colors(colors: &[[f32; 3]]) -> Result<Self, TintsError> {
        if !(LEAST..=MAX_COLORS).contains(&colors.len()) {
            return Err(TintsError::Count { found: colors.len() });
        }
        if let Some(color) = colors.iter().find(|color| !color.iter().all(|c| (0.0..=1.0).contains(c))) {
            return Err(TintsError::Color(*color));
        }
        let colors: Vec<Vec3> = colors.iter().copied().map(Vec3::from).collect();
        Ok(Self::new(&colors, &colors))
    }

    /// The colors of several paintings, by weights of which at least one is above 0: all that their pixels
    /// have, and the mixtures of their moments and tones.
    pub(super) fn united(parts: &[(&Self, f64)]) -> Self {
        let mixed = |of: fn(&Self) -> &(ColorMoments, Tones)| {
            let moments = ColorMoments::mixed(parts.iter().map(|(tints, weight)| (&of(tints).0, *weight)));
            (moments, Tones::mixed(parts.iter().map(|(tints, weight)| (&of(tints).1, *weight as f32))))
        };
        let total: f64 = parts.iter().map(|(_, weight)| weight).sum();
        let palettes: Vec<&Palette> =
            parts.iter().filter(|(_, weight)| *weight > 0.0).map(|(tints, _)| &tints.palette).collect();
        Self {
            palette: Palette::united(&palettes),
            whole: mixed(|tints| &tints.whole),
            low: mixed(|tints| &tints.low),
            mean: parts.iter().map(|(tints, weight)| tints.mean * (weight / total) as f32).sum(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_that_are_no_palette_are_refused() {
        assert_eq!(Tints::of_colors(&[[0.5; 3]]).err(), Some(TintsError::Count { found: 1 }));
        assert_eq!(Tints::of_colors(&[[0.5; 3]; 257]).err(), Some(TintsError::Count { found: 257 }));
        for bad in [f32::NAN, -0.1, 1.1] {
            assert!(matches!(Tints::of_colors(&[[0.1; 3], [0.2, bad, 0.2]]), Err(TintsError::Color(_))));
        }
    }

    #[test]
    fn united_colors_are_those_of_all_pixels() {
        let [a, b] = [0.2, 0.7].map(|red: f32| -> Vec<Vec3> {
            (0..200).map(|i| Vec3::new(red, i as f32 / 400.0, 0.3 + 0.002 * i as f32)).collect()
        });
        let all: Vec<Vec3> = a.iter().chain(&b).copied().collect();
        let (of_a, of_b, of_all) = (Tints::new(&a, &a), Tints::new(&b, &b), Tints::new(&all, &all));
        let united = Tints::united(&[(&of_a, 1.0), (&of_b, 1.0)]);
        assert!(united.mean.distance(of_all.mean) < 1e-5);
        for direction in [Vec3::X, Vec3::Y, Vec3::new(1.0, -1.0, 0.5)] {
            let [found, expected] = [&united, &of_all].map(|tints| tints.whole.0.deviation_along(direction));
            assert!((found - expected).abs() < 1e-3 * expected, "{direction}: {found} for {expected}");
        }
        // A red between both goes to the nearer one.
        for red in [0.3, 0.6] {
            let near = Vec3::new(red, 0.25, 0.5);
            let [found, expected] = [&united, &of_all].map(|tints| tints.palette.nearest(near));
            assert!(found.distance(expected) < 0.05, "{found} for {expected}");
        }
    }
}
