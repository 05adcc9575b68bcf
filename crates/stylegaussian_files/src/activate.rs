//! From stored parameters to a scene, for 3DGS files and checkpoints alike.

use std::collections::BTreeMap;

use glam::{DQuat, Quat, Vec3};
use rayon::prelude::*;
use stylegaussian::scene::{Features, Scene, Sh};

use super::check::fault;

/// Gaussians as training stores them: before the activations.
pub(super) struct StoredGaussians {
    /// Means `[N]`.
    pub means: Vec<Vec3>,
    /// Natural logarithms of the standard deviations `[N]`.
    pub log_scales: Vec<Vec3>,
    /// Quaternions `[N]` in the order w, x, y, z, of any length but zero.
    pub rotations_wxyz: Vec<[f32; 4]>,
    /// Opacities `[N]` before the sigmoid; infinite ones are opaque and transparent.
    pub opacity_logits: Vec<f32>,
    /// Captured colors, or `None` if the file keeps none.
    pub sh: Option<Sh>,
    /// Features, or `None` if the scene was never embedded.
    pub features: Option<Features>,
}

/// Applies exp, sigmoid and normalization. Drops Gaussians that are not finite or have a zero quaternion, and
/// adds a warning that counts them.
pub(super) fn activate(stored: StoredGaussians, warnings: &mut Vec<String>) -> Scene {
    let n = stored.means.len();
    let scene = Scene {
        rotations: stored.rotations_wxyz.into_par_iter().map(unit_quaternion).collect(),
        scales: mapped(stored.log_scales, Vec3::exp),
        opacities: mapped(stored.opacity_logits, sigmoid),
        means: stored.means,
        sh: stored.sh,
        order: (0..n as u32).collect(),
        n_source: n,
        features: stored.features,
        ..Scene::default()
    };
    drop_broken(scene, warnings)
}

/// The values of a function, in place.
fn mapped<T: Copy + Send>(mut values: Vec<T>, to: impl Fn(T) -> T + Sync) -> Vec<T> {
    values.par_iter_mut().for_each(|value| *value = to(*value));
    values
}

/// Drops Gaussians that are not finite, and adds a warning that counts them.
pub(super) fn drop_broken(scene: Scene, warnings: &mut Vec<String>) -> Scene {
    drop_if(scene, fault, warnings)
}

/// Drops Gaussians that have a `fault`, which names that of a scene's Gaussian by its index, as words that
/// follow "with". Adds a warning that counts them.
pub(super) fn drop_if(
    scene: Scene,
    fault: impl Fn(&Scene, usize) -> Option<&'static str> + Sync,
    warnings: &mut Vec<String>,
) -> Scene {
    let n = scene.len();
    let is_kept = |&i: &u32| fault(&scene, i as usize).is_none();
    // Of most scenes, everything is kept.
    if (0..n as u32).into_par_iter().all(|i| is_kept(&i)) {
        return scene;
    }
    let kept: Vec<u32> = (0..n as u32).into_par_iter().filter(is_kept).collect();
    let mut counts = BTreeMap::new();
    for fault in (0..n).filter_map(|i| fault(&scene, i)) {
        *counts.entry(fault).or_insert(0_usize) += 1;
    }
    let counts: Vec<String> = counts.into_iter().map(|(fault, n)| format!("{n} with {fault}")).collect();
    warnings.push(format!("dropped {} of {n} Gaussians: {}", n - kept.len(), counts.join(", ")));
    scene.subset(&kept)
}

/// The stored quaternion at length 1, or NaN if it is zero. In f64, since squares of f32 values overflow and
/// underflow in f32.
pub(super) fn unit_quaternion([w, x, y, z]: [f32; 4]) -> Quat {
    let stored = DQuat::from_xyzw(x.into(), y.into(), z.into(), w.into());
    // A zero quaternion becomes 0 times infinity, which is NaN.
    (stored * stored.length().recip()).as_quat()
}

/// 1 / (1 + exp(-logit)), rounded once: the decoder's faster sigmoid is off by up to 2e-7. 0 and 1 for infinite
/// logits, which writers of 8-bit opacities store for their ends.
pub(super) fn sigmoid(logit: f32) -> f32 {
    (1.0 / (1.0 + (-f64::from(logit)).exp())) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stored(n: usize) -> StoredGaussians {
        StoredGaussians {
            means: vec![Vec3::ONE; n],
            log_scales: vec![Vec3::new(0.0, 2.0_f32.ln(), -1.0); n],
            rotations_wxyz: vec![[0.0, 0.0, 3.0, 4.0]; n],
            opacity_logits: vec![3.0_f32.ln(); n],
            sh: None,
            features: None,
        }
    }

    #[test]
    fn applies_the_activations() {
        let mut warnings = Vec::new();
        let scene = activate(stored(1), &mut warnings);
        assert!(scene.scales[0].abs_diff_eq(Vec3::new(1.0, 2.0, 0.367_879_44), 1e-6));
        assert!(scene.rotations[0].abs_diff_eq(Quat::from_xyzw(0.0, 0.6, 0.8, 0.0), 1e-7));
        assert!((scene.opacities[0] - 0.75).abs() < 1e-6); // 1 / (1 + 1/3)
        assert!(warnings.is_empty());
    }

    #[test]
    fn infinite_logits_are_opaque_and_transparent() {
        let mut gaussians = stored(2);
        gaussians.opacity_logits = vec![f32::INFINITY, f32::NEG_INFINITY];
        let mut warnings = Vec::new();
        assert_eq!(activate(gaussians, &mut warnings).opacities, [1.0, 0.0]);
        assert!(warnings.is_empty(), "{warnings:?}");
    }

    #[test]
    fn drops_infinite_gaussians_and_keeps_tiny_quaternions() {
        let mut gaussians = stored(8);
        gaussians.means[0].y = f32::NAN;
        gaussians.rotations_wxyz[1] = [0.0; 4];
        // A valid one. Its square is 0 in f32.
        gaussians.rotations_wxyz[2] = [1e-38, 0.0, 0.0, 0.0];
        gaussians.opacity_logits[3] = f32::NAN;
        // exp(1000) is infinite in f32.
        gaussians.log_scales[4].z = 1e3;
        gaussians.rotations_wxyz[5] = [f32::INFINITY, 0.0, 0.0, 0.0];
        let mut coefficients = vec![0.0; 24];
        // Three coefficients per Gaussian: this is the first of Gaussian 6.
        coefficients[18] = f32::NEG_INFINITY;
        gaussians.sh = Some(Sh { degree: 0, coefficients });
        let mut warnings = Vec::new();
        let scene = activate(gaussians, &mut warnings);
        assert_eq!(scene.order, [2, 7]);
        assert_eq!(scene.n_source, 8);
        assert_eq!(scene.rotations[0], Quat::IDENTITY);
        assert_eq!(
            warnings,
            ["dropped 6 of 8 Gaussians: 1 with a color that is not finite, 1 with a position that is not \
              finite, 2 with a rotation that is zero or not finite, 1 with a size that is not finite, 1 with \
              an opacity that is not finite"]
        );
    }
}
