//! Statistics of a style image, which AdaIN matches.

use image::imageops::FilterType;
use stylegaussian::{ChannelStatistics, paint::Paint};

use crate::{Encoder, EncoderError, FeatureMap, Image, image::MIN_SIDE};

/// The size at which a style image is encoded.
///
/// relu3_1 sees strokes of a few dozen pixels, so the same painting at another size is another style.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StyleSize {
    /// Keeps the proportions and shrinks to at most this many pixels. Never enlarges, because that adds no
    /// strokes.
    Area(u32),
    /// Squashes to 256x256, whatever the proportions, with the triangle filter, as the paper's code does.
    Squash256,
}

/// 512x512 pixels. Decoders are trained on crops of paintings with a shorter side of 512, and strokes should
/// have the scale that they were trained with. The limit is on the area, not on the shorter side, so that a
/// panorama costs no more.
impl Default for StyleSize {
    fn default() -> Self {
        Self::Area(512 * 512)
    }
}

impl StyleSize {
    /// The size (width, height) at which an image of this size is encoded.
    pub fn of(self, width: u32, height: u32) -> (u32, u32) {
        match self {
            Self::Squash256 => (256, 256),
            Self::Area(area) => {
                // In f64: the product may overflow a `u32`.
                let n_pixels = f64::from(width) * f64::from(height);
                let factor = (f64::from(area) / n_pixels).sqrt().min(1.0);
                // A thin image keeps enough pixels to be encoded, but is not enlarged to that.
                let shrink = |side: u32| ((f64::from(side) * factor).round() as u32).max(MIN_SIDE.min(side));
                (shrink(width), shrink(height))
            }
        }
    }

    /// The image at that size.
    pub fn resize(self, image: &Image) -> Image {
        let (width, height) = self.of(image.width, image.height);
        match self {
            Self::Area(_) => image.resized(width, height),
            Self::Squash256 => image.resized_with(width, height, FilterType::Triangle),
        }
    }
}

/// Features of a style image at the given size, or at the encoder's own size if it has a fixed one.
///
/// # Errors
/// As [`Encoder::encode`].
pub fn style_features(encoder: &Encoder, image: &Image, size: StyleSize) -> Result<FeatureMap, EncoderError> {
    match encoder.input_size() {
        // A graph of one size leaves no choice, so `size` does not apply.
        Some((width, height)) => encoder.encode(&image.resized(width, height)),
        None => encoder.encode(&size.resize(image)),
    }
}

/// Mean and standard deviation of a style image's features, naming the encoder.
///
/// The covariance is `None`. Transfers beyond AdaIN need it, from [`FeatureMap::covariance`] of
/// [`style_features`].
///
/// # Errors
/// As [`Encoder::encode`].
pub fn style_statistics(
    encoder: &Encoder,
    image: &Image,
    size: StyleSize,
) -> Result<ChannelStatistics, EncoderError> {
    let statistics = style_features(encoder, image, size)?.statistics();
    Ok(ChannelStatistics { encoder: Some(encoder.id().clone()), ..statistics })
}

/// [`style_statistics`] and the painting's own paint.
///
/// # Errors
/// As [`Encoder::encode`].
pub fn painted_style(
    encoder: &Encoder,
    image: &Image,
    size: StyleSize,
) -> Result<(ChannelStatistics, Paint), EncoderError> {
    Ok((style_statistics(encoder, image, size)?, paint_of(image)))
}

/// The painting's own paint, for which no encoder is needed. It keeps the image's proportions: strokes have a
/// shape.
pub fn paint_of(image: &Image) -> Paint {
    let (width, height) = Paint::size_of(image.width, image.height);
    Paint::new(width as usize, height as usize, &image.resized(width, height).rgb)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn area_keeps_proportions_and_never_enlarges() {
        let size = StyleSize::default();
        // 2048 x 512 has four times 512 x 512 pixels, so both sides are halved.
        assert_eq!(size.of(2048, 512), (1024, 256));
        assert_eq!(size.of(512, 512), (512, 512));
        assert_eq!(size.of(100, 200), (100, 200));
        // sqrt(262,144 / 640,000) = 0.64.
        assert_eq!(size.of(16_000, 40), (10_240, 26));
        // 0.32 x 10 rows would be 3, too few to encode; 3 rows are left as they are.
        assert_eq!(StyleSize::Area(1024).of(1000, 10), (320, MIN_SIDE));
        assert_eq!(StyleSize::Area(1024).of(1000, 3).1, 3);
    }

    #[test]
    fn squash_ignores_proportions() {
        assert_eq!(StyleSize::Squash256.of(2048, 512), (256, 256));
        let image = Image { width: 2, height: 1, rgb: vec![0.25; 6] };
        let squashed = StyleSize::Squash256.resize(&image);
        assert_eq!((squashed.width, squashed.height), (256, 256));
        assert!(squashed.rgb.iter().all(|value| (value - 0.25).abs() < 1e-6));
    }
}
