//! Gaussians moved by an affine transform.
//!
//! A covariance S becomes L S L^T. For a turn and one scale that is a turn of the quaternion; for a matrix that
//! stretches, the new axes are eigenvectors.

use glam::{DAffine3, DMat3, DQuat, DVec3, Quat};
use rayon::prelude::*;
use stylegaussian::{scene::Scene, sh, symmetric::eigen};

use super::error::{Mismatch, mismatch};

/// Moves a scene within its coordinates: its offset is turned, but the way from there on is added to the means.
/// Its spherical harmonics turn along; under a matrix that stretches they turn with its
/// rotation, which a warning says.
pub(super) fn place(scene: &mut Scene, to: DAffine3, warnings: &mut Vec<String>) -> Result<(), Mismatch> {
    if to == DAffine3::IDENTITY {
        return Ok(());
    }
    let linear = to.matrix3;
    let (lengths, stretched) = eigen(linear.transpose() * linear);
    let factors = lengths.max(DVec3::ZERO).map(f64::sqrt);
    // Below this the inverse is noise. A matrix of zeros is not above it either.
    if factors.min_element() <= 1e-9 * factors.max_element() {
        let (least, most) = (factors.min_element(), factors.max_element());
        return Err(mismatch(
            format_args!("Gaussians in a node that scales by {least:e} to {most:e}"),
            "scales above 0, the largest at most 1e9 times the least",
        ));
    }
    // The polar decomposition L = Q P: P stretches along its eigenvectors, Q turns, and mirrors if L does.
    let inverse = stretched * DMat3::from_diagonal(factors.recip()) * stretched.transpose();
    let turn = linear * inverse;
    // Only files without cameras are read or written in this way.
    scene.cameras.clear();
    scene.offset = linear * scene.offset;
    scene.means.par_iter_mut().for_each(|mean| *mean = to.transform_point3(mean.as_dvec3()).as_vec3());
    if factors.max_element() - factors.min_element() <= 1e-5 * factors.max_element() {
        // A covariance does not change if all axes are mirrored.
        let proper = DQuat::from_mat3(&(turn * turn.determinant().signum()));
        let scale = factors.y as f32;
        scene
            .rotations
            .par_iter_mut()
            .for_each(|rotation| *rotation = (proper * rotation.as_dquat()).normalize().as_quat());
        scene.scales.par_iter_mut().for_each(|scales| *scales *= scale);
    } else {
        if scene.sh.as_ref().is_some_and(|sh| sh.degree > 0) {
            warnings.push(
                "a node stretches its Gaussians: colors that depend on the view are only turned".into(),
            );
        }
        scene.rotations.par_iter_mut().zip(&mut scene.scales).for_each(|(rotation, scales)| {
            let axes =
                linear * DMat3::from_quat(rotation.as_dquat()) * DMat3::from_diagonal(scales.as_dvec3());
            // NaN has no eigenvalues. Such Gaussians are dropped later.
            if axes.is_finite() {
                let (variances, vectors) = eigen(axes * axes.transpose());
                *scales = variances.max(DVec3::ZERO).map(f64::sqrt).as_vec3();
                *rotation = Quat::normalize(DQuat::from_mat3(&vectors).as_quat());
            }
        });
    }
    if let Some(sh) = &mut scene.sh {
        sh::rotate(turn, sh.degree, &mut sh.coefficients);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::{EulerRot, Mat3, Vec3};
    use stylegaussian::scene::Sh;

    use super::*;

    fn one() -> Scene {
        Scene {
            means: vec![Vec3::new(1.0, -2.0, 0.5)],
            rotations: vec![Quat::from_euler(EulerRot::XYZ, 1.0, 0.4, -0.7)],
            scales: vec![Vec3::new(0.1, 0.5, 2.0)],
            opacities: vec![1.0],
            sh: Some(Sh { degree: 3, coefficients: (0..48).map(|i| (i as f32 * 0.9).sin() * 0.2).collect() }),
            order: vec![0],
            n_source: 1,
            ..Scene::default()
        }
    }

    fn covariance(scene: &Scene) -> Mat3 {
        let axes = Mat3::from_quat(scene.rotations[0]) * Mat3::from_diagonal(scene.scales[0]);
        axes * axes.transpose()
    }

    #[test]
    fn covariances_and_colors_follow_the_transform() {
        let turn = DMat3::from_euler(EulerRot::XYZ, -0.8, 0.9, 1.7);
        let mirror = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
        let stretch = DMat3::from_diagonal(DVec3::new(3.0, 0.5, 1.0));
        for (linear, keeps_colors) in [
            (turn, true),
            (turn * 2.5, true),
            (turn * mirror, true),
            (turn * stretch, false),
            (stretch * turn, false),
        ] {
            let (before, mut after) = (one(), one());
            let mut warnings = Vec::new();
            let to = DAffine3 { matrix3: linear, translation: DVec3::new(10.0, 20.0, 30.0) };
            place(&mut after, to, &mut warnings).unwrap();
            let expected = linear.as_mat3() * covariance(&before) * linear.as_mat3().transpose();
            assert!(covariance(&after).abs_diff_eq(expected, 1e-5 * 40.0), "{linear}");
            assert!(after.rotations[0].is_normalized());
            let mean = linear.as_mat3() * before.means[0] + Vec3::new(10.0, 20.0, 30.0);
            assert!(after.means[0].abs_diff_eq(mean, 1e-5));
            assert_eq!(warnings.is_empty(), keeps_colors);
            if keeps_colors {
                let direction = Vec3::new(0.36, 0.48, -0.8);
                let seen =
                    |scene: &Scene, d: Vec3| sh::evaluate(3, &scene.sh.as_ref().unwrap().coefficients, d);
                let turned = (linear.as_mat3() * direction).normalize();
                assert!(seen(&after, turned).abs_diff_eq(seen(&before, direction), 1e-5));
            }
        }
        let flat = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
        assert!(place(&mut one(), flat, &mut Vec::new()).is_err());
        // Beyond what f32 holds: the scale that is told is the one that was found.
        let huge = DAffine3::from_scale(DVec3::new(1e39, 1.0, 1.0));
        let error = place(&mut one(), huge, &mut Vec::new()).unwrap_err().to_string();
        assert!(error.contains("scales by 1e0 to") && error.contains("e3"), "{error}");
    }
}
