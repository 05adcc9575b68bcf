//! `stylegaussian fetch-vgg`: the official VGG-19 weights, for those who want the true features.

mod download;
mod normalize;

use std::{
    fs,
    path::{Path, PathBuf},
    sync::atomic::Ordering,
};

use anyhow::{Context, Result, bail};
use clap::Args;
use safetensors::{Dtype, tensor::TensorView};
use stylegaussian::file::write_atomically;
use stylegaussian_encoder::{onnx::Convolution, vgg::imagenet_input, weights::Weights};

use crate::train::{INTERRUPTED, loss_network::CONVOLUTIONS};
use download::download;
use normalize::normalize;

/// torchvision's copy of the weights that Oxford's Visual Geometry Group published. PyTorch names files by the first digits
/// of their SHA-256.
const OFFICIAL: &str = "https://download.pytorch.org/models/vgg19-dcbb9e9d.pth";

/// torchvision's names of [`CONVOLUTIONS`]: places among VGG-19's modules.
const MODULES: [usize; 9] = [0, 2, 5, 7, 10, 12, 14, 16, 19];

/// So many digits of a checksum at least: as many as PyTorch's names have.
const MIN_DIGITS: usize = 8;

/// Download the official VGG-19 weights (575 MB) and keep what encoders and losses need, up to relu4_1 (14 MB).
///
/// An interrupted download goes on where it stopped when the same command is given again.
#[derive(Args, Clone, Debug)]
pub struct FetchVggArgs {
    /// The weights to write.
    #[arg(short, long, value_name = "OUT.safetensors")]
    output: PathBuf,
    /// A folder of images over which each channel's mean becomes 1, by scaling that changes no ReLU network otherwise:
    /// then no channel or layer drowns another in a style's error. Without it the weights stay as they are.
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
    /// Where from; a `.pth` of torchvision's, or its tensors as `.safetensors`.
    #[arg(long, default_value = OFFICIAL)]
    url: String,
    /// The first 8 or more digits of the file's SHA-256. Otherwise those in its name, before the extension.
    #[arg(long, value_name = "HEX", value_parser = digest)]
    sha256: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// When the file cannot be had, is not what its checksum says or holds no VGG-19, or the output cannot be written.
pub fn run(arguments: &FetchVggArgs) -> Result<()> {
    let FetchVggArgs { output, images, url, sha256 } = arguments;
    let Some(digest) = sha256.clone().or_else(|| digest_in_name(url)) else {
        bail!("{url}: its name holds no checksum; name the first digits of its SHA-256 with --sha256 HEX");
    };
    // A second handler in one process (tests) is refused; the first one serves.
    let _ = ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed));
    let name = url.rsplit('/').next().unwrap_or_default();
    let download_to = output.with_file_name(format!("{name}.part.{}", extension(name)));
    download(url, &download_to, &digest)?;
    let mut convolutions = read(&download_to)?;
    if let Some(folder) = images {
        normalize(&mut convolutions, folder)?;
    }
    write(output, &convolutions)?;
    fs::remove_file(&download_to).with_context(|| format!("cannot remove {}", download_to.display()))?;
    eprintln!("wrote {}: name it with --encoder or --vgg", output.display());
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

/// The convolutions of torchvision's VGG-19 up to conv4_1, under [`CONVOLUTIONS`]' names, behind a 1x1 one that takes RGB
/// 0..1 to what they expect.
fn read(path: &Path) -> Result<Vec<(&'static str, Convolution)>> {
    let weights = Weights::open(path)?;
    let mut convolutions = vec![("conv0", imagenet_input())];
    let mut d_in = 3;
    for ((name, d_out, _), module) in CONVOLUTIONS.into_iter().zip(MODULES) {
        let convolution = weights.convolution(&format!("features.{module}"), [d_out, d_in, 3, 3])?;
        convolutions.push((name, convolution));
        d_in = d_out;
    }
    Ok(convolutions)
}

fn write(path: &Path, convolutions: &[(&str, Convolution)]) -> Result<()> {
    let mut views = Vec::new();
    for (name, Convolution { shape, weight, bias }) in convolutions {
        let view = |values, shape| TensorView::new(Dtype::F32, shape, bytemuck::cast_slice(values));
        views.push((format!("{name}.weight"), view(weight, shape.to_vec())?));
        views.push((format!("{name}.bias"), view(bias, vec![shape[0]])?));
    }
    let bytes = safetensors::serialize(views, None)?;
    Ok(write_atomically(path, |out| out.write_all(&bytes))?)
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
