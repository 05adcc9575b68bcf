//! Large shapes: where a picture is bright and where dark, and in which hue.

use glam::Vec3;

/// Side of the cells whose mean colors are those of large shapes, in pixels. Strokes of a painting of 512 pixels are about
/// twice as long and a fraction as wide.
pub(crate) const SIDE: usize = 16;

/// Brightness by which large shapes may leave the aim for nothing, as a share of the contrast of the painting's: strokes are
/// lights and darks. Hue and saturation have no tolerance: they tell a pond from its banks. Without tolerance texture of
/// captures is told less often, with one for hue ponds turn gray (docs/notes/bake_experiments.md, seventh round). With the
/// same for all paintings, 0.25, dark and pale ones could drown whatever lies between their few tones (twelfth round).
const TOLERANCE: f32 = 0.5;

/// The contrast that is aimed at, over the painting's: within the tolerance, and beside losses that take contrast away, shapes end
/// up nearer to the middle than they should be. Chosen on the demo scene, whose pictures then have 0.9 of a painting's deviation
/// of luminance (0.88; Van Gogh's houses, Church, Friedrich, Goya, Vermeer); at 1 they have 0.79.
pub(crate) const OVER: f32 = 1.35;

/// The most by which contrast between large shapes is enlarged. Beyond it what is between black and white would be lost.
const MOST_GAIN: f32 = 2.0;

/// Least contrast of a scene's large shapes that is enlarged, eight of a display's steps. Below it there are no shapes, or the
/// scene is too small to show one as a whole.
const LEAST_CONTRAST: f32 = 8.0 / 255.0;

/// The mean of the channels.
pub(crate) fn brightness(color: Vec3) -> f32 {
    color.element_sum() / 3.0
}

/// The contrast between large shapes: the deviation of their brightness within a picture, over the `pictures`.
pub(crate) fn contrast(pictures: impl Iterator<Item = Vec<f32>>) -> f32 {
    let (mut squares, mut n) = (0.0_f64, 0_usize);
    for shapes in pictures {
        let mean = shapes.iter().map(|value| f64::from(*value)).sum::<f64>() / shapes.len().max(1) as f64;
        squares += shapes.iter().map(|value| (f64::from(*value) - mean).powi(2)).sum::<f64>();
        n += shapes.len();
    }
    (squares / n.max(1) as f64).sqrt() as f32
}

/// The brightness of the cells of a picture RGB `[h * w, 3]` that lie within it.
pub(crate) fn of_picture(rgb: &[f32], width: usize) -> Vec<f32> {
    let columns = width / SIDE;
    let rows = rgb.len() / 3 / width.max(1) / SIDE;
    let of_cell = |cell: usize| {
        let (top, left) = (cell / columns * SIDE, cell % columns * SIDE);
        let of_row = |row: usize| rgb[(row * width + left) * 3..][..SIDE * 3].iter().sum::<f32>();
        (top..top + SIDE).map(of_row).sum::<f32>() / (3 * SIDE * SIDE) as f32
    };
    (0..rows * columns).map(of_cell).collect()
}

/// What large shapes should be: the recolored scene's, with the contrast of the painting's.
///
/// A scene that is recolored has the painting's contrast, but in other sizes: the demo scene's is that of its grass and tiles, and a
/// painting's that of its light and shade. The loss takes the fine contrast away; without the coarse one in its place
/// pictures turn to fog.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ShapeAim {
    /// Brightness that stays as it is.
    middle: f32,
    /// Factor of the distance from it.
    gain: f32,
    /// Brightness by which shapes may leave the aim for nothing.
    tolerance: f32,
}

impl ShapeAim {
    /// For a painting with large shapes of contrast `painting` around the brightness `middle`, and a recolored scene with those
    /// of contrast `recolored`.
    pub fn new(middle: f32, painting: f32, recolored: f32) -> Self {
        let gain = match recolored > LEAST_CONTRAST {
            true => (OVER * painting / recolored).clamp(1.0, MOST_GAIN),
            false => 1.0,
        };
        Self { middle, gain, tolerance: TOLERANCE * painting }
    }

    /// The brightness that a shape of the recolored scene should have: within 0..1, unless it is beyond already.
    fn of(&self, brightness: f32) -> f32 {
        let aim = self.middle + self.gain * (brightness - self.middle);
        aim.clamp(brightness.min(0.0), brightness.max(1.0))
    }

    /// Mean squared distance of the mean colors of cells of 16 x 16 pixels from the aim for those of `recolored`, in brightness
    /// beyond the tolerance, over the covered pixels, which are in `cells`. `rgb` and `recolored` are RGB `[h * w, 3]`, `width`
    /// pixels wide. Adds `weight` times the gradient to `grad`.
    pub fn loss(
        &self,
        [rgb, recolored]: [&[f32]; 2],
        width: usize,
        cells: &[u32],
        weight: f32,
        grad: &mut [f32],
    ) -> f32 {
        let columns = width.div_ceil(SIDE);
        let shape = |pixel: u32| pixel as usize / width / SIDE * columns + pixel as usize % width / SIDE;
        let n_shapes = cells.iter().map(|&pixel| shape(pixel) + 1).max().unwrap_or(0);
        let mut sums = vec![([Vec3::ZERO; 2], 0.0_f32); n_shapes];
        for &pixel in cells {
            let (sums, n) = &mut sums[shape(pixel)];
            sums[0] += Vec3::from_slice(&rgb[pixel as usize * 3..]);
            sums[1] += Vec3::from_slice(&recolored[pixel as usize * 3..]);
            *n += 1.0;
        }
        let gap = |([found, recolored], n): ([Vec3; 2], f32)| {
            let (found, recolored) = (found / n.max(1.0), recolored / n.max(1.0));
            let [is, was] = [brightness(found), brightness(recolored)];
            let off = is - self.of(was);
            // Hue and saturation as they are, brightness beyond the tolerance.
            found - recolored - (is - was) + (off - off.clamp(-self.tolerance, self.tolerance))
        };
        let gaps: Vec<Vec3> = sums.into_iter().map(gap).collect();
        let scale = 1.0 / (3 * cells.len()).max(1) as f32;
        let mut sum = 0.0;
        for &pixel in cells {
            let gap = gaps[shape(pixel)];
            sum += f64::from(gap.length_squared());
            for (grad, gap) in grad[pixel as usize * 3..][..3].iter_mut().zip(gap.to_array()) {
                *grad += 2.0 * weight * scale * gap;
            }
        }
        sum as f32 * scale
    }
}
