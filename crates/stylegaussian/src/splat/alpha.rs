//! The limits of a splat's alpha, all of them Kerbl et al.'s (2023).

/// Smallest alpha that is drawn: one step of an 8-bit picture. A splat ends at the distance from its center at
/// which its alpha falls below this.
pub const MIN_ALPHA: f32 = 1.0 / 255.0;

/// Largest alpha of a splat. It keeps transmittance positive: no splat hides everything behind it.
pub const MAX_ALPHA: f32 = 0.99;

/// A pixel is finished before the splat that would bring its transmittance below this.
pub(super) const MIN_TRANSMITTANCE: f32 = 1e-4;

/// The squared distance from the mean, in standard deviations, at which alpha o exp(-q / 2) falls to
/// [`MIN_ALPHA`]: q = 2 ln(255 o), at most 11.1. Not below 0 for opacities that are drawn, [`MIN_ALPHA`] to 1.
pub(super) fn cutoff(opacity: f32) -> f32 {
    2.0 * (opacity / MIN_ALPHA).ln()
}
