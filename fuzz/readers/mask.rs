//! Masks, `*.mask.safetensors`.

use stylegaussian_files::mask_from_bytes;

/// Reads the mask. An accepted one has weights for each Gaussian of the scene that it names.
pub fn read(data: &[u8]) {
    if let Ok(mask) = mask_from_bytes(data, "fuzz.mask.safetensors") {
        assert_eq!(mask.len(), mask.scene.n_gaussians);
    }
}
