//! A camera's way from linear light to display-referred colors, and back.

use glam::Vec3;

/// Weights of red, green and blue in luminance, by Rec. 709, for linear colors.
pub const LINEAR_LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// The brightest scene color that an inverse gives, in c = x / (1 + x). Curves never reach 1, or only from
/// hundreds on: undone as it is, one white splat would give as much light to bloom as a lamp.
pub const BRIGHTEST_SHOWN: f32 = 8.0 / (1.0 + 8.0);

/// The color from which on the way to [`BRIGHTEST_SHOWN`] bends, so that whites keep their differences. Darker
/// colors are undone exactly.
pub const KNEE: f32 = 0.8;

/// Exposure, tone mapping and sRGB's encoding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Display {
    /// The tone mapping.
    pub curve: Curve,
    /// Stops by which the camera brightens light before it.
    pub exposure: f32,
}

/// Tone mapping with an inverse by formula.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Curve {
    /// None: light of 1 is white.
    #[default]
    Linear,
    /// x / (1 + x) of each channel.
    Reinhard,
    /// The same of the luminance.
    ReinhardLuminance,
}

/// Colors 0..1 as colors 0..[`BRIGHTEST_SHOWN`]: equal up to [`KNEE`], then ever slower, without a kink.
fn dimmed(c: Vec3) -> Vec3 {
    let above = (c - KNEE).max(Vec3::ZERO);
    let bend = 1.0 / (BRIGHTEST_SHOWN - KNEE) - 1.0 / (1.0 - KNEE);
    c.min(Vec3::splat(KNEE)) + above / (1.0 + bend * above)
}

/// Linear from display-referred, by the sRGB transfer function (IEC 61966-2-1), which its straight part
/// continues below 0 and its curve above 1.
pub fn linear_from_srgb(c: f32) -> f32 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// Display-referred from linear: the inverse of [`linear_from_srgb`].
pub fn srgb_from_linear(c: f32) -> f32 {
    if c <= 0.0031308 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

impl Display {
    /// The linear light that is shown as `color`, clamped to 0..1; less for whites, if the curve never shows
    /// them.
    pub fn scene(&self, color: Vec3) -> Vec3 {
        let linear = color.clamp(Vec3::ZERO, Vec3::ONE).map(linear_from_srgb);
        let before = match self.curve {
            Curve::Linear => linear,
            Curve::Reinhard => dimmed(linear) / (1.0 - dimmed(linear)),
            Curve::ReinhardLuminance => {
                let luminance = LINEAR_LUMINANCE.dot(linear);
                let limited = dimmed(Vec3::splat(luminance)).x;
                linear * (limited / luminance.max(1e-6)) / (1.0 - limited)
            }
        };
        before / self.exposure.exp2()
    }

    /// The color, 0..1, as which linear light of 0 or more is shown.
    pub fn shown(&self, light: Vec3) -> Vec3 {
        let exposed = light * self.exposure.exp2();
        let mapped = match self.curve {
            Curve::Linear => exposed,
            Curve::Reinhard => exposed / (1.0 + exposed),
            Curve::ReinhardLuminance => exposed / (1.0 + LINEAR_LUMINANCE.dot(exposed)),
        };
        mapped.clamp(Vec3::ZERO, Vec3::ONE).map(srgb_from_linear)
    }
}
