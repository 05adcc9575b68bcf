//! Shaders of strokes: the records of splats, and the draws with them.

use bytemuck::{Pod, Zeroable};
use stylegaussian::strokes as twin;

use super::{CHUNK, QUADS, RECORDS, SplatChunk, blend, source};
use crate::{Source, constants, float_constants};

const DETAIL: &str = include_str!("../../wgsl/splat_stroke_detail.wgsl");

/// A chunk, and the factors that change without computing strokes anew.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct StrokeChunk {
    /// The chunk.
    pub chunk: SplatChunk,
    /// Factor of all gains.
    pub amount: f32,
    /// Factor of protection.
    pub protection: f32,
    /// Factor of the size of strokes.
    pub stroke_scale: f32,
    /// Unused.
    pub padding: u32,
}

/// The uniforms of a draw with strokes.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct StrokeDraw {
    /// Share of finer strokes that are added where a painting is magnified.
    pub near: f32,
    /// Unused.
    pub padding_0: u32,
    /// Unused.
    pub padding_1: u32,
    /// Unused.
    pub padding_2: u32,
}

/// The constants of the CPU twin.
fn twin_constants() -> String {
    let integers = constants(&[("SEED_BITS", twin::SEED_BITS), ("SEVEN_BITS", twin::SEVEN_BITS)]);
    let floats = float_constants(&[
        ("MAX_GAIN", twin::MAX_GAIN),
        ("PERIOD", twin::PERIOD),
        ("FINE_SIDE", twin::FINE_SIDE as f32),
        ("WIDE_LEVEL", twin::WIDE_LEVEL),
        ("LEAST_ALPHA", twin::LEAST_ALPHA),
        ("MOST_OCTAVES", twin::MOST_OCTAVES as f32),
        ("PROTECTED", twin::PROTECTED),
        ("LEAST_LEVEL", twin::LEVELS.0),
        ("MOST_LEVEL", twin::LEVELS.1),
        ("SHARPER", twin::SHARPER),
        ("FLATTEST", twin::FLATTEST),
        ("EDGE_ON", twin::EDGE_ON),
        ("MAX_STEP", twin::MAX_STEP),
    ]);
    integers + &floats
}

/// Writes the strokes of splats.
pub fn records() -> Source {
    let kernel = include_str!("../../wgsl/splat_strokes.wgsl");
    source("splat_strokes", &[&twin_constants(), RECORDS, CHUNK, kernel])
}

/// Draws the sorted splats with strokes.
pub fn draw() -> Source {
    let draw = include_str!("../../wgsl/splat_draw_strokes.wgsl");
    source("splat_draw_strokes", &[&twin_constants(), RECORDS, QUADS, DETAIL, draw])
}

/// Blends the lists of tiles with strokes, with or without a depth texture.
pub fn tiles_blend(tested: bool) -> Source {
    blend(tested, &[&twin_constants(), DETAIL, include_str!("../../wgsl/splat_tiles_painted.wgsl")])
}
