//! Light and air: what changes the color of a splat that is drawn as captured or styled. A [`Tint`] of its
//! cloud, those of the volumes that it is in, shadows on it, and the [`Fog`] and the [`Atmosphere`] before it.
//!
//! Splats have display-referred colors. Light is linear, before a camera's exposure and tone mapping, and so is
//! a mesh's. With D the [`Display`] of a scene color, M the tint, s the share of the light that is not in
//! shadow, and t and a the transmission and the light of the air, the color c becomes
//!
//! ```text
//! D(s t M D^-1(c) + a) + k (c - D(D^-1(c)))        k = s t min(M 1, 1)
//! ```
//!
//! The first part is the color of an unlit mesh that looks like c. The second keeps as much of what D has no
//! inverse for as is left of the splat: colors beyond white, and whites that the inverse dims. So a tint and an
//! air that change nothing give c.

use glam::{Mat3, Vec3};

mod atmosphere;
mod display;
mod lamp;
mod shadow;
#[cfg(test)]
mod tests;
mod volume;

pub use atmosphere::{Atmosphere, FARTHEST_AIR};
pub use display::{
    BRIGHTEST_SHOWN, Curve, Display, KNEE, LINEAR_LUMINANCE, linear_from_srgb, srgb_from_linear,
};
pub use lamp::{Cone, MAX_LAMPS, ShadowLamp};
pub use shadow::{MAX_CASCADES, ShadowCascade, in_shadow};
pub use volume::{MAX_TINT_VOLUMES, TintVolume, tint_at};

/// Half the step of the difference quotient of [`Lit::contrast`]: about the amplitude of strokes, whose
/// contrast it is to be.
pub const CONTRAST_STEP: f32 = 1.0 / 16.0;

/// Suns that light fog at most; further ones are left out.
pub const MAX_SUNS: usize = 4;

/// A change of a cloud's colors, in linear light before exposure and tone mapping: first the saturation, then
/// the color, then the exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tint {
    /// Linear factors of red, green and blue, 0 or more.
    pub color: Vec3,
    /// Brightening in stops: 1 doubles the light.
    pub exposure: f32,
    /// Distance from gray, 0 or more: 0 is gray, 1 as it is.
    pub saturation: f32,
}

impl Tint {
    /// No change.
    pub const IDENTITY: Self = Self { color: Vec3::ONE, exposure: 0.0, saturation: 1.0 };

    /// The map of linear colors; `None` if it changes nothing, or if a number is not finite.
    pub fn matrix(&self) -> Option<Mat3> {
        let factor = self.color.max(Vec3::ZERO) * self.exposure.exp2();
        let saturation = self.saturation.max(0.0);
        let usable = self.color.is_finite() && factor.is_finite() && self.saturation.is_finite();
        if !usable || *self == Self::IDENTITY {
            return None;
        }
        // Each row of the first part is the luminance.
        let gray = Mat3::from_cols_array_2d(&LINEAR_LUMINANCE.to_array().map(|weight| [weight; 3]));
        Some(Mat3::from_diagonal(factor) * (gray * (1.0 - saturation) + Mat3::IDENTITY * saturation))
    }
}

impl Default for Tint {
    fn default() -> Self {
        Self::IDENTITY
    }
}

/// Air that takes light from what is behind it and adds its own, as Bevy's `DistanceFog` does.
#[derive(Clone, Debug, PartialEq)]
pub struct Fog {
    /// Its linear color.
    pub color: Vec3,
    /// Factor of all of it, 0..1: the alpha of Bevy's color.
    pub strength: f32,
    /// Its growth with distance.
    pub falloff: Falloff,
    /// Lights that make it glow around them.
    pub suns: Vec<Sun>,
    /// Exponent of the glow, over the cosine of the angle to a sun.
    pub exponent: f32,
}

/// The growth of fog with the distance from the eye, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Falloff {
    /// From nothing at `start` to all at `end`.
    Linear {
        /// Distance at which it begins.
        start: f32,
        /// Distance from which on nothing else is seen.
        end: f32,
    },
    /// 1 - exp(-density distance).
    Exponential {
        /// Share that is lost per unit.
        density: f32,
    },
    /// 1 - exp(-(density distance)^2).
    ExponentialSquared {
        /// Inverse of the distance at which it is at 0.63.
        density: f32,
    },
    /// Exponential, for each channel, and otherwise for the light behind than for the light that is added.
    Atmospheric {
        /// Density for the light behind.
        extinction: Vec3,
        /// Density for the light that is added.
        inscattering: Vec3,
    },
}

