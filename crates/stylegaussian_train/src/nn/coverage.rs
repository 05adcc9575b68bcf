//! Coverage of feature maps: which cells show the scene, and how much of each.

/// The coverage at the middle of each cell of a feature map of `[w, h]` cells over a picture's `alpha`.
pub fn coverage_of_cells(alpha: &[f32], [width, height]: [usize; 2], [w, h]: [usize; 2]) -> Vec<f32> {
    // (i + 1/2) pixels / n, rounded down, in whole numbers.
    let middle = |i: usize, n: usize, pixels: usize| (2 * i + 1) * pixels / (2 * n);
    (0..h * w).map(|i| alpha[middle(i / w, h, height) * width + middle(i % w, w, width)]).collect()
}

/// Values divided by their sum.
pub fn shares(values: &[f32]) -> Vec<f32> {
    // A picture without scene has shares of 0, and so no gradient, instead of NaN.
    let total = values.iter().sum::<f32>().max(1e-6);
    values.iter().map(|value| value / total).collect()
}
