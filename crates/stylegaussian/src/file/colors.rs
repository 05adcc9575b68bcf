//! Colors alone: a safetensors file with `rgb` f32 `[n_source, 3]`.

use std::path::Path;

use crate::scene::Scene;

use super::{
    atomic::write_atomically,
    error::{FileError, mismatch},
    tensors::Writer,
};

/// Writes `rgb` `[N]`, in scene order and unclamped, as tensor `rgb` f32 `[n_source, 3]` in source order. Gaussians of
/// the source that the scene lacks are NaN.
///
/// # Errors
/// If there is not one color per Gaussian, the scene contradicts itself, or the file cannot be written.
pub fn write_colors(path: &Path, rgb: &[[f32; 3]], scene: &Scene) -> Result<(), FileError> {
    let invalid = |found: String, expected: String| mismatch(found, expected).at(path);
    scene.validate().map_err(|error| invalid(format!("an inconsistent {error}"), "a valid scene".into()))?;
    if rgb.len() != scene.len() {
        return Err(invalid(format!("{} colors", rgb.len()), format!("{}, one per Gaussian", scene.len())));
    }
    let mut by_source: Vec<u32> = (0..scene.len() as u32).collect();
    by_source.sort_unstable_by_key(|&i| scene.order[i as usize]);
    // Each value is looked up when it is written: a scene file may claim a source of any size, which must not be
    // allocated.
    let value = |flat: usize| {
        let found = by_source.binary_search_by_key(&(flat / 3), |&i| scene.order[i as usize] as usize);
        // NaN and not black, which is a color.
        found.map_or(f32::NAN, |at| rgb[by_source[at] as usize][flat % 3])
    };
    let mut writer = Writer::new("stylegaussian-colors");
    writer.made("rgb", &[scene.n_source, 3], value);
    write_atomically(path, |out| writer.write(out))
}
