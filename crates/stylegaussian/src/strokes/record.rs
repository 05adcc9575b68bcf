//! The strokes of one splat: its affine map from the screen to the painting.

use glam::{Quat, Vec2, Vec3};
use half::f16;

use super::{
    knobs::StrokeKnobs,
    seed::{MAX_GAIN, PERIOD, PROTECTED, StrokeSeed, StrokeWord, wrapped},
    stable::{FARTHEST, NEAREST, stable_shares},
    texture::{FINE_SIDE, StrokeTexture},
};

/// Fragments of less alpha show no strokes: they are many, and give little.
pub const LEAST_ALPHA: f32 = 0.02;

/// Octaves of finer strokes that are added from near: eight times finer, at which the painting's grain is that
/// of the screen from an eighth of the usual distance.
pub const MOST_OCTAVES: u32 = 3;

/// Range of the level, in octaves: from 16 times magnified to a texture of one texel.
pub const LEVELS: (f32, f32) = (-4.0, 12.0);

/// Added to the level of detail. Texels are drawn sharper than one to a pixel, since mipmaps and the Gaussians
/// that blend in a pixel blur them again.
pub const SHARPER: f32 = -0.5;

/// A Gaussian's shortest axis, as a share of its longest, is no less than this. It keeps the plane of a flat
/// Gaussian in single precision.
pub const FLATTEST: f32 = 0.03;

/// Most of a Gaussian's longest standard deviation by which a step of a pixel moves the point along the ray:
/// seen from the edge, a plane would reach without end.
pub const EDGE_ON: f32 = 3.0;

/// The largest step in the painting for a pixel, in texels.
pub const MAX_STEP: f32 = 4096.0;

/// Strokes of one splat on screen: 16 bytes on the GPU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrokeRecord {
    /// Place in the painting at the splat's center, in texels, 0 to [`PERIOD`].
    pub texel: Vec2,
    /// Change of it for a pixel to the right.
    pub step_x: Vec2,
    /// Change of it for a pixel down.
    pub step_y: Vec2,
    /// Gain of fine detail.
    pub fine: f32,
    /// Gain of wide detail.
    pub wide: f32,
    /// Number of the texture.
    pub texture: u8,
    /// Level of detail: the binary logarithm of the texels to a pixel. Below 0 the painting is magnified.
    pub level: f32,
}

impl StrokeRecord {
    /// Octaves of strokes that are stable on screen, from the record's own, and their shares.
    pub(super) fn stable_octaves(&self, knobs: &StrokeKnobs) -> impl Iterator<Item = (f32, f32)> + use<> {
        // The middle octave, the next one, is between one texel to a pixel and two pixels to a texel.
        let part = (-1.0 - self.level - knobs.stroke_scale.log2()).clamp(0.0, 1.0);
        let shares = stable_shares(part).to_array();
        shares.into_iter().enumerate().map(|(octave, share)| (octave as f32, share))
    }

    /// The record of a Gaussian with `mean`, `rotation` and `scales`, or `None` if it shows no strokes.
    /// `pixel_x` and `pixel_y` are the gradients of the mean's position on screen, in pixels per scene unit, in
    /// scene space.
    pub fn new(
        word: u32,
        seeds: &[StrokeSeed],
        (mean, rotation, scales): (Vec3, Quat, Vec3),
        (pixel_x, pixel_y): (Vec3, Vec3),
        knobs: &StrokeKnobs,
    ) -> Option<Self> {
        let word = StrokeWord::unpacked(word);
        if word.share <= 0.0 {
            return None;
        }
        let seed = seeds[word.seed as usize].plain();
        let protection = word.protection_by(knobs.protection);
        let amount = word.share * knobs.amount;
        let fine = amount * seed.fine * (1.0 - PROTECTED * protection);
        let wide = amount * seed.wide * (1.0 - protection);
        // Along the ray neither coordinate changes.
        let ray = pixel_x.cross(pixel_y);
        let squared = ray.length_squared();
        let usable = squared > 0.0 && squared.is_finite() && fine.max(wide) > 0.0;
        if !usable {
            return None;
        }
        // Steps beside the ray that move by one pixel.
        let (beside_x, beside_y) = (pixel_y.cross(ray) / squared, ray.cross(pixel_x) / squared);
        let longest = scales.max_element();
        let precisions = (scales.max(Vec3::splat(FLATTEST * longest)) / longest).powf(-2.0);
        let across = rotation * (precisions * (rotation.inverse() * ray));
        let across_ray = across.dot(ray);
        // Strokes that are stable on screen have their size from their octave.
        let stroke_scale = if knobs.screen_stable { 1.0 } else { knobs.stroke_scale };
        let pitch = seed.pitch / stroke_scale;
        let limit = EDGE_ON * longest / squared.sqrt();
        let step = |beside: Vec3| {
            let along = (across.dot(beside) / across_ray).clamp(-limit, limit);
            let on_plane = beside - ray * along;
            pitch * Vec2::new(seed.right.dot(on_plane), seed.down.dot(on_plane))
        };
        let limited = |step: Vec2| step.clamp(Vec2::splat(-MAX_STEP), Vec2::splat(MAX_STEP));
        let (step_x, step_y) = (step(beside_x), step(beside_y));
        let local = mean - seed.at;
        let texel = seed.place + pitch * Vec2::new(seed.right.dot(local), seed.down.dot(local));
        // As if it were seen from the front. Slanted, up to three times as much: a texture cannot be blurred in
        // one direction.
        let facing = (beside_x.length() * beside_y.length() * pitch.x * pitch.y).sqrt();
        let texels = limited(step_x).perp_dot(limited(step_y)).abs().sqrt().clamp(facing, 3.0 * facing);
        let level = texels.log2() + SHARPER;
        let octave = match knobs.screen_stable {
            true => (-level - knobs.stroke_scale.log2()).floor().clamp(FARTHEST, NEAREST) - 1.0,
            false => 0.0,
        };
        let (texel, [step_x, step_y]) =
            (texel * octave.exp2(), [step_x, step_y].map(|step| step * octave.exp2()));
        let level = (level + octave).clamp(LEVELS.0, LEVELS.1);
        (texel.is_finite() && level.is_finite()).then_some(Self {
            texel,
            step_x: limited(step_x),
            step_y: limited(step_y),
            fine,
            wide,
            texture: seed.texture,
            level,
        })
    }

