//! Texture apart from color: pictures as luminance of equal mean and deviation.

use stylegaussian::palette;

/// Weights of red, green and blue.
pub(crate) const LUMINANCE: [f32; 3] = palette::LUMINANCE.to_array();
/// The deviation to which luminance is stretched, about a common mean of 0.5. Paintings have 0.1 to 0.25.
const DEVIATION: f32 = 0.18;
/// Least deviation that is stretched: eight steps of a display. Below it there is noise and no texture.
const LEAST_DEVIATION: f32 = 8.0 / 255.0;

/// Mean and mean square of a painting's luminance. Scene and painting are stretched alike: stretching the scene
/// by its own deviation would reward pictures without contrast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tone {
    pub mean: f32,
    pub square: f32,
}

/// Luminance of a color.
pub(crate) fn luminance(pixel: &[f32]) -> f32 {
    pixel.iter().zip(LUMINANCE).map(|(value, weight)| value * weight).sum()
}

impl Tone {
    /// Tone of the pixels in `cells` of a picture RGB `[n, 3]`.
    pub fn of(rgb: &[f32], cells: impl ExactSizeIterator<Item = usize>) -> Self {
        let n = cells.len().max(1) as f64;
        let (mut mean, mut square) = (0.0, 0.0);
        for cell in cells {
            let y = f64::from(luminance(&rgb[cell * 3..][..3]));
            (mean, square) = (mean + y, square + y * y);
        }
        Self { mean: (mean / n) as f32, square: (square / n) as f32 }
    }

    fn gain(&self) -> f32 {
        DEVIATION / (self.square - self.mean * self.mean).max(0.0).sqrt().max(LEAST_DEVIATION)
    }

    /// The picture as gray of the common mean and deviation `[n, 3]`.
    pub fn gray(&self, rgb: &[f32]) -> Vec<f32> {
        let gain = self.gain();
        rgb.chunks_exact(3).flat_map(|pixel| [(luminance(pixel) - self.mean) * gain + 0.5; 3]).collect()
    }

    /// Turns a gradient with respect to [`Self::gray`] `[n, 3]` into a direction of colors `[n, 3]` along
    /// `line`, the change of color that goes with luminance. With `line` = [`LUMINANCE`] it is the gradient
    /// itself; along the painting's own line, strokes get its lights and darks and no tint.
    pub fn backward(&self, grad: &[f32], line: [f32; 3]) -> Vec<f32> {
        let gain = self.gain();
        grad.chunks_exact(3)
            .flat_map(|grad| {
                let of_luminance = gain * grad.iter().sum::<f32>();
                line.map(|weight| of_luminance * weight)
            })
            .collect()
    }
}

/// The mean change of color per change of luminance among pixels `[n, 3]`; gray if they are all alike.
pub(crate) fn color_line(rgb: &[f32]) -> [f32; 3] {
    let n = (rgb.len() / 3).max(1) as f64;
    let (mut mean, mut mean_y) = ([0.0; 3], 0.0);
    for pixel in rgb.chunks_exact(3) {
        mean_y += f64::from(luminance(pixel)) / n;
        mean.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += f64::from(*value) / n);
    }
    let (mut with_y, mut variance) = ([0.0; 3], 0.0);
    for pixel in rgb.chunks_exact(3) {
        let y = f64::from(luminance(pixel)) - mean_y;
        variance += y * y / n;
        for ((sum, value), mean) in with_y.iter_mut().zip(pixel).zip(mean) {
            *sum += y * (f64::from(*value) - mean) / n;
        }
    }
    if variance < f64::from(LEAST_DEVIATION * LEAST_DEVIATION) {
        return [1.0; 3];
    }
    with_y.map(|covariance| (covariance / variance) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gray_has_the_common_mean_and_deviation() {
        let rgb: Vec<f32> = (0..90).map(|i| (i * 7 % 13) as f32 / 13.0).collect();
        let gray = Tone::of(&rgb, 0..30).gray(&rgb);
        let found = Tone::of(&gray, 0..30);
        assert!((found.mean - 0.5).abs() < 1e-5);
        assert!(((found.square - found.mean * found.mean).sqrt() - DEVIATION).abs() < 1e-5);
    }

    #[test]
    fn along_luminance_the_gradient_is_exact() {
        let (tone, rgb) = (Tone { mean: 0.4, square: 0.2 }, [0.1, 0.7, 0.3]);
        let loss = |rgb: &[f32]| tone.gray(rgb).iter().zip([1.0, 2.0, -0.5]).map(|(a, b)| a * b).sum::<f32>();
        let grad = tone.backward(&[1.0, 2.0, -0.5], LUMINANCE);
        for i in 0..3 {
            let mut moved = rgb;
            moved[i] += 0.5;
            assert!(((loss(&moved) - loss(&rgb)) / 0.5 - grad[i]).abs() < 1e-5);
        }
    }

    #[test]
    fn a_blue_and_yellow_painting_has_a_line_of_its_own() {
        let line = color_line(&[0.0, 0.0, 0.4, 1.0, 0.9, 0.2, 0.5, 0.45, 0.3]);
        assert!(line[0] > 1.0 && line[2] < 0.0, "{line:?}");
        // A change along the line changes luminance by as much.
        assert!((luminance(&line) - 1.0).abs() < 1e-5);
        assert_eq!(color_line(&[0.3; 12]), [1.0; 3]);
    }
}
