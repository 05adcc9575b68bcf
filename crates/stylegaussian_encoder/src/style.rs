//! Statistics of a style image, which AdaIN matches.

use fast_image_resize::FilterType;
use stylegaussian::{
    ChannelStatistics,
    paint::Paint,
    work::{Canceled, Work},
};

use crate::{Encoder, EncoderError, FeatureMap, Image, image::MIN_SIDE};

/// Share of encoding an image that shrinking it takes: for large ones, and less for others.
const SHRINKING: f32 = 0.2;

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
        let resized = self.resize_if_wanted(image, &Work::default());
        resized.expect("nobody else has the work, so nobody cancels it")
    }

    /// As [`resize`](Self::resize).
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn resize_if_wanted(self, image: &Image, work: &Work) -> Result<Image, Canceled> {
        let (width, height) = self.of(image.width, image.height);
        match self {
            Self::Area(_) => image.resized_if_wanted(width, height, work),
            Self::Squash256 => image.resized_with(width, height, FilterType::Bilinear, work),
        }
    }
}

/// Features of a style image at the given size, or at the encoder's own size if it has a fixed one.
///
/// # Errors
/// As [`Encoder::encode`].
pub fn style_features(encoder: &Encoder, image: &Image, size: StyleSize) -> Result<FeatureMap, EncoderError> {
    style_features_if_wanted(encoder, image, size, &Work::default())
}

fn style_features_if_wanted(
    encoder: &Encoder,
    image: &Image,
    size: StyleSize,
    work: &Work,
) -> Result<FeatureMap, EncoderError> {
    let shrinking = work.part(0.0, SHRINKING);
    let resized = match encoder.input_size() {
        // A graph of one size leaves no choice, so `size` does not apply.
        Some((width, height)) => image.resized_if_wanted(width, height, &shrinking)?,
        None => size.resize_if_wanted(image, &shrinking)?,
    };
    encoder.encode_if_wanted(&resized, &work.part(SHRINKING, 1.0))
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
    style_statistics_if_wanted(encoder, image, size, &Work::default())
}

