//! Shaders of shadows that splats cast: cores, and their depths in shadow maps.

use bytemuck::{Pod, Zeroable};

use super::text::{CHUNK, FOOTPRINT, ONE_EYE, RECORDS, mask, source};
use crate::Source;

/// Finds cores, those of clouds with a mask or of clouds without.
pub fn cores(masked: bool) -> Source {
    let kernel = include_str!("../../wgsl/splat_cores.wgsl");
    source("splat_cores", &[RECORDS, CHUNK, mask(masked), ONE_EYE, FOOTPRINT, kernel])
}

/// Draws cores into depths.
pub fn draw() -> Source {
    source("splat_cast", &[RECORDS, include_str!("../../wgsl/splat_cast.wgsl")])
}

/// Writes these depths into a shadow map.
pub fn write() -> Source {
    source("splat_cast_write", &[include_str!("../../wgsl/splat_cast_write.wgsl")])
}

/// The core of a splat in a shadow map. With `place` in the disc of radius 1, it is center + (width place.x, 0)
/// + slant place.y, in normalized device coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatCore {
    /// The middle.
    pub center: [f32; 2],
    /// Step from the middle to the lower edge, at `place` (0, 1).
    pub slant: [f32; 2],
    /// Half the width of the core's middle row.
    pub width: f32,
    /// Depth of the core's far end, 0..1, reverse z.
    pub depth: f32,
}

/// Arguments of the indirect draw of cores.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct CoreCommand {
    /// Three for each core.
    pub n_vertices: u32,
    /// 1.
    pub n_instances: u32,
    /// 0.
    pub first_vertex: u32,
    /// 0.
    pub first_instance: u32,
}
