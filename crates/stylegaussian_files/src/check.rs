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
        if fault(scene, i).is_some() {
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

/// The fault of Gaussian `i`, as words that follow "with", or `None` if everything about it is finite. A
/// quaternion that could not be normalized is NaN.
pub(super) fn fault(scene: &Scene, i: usize) -> Option<&'static str> {
    let finite_row = |values: &[f32]| {
        // `values` has a row per Gaussian, and there is a Gaussian i.
        let width = values.len() / scene.len();
        values[i * width..(i + 1) * width].iter().all(|value| value.is_finite())
    };
    let of_place = fault_of_place(scene, i);
    if of_place.is_some() {
        of_place
    } else if !scene.rotations[i].is_finite() {
        Some("a rotation that is zero or not finite")
    } else if !scene.opacities[i].is_finite() {
        Some("an opacity that is not finite")
    } else if scene.sh.as_ref().is_some_and(|sh| !finite_row(&sh.coefficients)) {
        Some("a color that is not finite")
    } else if scene.features.as_ref().is_some_and(|f| !(finite_row(&f.values) && finite_row(&f.extra))) {
        Some("features that are not finite")
    } else {
        None
    }
}

/// The [`fault`] of the position or the size of Gaussian `i`.
pub(super) fn fault_of_place(scene: &Scene, i: usize) -> Option<&'static str> {
    if !scene.means[i].is_finite() {
        Some("a position that is not finite")
    } else if !scene.scales[i].is_finite() {
        Some("a size that is not finite")
    } else {
        None
    }
}
