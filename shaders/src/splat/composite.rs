//! Shaders of the composite, and of the edges of meshes that it shows in single samples.

use bytemuck::{Pod, Zeroable};

use super::{light, text::source};
use crate::Source;

/// The layers that the composite reads, and its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CompositeKind {
    /// One layer, over a target of any number of samples.
    Single,
    /// The layers of both sides of edges, over a target of several samples.
    Multi,
    /// The same, over a target of one.
    Resolved,
}

/// Puts the layer over a picture.
pub fn composite(kind: CompositeKind) -> Source {
    let composite = include_str!("../../wgsl/splat_composite.wgsl");
    let layers = include_str!("../../wgsl/splat_composite_layers.wgsl");
    let target: &[&str] = match kind {
        CompositeKind::Single => &[include_str!("../../wgsl/splat_composite_single.wgsl")],
        CompositeKind::Multi => &[layers, include_str!("../../wgsl/splat_composite_multi.wgsl")],
        CompositeKind::Resolved => &[layers, include_str!("../../wgsl/splat_composite_resolved.wgsl")],
    };
    source("splat_composite", &[&[&light::twin_constants(), light::INVERSE, composite], target].concat())
}

/// Lifts what is exactly black before a tone mapping.
pub fn lift() -> Source {
    source("splat_lift", &[include_str!("../../wgsl/splat_lift.wgsl")])
}

/// The depth of meshes on the farther side of edges, or on the nearer side.
pub fn edges(nearer: bool) -> Source {
    let edges = include_str!("../../wgsl/splat_edges.wgsl");
    match nearer {
        false => source("splat_edges_farther", &[edges, include_str!("../../wgsl/splat_edges_farther.wgsl")]),
        true => source("splat_edges_nearer", &[edges, include_str!("../../wgsl/splat_edges_nearer.wgsl")]),
    }
}

/// The uniforms of the composite.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SplatComposite {
    /// The camera's factor on colors before tone mapping: 2^exposure of its color grading.
    pub exposure: f32,
}

/// The uniforms of the search for edges.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatEdges {
    /// Depths of one pixel that differ by more than x d + y at depth d are an edge.
    pub limit: [f32; 2],
}
