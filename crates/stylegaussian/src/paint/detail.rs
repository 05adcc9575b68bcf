//! A painting's detail, of which its strokes consist.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{
    bands::Mask,
    picture::{Copies, Picture},
    used::Used,
};
use crate::{
    palette::LUMINANCE,
    strokes::{FINE_SIDE, StrokeTexture, WIDE_SIDE},
    work::{Canceled, Work},
};

/// Factor of the finest band, which overlapping Gaussians blur most. Above this, canvas weave and JPEG grain
/// become beads.
pub const FINEST: f32 = 1.3;

/// Share of a painting's large shapes in wide detail.
pub const LOCAL: f32 = 0.3;

/// Standard deviation over which local energy is measured, in pixels.
pub(super) const AROUND: f32 = 10.0;

/// Exponent that weakens strong places of a painting and strengthens faint ones. At twice as much, ink and
/// watercolor lose their paint.
pub const WHITEN: f32 = 0.3;

/// Range of the resulting factors.
pub const WHITENED: (f32, f32) = (0.35, 1.5);

/// Added to local energy, as a share of the mean, so that flat places are not amplified.
pub const FLOOR: f32 = 0.06;

/// Least mean energy, at which a painting is flat.
pub const LEAST_TYPICAL: f32 = 1e-6;

/// Stride over the pixels of the painting without its detail, from which its moments are taken.
const STRIDE: usize = 3;

/// Detail of a painting at the scale at which it is read.
pub(super) struct Detail {
    /// Colors of the painting without its detail, from some of its pixels: the aim for the scene's own colors.
    pub low: Vec<Vec3>,
    /// Luminance energy of detail around each pixel of a picture of a quarter of the size.
    around: Picture,
    /// Mean of it.
    pub typical: f32,
    /// Luminance energy per pixel of the bands of fine detail, and of those of wide detail.
    pub energies: [f64; 2],
}

impl Detail {
    /// Detail of a painting's `copies`. Only `used` pixels count.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn new(copies: &Copies, used: Option<&Used>, work: &Work) -> Result<Self, Canceled> {
        work.check()?;
        let picture = copies.picture();
        let (w, h) = (picture.width, picture.height);
        let at = |i: usize| Vec2::new((i % w) as f32 + 0.5, (i / w) as f32 + 0.5);
        // Fine bands, and those above.
        let parts: Vec<[Vec3; 2]> = (0..w * h)
            .into_par_iter()
            .map(|i| {
                let [third, last] = [3, 5].map(|copy| copies.sample(copy, at(i)));
                let [first, second] = [0, 1].map(|copy| copies.copy(copy).values[i]);
                [FINEST * (first - second) + second - third, third - last]
            })
            .collect();
        work.at(0.4)?;
        let square = |[fine, wide]: &[Vec3; 2]| Vec3::splat((*fine + *wide).dot(LUMINANCE).powi(2));
        let squares = Picture { width: w, height: h, values: parts.par_iter().map(square).collect() };
        let around = squares.halved().halved().blurred(AROUND / 4.0);
        let mean = match used.map(|used| used.of(&squares.values).map(|v| v.x).collect::<Vec<_>>()) {
            Some(squares) => squares.iter().sum::<f32>() / squares.len() as f32,
            None => around.values.iter().map(|v| v.x).sum::<f32>() / around.values.len() as f32,
        };
        let typical = mean.max(LEAST_TYPICAL);
        let counted: Vec<u32> = (0..(w * h) as u32)
            .filter(|i| used.is_none_or(|used| used.pixels[*i as usize]))
            .step_by(STRIDE)
            .collect();
        let low = counted.par_iter().map(|&i| i as usize);
        let low =
            low.map(|i| picture.values[i] - (parts[i][0] + parts[i][1]) * whiten(&around, typical, at(i)));
        let low = low.collect();
        work.at(0.7)?;
        let bands: [Vec<f32>; 4] = {
            let half = picture.halved();
            let (size, luminance) = ([half.width, half.height], half.luminance());
            match used.map(|used| used.resized(half.width, half.height)) {
                Some(used) if used.pixels.contains(&true) => {
                    Mask::new(&used.pixels, size).bands(&used.of(&luminance).collect::<Vec<_>>())
                }
                _ => Mask::whole(size).bands(&luminance),
            }
        };
        let energy = |bands: &[Vec<f32>]| {
            let n = bands[0].len().max(1) as f64;
            bands.iter().map(|band| super::bands::dot(band, band)).sum::<f64>() / n
        };
        Ok(Self { low, energies: [energy(&bands[..2]), energy(&bands[2..])], around, typical })
    }

    /// Luminance energy around a position in pixels.
    pub fn energy_at(&self, at: Vec2) -> f32 {
        self.around.sample(0.25 * at).x
    }

    /// Fine and wide detail of the painting's `copies`, as they are drawn. `original` is the same painting at
    /// any size: fine detail comes from it, since it has more than the scale at which the painting is read.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn texture(
        &self,
        copies: &Copies,
        original: &Picture,
        work: &Work,
    ) -> Result<Arc<StrokeTexture>, Canceled> {
        let whiten = |at: Vec2| whiten(&self.around, self.typical, at);
        let size = copies.picture().size();
        let mean = original.values.iter().sum::<Vec3>() / original.values.len().max(1) as f32;
        let texels = |side: usize, value: &(dyn Fn(Vec2) -> Vec3 + Sync)| -> Result<Vec<Vec3>, Canceled> {
            let at = |i: usize| Vec2::new((i % side) as f32 + 0.5, (i / side) as f32 + 0.5) / side as f32;
            let mut texels = vec![Vec3::ZERO; side * side];
            let rows = texels.par_chunks_mut(side).enumerate();
            rows.try_for_each(|(y, row)| {
                work.check()?;
                row.iter_mut().enumerate().for_each(|(x, texel)| *texel = value(at(y * side + x)));
                Ok::<(), Canceled>(())
            })?;
            Ok(texels)
        };
        let fine = |at: Vec2| {
            let sharp = original.sample(at * original.size());
            let at = at * size;
            let finest = copies.sample(0, at) - copies.sample(1, at);
            (sharp + (FINEST - 1.0) * finest - copies.sample(3, at)) * whiten(at)
        };
        let wide = |at: Vec2| {
            let at = at * size;
            let large = copies.sample(5, at);
            (copies.sample(3, at) - large) * whiten(at) + LOCAL * (large - mean)
        };
        let fine = texels(FINE_SIDE, &fine)?;
        work.at(0.9)?;
        let wide = texels(WIDE_SIDE, &wide)?;
        work.check()?;
        Ok(Arc::new(StrokeTexture::new(fine, wide)))
    }
}

/// The factor at a position in pixels that evens out strong and faint places. `around` holds energies, and
/// `typical` is their mean.
fn whiten(around: &Picture, typical: f32, at: Vec2) -> f32 {
    let energy = around.sample(0.25 * at).x;
    (typical / (energy + FLOOR * typical)).powf(0.5 * WHITEN).clamp(WHITENED.0, WHITENED.1)
}
