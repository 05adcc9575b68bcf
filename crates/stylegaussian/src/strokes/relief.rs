//! Relief: light on the thickness of paint.
//!
//! The luminance of fine detail is the height of the paint. A direction lights it: a slope that faces the light
//! is brighter than flat paint, one that faces away is darker, and one that mirrors the light to the eye is
//! glossy. Flat paint stays as it is, since the captured light is in its color.

use glam::{Vec2, Vec3};
use half::f16;

use super::{
    knobs::StrokeKnobs,
    record::StrokeRecord,
    seed::PlainSeed,
    texture::{FINE_SIDE, StrokeTexture},
};
use crate::palette::LUMINANCE;

/// Height of the paint, in texels for a luminance of 1: a ridge that is an eighth brighter than its
/// surroundings is one and a half texels high, a tenth of a stroke's width.
pub const THICKNESS: f32 = 12.0;

/// The steepest slope: 45 degrees. Steeper ones approach it, so that grain is no spikes.
pub const STEEPEST: f32 = 1.0;

/// Levels of detail by which the height is blurrier than the colors: paint flows, and does not keep each hair
/// of the brush. At one level, the steps of slanted edges in the texture are seen as beads along strokes.
pub const BLURRIER: f32 = 2.0;

/// Exponent of the gloss: a highlight of about 20 degrees, as on oil that has dried.
pub const SHININESS: f32 = 24.0;

/// Share of white in a highlight.
pub const GLOSS: f32 = 0.35;

/// Cosine between the light and the surface below which gloss fades: there is none in the shade.
pub const IN_LIGHT: f32 = 0.25;

/// How light falls on the paint of one splat: 16 bytes on the GPU. Directions are in the painting's axes on the
/// surface, x right and y down, z out of it toward the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrokeRelief {
    /// Unit direction to the light.
    pub light: Vec3,
    /// Unit direction midway between the light and the eye.
    pub half: Vec3,
    /// Factor of the height.
    pub strength: f32,
    /// Texels in y to one in x.
    pub aspect: f32,
}

impl StrokeRelief {
    /// The relief of a splat that belongs to `seed`, with `to_eye` the direction to the eye in scene space.
    /// `None` if the knobs ask for none.
    pub fn new(seed: &PlainSeed, to_eye: Vec3, knobs: &StrokeKnobs) -> Option<Self> {
        let to_light = knobs.light.try_normalize()?;
        let to_eye = to_eye.try_normalize()?;
        let is_asked = knobs.relief > 0.0 && knobs.relief.is_finite();
        let out = seed.right.cross(seed.down);
        let out = if out.dot(to_eye) < 0.0 { -out } else { out };
        let in_axes = |v: Vec3| Vec3::new(v.dot(seed.right), v.dot(seed.down), v.dot(out));
        // Light from behind the eye's opposite has no direction midway, and lights nothing that is seen.
        let half = (to_light + to_eye).normalize_or_zero();
        is_asked.then(|| Self {
            light: in_axes(to_light),
            half: in_axes(half),
            strength: knobs.relief,
            aspect: seed.pitch.y / seed.pitch.x,
        })
    }

    /// The relief as the draw reads it: signed fractions of 16 bits and f16, two to a word.
    pub fn packed(&self) -> [u32; 4] {
        let snorm = |x: f32| u32::from(((x.clamp(-1.0, 1.0) * 32767.0).round() as i16).cast_unsigned());
        let f16 = |x: f32| u32::from(f16::from_f32(x).to_bits());
        [
            snorm(self.light.x) | snorm(self.light.y) << 16,
            snorm(self.light.z) | snorm(self.half.z) << 16,
            snorm(self.half.x) | snorm(self.half.y) << 16,
            f16(self.strength) | f16(self.aspect) << 16,
        ]
    }

    /// The inverse of [`packed`](Self::packed).
    pub fn unpacked(words: [u32; 4]) -> Self {
        let snorm = |bits: u32| f32::from((bits as u16).cast_signed()) / 32767.0;
        let f16 = |bits: u32| f16::from_bits(bits as u16).to_f32();
        let [light, z, half, factors] = words;
        Self {
            light: Vec3::new(snorm(light), snorm(light >> 16), snorm(z)),
            half: Vec3::new(snorm(half), snorm(half >> 16), snorm(z >> 16)),
            strength: f16(factors),
            aspect: f16(factors >> 16),
        }
    }

    /// The change of a `color` by light on paint with this gradient of its height, in texels to a texel: 0 if
    /// that is 0.
    pub fn shade(&self, gradient: Vec2, color: Vec3) -> Vec3 {
        let steep = self.strength * gradient * Vec2::new(1.0, self.aspect);
        if steep == Vec2::ZERO {
            return Vec3::ZERO;
        }
        let slope = steep / (1.0 + steep.length_squared() / (STEEPEST * STEEPEST)).sqrt();
        let normal = (-slope).extend(1.0) / (1.0 + slope.length_squared()).sqrt();
        let diffuse = normal.dot(self.light).max(0.0) - self.light.z.max(0.0);
        let shine = |cosine: f32| cosine.max(0.0).powf(SHININESS);
        let gloss = shine(normal.dot(self.half)) - shine(self.half.z);
        let in_light = (self.light.z / IN_LIGHT).clamp(0.0, 1.0);
        color * diffuse + Vec3::splat(GLOSS * in_light * gloss)
    }
}

impl StrokeRecord {
    /// The change of a splat's `color` by light at `offset` pixels from its center: on the painting's own
    /// octave alone, since finer ones would be grain, or on each of those that are stable on screen.
    pub fn lit(
        &self,
        texture: &StrokeTexture,
        offset: Vec2,
        (relief, knobs): (&StrokeRelief, &StrokeKnobs),
        color: Vec3,
    ) -> Vec3 {
        let at = self.at(offset);
        let of = |(octave, share): (f32, f32)| {
            let gradient = gradient(texture, at * octave.exp2(), self.level + octave);
            relief.shade(share * self.fine * gradient, color)
        };
        match knobs.screen_stable {
            true => self.stable_octaves(knobs).map(of).sum(),
            false => of((0.0, 1.0)),
        }
    }
}

/// The gradient of the height of fine detail at a place, for a gain of 1: differences over a texel of a
/// blurrier level, from three corners around the place.
fn gradient(texture: &StrokeTexture, at: Vec2, level: f32) -> Vec2 {
    let level = level.max(0.0) + BLURRIER;
    let step = level.exp2() / FINE_SIDE as f32;
    let first = at - step / 3.0;
    let height = |at: Vec2| texture.fine(at, level).dot(LUMINANCE);
    let [here, right, below] = [Vec2::ZERO, Vec2::X, Vec2::Y].map(|corner| height(first + step * corner));
    THICKNESS * Vec2::new(right - here, below - here) / level.exp2()
}
