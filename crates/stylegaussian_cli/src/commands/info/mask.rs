//! The description of a mask.

use std::path::Path;

use anyhow::Result;
use serde::Serialize;
use stylegaussian::mask::CHANNELS;
use stylegaussian_files::read_mask;

use crate::terminal::{lossy, print};

#[derive(Serialize)]
struct MaskInfo<'a> {
    #[serde(serialize_with = "lossy")]
    path: &'a Path,
    n_gaussians: usize,
    /// The fingerprint of its scene.
    fingerprint: String,
    channels: Vec<Channel<'a>>,
}

/// A channel that has a name or is painted.
#[derive(Debug, Serialize)]
pub struct Channel<'a> {
    index: usize,
    name: &'a str,
    /// Gaussians with a weight above 0.
    n_painted: usize,
}

/// Describes the mask at `path`.
///
/// # Errors
/// If it cannot be read.
pub fn run(path: &Path, json: bool) -> Result<()> {
    let mask = read_mask(path)?;
    let channels = used(&mask.names, mask.n_painted());
    let fingerprint = mask.scene.to_string();
    let info = MaskInfo { path, n_gaussians: mask.len(), fingerprint, channels };
    print(json, &info, || text(&info))
}

/// The channels of a scene's mask that are in use.
pub fn channels<'a>(names: &'a [String; CHANNELS], weights: &[[u8; CHANNELS]]) -> Vec<Channel<'a>> {
    used(names, [0, 1, 2, 3].map(|c| weights.iter().filter(|weights| weights[c] > 0).count()))
}

fn used(names: &[String; CHANNELS], n_painted: [usize; CHANNELS]) -> Vec<Channel<'_>> {
    let channels = names.iter().zip(n_painted).enumerate();
    let channels = channels.map(|(index, (name, n_painted))| Channel { index, name, n_painted });
    channels.filter(|channel| !channel.name.is_empty() || channel.n_painted > 0).collect()
}

/// The channels on one line.
pub fn text_of(channels: &[Channel]) -> String {
    if channels.is_empty() {
        return "unpainted".into();
    }
    let one = |Channel { index, name, n_painted }: &Channel| {
        let name = if name.is_empty() { String::new() } else { format!(" `{name}`") };
        format!("channel {index}{name} on {n_painted}")
    };
    channels.iter().map(one).collect::<Vec<_>>().join(", ")
}

fn text(info: &MaskInfo) -> String {
    [
        info.path.display().to_string(),
        format!("  Gaussians   {}", info.n_gaussians),
        format!("  fingerprint {}", info.fingerprint),
        format!("  painted     {}", text_of(&info.channels)),
    ]
    .join("\n")
}
