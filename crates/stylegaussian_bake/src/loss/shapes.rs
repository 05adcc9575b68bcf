//! Large shapes: where a picture is bright and where dark, and in which hue.

use std::collections::BTreeMap;

use glam::Vec3;

/// Side of the cells whose mean colors are those of large shapes, in pixels. Strokes of a painting of 512
/// pixels are about twice as long and a fraction as wide.
pub(crate) const SIDE: usize = 16;

/// Brightness by which large shapes may differ from the recolored scene's without a loss, because strokes are
/// lights and darks. Hue and saturation have no tolerance, because they separate a pond from its banks. Without
/// this tolerance, paintings are recognized by texture less often; with one for hue, ponds turn gray
/// (docs/notes.md, "Bakes").
const TOLERANCE: f32 = 0.25;

/// Side of the groups of shapes whose slope is measured, in shapes: 64 pixels.
const GROUP: usize = 4;

/// Weight of brightness that is missing for the slope, relative to that of brightness beyond the tolerance. At
/// 1, the paintings of Friedrich and Schiele are recognized by texture in half as many pictures of a capture.
pub(crate) const SLOPE_WEIGHT: f32 = 0.5;

/// Contrast that is aimed at, over the painting's. Other losses take contrast away, so the result is lower.
/// Chosen on the demo scene.
pub(crate) const OVER: f32 = 1.35;

/// Largest slope that is aimed at. Beyond it, tones between black and white would be lost.
const MOST_SLOPE: f32 = 2.0;

/// Least contrast of large shapes that has a slope: eight steps of a display. Below it there are no shapes, or
/// the scene is too small to show one as a whole.
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

/// The aim for large shapes: about the recolored scene's, with the contrast of the painting's.
///
/// A recolored scene has the painting's contrast at other sizes: the demo scene's is in grass and tiles, a
/// painting's in light and shade. The other losses remove the fine contrast, and without coarse contrast in its
/// place pictures turn to fog. A tolerance alone does not keep it, because all tones of a dark or pale painting
/// may be within it. So the slope of brightness over the recolored scene's brightness counts as well, for each
/// group of shapes. Strokes do not change it, fog does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ShapeAim {
    /// The least slope.
    slope: f32,
}

/// A large shape of a picture, and the same of the recolored scene.
struct Shape {
    /// Mean color.
    found: Vec3,
    /// Mean color of the recolored scene's.
    recolored: Vec3,
    /// Covered pixels.
    n: f32,
}

impl ShapeAim {
    /// For a painting with large shapes of contrast `painting`, and a recolored scene with those of contrast
    /// `recolored`.
    pub fn new(painting: f32, recolored: f32) -> Self {
        let slope = match recolored > LEAST_CONTRAST {
            true => (OVER * painting / recolored).clamp(1.0, MOST_SLOPE),
            false => 1.0,
        };
        Self { slope }
    }

    /// Mean squared distance of the mean colors of cells of 16 x 16 pixels from those of `recolored`, in
    /// brightness beyond a tolerance of 0.25, and half the mean square of the brightness that is missing for
    /// the slope, over the covered pixels, which are in `cells`. `rgb` and `recolored` are RGB `[h * w, 3]`,
    /// `width` pixels wide. Adds `weight` times the gradient to `grad`.
    pub fn loss(
        &self,
        [rgb, recolored]: [&[f32]; 2],
        width: usize,
        cells: &[u32],
        weight: f32,
        grad: &mut [f32],
    ) -> f32 {
        let columns = width.div_ceil(SIDE);
        let index = |pixel: u32| pixel as usize / width / SIDE * columns + pixel as usize % width / SIDE;
        let n_shapes = cells.iter().map(|&pixel| index(pixel) + 1).max().unwrap_or(0);
        let mut shapes: Vec<Shape> = Vec::new();
        shapes.resize_with(n_shapes, || Shape { found: Vec3::ZERO, recolored: Vec3::ZERO, n: 0.0 });
        for &pixel in cells {
            let shape = &mut shapes[index(pixel)];
            shape.found += Vec3::from_slice(&rgb[pixel as usize * 3..]);
            shape.recolored += Vec3::from_slice(&recolored[pixel as usize * 3..]);
            shape.n += 1.0;
        }
        for shape in &mut shapes {
            shape.found /= shape.n.max(1.0);
            shape.recolored /= shape.n.max(1.0);
        }
        let mut sum = 0.0;
        let mut gaps: Vec<Vec3> = shapes.iter().map(gap).collect();
        for (shape, gap) in shapes.iter().zip(&gaps) {
            sum += f64::from(shape.n * gap.length_squared());
        }
        for (index, missing) in self.missing(&shapes, columns) {
            gaps[index] -= SLOPE_WEIGHT * missing;
            sum += f64::from(SLOPE_WEIGHT * 3.0 * shapes[index].n * missing * missing);
        }
        let scale = 1.0 / (3 * cells.len()).max(1) as f32;
        for &pixel in cells {
            let gap = 2.0 * weight * scale * gaps[index(pixel)];
            grad[pixel as usize * 3..][..3]
                .iter_mut()
                .zip(gap.to_array())
                .for_each(|(grad, gap)| *grad += gap);
        }
        sum as f32 * scale
    }

    /// Shapes, in rows of `columns`, of groups whose slope is too small, and the brightness that each lacks.
    fn missing(&self, shapes: &[Shape], columns: usize) -> Vec<(usize, f32)> {
        let mut missing = Vec::new();
        let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for index in (0..shapes.len()).filter(|&index| shapes[index].n > 0.0) {
            let group = index / columns / GROUP * columns + index % columns / GROUP;
            groups.entry(group).or_default().push(index);
        }
        for group in groups.into_values() {
            let mean = |value: &dyn Fn(&Shape) -> f32| {
                let sum: f32 = group.iter().map(|&index| shapes[index].n * value(&shapes[index])).sum();
                sum / group.iter().map(|&index| shapes[index].n).sum::<f32>()
            };
            let middle = mean(&|shape| brightness(shape.recolored));
            let off = |shape: &Shape| brightness(shape.recolored) - middle;
            let variance = mean(&|shape| off(shape) * off(shape));
            if variance < LEAST_CONTRAST * LEAST_CONTRAST {
                continue;
            }
            let slope = mean(&|shape| off(shape) * brightness(shape.found)) / variance;
            if slope < self.slope {
                missing
                    .extend(group.iter().map(|&index| (index, (self.slope - slope) * off(&shapes[index]))));
            }
        }
        missing
    }
}

/// The distance of a shape's color from the recolored scene's: hue and saturation as they are, brightness
/// beyond the tolerance.
fn gap(shape: &Shape) -> Vec3 {
    let gap = shape.found - shape.recolored;
    let brighter = brightness(gap);
    gap - brighter.clamp(-TOLERANCE, TOLERANCE)
}
