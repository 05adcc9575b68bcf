//! The rules that every scene in a file obeys, checked on reading and on writing.

use stylegaussian::scene::Scene;

use super::error::{Mismatch, mismatch};

/// Checks shapes and indices, finite values, unit quaternions, and opacities in 0..1. Readers rely on them,
/// ours and others'.
pub(super) fn check_scene(scene: &Scene) -> Result<(), Mismatch> {
    scene.validate().map_err(|error| mismatch(format_args!("an inconsistent {error}"), "a valid scene"))?;
    for (i, source_index) in scene.order.iter().enumerate() {
        let wrong = |found: String, expected| {
            Err(mismatch(format_args!("{found} of source Gaussian {source_index}"), expected))
        };
        if !is_finite(scene, i) {
            return wrong("NaN or infinity".into(), "finite numbers");
        }
        let length = scene.rotations[i].length();
        // Quaternions of other writers are rounded, at worst to f16 (2^-11).
        if (length - 1.0).abs() > 1e-3 {
            return wrong(format!("a rotation of length {length}"), "unit quaternions");
        }
        let opacity = scene.opacities[i];
        if !(0.0..=1.0).contains(&opacity) {
            return wrong(format!("opacity {opacity}"), "0 to 1");
        }
    }
    Ok(())
}

/// Whether everything about Gaussian `i` is finite. A quaternion that could not be normalized is NaN.
pub(super) fn is_finite(scene: &Scene, i: usize) -> bool {
    let finite_row = |values: &[f32]| {
        // `values` has a row per Gaussian, and there is a Gaussian i.
        let width = values.len() / scene.len();
        values[i * width..(i + 1) * width].iter().all(|value| value.is_finite())
    };
    scene.means[i].is_finite()
        && scene.scales[i].is_finite()
        && scene.rotations[i].is_finite()
        && scene.opacities[i].is_finite()
        && scene.sh.as_ref().is_none_or(|sh| finite_row(&sh.coefficients))
        && scene.features.as_ref().is_none_or(|f| finite_row(&f.values) && finite_row(&f.extra))
}
