//! Masks: `*.mask.safetensors`, and the same in scene files.
//!
//! | tensor | type and shape | |
//! | --- | --- | --- |
//! | `mask` | u8 `[N, C]` | C in 1..=4; one row per Gaussian of the scene |
//!
//! A mask file has its rows in the order of the scene's source, a scene file in its own order.
//!
//! | metadata | value |
//! | --- | --- |
//! | `mask_channels` | a JSON list of the C channels' names |
//! | `scene` | `N@hash`, the scene's [`SceneFingerprint`]; in a mask file |

use stylegaussian::{
    look::SceneFingerprint,
    mask::{CHANNELS, Mask, StoredMask},
};

use super::{
    error::{Mismatch, mismatch},
    tensors::{
        Dimension::{Any, Is},
        Reader, Writer,
    },
};

const FORMAT: &str = "stylegaussian-mask";

/// The tensor.
pub(super) const TENSOR: &str = "mask";

/// Metadata with the names of its channels.
const NAMES: &str = "mask_channels";

pub(super) fn from_bytes(bytes: &[u8]) -> Result<StoredMask, Mismatch> {
    let reader = Reader::new(bytes)?;
    reader.expect_format(FORMAT)?;
    let scene: SceneFingerprint = reader.required("scene", "`scene` = `N@hash`, the scene's fingerprint")?;
    let Mask { weights, names, .. } = from_tensor(&reader, scene.n_gaussians)?;
    Ok(StoredMask { weights, names, scene })
}

/// The mask of the `n` Gaussians in a file, in the file's order.
pub(super) fn from_tensor(reader: &Reader, n: usize) -> Result<Mask, Mismatch> {
    let (bytes, shape) = reader.bytes(TENSOR, &[Is(n), Any("C")])?;
    let n_channels = shape[1];
    if !(1..=CHANNELS).contains(&n_channels) {
        return Err(mismatch(
            format_args!("a mask of {n_channels} channels"),
            format_args!("1 to {CHANNELS}"),
        ));
    }
    let mut mask = Mask::new(n);
    for (weights, row) in mask.weights.iter_mut().zip(bytes.chunks_exact(n_channels)) {
        weights[..n_channels].copy_from_slice(row);
    }
    let text: String = reader.required(NAMES, "`mask_channels` = a JSON list")?;
    let names: Option<Vec<String>> = serde_json::from_str(&text).ok();
    let expected = || format!("a JSON list of {n_channels} names, one for each channel");
    match names {
        Some(names) if names.len() == n_channels => {
            mask.names.iter_mut().zip(names).for_each(|(to, name)| *to = name);
            Ok(mask)
        }
        Some(names) => Err(mismatch(format_args!("{} names in `{NAMES}`", names.len()), expected())),
        None => Err(mismatch(format_args!("metadata `{NAMES}` of another form"), expected())),
    }
}

/// The tensors and metadata of a mask file.
pub(super) fn prepare(mask: &StoredMask) -> Result<Writer<'static>, Mismatch> {
    let n = mask.scene.n_gaussians;
    if mask.len() != n {
        return Err(mismatch(format_args!("{} weights", mask.len()), format_args!("{n}, one per Gaussian")));
    }
    let mut writer = Writer::new(FORMAT);
    to_tensor(&mask.weights, &mask.names, &mut writer);
    writer.set("scene", mask.scene);
    Ok(writer)
}

/// Adds a mask to a file whose Gaussians are in the order of `weights`. Channels after the last one that has a
/// name or a weight are left out.
pub(super) fn to_tensor(weights: &[[u8; CHANNELS]], names: &[String; CHANNELS], writer: &mut Writer) {
    let is_used =
        |&channel: &usize| !names[channel].is_empty() || weights.iter().any(|weights| weights[channel] > 0);
    let n_channels = 1 + (0..CHANNELS).rfind(is_used).unwrap_or(0);
    let bytes: Vec<u8> = weights.iter().flat_map(|weights| &weights[..n_channels]).copied().collect();
    writer.u8(TENSOR, &[weights.len(), n_channels], bytes);
    writer.set(NAMES, serde_json::json!(names[..n_channels]));
}

#[cfg(test)]
pub(super) mod tests;
