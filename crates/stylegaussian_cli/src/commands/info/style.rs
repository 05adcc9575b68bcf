//! The description of a style preset.

use std::path::Path;

use anyhow::Result;
use serde::Serialize;
use stylegaussian::EncoderId;
use stylegaussian_files::{read_paint, read_style};

use super::or_unknown;
use crate::terminal::{lossy, print};

#[derive(Serialize)]
struct StyleInfo<'a> {
    #[serde(serialize_with = "lossy")]
    path: &'a Path,
    /// D, the channels of the statistics.
    n_channels: usize,
    encoder: Option<String>,
    /// Whether the covariance of the channels is there too.
    has_covariance: bool,
    /// Width and height of the painting in pixels, or `None` if the style can only be decoded.
    paint: Option<[usize; 2]>,
}

/// Describes the style at `path`.
///
/// # Errors
/// If it cannot be read.
pub fn run(path: &Path, json: bool) -> Result<()> {
    let (style, paint) = (read_style(path)?, read_paint(path)?);
    let info = StyleInfo {
        path,
        n_channels: style.mean.len(),
        encoder: style.encoder.as_ref().map(EncoderId::to_string),
        has_covariance: style.covariance.is_some(),
        paint: paint.map(|paint| [paint.width, paint.height]),
    };
    print(json, &info, || text(&info))
}

fn text(info: &StyleInfo) -> String {
    let covariance = if info.has_covariance { " with their covariance" } else { "" };
    let paint = info.paint.map_or_else(
        || "none: it is decoded; `stylegaussian style IMAGE` makes one with paint".into(),
        |[width, height]| format!("{width}x{height} pixels"),
    );
    [
        info.path.display().to_string(),
        format!(
            "  statistics  {} channels{covariance}, encoder {}",
            info.n_channels,
            or_unknown(&info.encoder)
        ),
        format!("  paint       {paint}"),
    ]
    .join("\n")
}
