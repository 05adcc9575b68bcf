//! What a bake costs and how bold it is.

/// Weights of the parts of the loss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossWeights {
    /// Matching of cells with the painting's.
    pub matching: f32,
    /// Means and deviations of channels.
    pub statistics: f32,
    /// Distance of the deepest features from the unstyled scene's.
    pub content: f32,
    /// The share of the way toward the nearest color of the painting that every color goes in each step.
    pub palette: f32,
    /// Colors beyond 0..1.
    pub range: f32,
}

/// Settings of a bake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BakeConfig {
    /// Steps.
    pub steps: u32,
    /// Random seed.
    pub seed: u64,
    /// Side of the pictures that are compared, in pixels; a multiple of 4.
    pub crop: u32,
    /// Side of a whole view, in pixels: the scale of strokes. Paintings are compared at as many pixels.
    pub view: u32,
    /// Adam's rate at the first step, in units of color. It falls to 30% along a cosine.
    pub rate: f32,
    /// Share of the new crop in the running statistics, 0..1.
    pub pool: f32,
    /// Cells of a crop that are matched at each layer.
    pub queries: usize,
    /// Cells of the paintings that they are matched with.
    pub keys: usize,
    /// Weights of the parts of the loss.
    pub weights: LossWeights,
}

impl Default for BakeConfig {
    fn default() -> Self {
        Self {
            steps: 150,
            seed: 0,
            crop: 192,
            view: 512,
            rate: 0.03,
            pool: 1.0,
            queries: 1000,
            keys: 2500,
            weights: LossWeights { matching: 1.0, statistics: 0.1, content: 0.01, palette: 0.1, range: 1.0 },
        }
    }
}
