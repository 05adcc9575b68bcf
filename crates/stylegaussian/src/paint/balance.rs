//! How much detail is laid on.

use rayon::prelude::*;

use super::{choice::Choice, proofs::LuminanceTexture};
use crate::{
    scene::Scene,
    strokes::{PROTECTED, StrokeSeed, StrokeTexture},
};

/// Ranges of the gains of wide and of fine detail. Overlapping Gaussians blur fine detail, so a gain of 1 shows
/// less of it than the painting has; above 2 its grain becomes beads.
const WIDE: (f64, f64) = (0.5, 1.2);
const FINE: (f64, f64) = (1.2, 2.0);

/// Gains of detail.
pub(super) struct Balance {
    /// Gains of fine and of wide detail.
    pub fine: f32,
    pub wide: f32,
    /// Energy of fine detail in the proofs, over the painting's.
    pub fine_energy: f64,
}

impl Balance {
    /// The gains at which pictures have as much detail as the painting. With K the detail that the scene keeps
    /// and P the painting's energy, the gains c of wide detail W and d of fine detail F solve |K + c W|^2 = P
    /// in wide bands and |K + c W + d F|^2 = P in fine ones. `plain` are the seeds at gains of 1.
    pub fn new(
        scene: &Scene,
        choice: &Choice,
        plain: &[StrokeSeed],
        textures: &[&StrokeTexture],
        protection: &[f32],
        kept: &[f32],
    ) -> Self {
        let surface = choice.surface;
        let kept = surface.proofs.bands(kept);
        let gains =
            [PROTECTED, 1.0].map(|most| protection.iter().map(|p| 1.0 - most * p).collect::<Vec<_>>());
        let textures: Vec<LuminanceTexture> =
            textures.par_iter().map(|texture| LuminanceTexture::new(texture)).collect();
        let owners = &surface.seeds.owners;
        let detail = surface.proofs.detail(scene, plain, owners, [&gains[0], &gains[1]], &textures);
        let [of_fine, of_wide] = choice.energies();
        let product = |a: &super::proofs::Bands, b: &super::proofs::Bands| a.products(b);
        let (kk, kf, kw) =
            (product(&kept, &kept), product(&kept, &detail.fine), product(&kept, &detail.wide));
        let (ff, fw) = (product(&detail.fine, &detail.fine), product(&detail.fine, &detail.wide));
        let ww = product(&detail.wide, &detail.wide);
        let c = root(ww[1], kw[1] + fw[1], kk[1] + ff[1] + 2.0 * kf[1] - of_wide).clamp(WIDE.0, WIDE.1);
        let with_wide = kk[0] + 2.0 * c * kw[0] + c * c * ww[0];
        let d = root(ff[0], kf[0] + c * fw[0], with_wide - of_fine).clamp(FINE.0, FINE.1);
        Self { fine: d as f32, wide: c as f32, fine_energy: d * d * ff[0] / of_fine.max(1e-9) }
    }

    /// Those beside a scene with this gain of wide detail, on a surface on which nothing blurs fine detail: it
    /// is as strong as in the painting.
    pub fn beside(wide: f32) -> Self {
        Self { fine: 1.0, wide, fine_energy: 1.0 }
    }
}

/// The positive root x of a x^2 + 2 b x + c = 0, or 0.
fn root(a: f64, b: f64, c: f64) -> f64 {
    if a > 1e-12 { (-b + (b * b - a * c).max(0.0).sqrt()) / a } else { 0.0 }
}
