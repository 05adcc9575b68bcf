//! Strokes under layers: words are mixed as colors are, and the layers' seeds are put together in one table.

use std::ops::Range;

use stylegaussian::strokes::{MAX_SEEDS, StrokeMotion};
use stylegaussian_shaders::splat::strokes::MAX_CHANGES;

use super::{GpuLayer, LayerMixer, MixedLayers, Values, check_mask, pack};
use crate::{
    buffers::TooLarge,
    device::GpuEncoder,
    splat::GpuScene,
    strokes::{GaussianStrokes, seed_bytes},
};

#[cfg(test)]
mod tests;

/// The strokes of a scene under layers, and which layers they hold. A new one holds none.
#[derive(Debug, Default)]
pub struct StrokeMix {
    strokes: Option<GaussianStrokes>,
    tables: Vec<Table>,
    mixed: MixedLayers,
}

/// The seeds of a look, as a part of the mix's table. A look that moves differs from the same one that stands
/// still.
#[derive(Clone, Debug, PartialEq)]
struct Table {
    seeds: wgpu::Buffer,
    motions: Vec<(Range<u32>, StrokeMotion)>,
    version: u64,
    /// Index of the first seed.
    first: usize,
    n_seeds: usize,
}

impl Table {
    fn end(&self) -> usize {
        self.first + self.n_seeds
    }

    /// Whether this is the table of `strokes`.
    fn is_of(&self, strokes: &GaussianStrokes) -> bool {
        self.seeds == *strokes.seeds() && self.motions == strokes.motions()
    }

    /// Its motions, by the numbers that its seeds have in the mix.
    fn placed_motions(&self) -> impl Iterator<Item = (Range<u32>, StrokeMotion)> {
        let first = self.first as u32;
        self.motions.iter().map(move |(seeds, motion)| (first + seeds.start..first + seeds.end, *motion))
    }
}

impl StrokeMix {
    /// The strokes of the last mix; `None` if no layer had any. A later mix may put others in their place.
    pub fn strokes(&self) -> Option<&GaussianStrokes> {
        self.strokes.as_ref()
    }
}

impl LayerMixer {
    /// Encodes the mix of the strokes of any number of `layers` into `mix`, from none up. Only what differs
    /// from its last mix is encoded. If something is, the strokes count as changed. If no layer has strokes,
    /// the mix has none, and takes no memory.
    ///
    /// The seeds of all layers together are at most [`MAX_SEEDS`]. If there are more, the lowest layers show no
    /// strokes. Each layer's strokes move in their own way; if more than eight do, the lowest stand still.
    ///
    /// A layer with `factors` changes the strokes below it. Each that changes more than words carry
    /// ([`change_seeds`](stylegaussian::strokes::StrokeFactors::change_seeds)) takes as many numbers of seeds
    /// as there are below. If there are more than eight, or too few numbers, the lowest change words alone.
    ///
    /// Before the first mix of a submission, call [`begin_submission`](Self::begin_submission).
    ///
    /// # Errors
    /// If the scene has more Gaussians than the device has room for. The mix has no strokes then.
    ///
    /// # Panics
    /// If strokes or a mask are not of the scene's Gaussians, if a layer's strokes are those of the mix, or if
    /// they are those of another mix in which seeds are changed.
    pub fn encode_strokes(
        &self,
        gpu: &mut GpuEncoder,
        scene: &GpuScene,
        layers: &[GpuLayer],
        mix: &mut StrokeMix,
    ) -> Result<(), TooLarge> {
        check(scene, layers, mix);
        let seen: Vec<_> = layers.iter().filter(|layer| pack::packed(layer).is_some()).collect();
        if seen.iter().all(|layer| layer.strokes.is_none()) {
            *mix = StrokeMix::default();
            return Ok(());
        }
        let tables = placed(&mix.tables, wanted(&seen));
        let (target, is_new) = match target(gpu.device, scene, std::mem::take(&mut mix.strokes), &tables) {
            Ok(target) => target,
            Err(error) => {
                *mix = StrokeMix::default();
                return Err(error);
            }
        };
        let mut is_changed = is_new;
        for table in &tables {
            if table.n_seeds > 0 && (is_new || !mix.tables.contains(table)) {
                let (first, bytes) = (table.first as u64 * seed_bytes(1), seed_bytes(table.n_seeds));
                gpu.encoder.copy_buffer_to_buffer(&table.seeds, 0, target.seeds(), first, bytes);
                is_changed = true;
            }
        }
        let added = added(&seen, tables.iter().map(Table::end).max().unwrap_or(0));
        let values = |(layer, added): (&GpuLayer, Option<u32>)| {
            if let Some(first_seed) = added {
                return Some(Values { buffer: None, version: 0, first_seed });
            }
            let strokes = layer.strokes?;
            let table = tables.iter().find(|table| table.is_of(strokes))?;
            let (buffer, version) = (Some(strokes.words().clone()), strokes.version());
            Some(Values { buffer, version, first_seed: table.first as u32 })
        };
        let changes = seen.iter().zip(&added).rev();
        let changes = changes.filter_map(|(layer, added)| Some(((*added)?, layer.factors?.usual())));
        let changes = changes.collect();
        let seen: Vec<_> =
            seen.iter().zip(added).map(|(&layer, added)| (layer, values((layer, added)))).collect();
        let target = mix.strokes.insert(keep_textures(target, &seen));
        // The topmost layers' first, of which some count if there are too many.
        target.set_motions(tables.iter().flat_map(Table::placed_motions).collect());
        target.set_changes(changes);
        let pipelines = self.strokes_pipelines(gpu.device);
        is_changed |= self.encode_values(gpu, pipelines, scene, seen, target.words(), &mut mix.mixed);
        if is_changed {
            target.mark_changed();
        }
        mix.tables = tables;
        Ok(())
    }
}

