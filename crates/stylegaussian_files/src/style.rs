//! Style statistics: `*.style.safetensors`.
//!
//! Tensors `mean` and `std_dev` f32 `[D]`, optionally `covariance` f32 `[D, D]`. Metadata `format`, `version`
//! and, if known, `encoder`.
//!
//! Optionally the painting's paint: `paint` u8 `[height, width, 3]`, and if some pixels must not be used,
//! `used` u8 `[height, width]`, 0 for those and else 1. Readers that know only statistics ignore both.

use stylegaussian::{
    paint::{MAX_PIXELS, Paint},
    statistics::ChannelStatistics,
};

use super::{
    error::{Mismatch, mismatch},
    tensors::{
        Dimension::{Any, Is},
        Reader, Writer, expect_finite,
    },
};

const FORMAT: &str = "stylegaussian-style";

pub(super) fn from_bytes(bytes: &[u8]) -> Result<ChannelStatistics, Mismatch> {
    let reader = Reader::new(bytes)?;
    reader.expect_format(FORMAT)?;
    let mean = reader.floats("mean", &[Any("D")])?;
    let d = mean.len();
    let std_dev = reader.floats("std_dev", &[Is(d)])?;
    let covariance = match reader.has("covariance") {
        true => Some(reader.floats("covariance", &[Is(d), Is(d)])?),
        false => None,
    };
    let encoder = reader.parsed("encoder", "an encoder `name@hash`")?;
    let style = ChannelStatistics { mean, std_dev, covariance, encoder };
    validate(&style)?;
    Ok(style)
}

pub(super) fn prepare(style: &ChannelStatistics) -> Result<Writer<'_>, Mismatch> {
    validate(style)?;
    let d = style.mean.len();
    let mut writer = Writer::new(FORMAT);
    writer.f32("mean", &[d], &style.mean);
    writer.f32("std_dev", &[d], &style.std_dev);
    if let Some(covariance) = &style.covariance {
        writer.f32("covariance", &[d, d], covariance);
    }
    if let Some(encoder) = &style.encoder {
        writer.set("encoder", encoder);
    }
    Ok(writer)
}

/// The paint in the bytes of a style, or `None` if it carries none.
pub(super) fn paint_from_bytes(bytes: &[u8]) -> Result<Option<Paint>, Mismatch> {
    let reader = Reader::new(bytes)?;
    reader.expect_format(FORMAT)?;
    if !reader.has("paint") {
        return Ok(None);
    }
    let (pixels, shape) = reader.bytes("paint", &[Any("height"), Any("width"), Is(3)])?;
    let paint = Paint { width: shape[1], height: shape[0], pixels: pixels.to_vec(), used: None };
    validate_paint(&paint)?;
    if !reader.has("used") {
        return Ok(Some(paint));
    }
    let (used, _) = reader.bytes("used", &[Is(paint.height), Is(paint.width)])?;
    if let Some(other) = used.iter().find(|used| **used > 1) {
        return Err(mismatch(format_args!("{other} in `used`"), "0 or 1"));
    }
    let used = used.iter().map(|used| *used == 1).collect();
    Ok(Some(paint.with_used(Some(used))))
}

/// The tensors of a style with its paint.
pub(super) fn prepare_painted<'a>(
    style: &'a ChannelStatistics,
    paint: &'a Paint,
) -> Result<Writer<'a>, Mismatch> {
    let mut writer = prepare(style)?;
    validate_paint(paint)?;
    writer.u8("paint", &[paint.height, paint.width, 3], &paint.pixels);
    if let Some(used) = &paint.used {
        let bytes: Vec<u8> = used.iter().map(|used| u8::from(*used)).collect();
        writer.u8("used", &[paint.height, paint.width], bytes);
    }
    Ok(writer)
}

fn validate_paint(paint: &Paint) -> Result<(), Mismatch> {
    let Paint { width, height, pixels, used } = paint;
    let n_pixels = width.saturating_mul(*height);
    if n_pixels == 0 || n_pixels > MAX_PIXELS || pixels.len() != 3 * n_pixels {
        let found = format_args!("a painting of {width}x{height} pixels in {} bytes", pixels.len());
        return Err(mismatch(found, format_args!("1 to {MAX_PIXELS} pixels of 3 bytes")));
    }
    if let Some(used) = used.as_ref().filter(|used| used.len() != n_pixels) {
        return Err(mismatch(format_args!("{} pixels in `used`", used.len()), format_args!("{n_pixels}")));
    }
    Ok(())
}

fn validate(style: &ChannelStatistics) -> Result<(), Mismatch> {
    let d = style.mean.len();
    if d == 0 {
        return Err(mismatch("a style of no channels", "at least one"));
    }
    if style.std_dev.len() != d {
        return Err(mismatch(
            format_args!("{} standard deviations", style.std_dev.len()),
            format_args!("{d}"),
        ));
    }
    expect_finite("mean", &style.mean)?;
    expect_finite("std_dev", &style.std_dev)?;
    if let Some(negative) = style.std_dev.iter().find(|&&value| value < 0.0) {
        return Err(mismatch(format_args!("standard deviation {negative}"), "0 or more"));
    }
    if let Some(covariance) = &style.covariance {
        if covariance.len() != d * d {
            return Err(mismatch(format_args!("a covariance of {} values", covariance.len()), d * d));
        }
        expect_finite("covariance", covariance)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
