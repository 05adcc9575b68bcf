//! Settings of a bake: its cost, and how bold it is.

/// Number of steps. Strokes are there from the start, so steps only settle the colors under them, and more
/// steps bring nothing: on the demo scene in mosaic, 60, 80 and 100 steps give style errors of 2.11, 2.14 and
/// 2.16, for 2.26 at the start (two views; errors of texture stay at 1.22 to 1.24).
const STEPS: u32 = 80;

/// Gaussians up to which that is so: as many as the demo scene has.
const FEW: f64 = 70_000.0;

/// The power of the number of Gaussians by which steps grow beyond, and their most, as a factor. On the bonsai
/// (271,123) in four paintings, 440 and 600 steps have a texture error of 1.01 and 0.98; 126 have 1.22 in two
/// of them, for 1.00 and 0.97.
const GROWTH: f64 = 1.5;
const MOST: f64 = 8.0;

/// Adam's rate at the first step. At twice as much, colors under strokes become confetti again.
const RATE: f32 = 0.0175;

/// Weights of the parts of the loss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossWeights {
    /// Matching of cells with the painting's.
    pub matching: f32,
    /// Means and deviations of channels.
    pub statistics: f32,
    /// Pull of every color toward the nearest color of the painting, as a share of the distance in each step:
    /// in hue and saturation, and a tenth of it in luminance.
    pub palette: f32,
    /// Distance of the colors of large shapes from the recolored scene's, with a tolerance of brightness, and
    /// their lack of the painting's contrast.
    pub shapes: f32,
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
    /// Side of the pictures that are compared, in pixels; a multiple of 8.
    pub crop: u32,
    /// Side of a whole view, in pixels: the scale of strokes. Paintings are compared at as many pixels.
    pub view: u32,
    /// Adam's rate at the first step, in units of color. It falls to 30% along a cosine.
    pub rate: f32,
    /// Start of the bake, 0..1: from the recolored scene (0) to instant paint ([`stylegaussian::paint`]) (1).
    pub paint: f32,
    /// Strength of the pull toward the initial color for Gaussians that should not carry strokes, 0 or more: in
    /// a step of Adam's rate r, the share r `protection` of the distance is taken back. This limits drift to
    /// 1 / `protection`. Gaussians that are larger than a stroke are pulled ten times as much, and Gaussians
    /// under strokes a third as much.
    pub protection: f32,
    /// Share of the new crop in the running statistics, 0..1.
    pub pool: f32,
    /// Cells of a crop that are matched at each layer.
    pub queries: usize,
    /// Cells of the paintings that they are matched with at each layer, the same in all steps. For an equal
    /// cost, more queries and fewer keys give a steadier gradient (docs/notes.md, "Bakes").
    pub keys: usize,
    /// Weights of the parts of the loss.
    pub weights: LossWeights,
}

impl BakeConfig {
    /// The default settings.
    pub const DEFAULT: Self = Self {
        steps: STEPS,
        seed: 0,
        crop: 256,
        view: 512,
        rate: RATE,
        paint: 1.0,
        protection: 1.0,
        pool: 0.15,
        queries: 4000,
        keys: 750,
        weights: LossWeights { matching: 9.0, statistics: 1.0, palette: 0.1, shapes: 300.0, range: 1.0 },
    };

    /// The default settings for a scene of `n_gaussians`: as many steps as [`Self::DEFAULT`] up to 70,000
    /// Gaussians, then more, up to eight times as many for 280,000.
    ///
    /// More and smaller Gaussians settle more slowly: a step moves those that a crop shows, by their share of a
    /// pixel.
    pub fn for_scene(n_gaussians: usize) -> Self {
        let larger = (n_gaussians as f64 / FEW).powf(GROWTH).clamp(1.0, MOST);
        let steps = (f64::from(Self::DEFAULT.steps) * larger).round() as u32;
        Self { steps, ..Self::DEFAULT }
    }

    /// These settings with the style at `strength`: 0 gives the recolored scene, 1 the default, 2 a bold
    /// picture in which the scene's own detail may get lost.
    ///
    /// Strength multiplies the rate: every Gaussian then goes so much farther, whatever the number of steps.
    /// The scene's large shapes and protected Gaussians are kept less. Below 1 there is also less of instant
    /// paint at the start.
    pub fn with_strength(self, strength: f32) -> Self {
        let kept = 1.0 / strength.max(0.1);
        let weights = LossWeights { shapes: kept * self.weights.shapes, ..self.weights };
        Self {
            rate: self.rate * strength,
            paint: (self.paint * strength).min(1.0),
            protection: kept * self.protection,
            weights,
            ..self
        }
    }
}

impl Default for BakeConfig {
    fn default() -> Self {
        Self::DEFAULT
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn larger_scenes_take_more_steps() {
        let steps = |n| BakeConfig::for_scene(n).steps;
        assert_eq!([steps(0), steps(70_000), steps(271_123), steps(10_000_000)], [80, 80, 610, 640]);
    }
}
