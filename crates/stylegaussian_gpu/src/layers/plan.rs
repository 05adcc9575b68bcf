//! The dispatches of a mix: which layers touch which blocks, and which mixes are there already.

use std::{ops::Range, sync::Arc};

use glam::Vec3;
use stylegaussian::layers::{Cover, Region, RegionCover};
use stylegaussian_shaders::layers::{MIX_LAYERS, MIX_LOOKS, MixBlock, STARTS};

use super::layer::GpuLayer;
use crate::splat::{Ball, GpuScene};

/// Blocks that are asked about together first.
const GROUP: usize = 32;

/// The layers that colors or words hold, from the last mix. Regions that did not move are not asked again, and
/// blocks whose values stay as they are take no part in the next mix.
#[derive(Debug, Default)]
pub struct MixedLayers {
    /// The colors or words, or `None` if they may hold anything.
    target: Option<wgpu::Buffer>,
    layers: Vec<MixedLayer>,
}

/// A layer of the last mix.
#[derive(Debug)]
struct MixedLayer {
    region: Region,
    source: Source,
    /// How the region covers each block, over all chunks.
    covers: Arc<[Cover]>,
}

/// The values that a layer lays over those below: colors of a look, words of its strokes, or words below with
/// changes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Values {
    /// `None` if they are those below.
    pub(super) buffer: Option<wgpu::Buffer>,
    /// A number that differs after each change of them.
    pub(super) version: u64,
    /// Added to the seeds of words, as far as they are changed.
    pub(super) first_seed: u32,
}

/// Everything that a layer's values depend on, except its region.
#[derive(Debug, PartialEq)]
struct Source {
    look: Option<Values>,
    mask: Option<(wgpu::Buffer, u64, u32)>,
    strength: f32,
    /// The changes that a layer makes in the words below.
    factors: Option<[f32; 2]>,
}

/// A dispatch of the kernel: layers that are mixed together, in the blocks of a chunk.
#[derive(Debug)]
pub(super) struct Dispatch {
    /// The layers, at most [`MIX_LAYERS`] with at most [`MIX_LOOKS`] looks and one mask.
    pub(super) layers: Range<usize>,
    pub(super) chunk: usize,
    /// Its part of the blocks.
    pub(super) blocks: Range<u32>,
}

impl Source {
    fn of(layer: &GpuLayer, look: Option<&Values>) -> Self {
        Self {
            look: look.cloned(),
            mask: layer.mask.map(|(mask, channel)| (mask.buffer.clone(), mask.version(), channel)),
            strength: layer.strength,
            factors: layer.factors.map(|factors| factors.usual().of_words()),
        }
    }

    /// Whether the layer hides all below it within the region.
    fn is_opaque(&self) -> bool {
        self.mask.is_none() && self.strength >= 1.0 && self.factors.is_none()
    }
}

impl MixedLayers {
    /// The dispatches that turn the last mix into that of `layers`, and the blocks in which they work.
    pub(super) fn update(
        &mut self,
        scene: &GpuScene,
        layers: &[(&GpuLayer, Option<Values>)],
        target: &wgpu::Buffer,
    ) -> (Vec<Dispatch>, Vec<MixBlock>) {
        let holds_last = self.target.as_ref() == Some(target);
        let last = if holds_last { std::mem::take(&mut self.layers) } else { Vec::new() };
        let next: Vec<_> = layers
            .iter()
            .enumerate()
            .map(|(i, (layer, look))| {
                let same_region = last.get(i).filter(|last| last.region == layer.region);
                let covers = match same_region {
                    Some(last) => Arc::clone(&last.covers),
                    None => covers(scene, &layer.region),
                };
                MixedLayer { region: layer.region, source: Source::of(layer, look.as_ref()), covers }
            })
            .collect();
        let n_blocks = scene.chunks().iter().map(|chunk| chunk.blocks.len()).sum();
        let changed = if holds_last { changed_blocks(&last, &next, n_blocks) } else { vec![true; n_blocks] };
        self.target = Some(target.clone());
        self.layers = next;
        dispatches(scene, &self.layers, &changed)
    }
}

/// How a region covers the blocks of a scene.
fn covers(scene: &GpuScene, region: &Region) -> Arc<[Cover]> {
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
    covers.into()
}

