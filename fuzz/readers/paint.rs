//! The paint in styles, `*.style.safetensors`.

use stylegaussian_files::paint_from_bytes;

/// Reads the paint. An accepted one has 3 bytes for each pixel, and says of each whether it is used, if of any.
pub fn read(data: &[u8]) {
    if let Ok(Some(paint)) = paint_from_bytes(data, "fuzz.style.safetensors") {
        assert_eq!(paint.pixels.len(), 3 * paint.width * paint.height);
        assert!(paint.used.is_none_or(|used| 3 * used.len() == paint.pixels.len()));
    }
}