/// A directional light in fog.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit direction to it.
    pub direction: Vec3,
    /// The light that it adds to the fog's color where the eye looks into it, linear.
    pub glow: Vec3,
}

/// The air between the eye and a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    /// Share of the light that passes.
    pub transmission: Vec3,
    /// Linear light that is added.
    pub light: Vec3,
}

impl Air {
    /// No air.
    pub const CLEAR: Self = Self { transmission: Vec3::ONE, light: Vec3::ZERO };
}

impl Fog {
    /// The air between the eye and a point at `ray` from it.
    pub fn along(&self, ray: Vec3) -> Air {
        let distance = ray.length();
        let direction = ray / distance.max(1e-20);
        let glow = |sun: &Sun| {
            let cosine = direction.dot(sun.direction);
            if cosine > 0.0 { cosine.powf(self.exponent) * sun.glow } else { Vec3::ZERO }
        };
        let color = self.color + self.suns.iter().take(MAX_SUNS).map(glow).sum::<Vec3>();
        let share = |density: Vec3| 1.0 - (-distance * density).exp();
        let (lost, added) = match self.falloff {
            Falloff::Linear { start, end } => {
                let both = Vec3::splat(1.0 - ((end - distance) * steepness(start, end)).clamp(0.0, 1.0));
                (both, both)
            }
            Falloff::Exponential { density } => {
                let both = share(Vec3::splat(density));
                (both, both)
            }
            Falloff::ExponentialSquared { density } => {
                let both = share(Vec3::splat(density * density * distance));
                (both, both)
            }
            Falloff::Atmospheric { extinction, inscattering } => (share(extinction), share(inscattering)),
        };
        Air { transmission: 1.0 - self.strength * lost, light: self.strength * added * color }
    }

    /// Whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        let falloff = match self.falloff {
            Falloff::Linear { start, end } => start.is_finite() && end.is_finite(),
            Falloff::Exponential { density } | Falloff::ExponentialSquared { density } => density.is_finite(),
            Falloff::Atmospheric { extinction, inscattering } => {
                extinction.is_finite() && inscattering.is_finite()
            }
        };
        let suns = self.suns.iter().all(|sun| sun.direction.is_finite() && sun.glow.is_finite());
        falloff && suns && self.color.is_finite() && self.strength.is_finite() && self.exponent.is_finite()
    }
}

/// The inverse of the length of a linear falloff. Where that is 0, fog is a wall: steeper than any distance
/// between two numbers shows.
pub fn steepness(start: f32, end: f32) -> f32 {
    if end == start { 1e9 } else { 1.0 / (end - start) }
}

/// The light on a splat, and the way in which its camera shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lit {
    /// The tint as [`Tint::matrix`] or [`tint_at`] give it.
    pub tint: Mat3,
    /// Share of the light that reaches the splat: see [`in_shadow`].
    pub shade: f32,
    /// The air before the splat.
    pub air: Air,
    /// The camera's way from light to colors.
    pub display: Display,
}

impl Lit {
    /// The color, display-referred, of a splat with this one.
    pub fn color(&self, color: Vec3) -> Vec3 {
        let Self { tint, shade, air: Air { transmission, light }, display } = *self;
        let scene = display.scene(color);
        let passed = shade * transmission;
        let lit = (passed * (tint * scene).max(Vec3::ZERO) + light).max(Vec3::ZERO);
        let kept = passed * (tint * Vec3::ONE).clamp(Vec3::ZERO, Vec3::ONE);
        display.shown(lit) + kept * (color - display.shown(scene))
    }

    /// The share of their contrast that strokes on a splat of this color keep: one number for all channels,
    /// since strokes have one gain.
    pub fn contrast(&self, color: Vec3) -> f32 {
        let change = self.color(color + CONTRAST_STEP) - self.color(color - CONTRAST_STEP);
        (LINEAR_LUMINANCE.dot(change) / (2.0 * CONTRAST_STEP)).max(0.0)
    }
}
