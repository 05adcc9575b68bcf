//! Colors alone: a safetensors file with `rgb` f32 `[n_source, 3]`.

use std::path::Path;

use stylegaussian::scene::Scene;

use super::{
    atomic::write_atomically,
    error::{FileError, mismatch},
    tensors::Writer,
};

/// Writes `rgb` `[N]`, in scene order and unclamped, as tensor `rgb` f32 `[n_source, 3]` in source order. A
/// Gaussian of the source has the mean color of its parts, or NaN if the scene lacks it.
///
/// # Errors
/// If there is not one color per Gaussian, the scene contradicts itself, or the file cannot be written.
pub fn write_colors(path: &Path, rgb: &[[f32; 3]], scene: &Scene) -> Result<(), FileError> {
    let invalid = |found: String, expected: String| mismatch(found, expected).at(path);
    scene.validate().map_err(|error| invalid(format!("an inconsistent {error}"), "a valid scene".into()))?;
    if rgb.len() != scene.len() {
        return Err(invalid(format!("{} colors", rgb.len()), format!("{}, one per Gaussian", scene.len())));
    }
    let by_source = scene.by_source();
    let source = |i: &u32| scene.order[*i as usize] as usize;
    // Each value is made when it is written: a scene file may claim a source of any size, which must not be
    // allocated.
    let value = |flat: usize| {
        let (row, channel) = (flat / 3, flat % 3);
        let start = by_source.partition_point(|i| source(i) < row);
        let parts = by_source[start..].iter().take_while(|i| source(i) == row);
        let (sum, n) = parts.fold((0.0, 0), |(sum, n), &i| (sum + rgb[i as usize][channel], n + 1));
        // NaN if there is none (0 / 0), and not black, which is a color.
        sum / n as f32
    };
    let mut writer = Writer::new("stylegaussian-colors");
    writer.made("rgb", &[scene.n_source, 3], value);
    write_atomically(path, |out| writer.write(out))
}
