//! Images as styles.

use stylegaussian_encoder::Image;

/// Decodes the image. An accepted one has finite values from 0 to 1.
pub fn read(data: &[u8]) {
    if let Ok(image) = Image::from_bytes(data, "fuzz.png".as_ref()) {
        assert_eq!(image.rgb.len(), 3 * image.width as usize * image.height as usize);
        assert!(image.rgb.iter().all(|value| (0.0..=1.0).contains(value)));
    }
}
