//! Strokes: a painting's fine detail, as the splat pass draws it on a scene, pixel by pixel.
//!
//! A Gaussian's color carries all that is coarser than a stroke. Strokes are added by the pixel: each Gaussian
//! belongs to a *seed*, a spot on the surface about a stroke wide, and a seed maps the scene to the painting,
//!
//! ```text
//! t(x) = place + pitch / stroke_scale (right . (x - at), down . (x - at))        in texels
//! ```
//!
//! A pixel's ray meets a Gaussian where the Gaussian's density is largest along the ray. With S the Gaussian's
//! covariance, m = S^-1 r, and r the ray, a step v beside the ray moves that point by v - r (m . v) / (m . r):
//! along the plane through the mean with normal m. So on screen, each splat has one affine map to the painting,
//! its [`StrokeRecord`], which is exact to first order for every projection. A fragment adds
//!
//! ```text
//! fine gain . fine(t) + wide gain . wide(t)
//! ```
//!
//! to the splat's color. Nothing here knows how seeds, gains and textures are found: see
//! [`paint`](crate::paint). The kernel is `splat_strokes`.

mod curve;
mod factors;
mod knobs;
mod mix;
mod motion;
mod of_scene;
mod record;
mod relief;
mod seed;
mod stable;
#[cfg(test)]
mod tests;
mod texture;

pub use curve::{MAX_CURVE_POINTS, StrokeCurve};
pub(crate) use curve::{along_curve, step};
pub use factors::{IN_PLANE, StrokeFactors};
pub use knobs::StrokeKnobs;
pub use mix::{EDGE, StrokeLayer, mix_strokes, mixed};
pub use motion::{
    ACROSS, DIRECTION_SHIFT, DIRECTIONS, FADE, KIND_BOIL, KIND_FLOW, KIND_STILL, MotionNow, SLOW, STROKE,
    StrokeMotion, TURN,
};
pub use of_scene::Strokes;
pub use record::{EDGE_ON, FLATTEST, LEAST_ALPHA, LEVELS, MAX_STEP, MOST_OCTAVES, SHARPER, StrokeRecord};
pub use relief::{BLURRIER, GLOSS, IN_LIGHT, SHININESS, STEEPEST, StrokeRelief, THICKNESS};
pub use seed::{
    MAX_GAIN, MAX_SEEDS, MAX_TEXTURES, PERIOD, PROTECTED, PlainSeed, SEED_BITS, SEVEN_BITS, StrokeSeed,
    StrokeWord,
};
pub use stable::{FARTHEST, NEAREST, STABLE_OCTAVES, stable_shares};
pub use texture::{FINE_SIDE, StrokeTexture, WIDE_LEVEL, WIDE_SIDE};
