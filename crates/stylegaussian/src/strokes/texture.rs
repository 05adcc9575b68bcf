//! A painting's detail in two textures, and their filter.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Texels along a side of fine detail, which is smaller than a stroke.
pub const FINE_SIDE: usize = 512;

/// Texels along a side of wide detail, which has nothing smaller than four texels of fine detail.
pub const WIDE_SIDE: usize = 128;

/// Levels between the two: a texel of wide detail is as large as four.
pub const WIDE_LEVEL: f32 = (FINE_SIDE / WIDE_SIDE).ilog2() as f32;

/// Detail of a painting, as differences of display-referred RGB, -1..1, and its mipmaps down to one texel. Both
/// textures show the whole painting, stretched to a square, and repeat mirrored.
///
/// Values are signed bytes of 127ths, four to a texel; the fourth is 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StrokeTexture {
    /// Fine detail: levels of 512, 256, ... 1 texels along a side.
    pub fine: Vec<Vec<[i8; 4]>>,
    /// Wide detail: levels of 128, 64, ... 1 texels along a side.
    pub wide: Vec<Vec<[i8; 4]>>,
}

impl StrokeTexture {
    /// The textures of fine detail `[512 * 512]` and wide detail `[128 * 128]`, row by row.
    ///
    /// # Panics
    /// If either has another number of texels.
    pub fn new(fine: Vec<Vec3>, wide: Vec<Vec3>) -> Self {
        Self { fine: levels(fine, FINE_SIDE), wide: levels(wide, WIDE_SIDE) }
    }

    /// The same texture with each texel changed.
    #[must_use]
    pub fn mapped(&self, map: impl Fn(Vec3) -> Vec3 + Sync) -> Self {
        let value = |[r, g, b, _]: &[i8; 4]| Vec3::new(f32::from(*r), f32::from(*g), f32::from(*b)) / 127.0;
        let level = |texels: &Vec<[i8; 4]>| {
            quantized(&texels.par_iter().map(|texel| map(value(texel))).collect::<Vec<_>>())
        };
        Self { fine: self.fine.iter().map(level).collect(), wide: self.wide.iter().map(level).collect() }
    }

    /// Fine detail at `at`, where the texture is the unit square, at a level of detail of at least 0.
    pub fn fine(&self, at: Vec2, level: f32) -> Vec3 {
        filtered(&self.fine, FINE_SIDE, at, level)
    }

    /// Wide detail likewise, at a level of fine detail.
    pub fn wide(&self, at: Vec2, level: f32) -> Vec3 {
        filtered(&self.wide, WIDE_SIDE, at, level - WIDE_LEVEL)
    }
}

/// A texture and its mipmaps.
fn levels(texels: Vec<Vec3>, side: usize) -> Vec<Vec<[i8; 4]>> {
    assert_eq!(texels.len(), side * side, "a square of {side} x {side} texels");
    let mut levels = vec![quantized(&texels)];
    let (mut texels, mut side) = (texels, side);
    while side > 1 {
        let half = side / 2;
        let mean = |i: usize| {
            let first = 2 * (i / half) * side + 2 * (i % half);
            0.25 * (texels[first] + texels[first + 1] + texels[first + side] + texels[first + side + 1])
        };
        texels = (0..half * half).into_par_iter().map(mean).collect();
        side = half;
        levels.push(quantized(&texels));
    }
    levels
}

fn quantized(texels: &[Vec3]) -> Vec<[i8; 4]> {
    // The cast saturates.
    let byte = |x: f32| (x.clamp(-1.0, 1.0) * 127.0).round() as i8;
    texels.iter().map(|t| [byte(t.x), byte(t.y), byte(t.z), 0]).collect()
}

/// Trilinear interpolation, mirrored beyond the edges: the filter of the GPU.
fn filtered(levels: &[Vec<[i8; 4]>], side: usize, at: Vec2, level: f32) -> Vec3 {
    let level = level.clamp(0.0, (levels.len() - 1) as f32);
    let (first, between) = (level as usize, level.fract());
    let sharp = bilinear(&levels[first], side >> first, at);
    if between > 0.0 {
        sharp.lerp(bilinear(&levels[first + 1], side >> (first + 1), at), between)
    } else {
        sharp
    }
}

fn bilinear(texels: &[[i8; 4]], side: usize, at: Vec2) -> Vec3 {
    let at = at * side as f32 - 0.5;
    let (corner, part) = (at.floor(), at - at.floor());
    let (x, y) = (corner.x as i32, corner.y as i32);
    let texel = |dx: i32, dy: i32| {
        let [r, g, b, _] =
            texels[mirrored(y.wrapping_add(dy), side) * side + mirrored(x.wrapping_add(dx), side)];
        Vec3::new(f32::from(r), f32::from(g), f32::from(b))
    };
    let upper = texel(0, 0).lerp(texel(1, 0), part.x);
    upper.lerp(texel(0, 1).lerp(texel(1, 1), part.x), part.y) / 127.0
}

/// An index folded into 0..side. `side` is a power of two.
fn mirrored(i: i32, side: usize) -> usize {
    let within = i.cast_unsigned() as usize & (2 * side - 1);
    if within < side { within } else { 2 * side - 1 - within }
}
