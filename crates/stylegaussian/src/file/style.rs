//! Style statistics: `*.style.safetensors`.
//!
//! Tensors `mean` and `std_dev` f32 `[D]`, optionally `covariance` f32 `[D, D]`. Metadata `format`, `version` and, if
//! known, `encoder`.

use crate::statistics::ChannelStatistics;

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
