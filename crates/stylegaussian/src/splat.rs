//! EWA splatting on the CPU: pictures of a scene, and the weights with which its Gaussians blend.
//!
//! A Gaussian with covariance S is drawn as its 2D footprint, a *splat*: the first-order projection J W S W^T
//! J^T (Zwicker et al., "EWA Volume Splatting", 2001) plus 0.3 px^2 on the diagonal. Splats blend front to
//! back: color = sum_i w_i c_i with w_i = alpha_i prod_{j < i} (1 - alpha_j).
//!
//! The rules are those of the 3D Gaussian Splatting rasterizer (Kerbl et al. 2023) with one exception. Here a
//! footprint covers every pixel in which alpha reaches 1/255. The original stops at three standard deviations,
//! at which an opaque splat still has alpha 0.011.
//!
//! Scenes that were trained with the 2D filter of mip-splatting say so
//! ([`ScreenFilter`](crate::scene::ScreenFilter)). The opacities of their splats make up for the area that the
//! 0.3 px^2 add.
//!
//! The stages, one module each: `project` (cull, project, sort by depth), `bands` (list the splats of each
//! tile), `composite` (blend one tile), `weights` (keep the blend weights in place of a picture). `iso` finds
//! how far away the surface is, `cast` what casts shadows, and `half` draws at half the width and height.
//! `alpha` holds the limits that they share, and `bounds` the box around all that is drawn.

mod alpha;
mod bands;
mod bounds;
mod cast;
mod composite;
mod half;
mod iso;
mod project;
mod weights;

#[cfg(test)]
mod tests;

use glam::{UVec2, Vec2, Vec3};
use rayon::prelude::*;

pub use self::half::{half_depths, half_size, render_half, upsampled};
use crate::{
    camera::Camera,
    mask::Visibility,
    scene::Scene,
    sh,
    strokes::{LEAST_ALPHA, StrokeKnobs, StrokeRecord, StrokeRelief, StrokeSeed, StrokeWord, Strokes},
    work::{Canceled, Work},
};
pub use alpha::{MAX_ALPHA, MIN_ALPHA};
use bands::Bands;
pub use cast::{CAST_THRESHOLD, cast, cast_threshold};
use composite::{GROUP, GROUPS, TILE};
pub use iso::{ISO_THRESHOLD, iso_depth, iso_threshold};
pub(crate) use project::Projection;
use project::{Splat, project, project_with};
pub use weights::BlendWeights;

/// The colors that a scene is drawn with.
#[derive(Clone, Copy, Debug)]
pub enum Colors<'a> {
    /// The scene's captured colors: its spherical harmonics seen from the camera, clamped at 0 from below. A
    /// scene without any is mid-gray.
    Captured,
    /// One RGB per Gaussian `[N]`, such as a stylized scene's. Not clamped.
    Rgb(&'a [[f32; 3]]),
    /// One color per Gaussian `[N]` as [`mix_layers`](crate::layers::mix_layers) gives them: RGB multiplied by
    /// the fourth number, of which the rest to 1 is the share of the captured color.
    Mixed(&'a [[f32; 4]]),
}

impl Colors<'_> {
    /// The number of colors, or `None` if they are the scene's own.
    fn len(&self) -> Option<usize> {
        match self {
            Self::Captured => None,
            Self::Rgb(rgb) => Some(rgb.len()),
            Self::Mixed(mixed) => Some(mixed.len()),
        }
    }
}

/// A rendered picture. All planes are row-major `[H, W]`, from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderedImage {
    /// Width and height, in pixels.
    pub size: UVec2,
    /// Premultiplied, display-referred RGB `[H, W]`.
    pub color: Vec<[f32; 3]>,
    /// Coverage `[H, W]`, 0..1: the sum of the blend weights.
    pub alpha: Vec<f32>,
    /// View-space z times the blend weights, summed `[H, W]`, in scene units. Divide by `alpha` for the mean
    /// depth.
    pub depth: Vec<f32>,
}

/// Draws `scene` as `camera` sees it.
///
/// # Panics
/// If `colors` holds another number of colors than the scene has Gaussians.
pub fn render(scene: &Scene, colors: Colors, camera: &Camera) -> RenderedImage {
    render_visible(scene, colors, camera, None)
}

/// Draws the part of `scene` that a mask lets through, or all of it, as `camera` sees it.
///
/// # Panics
/// If `colors` or the mask holds another number of entries than the scene has Gaussians.
pub fn render_visible(
    scene: &Scene,
    colors: Colors,
    camera: &Camera,
    visibility: Option<&Visibility>,
) -> RenderedImage {
    draw(scene, colors, None, (camera, false), visibility)
}

