//! From an image in memory to style statistics.

use anyhow::Result;
use stylegaussian_encoder::{Image, StyleSize, style_features};
use stylegaussian_tools::encoder::open_encoder;

use crate::{
    measure::Samples,
    plan::Plan,
    report::{Report, Row},
    scenes::Random,
};

/// Width and height of the image: what style images are scaled to.
const SIDE: u32 = 256;

/// An image of noise.
pub fn noise(side: u32) -> image::RgbImage {
    let mut random = Random::new();
    image::RgbImage::from_fn(side, side, |_, _| image::Rgb([(); 3].map(|()| (255.0 * random.next()) as u8)))
}

/// Features, then their statistics.
pub fn run(_plan: &Plan, report: &mut Report) -> Result<()> {
    // The one that the environment names, otherwise the default one.
    let encoder = open_encoder(None)?;
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
