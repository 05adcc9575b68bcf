//! The parts of the loss, each with its gradient.

pub(crate) mod matching;
pub(crate) mod shapes;
pub(crate) mod statistics;

/// The parts of a step's loss, unweighted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    /// Mean cosine distance of cells from the nearest of the painting's, summed over the layers that are
    /// matched.
    pub matching: f32,
    /// Mean squared error of channel means and deviations, summed over layers.
    pub statistics: f32,
    /// Mean squared distance of the Gaussians' colors from the hue and saturation of the nearest color of the
    /// painting.
    pub palette: f32,
    /// Mean squared distance of the colors of large shapes from the recolored scene's, with a tolerance of
    /// brightness, and half the mean square of their lack of the painting's contrast; none in a step that
    /// compares luminance, and if its weight is 0.
    pub shapes: Option<f32>,
    /// Mean squared excess of pixels over 0..1.
    pub range: f32,
}

/// Mean squared excess of `rgb` over 0..1 over the pixels in `cells`. Adds `weight` times the gradient to
/// `grad`.
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
