//! EWA splatting on the CPU: what a camera sees of a scene, and with which weights.
//!
//! A Gaussian with covariance S is drawn as its 2D footprint, a *splat*: the first-order projection J W S W^T J^T
//! (Zwicker et al., "EWA Volume Splatting", 2001) plus 0.3 px^2 on the diagonal. Splats blend front to back:
//! color = sum_i w_i c_i with w_i = alpha_i prod_{j < i} (1 - alpha_j). The rules are those of the 3D Gaussian
//! Splatting rasterizer (Kerbl et al. 2023) but for the footprint, which here covers every pixel where alpha reaches
//! 1/255 (the original stops at three standard deviations, where an opaque splat still has alpha 0.011).
//!
//! The stages, one module each: `project` (cull, project, sort by depth), `bands` (which tile sees which splat),
//! `composite` (blend one tile), `weights` (keep the blend weights instead of a picture).

mod bands;
mod composite;
mod project;
mod weights;

#[cfg(test)]
mod tests;

use glam::{UVec2, Vec3};
use rayon::prelude::*;

use crate::{camera::Camera, scene::Scene, sh};
use bands::{Bands, TILE};
use project::{Splat, project};
pub use weights::BlendWeights;

/// Smallest alpha that is drawn: one step of an 8-bit picture (Kerbl et al. 2023). A splat ends where it falls below.
pub const MIN_ALPHA: f32 = 1.0 / 255.0;

/// Largest alpha of a splat (Kerbl et al. 2023): no splat hides everything behind it, so transmittance stays positive.
pub const MAX_ALPHA: f32 = 0.99;

/// Which colors to draw a scene with.
#[derive(Clone, Copy, Debug)]
pub enum Colors<'a> {
    /// The scene's own, view-dependent: its spherical harmonics, clamped at 0 from below. A scene without any is
    /// mid-gray.
    Captured,
    /// One RGB per Gaussian `[N]`, e.g. a stylized scene's; not clamped.
    Rgb(&'a [[f32; 3]]),
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
    /// View-space z accumulated with the blend weights `[H, W]`, in scene units; divide by `alpha` for the mean depth.
    pub depth: Vec<f32>,
}

/// Draws `scene` as `camera` sees it.
///
/// # Panics
/// When `colors` holds another number of colors than the scene has Gaussians.
pub fn render(scene: &Scene, colors: Colors, camera: &Camera) -> RenderedImage {
    if let Colors::Rgb(rgb) = colors {
        assert_eq!(rgb.len(), scene.len(), "one color per Gaussian");
    }
    let splats = project(scene, camera);
    let colors = splat_colors(scene, colors, camera, &splats);
    let bands = Bands::new(&splats, camera.size);

    let n_pixels = camera.size.x as usize * camera.size.y as usize;
    let mut view = RenderedImage {
        size: camera.size,
        color: vec![[0.0; 3]; n_pixels],
        alpha: vec![0.0; n_pixels],
        depth: vec![0.0; n_pixels],
    };
    let pixels_per_band = (camera.size.x as usize * TILE).max(1);
    view.color
        .par_chunks_mut(pixels_per_band)
        .zip(view.alpha.par_chunks_mut(pixels_per_band))
        .zip(view.depth.par_chunks_mut(pixels_per_band))
        .enumerate()
        .for_each(|(band, ((color, alpha), depth))| {
            bands.composite(band, &splats, |pixel, splat, weight| {
                let (rgb, z) = (&colors[splat], splats[splat].depth);
                for (sum, channel) in color[pixel].iter_mut().zip(rgb) {
                    *sum += weight * channel;
                }
                alpha[pixel] += weight;
                depth[pixel] += weight * z;
            });
        });
    view
}

/// The weight of every Gaussian in every pixel of `camera`: what [`render`] multiplies colors with.
///
/// Colors do not enter, so one set of weights serves any number of per-Gaussian values (colors, features) and the
/// gradients with respect to them.
pub fn blend_weights(scene: &Scene, camera: &Camera) -> BlendWeights {
    let splats = project(scene, camera);
    let bands = Bands::new(&splats, camera.size);
    BlendWeights::gather(&splats, &bands, scene.len())
}

/// The color of each splat, in the splats' order.
fn splat_colors(scene: &Scene, colors: Colors, camera: &Camera, splats: &[Splat]) -> Vec<[f32; 3]> {
    let eye = camera.position();
    let color = |splat: &Splat| -> [f32; 3] {
        let gaussian = splat.gaussian as usize;
        match (colors, &scene.sh) {
            (Colors::Rgb(rgb), _) => rgb[gaussian],
            (Colors::Captured, None) => [0.5; 3],
            (Colors::Captured, Some(of_scene)) => {
                let n = 3 * (usize::from(of_scene.degree) + 1).pow(2);
                let coefficients = &of_scene.coefficients[gaussian * n..(gaussian + 1) * n];
                let direction: Vec3 = (scene.means[gaussian] - eye).normalize_or_zero();
                sh::evaluate(of_scene.degree, coefficients, direction).to_array()
            }
        }
    };
    splats.par_iter().map(color).collect()
}
