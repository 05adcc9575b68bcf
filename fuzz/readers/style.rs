//! Style statistics, `*.style.safetensors`.

use stylegaussian_files::style_from_bytes;

/// Reads the statistics. Accepted ones have a deviation for each mean.
pub fn read(data: &[u8]) {
    if let Ok(style) = style_from_bytes(data, "fuzz.style.safetensors") {
        assert_eq!(style.mean.len(), style.std_dev.len());
        assert!(style.std_dev.iter().all(|value| *value >= 0.0));
    }
}
