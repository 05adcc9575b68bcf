//! The parts of the loss, each with its gradient.

pub(crate) mod matching;
pub(crate) mod statistics;

/// The parts of a step's loss, unweighted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    /// Mean cosine distance of cells from the nearest of the painting's, summed over the layers that are matched.
    pub matching: f32,
    /// Mean squared error of channel means and deviations, summed over layers.
    pub statistics: f32,
    /// Mean squared distance of the deepest features from the unstyled scene's; none in a step that compares luminance,
    /// and if its weight is 0.
    pub content: Option<f32>,
    /// Mean squared distance of the Gaussians' colors from the hue and saturation of the nearest color of the painting.
    pub palette: f32,
    /// Mean squared distance of the colors of large shapes from the recolored scene's, with a tolerance of brightness; none in
    /// a step that compares luminance, and if its weight is 0.
    pub shapes: Option<f32>,
    /// Mean squared excess of pixels over 0..1.
    pub range: f32,
}

/// Side of the cells whose mean colors are those of large shapes, in pixels. Strokes of a painting of 512 pixels are about
/// twice as long and a fraction as wide.
const SHAPE: usize = 16;

/// Brightness (the mean of the channels) by which large shapes may leave the recolored scene's for nothing: strokes are lights
/// and darks. Hue and saturation have no tolerance: they tell a pond from its banks. Without tolerance texture of
/// captures is told less often, with one for hue ponds turn gray (docs/notes/bake_experiments.md, seventh round).
const TOLERANCE: f32 = 0.25;

/// Mean squared distance of the mean colors of cells of 16 x 16 pixels from those of `reference`, in brightness beyond a
/// tolerance of 0.25, over the covered pixels, which are in `cells`. `rgb` and `reference` are RGB `[h * w, 3]`, `width` pixels
/// wide. Adds `weight` times the gradient to `grad`.
pub(crate) fn shapes(
    rgb: &[f32],
    reference: &[f32],
    width: usize,
    cells: &[u32],
    weight: f32,
    grad: &mut [f32],
) -> f32 {
    let columns = width.div_ceil(SHAPE);
    let shape = |pixel: u32| pixel as usize / width / SHAPE * columns + pixel as usize % width / SHAPE;
    let n_shapes = cells.iter().map(|&pixel| shape(pixel) + 1).max().unwrap_or(0);
    let mut gaps = vec![([0.0_f32; 3], 0.0_f32); n_shapes];
    for &pixel in cells {
        let (gap, n) = &mut gaps[shape(pixel)];
        let range = pixel as usize * 3..pixel as usize * 3 + 3;
        gap.iter_mut()
            .zip(rgb[range.clone()].iter().zip(&reference[range]))
            .for_each(|(gap, (a, b))| *gap += a - b);
        *n += 1.0;
    }
    // From sums to means, and from brightness to what is beyond the tolerance.
    for (gap, n) in &mut gaps {
        let means = gap.map(|gap| gap / n.max(1.0));
        let brightness = means.iter().sum::<f32>() / 3.0;
        let beyond = brightness - brightness.clamp(-TOLERANCE, TOLERANCE);
        *gap = means.map(|mean| mean - brightness + beyond);
    }
    let scale = 1.0 / (3 * cells.len()).max(1) as f32;
    let mut sum = 0.0;
    for &pixel in cells {
        let (gap, _) = gaps[shape(pixel)];
        for (grad, gap) in grad[pixel as usize * 3..][..3].iter_mut().zip(gap) {
            sum += f64::from(gap * gap);
            *grad += 2.0 * weight * scale * gap;
        }
    }
    sum as f32 * scale
}

/// Mean squared distance of `rows` from `reference`, both `[n, C]`, over the rows in `cells`. Adds `weight` times the
/// gradient to `grad` `[n, C]`.
pub(crate) fn content(
    rows: &[f32],
    reference: &[f32],
    channels: usize,
    cells: &[u32],
    weight: f32,
    grad: &mut [f32],
) -> f32 {
    let scale = 1.0 / (cells.len() * channels).max(1) as f32;
    let mut sum = 0.0;
    for &cell in cells {
        let range = cell as usize * channels..(cell as usize + 1) * channels;
        let pairs = rows[range.clone()].iter().zip(&reference[range.clone()]);
        for (grad, (a, b)) in grad[range].iter_mut().zip(pairs) {
            sum += f64::from((a - b) * (a - b));
            *grad += 2.0 * weight * scale * (a - b);
        }
    }
    sum as f32 * scale
}

/// Mean squared excess of `rgb` over 0..1 over the pixels in `cells`. Adds `weight` times the gradient to `grad`.
pub(crate) fn range(rgb: &[f32], cells: &[u32], weight: f32, grad: &mut [f32]) -> f32 {
    let scale = 1.0 / cells.len().max(1) as f32;
    let mut sum = 0.0;
    for i in cells.iter().flat_map(|&cell| cell as usize * 3..cell as usize * 3 + 3) {
        let excess = rgb[i] - rgb[i].clamp(0.0, 1.0);
        sum += f64::from(excess * excess);
        grad[i] += 2.0 * weight * scale * excess;
    }
    sum as f32 * scale
}

#[cfg(test)]
mod tests;
