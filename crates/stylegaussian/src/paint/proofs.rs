//! Proofs: small test renders of the scene from usual distances, by which paint is measured before it is shown.

use std::ops::Range;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{
    bands::{Mask, dot},
    sight::FAINT,
};
use crate::{
    camera::Camera,
    palette::LUMINANCE,
    scene::Scene,
    splat::{BlendWeights, blend_weights_if_wanted, stroke_record},
    strokes::{StrokeKnobs, StrokeRecord, StrokeSeed, StrokeTexture, StrokeWord},
    work::{Canceled, Work},
};

/// Least alpha of pixels that count, because the background shines through the others.
const COVERED: f32 = 0.9;

/// Least blend weight that is kept. Most weights of a pixel are smaller, and sum to little.
const LEAST_WEIGHT: f32 = 0.004;

/// Least blend weight at which strokes are looked up, as in drawing.
const LEAST_STROKE: f32 = 0.02;

/// Bands of a proof that are measured. A proof's pixel is two of the painting's.
const N: usize = 4;

/// Bands of fine detail, and those of wide detail.
const KINDS: [Range<usize>; 2] = [0..2, 2..4];

/// Pictures of the scene that can be drawn in any colors at once.
pub(super) struct Proofs(Vec<Proof>);

struct Proof {
    camera: Camera,
    /// Blend weights of the pixels that count, summing to 1 in each: one row for each.
    weights: BlendWeights,
    /// The center of each of these pixels.
    pixels: Vec<Vec2>,
    mask: Mask,
}

/// Bands of luminance in all proofs, one list of four for each proof.
pub(super) struct Bands(Vec<[Vec<f32>; N]>);

/// Fine and wide detail in all proofs.
pub(super) struct DetailBands {
    pub fine: Bands,
    pub wide: Bands,
}

impl Proofs {
    /// Pictures of `scene` from `cameras`. Those that show nothing are left out.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn new(scene: &Scene, cameras: &[Camera], work: &Work) -> Result<Self, Canceled> {
        let mut proofs = Vec::new();
        for (i, camera) in cameras.iter().enumerate() {
            work.at(i as f32 / cameras.len() as f32)?;
            proofs.push(Proof::new(camera, &blend_weights_if_wanted(scene, camera, FAINT, work)?));
        }
        proofs.retain(|proof| proof.mask.n_covered() > 0);
        Ok(Self(proofs))
    }

    /// Calls the i-th Gaussian by the i-th of `names` `[N]`.
    pub fn renumber(&mut self, names: &[u32]) {
        for i in self.0.iter_mut().flat_map(|proof| &mut proof.weights.indices) {
            *i = names[*i as usize];
        }
    }

    /// The pixels of all proofs if Gaussians have these `colors` `[N]`.
    pub fn pixels(&self, colors: &[Vec3]) -> Vec<Vec3> {
        let flat: Vec<f32> = colors.iter().flat_map(|color| color.to_array()).collect();
        let drawn = self.0.iter().map(|proof| proof.weights.apply(&flat, 3));
        drawn.flat_map(|pixels| pixels.chunks_exact(3).map(Vec3::from_slice).collect::<Vec<_>>()).collect()
    }

    /// Bands of the luminance of Gaussians `[N]`.
    pub fn bands(&self, luminance: &[f32]) -> Bands {
        let bands = |proof: &Proof| proof.mask.bands(&proof.weights.apply(luminance, 1));
        Bands(self.0.par_iter().map(bands).collect())
    }

    /// Bands of the detail of `textures`, laid on by `seeds`, at these fine and wide gains `[N]`.
    pub fn detail(
        &self,
        scene: &Scene,
        seeds: &[StrokeSeed],
        owners: &[u32],
        gains: [&[f32]; 2],
        textures: &[LuminanceTexture],
    ) -> DetailBands {
        let of = |proof: &Proof| {
            let (fine, wide): (Vec<f32>, Vec<f32>) = proof.detail(scene, seeds, owners, gains, textures);
            rayon::join(|| proof.mask.bands(&fine), || proof.mask.bands(&wide))
        };
        let (fine, wide) = self.0.iter().map(of).unzip();
        DetailBands { fine: Bands(fine), wide: Bands(wide) }
    }
}

impl Bands {
    /// Scalar products with other bands per pixel: of fine bands, and of wide ones.
    pub fn products(&self, other: &Self) -> [f64; 2] {
        let n: usize = self.0.iter().map(|bands| bands[0].len()).sum();
        KINDS.map(|kind| {
            let both = self.0.iter().zip(&other.0);
            let sum = |(a, b): (&[Vec<f32>; N], &[Vec<f32>; N])| -> f64 {
                kind.clone().map(|band| dot(&a[band], &b[band])).sum()
            };
            both.map(sum).sum::<f64>() / n.max(1) as f64
        })
    }
}

impl Proof {
    fn new(camera: &Camera, weights: &BlendWeights) -> Self {
        let width = weights.size.x as usize;
        let (counts, kept) = solid(weights);
        let center = |i: usize| Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
        let pixels = (0..counts.len()).filter(|&i| counts[i]).map(center).collect();
        let mask = Mask::new(&counts, [width, weights.size.y as usize]);
        Self { camera: camera.clone(), mask, pixels, weights: kept }
    }

