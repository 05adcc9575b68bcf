//! Looks, `*.look.safetensors`.

use stylegaussian_files::look_from_bytes;

/// Reads the look. An accepted one has a color for each Gaussian of the scene that it names.
pub fn read(data: &[u8]) {
    if let Ok(look) = look_from_bytes(data, "fuzz.look.safetensors") {
        assert_eq!(look.len(), look.scene.n_gaussians);
    }
}
