//! The dispatches of a mix: which layers touch which blocks, and what is there already.

use std::ops::Range;

use glam::Vec3;
use stylegaussian::layers::{Cover, Region, RegionCover};
use stylegaussian_shaders::layers::{STARTS, WITHIN};

use super::GpuLayer;
use crate::{
    colors::GaussianColors,
    splat::{Ball, GpuScene},
};

/// Blocks that are asked about together first.
const GROUP: usize = 32;

/// The layers that colors hold, from the last mix. Regions that did not move are not asked again, and blocks whose colors stay
/// as they are take no part in the next mix.
#[derive(Debug, Default)]
pub struct MixedLayers {
    /// The colors, or `None` if they may hold anything.
    colors: Option<wgpu::Buffer>,
    layers: Vec<MixedLayer>,
}

/// A layer of the last mix.
#[derive(Debug)]
struct MixedLayer {
    region: Region,
    source: Source,
    /// How the region covers each block, over all chunks.
    covers: Vec<Cover>,
}

/// Everything that a layer's colors depend on, except its region.
#[derive(Debug, PartialEq)]
struct Source {
    look: Option<(wgpu::Buffer, u64)>,
    mask: Option<(wgpu::Buffer, u64, u32)>,
    strength: f32,
}

/// A dispatch of the kernel.
#[derive(Debug)]
pub(super) struct Dispatch {
    /// Index of the layer, or `None` for the captured colors.
    pub(super) layer: Option<usize>,
    /// Whether any of its blocks lies on the edge of the layer's region, and not within.
    pub(super) has_edge: bool,
    pub(super) chunk: usize,
    /// Its part of the indices of blocks.
    pub(super) blocks: Range<u32>,
}

impl Source {
    fn of(layer: &GpuLayer) -> Self {
        Self {
            look: layer.look.map(|look| (look.buffer().clone(), look.version())),
            mask: layer.mask.map(|(mask, channel)| (mask.buffer.clone(), mask.version(), channel)),
            strength: layer.strength,
        }
    }

    /// Whether nothing of the colors below is left within the region.
    fn is_opaque(&self) -> bool {
        self.mask.is_none() && self.strength >= 1.0
    }
}

impl MixedLayers {
    /// The dispatches that turn the last mix into that of `layers`, and the indices of their blocks in the chunks.
    pub(super) fn update(
        &mut self,
        scene: &GpuScene,
        layers: &[GpuLayer],
        colors: &GaussianColors,
    ) -> (Vec<Dispatch>, Vec<u32>) {
        let holds_last = self.colors.as_ref() == Some(colors.buffer());
        let last = if holds_last { std::mem::take(&mut self.layers) } else { Vec::new() };
        let next: Vec<_> = layers
            .iter()
            .enumerate()
            .map(|(i, layer)| {
                let same_region = last.get(i).filter(|last| last.region == layer.region);
                let covers = match same_region {
                    // Compared below, so it is copied and not taken.
                    Some(last) => last.covers.clone(),
                    None => covers(scene, &layer.region),
                };
                MixedLayer { region: layer.region, source: Source::of(layer), covers }
            })
            .collect();
        let n_blocks = scene.chunks().iter().map(|chunk| chunk.blocks.len()).sum();
        let changed = if holds_last { changed_blocks(&last, &next, n_blocks) } else { vec![true; n_blocks] };
        self.colors = Some(colors.buffer().clone());
        self.layers = next;
        dispatches(scene, &self.layers, &changed)
    }
}

/// How a region covers the blocks of a scene.
fn covers(scene: &GpuScene, region: &Region) -> Vec<Cover> {
    let region = RegionCover::new(region);
    let mut covers = Vec::new();
    for chunk in scene.chunks() {
        for group in chunk.blocks.chunks(GROUP) {
            let around = around(group);
            match region.of(around.center, around.radius) {
                Cover::Edge => covers.extend(group.iter().map(|ball| region.of(ball.center, ball.radius))),
                same => covers.extend(group.iter().map(|_| same)),
            }
        }
    }
    covers
}

/// A ball around balls.
fn around(balls: &[Ball]) -> Ball {
    let center = balls.iter().map(|ball| ball.center).sum::<Vec3>() / balls.len() as f32;
    let radius = balls.iter().map(|ball| ball.center.distance(center) + ball.radius).fold(0.0, f32::max);
    Ball { center, radius }
}

/// Which blocks have other colors under `next` than under `last`.
fn changed_blocks(last: &[MixedLayer], next: &[MixedLayer], n_blocks: usize) -> Vec<bool> {
    let mut changed = vec![false; n_blocks];
    for i in 0..last.len().max(next.len()) {
        match (last.get(i), next.get(i)) {
            (Some(last), Some(next)) => {
                let (moved, differs) = (last.region != next.region, last.source != next.source);
                if !moved && !differs {
                    continue;
                }
                for (block, (&was, &is)) in last.covers.iter().zip(&next.covers).enumerate() {
                    let is_touched = was != Cover::Outside || is != Cover::Outside;
                    changed[block] |= is_touched && (differs || was != is || is == Cover::Edge);
                }
            }
            (Some(only), None) | (None, Some(only)) => {
                for (block, &cover) in only.covers.iter().enumerate() {
                    changed[block] |= cover != Cover::Outside;
                }
            }
            (None, None) => {}
        }
    }
    changed
}

/// The dispatches over changed blocks, layer by layer.
fn dispatches(scene: &GpuScene, layers: &[MixedLayer], changed: &[bool]) -> (Vec<Dispatch>, Vec<u32>) {
    // The lowest layer that is seen in each block: what lies below an opaque one is left out. One more than the layers if
    // there is none.
    let lowest = |block: usize| {
        let covers = |layer: &MixedLayer| layer.covers[block] == Cover::Inside && layer.source.is_opaque();
        let touches = |layer: &MixedLayer| layer.covers[block] != Cover::Outside;
        layers.iter().rposition(covers).or_else(|| layers.iter().position(touches)).unwrap_or(layers.len())
    };
    let lowest: Vec<_> =
        (0..changed.len()).map(|block| if changed[block] { lowest(block) } else { usize::MAX }).collect();
    let (mut dispatches, mut blocks) = (Vec::new(), Vec::new());
    let mut first = 0;
    for (chunk, of_chunk) in scene.chunks().iter().enumerate() {
        let range = first..first + of_chunk.blocks.len();
        let mut dispatch = |layer: Option<usize>, chosen: &dyn Fn(usize) -> Option<u32>| {
            let begin = blocks.len();
            blocks.extend(range.clone().filter_map(|block| Some((block - first) as u32 | chosen(block)?)));
            let has_edge = blocks[begin..].iter().any(|block| block & WITHIN == 0);
            let blocks = begin as u32..blocks.len() as u32;
            if !blocks.is_empty() {
                dispatches.push(Dispatch { layer, has_edge, chunk, blocks });
            }
        };
        // Blocks that no layer touches any more.
        dispatch(None, &|block| (lowest[block] == layers.len()).then_some(STARTS | WITHIN));
        for (i, layer) in layers.iter().enumerate() {
            dispatch(Some(i), &|block| {
                let cover = layer.covers[block];
                let is_seen = lowest[block] <= i && cover != Cover::Outside;
                let start = if lowest[block] == i { STARTS } else { 0 };
                is_seen.then_some(start | if cover == Cover::Inside { WITHIN } else { 0 })
            });
        }
        first = range.end;
    }
    (dispatches, blocks)
}
