//! Seeds, and the strokes of single Gaussians, as numbers and as bits.

use std::f32::consts::SQRT_2;

use bytemuck::{Pod, Zeroable};
use glam::{Quat, Vec2, Vec3};
use half::f16;

use super::texture::FINE_SIDE;

/// Bits of a word that hold the seed, from the lowest.
pub const SEED_BITS: u32 = 18;
/// Most seeds of one table, mixes of several styles included.
pub const MAX_SEEDS: usize = 1 << SEED_BITS;
/// Most textures of one table: a byte names them.
pub const MAX_TEXTURES: usize = 256;
/// The largest number of the seven bits that hold a protection or a share.
pub const SEVEN_BITS: u32 = 127;
/// The largest gain that a seed holds.
pub const MAX_GAIN: f32 = 2.0;
/// Texels after which a mirrored texture repeats.
pub const PERIOD: f32 = 2.0 * FINE_SIDE as f32;
/// Share of the fine gain that protection takes. The rest is left even to the best protected Gaussians, so that
/// it is not bare.
pub const PROTECTED: f32 = 0.95;

/// The strokes of one Gaussian, in 32 bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrokeWord {
    /// Index of its seed.
    pub seed: u32,
    /// How much it stands out, 0..1: such things keep their own detail.
    pub protection: f32,
    /// Share of its strokes that are shown, 0..1. 0 if it has none.
    pub share: f32,
}

impl StrokeWord {
    /// A Gaussian without strokes.
    pub const NONE: Self = Self { seed: 0, protection: 0.0, share: 0.0 };

    /// The 32 bits: seed, protection, share, from the lowest.
    pub fn packed(self) -> u32 {
        let seven = |x: f32| (x.clamp(0.0, 1.0) * SEVEN_BITS as f32 + 0.5) as u32;
        (self.seed & (MAX_SEEDS as u32 - 1))
            | seven(self.protection) << SEED_BITS
            | seven(self.share) << (SEED_BITS + 7)
    }

    /// The inverse of [`packed`](Self::packed).
    pub fn unpacked(word: u32) -> Self {
        let seven = |shift: u32| (word >> shift & SEVEN_BITS) as f32 / SEVEN_BITS as f32;
        Self {
            seed: word & (MAX_SEEDS as u32 - 1),
            protection: seven(SEED_BITS),
            share: seven(SEED_BITS + 7),
        }
    }

    /// The protection if the Gaussian stands out `factor` times as much. A protection p stands for q = sqrt(p /
    /// (1 - p)), by which factor it stands out more than usual.
    pub fn protection_by(self, factor: f32) -> f32 {
        let squared = factor * factor * self.protection;
        squared / (1.0 - self.protection + squared).max(1e-6)
    }
}

/// A seed as the kernel reads it, 32 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct StrokeSeed {
    /// Its position, in scene units.
    pub at: [f32; 3],
    /// Texels in the painting's x direction to a scene unit.
    pub pitch: f32,
    /// The turn from the painting's axes (x right, y down) to the scene's: a unit quaternion x, y, z, w without
    /// its largest number, which is positive. The first two others, as signed fractions of 16 bits of 1 /
    /// sqrt(2).
    pub rotation_xy: u32,
    /// The third likewise, and above it, as f16, texels in y to one in x.
    pub rotation_z_aspect: u32,
    /// Its place in the painting, x and y: fractions of 16 bits of [`PERIOD`].
    pub place: u32,
    /// Fine gain and wide gain (bytes, of [`MAX_GAIN`]), number of the texture (a byte), which number of the
    /// quaternion is left out (two bits, 0 for x, 3 for w), and the direction of strokes in the painting (six
    /// bits, of half a circle): see [`direction`](Self::direction).
    pub look: u32,
}

/// A seed in plain numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlainSeed {
    /// Its position, in scene units.
    pub at: Vec3,
    /// The painting's x axis on the scene, a unit vector.
    pub right: Vec3,
    /// The painting's y axis on the scene, a unit vector perpendicular to `right`.
    pub down: Vec3,
    /// Texels to a scene unit, in x and in y.
    pub pitch: Vec2,
    /// Its place in the painting, in texels.
    pub place: Vec2,
    /// Factor of fine detail, 0 to [`MAX_GAIN`].
    pub fine: f32,
    /// Factor of wide detail, likewise.
    pub wide: f32,
    /// Number of its texture.
    pub texture: u8,
}