/// As [`style_statistics`].
///
/// # Errors
/// As [`Encoder::encode_if_wanted`].
pub fn style_statistics_if_wanted(
    encoder: &Encoder,
    image: &Image,
    size: StyleSize,
    work: &Work,
) -> Result<ChannelStatistics, EncoderError> {
    let statistics = style_features_if_wanted(encoder, image, size, work)?.statistics();
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

/// Least opacity of a pixel that paint is taken from: at half, most of what is seen there is the painting.
const OPAQUE: f32 = 0.5;

/// The painting's own paint, for which no encoder is needed. It keeps the image's proportions: strokes have a
/// shape. Pixels that are more transparent than opaque are not used.
pub fn paint_of(image: &Image) -> Paint {
    paint_of_if_wanted(image, &Work::default()).expect("nobody else has the work, so nobody cancels it")
}

/// As [`paint_of`].
///
/// # Errors
/// If `work` is canceled.
pub fn paint_of_if_wanted(image: &Image, work: &Work) -> Result<Paint, Canceled> {
    let (width, height) = Paint::size_of(image.width, image.height);
    let mut image = image.resized_if_wanted(width, height, work)?;
    if let Some(alpha) = &image.alpha {
        for (pixel, alpha) in image.rgb.chunks_exact_mut(3).zip(alpha).filter(|(_, alpha)| **alpha >= OPAQUE)
        {
            // The color itself, c, of c alpha + 1 - alpha over white.
            pixel.iter_mut().for_each(|value| *value = 1.0 - (1.0 - *value) / alpha);
        }
    }
    let used = image.alpha.as_ref().map(|alpha| alpha.iter().map(|alpha| *alpha >= OPAQUE).collect());
    Ok(Paint::new(width as usize, height as usize, &image.rgb).with_used(used))
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
    fn transparent_pixels_are_not_used_and_translucent_ones_keep_their_color() {
        let rgba = |x: u32| match x {
            0..10 => [200, 40, 10, 255],
            10..12 => [200, 40, 10, 153],
            _ => [0, 0, 0, 0],
        };
        let picture = image::RgbaImage::from_fn(20, 10, |x, _| image::Rgba(rgba(x)));
        let paint = paint_of(&Image::from(image::DynamicImage::from(picture)));
        let used = paint.used.unwrap();
        assert!(used.iter().enumerate().all(|(i, used)| *used == (i % 20 < 12)));
        let first = &paint.pixels[3 * 10..][..6];
        assert!(first.iter().zip([200, 40, 10, 200, 40, 10]).all(|(a, b)| a.abs_diff(b) <= 1), "{first:?}");
        // Opaque pixels of a file with an alpha channel are those of one without.
        let opaque = image::RgbaImage::from_fn(20, 10, |x, y| image::Rgba([x as u8, y as u8, 9, 255]));
        let opaque = image::DynamicImage::from(opaque);
        let paints =
            [opaque.to_rgb8().into(), opaque].map(|image: image::DynamicImage| paint_of(&image.into()));
        assert!(paints[0] == paints[1] && paints[0].used.is_none());
    }

    /// A picture of several bands, translucent from a row within the second one on.
    fn bands() -> image::DynamicImage {
        let opacity = |y: u32| if y < 300 { 255 } else { 100 + (y % 100) as u8 };
        let pixel = |x: u32, y: u32| image::Rgba([x as u8, y as u8, (x ^ y) as u8, opacity(y)]);
        image::RgbaImage::from_fn(1024, 700, pixel).into()
    }

    #[test]
    fn a_part_is_that_of_the_whole_image() {
        let decoded = bands();
        let whole = Image::from(decoded.clone());
        for edges in [[0, 0, 1024, 700], [0, 0, 1024, 280], [3, 20, 1000, 690], [10, 400, 11, 401]] {
            let area = [(0, 1024.0), (1, 700.0), (2, 1024.0), (3, 700.0)];
            let area = area.map(|(i, side): (usize, f32)| edges[i] as f32 / side);
            let mut expected = whole.cropped(area).unwrap();
            // An alpha channel of an opaque part says nothing.
            expected.alpha = expected.alpha.filter(|alpha| alpha.iter().any(|alpha| *alpha < 1.0));
            assert!(Image::of_part(&decoded, edges, &Work::default()).unwrap() == expected, "{edges:?}");
        }
    }

    /// A computation that is canceled once more than a share of it is done.
    fn stopping_after(stop: f32) -> Work {
        let own = std::sync::Arc::new(std::sync::OnceLock::<Work>::new());
        let known = std::sync::Arc::clone(&own);
        let work = Work::telling(move |share| {
            if share > stop {
                known.get().unwrap().cancel();
            }
        });
        own.get_or_init(|| work).clone()
    }

    #[test]
    fn an_image_that_nobody_waits_for_is_read_no_further() {
        let decoded = bands();
        let whole = Image::of_part(&decoded, [0, 0, 1024, 700], &Work::default()).unwrap();
        for stop in [0.0, 0.2, 0.5] {
            let work = stopping_after(stop);
            assert!(Image::of_part(&decoded, [0, 0, 1024, 700], &work) == Err(Canceled), "{stop}");
            assert!(work.done() < 0.9, "it went on to {}", work.done());
            let work = stopping_after(stop);
            assert!(paint_of_if_wanted(&whole, &work) == Err(Canceled), "{stop}");
            assert!(work.done() < 0.9, "it went on to {}", work.done());
        }
    }

    #[test]
    fn a_crop_keeps_its_pixels_and_their_opacity() {
        let value = |i: usize| i as f32 / 1000.0;
        let (rgb, alpha) = ((0..150).map(value).collect(), Some((0..50).map(value).collect()));
        let image = Image { width: 10, height: 5, rgb, alpha };
        let part = image.cropped([0.3, 0.2, 0.6, 0.6]).unwrap();
        assert_eq!((part.width, part.height), (3, 2));
        assert_eq!(part.alpha.unwrap(), [13, 14, 15, 23, 24, 25].map(value));
        assert_eq!(part.rgb[..3], [39, 40, 41].map(value));
        assert_eq!(image.cropped([0.0, 0.0, 1.0, 1.0]).unwrap(), image);
        for bad in [[0.5, 0.0, 0.5, 1.0], [0.0, 0.0, 1.1, 1.0], [f32::NAN, 0.0, 1.0, 1.0]] {
            assert!(image.cropped(bad).unwrap_err().to_string().contains("expected"), "{bad:?}");
        }
    }

    #[test]
    fn squash_ignores_proportions() {
        assert_eq!(StyleSize::Squash256.of(2048, 512), (256, 256));
        let image = Image { width: 2, height: 1, rgb: vec![0.25; 6], alpha: None };
        let squashed = StyleSize::Squash256.resize(&image);
        assert_eq!((squashed.width, squashed.height), (256, 256));
        assert!(squashed.rgb.iter().all(|value| (value - 0.25).abs() < 1e-6));
    }
}