    /// The record as the draw reads it: the place (fractions of 16 bits of [`PERIOD`]), the steps (f16), and
    /// bytes for fine gain, wide gain (of [`MAX_GAIN`]), texture and level.
    pub fn packed(&self) -> [u32; 4] {
        let place = self.texel / PERIOD;
        let halves =
            |v: Vec2| u32::from(f16::from_f32(v.x).to_bits()) | u32::from(f16::from_f32(v.y).to_bits()) << 16;
        let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u32;
        let level = (self.level - LEVELS.0) / (LEVELS.1 - LEVELS.0);
        [
            wrapped(place.x) | wrapped(place.y) << 16,
            halves(self.step_x),
            halves(self.step_y),
            byte(self.fine / MAX_GAIN)
                | byte(self.wide / MAX_GAIN) << 8
                | u32::from(self.texture) << 16
                | byte(level) << 24,
        ]
    }

    /// The inverse of [`packed`](Self::packed).
    pub fn unpacked([place, x, y, look]: [u32; 4]) -> Self {
        let halves = |bits: u32| {
            let half = |bits: u32| f16::from_bits(bits as u16).to_f32();
            Vec2::new(half(bits), half(bits >> 16))
        };
        let byte = |shift: u32| (look >> shift & 0xff) as f32 / 255.0;
        Self {
            texel: PERIOD / 65536.0 * Vec2::new((place & 0xffff) as f32, (place >> 16) as f32),
            step_x: halves(x),
            step_y: halves(y),
            fine: MAX_GAIN * byte(0),
            wide: MAX_GAIN * byte(8),
            texture: (look >> 16) as u8,
            level: LEVELS.0 + (LEVELS.1 - LEVELS.0) * byte(24),
        }
    }

    /// The place in the painting at `offset` pixels from the splat's center, where the texture is the unit
    /// square.
    pub fn at(&self, offset: Vec2) -> Vec2 {
        (self.texel + self.step_x * offset.x + self.step_y * offset.y) / FINE_SIDE as f32
    }

    /// The detail at `offset` pixels from the splat's center.
    pub fn detail(&self, texture: &StrokeTexture, offset: Vec2, knobs: &StrokeKnobs) -> Vec3 {
        let (at, near) = (self.at(offset), knobs.near);
        let mut sum = Vec3::ZERO;
        if knobs.screen_stable {
            for (octave, share) in self.stable_octaves(knobs) {
                let (at, level) = (at * octave.exp2(), self.level + octave);
                sum += share * (self.fine * texture.fine(at, level) + self.wide * texture.wide(at, level));
            }
            return sum;
        }
        if self.fine > 0.0 {
            let mut fine = texture.fine(at, self.level);
            let mut gain = near;
            for octave in 1..=MOST_OCTAVES {
                let k = octave as f32;
                // An octave comes in from 0.4 octaves before its own distance to 0.2 after it.
                let share = ((-self.level - k + 0.6) / 0.8).clamp(0.0, 1.0);
                if share <= 0.0 {
                    break;
                }
                fine += texture.fine(at * k.exp2(), self.level + k) * (gain * share);
                gain *= near;
            }
            sum += self.fine * fine;
        }
        if self.wide > 0.0 {
            sum += self.wide * texture.wide(at, self.level);
        }
        sum
    }
}