/// Draws `scene` with `strokes` over its colors.
///
/// # Panics
/// If `colors`, the strokes' words or the mask hold another number of entries than the scene has Gaussians, or
/// if a word names a seed, or a seed a texture, that is not there.
pub fn render_strokes(
    scene: &Scene,
    colors: Colors,
    strokes: (&Strokes, &StrokeKnobs),
    camera: &Camera,
    visibility: Option<&Visibility>,
) -> RenderedImage {
    draw(scene, colors, Some(strokes), (camera, false), visibility)
}

/// Draws with a camera, whose picture may be one of [`half`] the size.
fn draw(
    scene: &Scene,
    colors: Colors,
    strokes: Option<(&Strokes, &StrokeKnobs)>,
    (camera, is_half): (&Camera, bool),
    visibility: Option<&Visibility>,
) -> RenderedImage {
    assert!(colors.len().is_none_or(|n| n == scene.len()), "one color per Gaussian");
    assert!(visibility.is_none_or(|mask| mask.weights.len() == scene.len()), "one weight per Gaussian");
    let splats = project_with(&Projection::new(camera).of_half(is_half), scene, visibility);
    let colors = splat_colors(scene, colors, camera, &splats);
    let records = strokes.map(|(strokes, knobs)| stroke_records(scene, strokes, knobs, camera, &splats));
    let reliefs = strokes.map(|(strokes, knobs)| reliefs(scene, strokes, knobs, camera, &splats));
    let bands = Bands::new(&splats, camera.size);

    let size = camera.size.as_usizevec2();
    let n_pixels = size.x * size.y;
    let mut view = RenderedImage {
        size: camera.size,
        color: vec![[0.0; 3]; n_pixels],
        alpha: vec![0.0; n_pixels],
        depth: vec![0.0; n_pixels],
    };
    // Bands are contiguous in each plane, so threads write to slices of their own. A picture of width 0 still
    // needs chunks of some length.
    let pixels_per_band = (camera.size.x as usize * TILE).max(1);
    view.color
        .par_chunks_mut(pixels_per_band)
        .zip(view.alpha.par_chunks_mut(pixels_per_band))
        .zip(view.depth.par_chunks_mut(pixels_per_band))
        .enumerate()
        .for_each(|(band, ((color, alpha), depth))| {
            for (tile, in_tile) in bands.tiles(band, &splats) {
                let mut sums = [[[0.0; GROUP]; GROUPS]; 5];
                tile.composite(&splats, &in_tile, 0.0, |group, splat, weights, alphas| {
                    let [r, g, b] = colors[splat];
                    if let Some(record) = records.as_ref().and_then(|records| records[splat].as_ref())
                        && let Some((strokes, knobs)) = strokes
                    {
                        let texture = &strokes.textures[usize::from(record.texture)];
                        let first = tile.first_pixel(group) - splats[splat].center;
                        let relief = reliefs.as_ref().and_then(|reliefs| reliefs.get(splat)?.as_ref());
                        for (i, (&weight, &alpha)) in weights.iter().zip(alphas).enumerate() {
                            if weight > 0.0 && alpha >= LEAST_ALPHA {
                                let offset = first + Vec2::new(i as f32, 0.0);
                                let mut detail = record.detail(texture, offset, knobs);
                                if let Some(relief) = relief {
                                    detail +=
                                        record.lit(texture, offset, (relief, knobs), Vec3::new(r, g, b));
                                }
                                for (sums, value) in sums.iter_mut().zip(detail.to_array()) {
                                    sums[group][i] += weight * value;
                                }
                            }
                        }
                    }
                    for (sums, value) in sums.iter_mut().zip([r, g, b, 1.0, splats[splat].depth]) {
                        sums[group].iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight * value);
                    }
                });
                let [r, g, b, a, z] = sums.each_ref().map(|groups| groups.as_flattened());
                for row in 0..tile.height {
                    for column in 0..tile.width {
                        let (i, pixel) = (row * TILE + column, row * size.x + tile.x + column);
                        color[pixel] = [r[i], g[i], b[i]];
                        alpha[pixel] = a[i];
                        depth[pixel] = z[i];
                    }
                }
            }
        });
    view
}

/// The weight of every Gaussian in every pixel of `camera`, by which [`render`] multiplies colors.
///
/// The weights do not depend on colors, so one set of them serves any number of per-Gaussian values (colors,
/// features) and their gradients.
pub fn blend_weights(scene: &Scene, camera: &Camera) -> BlendWeights {
    blend_weights_from(scene, camera, 0.0)
}

/// The [`blend_weights`] of `least` or more. At 0.001 two fifths are left out on the demo scene and on a
/// capture of a bonsai, and half a hundredth of the coverage or less.
pub fn blend_weights_from(scene: &Scene, camera: &Camera, least: f32) -> BlendWeights {
    match blend_weights_if_wanted(scene, camera, least, &Work::default()) {
        Ok(weights) => weights,
        Err(Canceled) => unreachable!("nobody cancels it"),
    }
}

