//! From an image in memory to style statistics.

use anyhow::{Context, Result};
use stylegaussian_encoder::{Encoder, Image, StyleSize, resolve, style_features};

use crate::{
    measure::Samples,
    plan::Plan,
    report::{Report, Row},
    scenes::Random,
};

/// Width and height of the image: what style images are scaled to.
const SIDE: u32 = 256;

/// The encoder that the environment names.
pub fn encoder() -> Result<Encoder> {
    resolve(None, None).context("weights of VGG-19 do not ship with the repository")
}

/// An image of noise.
pub fn noise(side: u32) -> image::RgbImage {
    let mut random = Random::new();
    image::RgbImage::from_fn(side, side, |_, _| image::Rgb([(); 3].map(|()| (255.0 * random.next()) as u8)))
}

/// Features, then their statistics.
pub fn run(_plan: &Plan, report: &mut Report) -> Result<()> {
    let encoder = encoder()?;
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