/// A ball around balls.
fn around(balls: &[Ball]) -> Ball {
    let center = balls.iter().map(|ball| ball.center).sum::<Vec3>() / balls.len() as f32;
    let radius = balls.iter().map(|ball| ball.center.distance(center) + ball.radius).fold(0.0, f32::max);
    Ball { center, radius }
}

/// Which blocks have other values under `next` than under `last`.
fn changed_blocks(last: &[MixedLayer], next: &[MixedLayer], n_blocks: usize) -> Vec<bool> {
    let mut changed = vec![false; n_blocks];
    for i in 0..last.len().max(next.len()) {
        match (last.get(i), next.get(i)) {
            (Some(last), Some(next)) => {
                let (moved, differs) = (last.region != next.region, last.source != next.source);
                if !moved && !differs {
                    continue;
                }
                for (block, (&was, &is)) in last.covers.iter().zip(&*next.covers).enumerate() {
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

/// The dispatches over changed blocks: for each stack of layers, one for each chunk.
fn dispatches(scene: &GpuScene, layers: &[MixedLayer], changed: &[bool]) -> (Vec<Dispatch>, Vec<MixBlock>) {
    // The lowest layer that is seen in each block: layers below an opaque one are left out. One more than the
    // layers if there is none.
    let lowest = |block: usize| {
        let covers = |layer: &MixedLayer| layer.covers[block] == Cover::Inside && layer.source.is_opaque();
        let touches = |layer: &MixedLayer| layer.covers[block] != Cover::Outside;
        layers.iter().rposition(covers).or_else(|| layers.iter().position(touches)).unwrap_or(layers.len())
    };
    let lowest: Vec<_> = (0..changed.len()).map(|block| changed[block].then(|| lowest(block))).collect();
    let (mut dispatches, mut blocks) = (Vec::new(), Vec::new());
    for stack in stacks(layers) {
        let mut first = 0;
        for (chunk, of_chunk) in scene.chunks().iter().enumerate() {
            let (begin, end) = (blocks.len() as u32, first + of_chunk.blocks.len());
            for block in first..end {
                let Some(lowest) = lowest[block] else { continue };
                let start = if lowest >= stack.start { STARTS } else { 0 };
                let mut item = MixBlock { index: (block - first) as u32 | start, ..MixBlock::default() };
                let hidden = lowest.saturating_sub(stack.start);
                for (bit, layer) in layers[stack.clone()].iter().enumerate().skip(hidden) {
                    let cover = layer.covers[block];
                    item.touches |= u32::from(cover != Cover::Outside) << bit;
                    item.within |= u32::from(cover == Cover::Inside) << bit;
                }
                // The first stack writes the captured colors where no layer is.
                if item.touches != 0 || (stack.start == 0 && lowest == layers.len()) {
                    blocks.push(item);
                }
            }
            let of_chunk = begin..blocks.len() as u32;
            if !of_chunk.is_empty() {
                dispatches.push(Dispatch { layers: stack.clone(), chunk, blocks: of_chunk });
            }
            first = end;
        }
    }
    (dispatches, blocks)
}

/// Layers that a dispatch can mix together. There is always a first stack, if only for the captured colors.
fn stacks(layers: &[MixedLayer]) -> Vec<Range<usize>> {
    let mut stacks = Vec::new();
    let (mut start, mut looks, mut masks) = (0, Vec::new(), Vec::new());
    for (i, layer) in layers.iter().enumerate() {
        let look = layer.source.look.as_ref().and_then(|look| look.buffer.as_ref());
        let mask = layer.source.mask.as_ref().map(|(mask, ..)| mask);
        let new_look = look.filter(|look| !looks.contains(look));
        let new_mask = mask.filter(|mask| !masks.contains(mask));
        let is_full = i - start == MIX_LAYERS as usize
            || (new_look.is_some() && looks.len() == MIX_LOOKS as usize)
            || (new_mask.is_some() && !masks.is_empty());
        if is_full {
            stacks.push(start..i);
            start = i;
            (looks, masks) = (look.into_iter().collect(), mask.into_iter().collect());
        } else {
            looks.extend(new_look);
            masks.extend(new_mask);
        }
    }
    stacks.push(start..layers.len());
    stacks
}
