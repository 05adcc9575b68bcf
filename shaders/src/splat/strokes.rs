//! Shaders of strokes: the records of splats, and the draws with them.

use bytemuck::{Pod, Zeroable};
use stylegaussian::{palette::LUMINANCE, strokes as twin};

use super::{
    chunk::SplatChunk,
    text::{CHUNK, QUADS, RECORDS, source},
    tiles::blend,
};
use crate::{Source, constants, float_constants};

const MOTION: &str = include_str!("../../wgsl/splat_stroke_motion.wgsl");
const CHANGE: &str = include_str!("../../wgsl/splat_stroke_change.wgsl");
const DETAIL: &str = include_str!("../../wgsl/splat_stroke_detail.wgsl");
const RELIEF: &str = include_str!("../../wgsl/splat_stroke_relief.wgsl");

/// Motions of a chunk's strokes at most.
pub const MAX_MOTIONS: usize = 8;
/// Changes of a chunk's strokes at most.
pub const MAX_CHANGES: usize = 8;
/// [`StrokeChange::motion`] of strokes that keep their own.
pub const OWN_MOTION: u32 = u32::MAX;
/// [`StrokeChange::motion`] of strokes that stand still.
pub const NO_MOTION: u32 = u32::MAX - 1;

/// How the strokes of some seeds move, now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct StrokeMotion {
    /// The unit direction of a flow, in scene space.
    pub toward: [f32; 3],
    /// The first seed that moves so.
    pub first: u32,
    /// The number after that of the last one.
    pub end: u32,
    /// One of the twin's `KIND_` constants.
    pub kind: u32,
    /// Number of the present drawing of strokes that are redrawn, or the bits of the part of the present run of
    /// strokes that run, an f32 of 0..1.
    pub phase: u32,
    /// Distance in widths of a stroke.
    pub amount: f32,
}

/// A point of a curve that strokes run along.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct CurvePoint {
    /// Its place, in scene space.
    pub at: [f32; 3],
    /// Unused.
    pub padding_0: f32,
    /// Unit direction of the curve there; 0 if it turns back.
    pub toward: [f32; 3],
    /// Unused.
    pub padding_1: f32,
}

/// A change of the strokes in a part of the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct StrokeChange {
    /// Their unit direction in scene space; 0 if they keep their own.
    pub direction: [f32; 3],
    /// What is added to the numbers of changed seeds.
    pub first: u32,
    /// Factor of their gains.
    pub gain: f32,
    /// Factor of their size.
    pub stroke_scale: f32,
    /// Factor of the thickness of their paint.
    pub relief: f32,
    /// Index of their motion, [`OWN_MOTION`] or [`NO_MOTION`].
    pub motion: u32,
    /// Thickness of paint that is added to that below.
    pub added_relief: f32,
    /// Points of a curve, along which strokes run in place of the direction.
    pub n_points: u32,
    /// Unused.
    pub padding_0: u32,
    /// Unused.
    pub padding_1: u32,
    /// The points.
    pub points: [CurvePoint; twin::MAX_CURVE_POINTS],
}

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
    /// Motions that count; 0 if all strokes stand still.
    pub n_motions: u32,
    /// The unit direction to the light, in scene space.
    pub light: [f32; 3],
    /// Factor of the thickness of paint.
    pub relief: f32,
    /// 1 if any paint of the view has relief, else 0.
    pub n_lights: u32,
    /// 1 if strokes keep their size on screen, else 0.
    pub is_stable: u32,
    /// Changes that count; 0 if no strokes are changed.
    pub n_changes: u32,
    /// Unused.
    pub padding: u32,
    /// The motions, each of other seeds.
    pub motions: [StrokeMotion; MAX_MOTIONS],
    /// The changes, the topmost first.
    pub changes: [StrokeChange; MAX_CHANGES],
}

/// The uniforms of a draw with strokes.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct StrokeDraw {
    /// Share of finer strokes that are added where a painting is magnified.
    pub near: f32,
    /// 1 if there is relief, else 0.
    pub n_lights: u32,
    /// 1 if strokes keep their size on screen, else 0.
    pub is_stable: u32,
    /// Binary logarithm of their size.
    pub scale_octaves: f32,
}

/// The constants of the CPU twin.
pub(crate) fn twin_constants() -> String {
    let integers = constants(&[
        ("SEED_BITS", twin::SEED_BITS),
        ("SEVEN_BITS", twin::SEVEN_BITS),
        ("DIRECTION_SHIFT", twin::DIRECTION_SHIFT),
        ("KIND_BOIL", twin::KIND_BOIL),
        ("KIND_FLOW", twin::KIND_FLOW),
        ("MAX_MOTIONS", MAX_MOTIONS as u32),
        ("MAX_CHANGES", MAX_CHANGES as u32),
        ("MAX_CURVE_POINTS", twin::MAX_CURVE_POINTS as u32),
        ("OWN_MOTION", OWN_MOTION),
    ]);
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
        ("STROKE", twin::STROKE),
        ("TURN", twin::TURN),
        ("FADE", twin::FADE),
        ("ACROSS", twin::ACROSS),
        ("SLOW", twin::SLOW),
        ("STABLE_OCTAVES", twin::STABLE_OCTAVES as f32),
        ("NEAREST", twin::NEAREST),
        ("FARTHEST", twin::FARTHEST),
        ("THICKNESS", twin::THICKNESS),
        ("STEEPEST", twin::STEEPEST),
        ("BLURRIER", twin::BLURRIER),
        ("SHININESS", twin::SHININESS),
        ("GLOSS", twin::GLOSS),
        ("IN_LIGHT", twin::IN_LIGHT),
        ("IN_PLANE", twin::IN_PLANE),
        ("DIRECTION_STEP", std::f32::consts::PI / twin::DIRECTIONS as f32),
    ]);
    let [r, g, b] = LUMINANCE.to_array();
    integers + &floats + &format!("const LUMINANCE = vec3<f32>({r:?}, {g:?}, {b:?});\n")
}

/// Writes the strokes of splats.
pub fn records() -> Source {
    let kernel = include_str!("../../wgsl/splat_strokes.wgsl");
    source("splat_strokes", &[&twin_constants(), RECORDS, CHUNK, MOTION, CHANGE, kernel])
}

/// Draws the sorted splats with strokes.
pub fn draw() -> Source {
    let draw = include_str!("../../wgsl/splat_draw_strokes.wgsl");
    source("splat_draw_strokes", &[&twin_constants(), RECORDS, QUADS, DETAIL, RELIEF, draw])
}

/// Blends the lists of tiles with strokes, with or without a depth texture.
pub fn tiles_blend(tested: bool) -> Source {
    blend(tested, &[&twin_constants(), DETAIL, RELIEF, include_str!("../../wgsl/splat_tiles_painted.wgsl")])
}
