//! Files that several shaders of the splat pass share, and how they are joined.

use super::numbers::in_wgsl;
use crate::Source;

pub(super) const RECORDS: &str = include_str!("../../wgsl/splat_records.wgsl");
pub(super) const CHUNK: &str = include_str!("../../wgsl/splat_chunk.wgsl");
pub(super) const FOOTPRINT: &str = include_str!("../../wgsl/splat_footprint.wgsl");
pub(super) const ONE_EYE: &str = include_str!("../../wgsl/splat_one_eye.wgsl");
pub(super) const QUADS: &str = include_str!("../../wgsl/splat_quads.wgsl");

/// A shader from the numbers and its files.
pub(super) fn source(label: &'static str, files: &[&str]) -> Source {
    Source { label, wgsl: in_wgsl() + &files.join("\n") }
}

/// The opacities of clouds with a mask or of clouds without.
pub(super) fn mask(masked: bool) -> &'static str {
    match masked {
        false => include_str!("../../wgsl/splat_unmasked.wgsl"),
        true => include_str!("../../wgsl/splat_masked.wgsl"),
    }
}
