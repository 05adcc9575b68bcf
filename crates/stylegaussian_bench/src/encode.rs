//! Encoding an image in memory to style statistics.

use anyhow::Result;
use stylegaussian_defaults::{ENCODER, ENCODER_NAME};
use stylegaussian_encoder::{Encoder, Image, StyleSize, style_features};

use crate::{
    measure::Samples,
    plan::Plan,
    report::{Report, Row},
    scenes::Random,
};

/// Width and height of the image in pixels, to which style images are scaled.
const SIDE: u32 = 256;

/// The built-in encoder.
pub fn default_encoder() -> Result<Encoder> {
    Ok(Encoder::from_bytes(ENCODER_NAME, ENCODER.to_vec())?)
}

/// An image of noise.
pub fn noise(side: u32) -> image::RgbImage {
    let mut random = Random::new();
    image::RgbImage::from_fn(side, side, |_, _| image::Rgb([(); 3].map(|()| (255.0 * random.next()) as u8)))
}

/// Measures features, then their statistics.
pub fn run(_plan: &Plan, report: &mut Report) -> Result<()> {
    let encoder = default_encoder()?;
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("noise.png");
    noise(SIDE).save(&path)?;
    let image = Image::open(&path)?;
    let size = StyleSize::default();
    let encode = Samples::wall(1, 5, || Ok(style_features(&encoder, &image, size).map(drop)?))?;
    report.add(Row::new("encode an image", (SIDE * SIDE) as usize, &encode));
    let features = style_features(&encoder, &image, size)?;
    let statistics = Samples::wall(1, 5, || {
        std::hint::black_box(features.statistics());
        Ok(())
    })?;
    report.add(Row::new("style statistics", (SIDE * SIDE) as usize, &statistics));
    Ok(())
}
