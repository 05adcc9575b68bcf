//! `stylegaussian style`: an image's style statistics as a file, so that stylizing needs no encoder.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::{Args, CommandFactory, error::ErrorKind};
use serde::Serialize;
use stylegaussian::{ChannelStatistics, EncoderId, file};
use stylegaussian_encoder::{Encoder, Image, StyleSize, style_statistics};

use super::{Cli, output::print};
use crate::encoder::open_encoder;

/// Compute the style statistics of an image once and for all.
#[derive(Args, Debug)]
pub struct StyleArgs {
    /// The painting: PNG or JPEG.
    image: PathBuf,
    /// The file to write: *.style.safetensors.
    #[arg(short, long, value_name = "OUT.style.safetensors")]
    output: PathBuf,
    /// The encoder: an ONNX file, or VGG-19 weights as safetensors or torchvision's .pth. Otherwise the one that
    /// STYLEGAUSSIAN_ENCODER names, otherwise the default one.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// Squash the image to 256x256 whatever its proportions, as the paper's code does.
    #[arg(long)]
    squash: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Written<'a> {
    image: &'a Path,
    output: &'a Path,
    n_channels: usize,
    encoder: Option<String>,
}

/// Runs the command.
pub fn run(arguments: &StyleArgs) -> Result<()> {
    let StyleArgs { image, output, encoder, squash, json } = arguments;
    let is_safetensors =
        output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("safetensors"));
    if !is_safetensors {
        let message = format!("{}: expected extension .style.safetensors", output.display());
        return Err(Cli::command().error(ErrorKind::ValueValidation, message).into());
    }
    let encoder = open_encoder(encoder.as_deref())?;
    let size = if *squash { StyleSize::Squash256 } else { StyleSize::default() };
    let statistics = image_statistics(&encoder, image, size)?;
    file::write_style(output, &statistics)?;
    let n_channels = statistics.mean.len();
    let encoder = statistics.encoder.as_ref().map(EncoderId::to_string);
    let written = Written { image, output, n_channels, encoder };
    print(*json, &written, || format!("{}: mean and std of {n_channels} channels", output.display()))
}

/// Style statistics of the image at `path`.
pub fn image_statistics(encoder: &Encoder, path: &Path, size: StyleSize) -> Result<ChannelStatistics> {
    let image = Image::open(path)?;
    style_statistics(encoder, &image, size).with_context(|| path.display().to_string())
}
