//! Several primitives as one scene.

use stylegaussian::{
    scene::{Scene, ScreenFilter, Sh},
    sh::n_coefficients,
};

/// The Gaussians of all parts, one part after another. Parts of a lower degree get coefficients of zero.
pub(super) fn merge(mut parts: Vec<Scene>) -> Scene {
    if parts.len() == 1 {
        return parts.remove(0);
    }
    let has_sh = parts.iter().any(|part| part.sh.is_some());
    let degree = parts.iter().filter_map(|part| part.sh.as_ref()).map(|sh| sh.degree).max().unwrap_or(0);
    let is_antialiased = parts.iter().any(|part| part.filter == ScreenFilter::Antialiased);
    let mut merged = Scene::default();
    let mut coefficients = Vec::new();
    for part in parts {
        let width = 3 * n_coefficients(degree);
        let n = part.len();
        // Indices of Gaussians that are dropped later still count.
        let first = merged.n_source as u32;
        merged.order.extend(part.order.iter().map(|index| first + index));
        merged.n_source += part.n_source;
        merged.means.extend(part.means);
        merged.rotations.extend(part.rotations);
        merged.scales.extend(part.scales);
        merged.opacities.extend(part.opacities);
        if has_sh {
            let start = coefficients.len();
            coefficients.resize(start + n * width, 0.0);
            let found = part.sh.unwrap_or(Sh { degree: 0, coefficients: vec![0.0; 3 * n] });
            let found_width = 3 * n_coefficients(found.degree);
            let rows = coefficients[start..].chunks_exact_mut(width);
            for (row, values) in rows.zip(found.coefficients.chunks_exact(found_width)) {
                row[..found_width].copy_from_slice(values);
            }
        }
    }
    merged.sh = has_sh.then_some(Sh { degree, coefficients });
    merged.filter = if is_antialiased { ScreenFilter::Antialiased } else { ScreenFilter::Classic };
    merged
}