/// As [`blend_weights_from`].
///
/// # Errors
/// If `work` is canceled.
pub(crate) fn blend_weights_if_wanted(
    scene: &Scene,
    camera: &Camera,
    least: f32,
    work: &Work,
) -> Result<BlendWeights, Canceled> {
    work.check()?;
    let splats = project(scene, camera, None);
    work.check()?;
    let bands = Bands::new(&splats, camera.size);
    work.check()?;
    Ok(BlendWeights::gather(&splats, &bands, least, scene.len()))
}

/// The strokes of Gaussian `i`, which must be before the camera, and its center on screen in pixels. `None` if
/// it shows none.
///
/// A pixel's detail is [`StrokeRecord::detail`] at its offset from that center, times the Gaussian's blend
/// weight there.
///
/// # Panics
/// If `word` names a seed that is not there, or there is no Gaussian `i`.
pub fn stroke_record(
    scene: &Scene,
    i: usize,
    word: u32,
    seeds: &[StrokeSeed],
    camera: &Camera,
    knobs: &StrokeKnobs,
) -> Option<(StrokeRecord, Vec2)> {
    let mean: Vec3 = camera.view_from_world.transform_point3(scene.means[i]);
    let gradients = Projection::new(camera).gradients(mean);
    let gaussian = (scene.means[i], scene.rotations[i], scene.scales[i]);
    let record = StrokeRecord::new(word, seeds, gaussian, gradients, knobs)?;
    Some((record, camera.focal * mean.truncate() / mean.z + camera.center))
}

/// The strokes of each splat, in the splats' order, rounded as the GPU's are.
fn stroke_records(
    scene: &Scene,
    strokes: &Strokes,
    knobs: &StrokeKnobs,
    camera: &Camera,
    splats: &[Splat],
) -> Vec<Option<StrokeRecord>> {
    assert_eq!(strokes.words.len(), scene.len(), "one word per Gaussian");
    let record = |splat: &Splat| {
        let i = splat.gaussian as usize;
        let (record, _) = stroke_record(scene, i, strokes.words[i], &strokes.seeds, camera, knobs)?;
        Some(StrokeRecord::unpacked(record.packed()))
    };
    splats.par_iter().map(record).collect()
}

/// How light falls on each splat, likewise; empty if there is no relief.
fn reliefs(
    scene: &Scene,
    strokes: &Strokes,
    knobs: &StrokeKnobs,
    camera: &Camera,
    splats: &[Splat],
) -> Vec<Option<StrokeRelief>> {
    let (eye, is_asked) = (camera.position(), knobs.relief > 0.0);
    let relief = |splat: &Splat| {
        let i = splat.gaussian as usize;
        let seed = strokes.seeds.get(StrokeWord::unpacked(strokes.words[i]).seed as usize)?.plain();
        let relief = StrokeRelief::new(&seed, eye - scene.means[i], knobs)?;
        Some(StrokeRelief::unpacked(relief.packed()))
    };
    if is_asked { splats.par_iter().map(relief).collect() } else { Vec::new() }
}

/// The color of each splat, in the splats' order.
fn splat_colors(scene: &Scene, colors: Colors, camera: &Camera, splats: &[Splat]) -> Vec<[f32; 3]> {
    let eye = camera.position();
    let captured = |gaussian: usize| -> [f32; 3] {
        let Some(captured) = &scene.sh else { return [0.5; 3] };
        let n = 3 * (usize::from(captured.degree) + 1).pow(2);
        let coefficients = &captured.coefficients[gaussian * n..(gaussian + 1) * n];
        // A Gaussian at the eye itself has no direction, and is culled in any case.
        let direction: Vec3 = (scene.means[gaussian] - eye).normalize_or_zero();
        sh::evaluate(captured.degree, coefficients, direction).to_array()
    };
    let color = |splat: &Splat| -> [f32; 3] {
        let gaussian = splat.gaussian as usize;
        match colors {
            Colors::Captured => captured(gaussian),
            Colors::Rgb(rgb) => rgb[gaussian],
            Colors::Mixed(mixed) => match mixed[gaussian] {
                [r, g, b, share] if share >= 1.0 => [r, g, b],
                [r, g, b, share] => {
                    let below = captured(gaussian).map(|channel| (1.0 - share) * channel);
                    [r + below[0], g + below[1], b + below[2]]
                }
            },
        }
    };
    // Per splat and not per Gaussian: harmonics are evaluated only for what the camera can see.
    splats.par_iter().map(color).collect()
}