    /// Luminance of fine and of wide detail in each pixel.
    fn detail(
        &self,
        scene: &Scene,
        seeds: &[StrokeSeed],
        owners: &[u32],
        [fine, wide]: [&[f32]; 2],
        textures: &[LuminanceTexture],
    ) -> (Vec<f32>, Vec<f32>) {
        let mut is_seen = vec![false; scene.len()];
        for (i, weight) in self.weights.indices.iter().zip(&self.weights.weights) {
            is_seen[*i as usize] |= *weight >= LEAST_STROKE;
        }
        let knobs = StrokeKnobs::default();
        let record = |i: usize| {
            let word = StrokeWord { seed: owners[i], protection: 0.0, share: 1.0 }.packed();
            is_seen[i].then(|| stroke_record(scene, i, word, seeds, &self.camera, &knobs)).flatten()
        };
        let records: Vec<Option<(StrokeRecord, Vec2)>> =
            (0..scene.len()).into_par_iter().map(record).collect();
        let of_pixel = |(pixel, at): (usize, &Vec2)| {
            let entries = self.weights.pixel(pixel).filter(|(_, weight)| *weight >= LEAST_STROKE);
            entries.fold((0.0, 0.0), |sum, (i, weight)| {
                let Some((record, center)) = &records[i] else { return sum };
                let at = record.at(*at - *center);
                let texture = &textures[usize::from(record.texture)];
                let of = |gain: f32, value: &dyn Fn() -> f32| if gain > 0.0 { gain * value() } else { 0.0 };
                (
                    sum.0 + weight * of(fine[i], &|| texture.fine.at(at, record.level)),
                    sum.1 + weight * of(wide[i], &|| texture.wide.at(at, record.level - 2.0)),
                )
            })
        };
        self.pixels.par_iter().enumerate().map(of_pixel).unzip()
    }
}

/// Luminance of a texture, to be read fast.
pub(super) struct LuminanceTexture {
    fine: Levels,
    wide: Levels,
}

/// A texture and its mipmaps.
struct Levels(Vec<Vec<f32>>);

impl LuminanceTexture {
    pub fn new(texture: &StrokeTexture) -> Self {
        let value = |texel: &[i8; 4]| {
            let [r, g, b, _] = texel.map(f32::from);
            Vec3::new(r, g, b).dot(LUMINANCE) / 127.0
        };
        let levels = |levels: &[Vec<[i8; 4]>]| {
            Levels(levels.iter().map(|level| level.iter().map(value).collect()).collect())
        };
        Self { fine: levels(&texture.fine), wide: levels(&texture.wide) }
    }
}

impl Levels {
    /// The value at `at`, where the texture is the unit square, at the nearest level of detail: interpolated,
    /// and mirrored beyond the edges.
    fn at(&self, at: Vec2, level: f32) -> f32 {
        let level = (level.max(0.0) + 0.5) as usize;
        let level = level.min(self.0.len() - 1);
        let (texels, side) = (&self.0[level], 1_usize << (self.0.len() - 1 - level));
        let at = at * side as f32 - 0.5;
        // The cast rounds toward 0; places in the painting are positive, and steps from them small.
        let corner = at.floor();
        let part = at - corner;
        let fold = |i: i32| {
            let within = i.cast_unsigned() as usize & (2 * side - 1);
            if within < side { within } else { 2 * side - 1 - within }
        };
        let (x, y) = (corner.x as i32, corner.y as i32);
        let (left, right) = (fold(x), fold(x + 1));
        let (top, bottom) = (fold(y) * side, fold(y + 1) * side);
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let upper = mix(texels[top + left], texels[top + right], part.x);
        mix(upper, mix(texels[bottom + left], texels[bottom + right], part.x), part.y)
    }
}

/// Which pixels of a view count `[H * W]`, and the blend weights of those that do: one row for each, summing to
/// 1.
fn solid(weights: &BlendWeights) -> (Vec<bool>, BlendWeights) {
    let row = |pixel: usize| weights.starts[pixel] as usize..weights.starts[pixel + 1] as usize;
    let n_pixels = weights.starts.len() - 1;
    let is_covered = |pixel: usize| weights.weights[row(pixel)].iter().sum::<f32>() > COVERED;
    let counts: Vec<bool> = (0..n_pixels).map(is_covered).collect();
    let mut kept = BlendWeights { starts: vec![0], indices: Vec::new(), weights: Vec::new(), ..*weights };
    for pixel in (0..n_pixels).filter(|&pixel| counts[pixel]) {
        let entries = || row(pixel).map(|i| (weights.indices[i], weights.weights[i]));
        let most = entries().map(|(_, weight)| weight).fold(0.0, f32::max);
        // Of many thin Gaussians none may have the least weight: half of the largest weight is kept in any
        // case.
        let kept_here = || entries().filter(|(_, weight)| *weight >= LEAST_WEIGHT.min(0.5 * most));
        let total: f32 = kept_here().map(|(_, weight)| weight).sum();
        kept.indices.extend(kept_here().map(|(gaussian, _)| gaussian));
        kept.weights.extend(kept_here().map(|(_, weight)| weight / total));
        kept.starts.push(kept.indices.len() as u32);
    }
    (counts, kept)
}