/// The tables of layers, as many as fit, the topmost layer's first. Their places are not known yet.
fn wanted(layers: &[&GpuLayer]) -> Vec<Table> {
    let mut tables: Vec<Table> = Vec::new();
    let mut n_seeds = 0;
    for strokes in layers.iter().rev().filter_map(|layer| layer.strokes) {
        if tables.iter().any(|table| table.is_of(strokes)) {
            continue;
        }
        n_seeds += strokes.n_seeds();
        if n_seeds > MAX_SEEDS {
            break;
        }
        tables.push(Table {
            seeds: strokes.seeds().clone(),
            motions: strokes.motions().to_vec(),
            version: strokes.version(),
            first: 0,
            n_seeds: strokes.n_seeds(),
        });
    }
    tables
}

/// Gives each of the `tables` its place. Those that have one keep it, so that words that name their seeds stay
/// as they are, unless there would be no room for the others.
fn placed(last: &[Table], mut tables: Vec<Table>) -> Vec<Table> {
    let is_same = |a: &Table, b: &Table| a.seeds == b.seeds && a.motions == b.motions;
    let place = |table: &Table| last.iter().find(|last| is_same(last, table)).map(|last| last.first);
    let kept = tables.iter().filter_map(|table| Some(place(table)? + table.n_seeds)).max();
    let new: usize = tables.iter().filter(|table| place(table).is_none()).map(|table| table.n_seeds).sum();
    let keeps = kept.unwrap_or(0) + new <= MAX_SEEDS;
    let mut end = kept.filter(|_| keeps).unwrap_or(0);
    for table in &mut tables {
        table.first = place(table).filter(|_| keeps).unwrap_or(end);
        end = end.max(table.end());
    }
    tables
}

/// What each of the layers that change seeds adds to their numbers, if the tables end at `end`; `None` for the
/// other layers. Each has the numbers of all changes below it and as many more.
fn added(layers: &[&GpuLayer], end: usize) -> Vec<Option<u32>> {
    let changes_seeds =
        |layer: &GpuLayer| layer.factors.is_some_and(|factors| factors.usual().change_seeds());
    // Few numbers of seeds ask for others when tables come and go.
    let first = end.next_power_of_two();
    let room = (MAX_SEEDS / first).ilog2() as usize;
    let n = layers.iter().filter(|layer| changes_seeds(layer)).count();
    let left_out = n - n.min(room).min(MAX_CHANGES);
    let mut number = 0;
    let of_layer = |layer: &&GpuLayer| {
        let counts = changes_seeds(layer);
        number += usize::from(counts);
        (counts && number > left_out).then(|| (first << (number - 1 - left_out)) as u32)
    };
    layers.iter().map(of_layer).collect()
}

/// Strokes with room for `tables`, those of the `last` mix if they have it, and whether their table is new.
fn target(
    device: &wgpu::Device,
    scene: &GpuScene,
    last: Option<GaussianStrokes>,
    tables: &[Table],
) -> Result<(GaussianStrokes, bool), TooLarge> {
    let (n, n_seeds) = (scene.n_gaussians(), tables.iter().map(Table::end).max().unwrap_or(0));
    // Tables come and go: few of them ask for a larger buffer.
    let room = n_seeds.next_power_of_two();
    match last.filter(|last| last.n_gaussians() == n) {
        Some(last) if last.n_seeds() >= n_seeds => Ok((last, false)),
        Some(last) => Ok((last.with_table(device, room)?, true)),
        None => Ok((GaussianStrokes::empty(device, n, room)?, true)),
    }
}

/// The strokes, which keep the textures of `layers` in the store.
fn keep_textures(mut strokes: GaussianStrokes, layers: &[(&GpuLayer, Option<Values>)]) -> GaussianStrokes {
    let shown = layers.iter().filter(|(_, values)| values.is_some()).filter_map(|(layer, _)| layer.strokes);
    strokes.keep(shown.flat_map(GaussianStrokes::textures).cloned().collect());
    strokes
}

/// Checks that everything is of the scene's Gaussians.
fn check(scene: &GpuScene, layers: &[GpuLayer], mix: &StrokeMix) {
    let n = scene.n_gaussians();
    for layer in layers {
        assert!(layer.strokes.is_none_or(|strokes| strokes.n_gaussians() == n), "one word per Gaussian");
        let is_changed = layer.strokes.is_some_and(|strokes| !strokes.changes().is_empty());
        assert!(!is_changed, "the words of a layer name seeds");
        let is_mix =
            |strokes: &GaussianStrokes| mix.strokes().is_some_and(|mix| mix.words() == strokes.words());
        assert!(!layer.strokes.is_some_and(is_mix), "a layer is not the mix");
        check_mask(layer, n);
    }
}
