//! `stylegaussian style`: writes an image's style statistics and its paint to a file, so that stylizing needs
//! no encoder.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use serde::Serialize;
use stylegaussian::EncoderId;
use stylegaussian_encoder::{StyleSize, image::format_names};
use stylegaussian_files::{write_painted_style, write_style};

use crate::{
    arguments::area,
    choose::open_encoder,
    outputs::expect_files,
    stylization::image_style,
    terminal::{lossy, print, usage_error},
};

/// Compute the style statistics and the paint of an image, so that stylizing needs no encoder.
#[derive(Args, Debug)]
pub struct StyleArgs {
    #[arg(help = image_help())]
    image: PathBuf,
    /// The file to write: *.style.safetensors.
    #[arg(short, long, value_name = "OUT.style.safetensors")]
    output: PathBuf,
    /// The encoder: a file of `distill`, VGG-19 weights (safetensors, .pth) or an ONNX file. Default: the file
    /// in STYLEGAUSSIAN_ENCODER, else the built-in encoder.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// Use only this part of the image: left edge, top edge, width and height as shares of the sides.
    #[arg(long, value_name = "X,Y,W,H", value_parser = area, allow_hyphen_values = true)]
    style_crop: Option<[f32; 4]>,
    /// Resize the image to 256x256 without keeping its proportions, as the paper's code does.
    #[arg(long)]
    squash: bool,
    /// Write the statistics alone (2 KiB), for the decoder, and not the painting's paint (up to 0.9 MB).
    #[arg(long)]
    no_paint: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

fn image_help() -> String {
    format!("The painting: {}", format_names())
}

#[derive(Serialize)]
struct Written<'a> {
    #[serde(serialize_with = "lossy")]
    image: &'a Path,
    #[serde(serialize_with = "lossy")]
    output: &'a Path,
    n_channels: usize,
    encoder: Option<String>,
}

/// Runs the command.
pub fn run(arguments: &StyleArgs) -> Result<()> {
    let StyleArgs { image, output, encoder, style_crop, squash, no_paint, json } = arguments;
    let is_safetensors =
        output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("safetensors"));
    if !is_safetensors {
        return Err(usage_error(format!("{}: expected extension .style.safetensors", output.display())));
    }
    expect_files([&**output])?;
    let encoder = open_encoder(encoder.as_deref())?;
    let size = if *squash { StyleSize::Squash256 } else { StyleSize::default() };
    let (statistics, paint) = image_style(&encoder, image, *style_crop, size)?;
    if *no_paint {
        write_style(output, &statistics)?;
    } else {
        write_painted_style(output, &statistics, &paint)?;
    }
    let n_channels = statistics.mean.len();
    let encoder = statistics.encoder.as_ref().map(EncoderId::to_string);
    let written = Written { image, output, n_channels, encoder };
    print(*json, &written, || format!("{}: mean and std of {n_channels} channels", output.display()))
}
