//! `stylegaussian fetch-vgg`: downloads the official VGG-19 weights, for VGG-19's own features.

use std::{fs, path::PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use stylegaussian_train::nn::{
    normalize::normalize,
    vgg::{read_torchvision, write_weights},
};

use crate::{
    download::download,
    terminal::{Interrupt, note},
};

/// torchvision's copy of the weights that Oxford's Visual Geometry Group published. PyTorch puts the first
/// digits of a file's SHA-256 into its name.
const OFFICIAL: &str = "https://download.pytorch.org/models/vgg19-dcbb9e9d.pth";

/// Least number of digits of a checksum, as in PyTorch's names.
const MIN_DIGITS: usize = 8;

/// Download the official VGG-19 weights (575 MB) and keep the layers up to relu4_1 (14 MB).
///
/// The same command resumes an interrupted download.
#[derive(Args, Debug)]
pub struct FetchVggArgs {
    /// The weights to write.
    #[arg(short, long, value_name = "OUT.safetensors")]
    output: PathBuf,
    /// A folder of images. The weights are scaled so that over these images every channel has mean 1, which
    /// keeps single channels or layers from dominating a style error. A ReLU network is otherwise unchanged.
    /// Default: no scaling.
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
    /// The address of torchvision's `.pth`, or of its tensors as `.safetensors`.
    #[arg(long, default_value = OFFICIAL)]
    url: String,
    /// The first 8 or more digits of the file's SHA-256. Default: those in its name, before the extension.
    #[arg(long, value_name = "HEX", value_parser = digest)]
    sha256: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// If the download fails, its checksum differs, it does not hold VGG-19, or the output cannot be written.
pub fn run(arguments: &FetchVggArgs, interrupt: &Interrupt) -> Result<()> {
    let FetchVggArgs { output, images, url, sha256 } = arguments;
    let Some(digest) = sha256.clone().or_else(|| digest_in_name(url)) else {
        bail!("{url}: its name holds no checksum; name the first digits of its SHA-256 with --sha256 HEX");
    };
    let name = url.rsplit('/').next().unwrap_or_default();
    // A name that does not change, so that the same command finds the part. The extension stays last, because
    // reading goes by it.
    let download_to = output.with_file_name(format!("{name}.part.{}", extension(name)));
    download(url, &download_to, &digest, interrupt.watch())?;
    let mut convolutions = read_torchvision(&download_to)?;
    if let Some(folder) = images {
        normalize(&mut convolutions, folder)?;
    }
    write_weights(output, &convolutions)?;
    // Last: if writing fails, 575 MB need not come again.
    fs::remove_file(&download_to).with_context(|| format!("cannot remove {}", download_to.display()))?;
    note(format!("wrote {}: name it with --encoder or --vgg", output.display()));
    Ok(())
}

/// `dcbb9e9d` of `vgg19-dcbb9e9d.pth`.
fn digest_in_name(url: &str) -> Option<String> {
    let stem = url.rsplit('/').next()?.rsplit_once('.')?.0;
    digest(stem.rsplit_once('-')?.1).ok()
}

/// The beginning of a SHA-256, in lower case.
fn digest(text: &str) -> Result<String, String> {
    if (MIN_DIGITS..=64).contains(&text.len()) && text.chars().all(|digit| digit.is_ascii_hexdigit()) {
        Ok(text.to_lowercase())
    } else {
        Err(format!("expected {MIN_DIGITS} to 64 hexadecimal digits"))
    }
}

fn extension(name: &str) -> &str {
    if name.ends_with(".safetensors") { "safetensors" } else { "pth" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_hold_checksums() {
        assert_eq!(digest_in_name(OFFICIAL).as_deref(), Some("dcbb9e9d"));
        for without in ["https://a.org/vgg19.pth", "https://a.org/vgg-19.pth", "vgg19-notahash.pth", ""] {
            assert_eq!(digest_in_name(without), None, "{without}");
        }
    }

    #[test]
    fn a_checksum_says_something() {
        assert_eq!(digest("DCBB9E9D").as_deref(), Ok("dcbb9e9d"));
        for short_or_long in ["", "dcbb9e9", "dcbb9e9g", &"0".repeat(65)] {
            assert!(digest(short_or_long).is_err(), "{short_or_long}");
        }
    }
}