/// A fraction of 16 bits, wrapped.
pub(super) fn wrapped(x: f32) -> u32 {
    // 65,536 is 0 again.
    (((x - x.floor()) * 65536.0) as u32) & 0xffff
}

impl PlainSeed {
    /// The level of detail of a Gaussian with the deviation `side`, in scene units: its texels are two
    /// deviations wide.
    pub fn level_of(&self, side: f32) -> f32 {
        (2.0 * side * (self.pitch.x * self.pitch.y).sqrt()).max(1.0).log2()
    }

    /// Gains of fine and of wide detail in a Gaussian with the strokes `word`.
    pub fn gains(&self, word: &StrokeWord) -> [f32; 2] {
        let fine = self.fine * (1.0 - PROTECTED * word.protection);
        [word.share * fine, word.share * self.wide * (1.0 - word.protection)]
    }

    /// The seed as the kernel reads it.
    pub fn packed(&self) -> StrokeSeed {
        let axes = glam::Mat3::from_cols(self.right, self.down, self.right.cross(self.down));
        let q = Quat::from_mat3(&axes).to_array();
        let largest = (1..4).fold(0, |a, b| if q[b].abs() > q[a].abs() { b } else { a });
        let sign = if q[largest] < 0.0 { -SQRT_2 } else { SQRT_2 };
        // The four numbers after the largest in a circle are it and the others.
        let [x, y, z] = std::array::from_fn(|i| sign * q[(largest + 1 + i) % 4]);
        let snorm = |x: f32| u32::from(((x.clamp(-1.0, 1.0) * 32767.0).round() as i16).cast_unsigned());
        let gain = |x: f32| (x.clamp(0.0, MAX_GAIN) / MAX_GAIN * 255.0).round() as u32;
        let place = self.place / PERIOD;
        StrokeSeed {
            at: self.at.to_array(),
            pitch: self.pitch.x,
            rotation_xy: snorm(x) | snorm(y) << 16,
            rotation_z_aspect: snorm(z)
                | u32::from(f16::from_f32(self.pitch.y / self.pitch.x).to_bits()) << 16,
            place: wrapped(place.x) | wrapped(place.y) << 16,
            look: gain(self.fine)
                | gain(self.wide) << 8
                | u32::from(self.texture) << 16
                | (largest as u32) << 24,
        }
    }
}

impl StrokeSeed {
    /// The seed in plain numbers.
    pub fn plain(&self) -> PlainSeed {
        let snorm = |bits: u32| f32::from((bits as u16).cast_signed()) / (32767.0 * SQRT_2);
        let others = [self.rotation_xy, self.rotation_xy >> 16, self.rotation_z_aspect].map(snorm);
        let largest = (self.look >> 24 & 3) as usize;
        let mut q = [0.0; 4];
        q[largest] = (1.0 - others.iter().map(|x| x * x).sum::<f32>()).max(0.0).sqrt();
        for (i, other) in others.into_iter().enumerate() {
            q[(largest + 1 + i) % 4] = other;
        }
        let rotation = Quat::from_array(q).normalize();
        let aspect = f16::from_bits((self.rotation_z_aspect >> 16) as u16).to_f32();
        let fraction = |bits: u32| (bits & 0xffff) as f32 / 65536.0;
        let gain = |bits: u32| (bits & 0xff) as f32 / 255.0 * MAX_GAIN;
        PlainSeed {
            at: self.at.into(),
            right: rotation * Vec3::X,
            down: rotation * Vec3::Y,
            pitch: Vec2::new(self.pitch, self.pitch * aspect),
            place: PERIOD * Vec2::new(fraction(self.place), fraction(self.place >> 16)),
            fine: gain(self.look),
            wide: gain(self.look >> 8),
            texture: (self.look >> 16) as u8,
        }
    }

    /// The same seed with another number of its texture.
    pub fn with_texture(self, texture: u8) -> Self {
        Self { look: self.look & 0xff00_ffff | u32::from(texture) << 16, ..self }
    }
}
