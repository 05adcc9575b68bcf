//! The state of a world: the level that each node shows, and the one that is on its way.

use std::{cmp::Reverse, sync::Arc, time::Duration};

use bevy::{
    asset::AssetPath,
    platform::collections::{HashMap, HashSet},
    prelude::*,
};
use stylegaussian::cut;
use stylegaussian_files::world::World as Levels;

use super::reference::Reference;
use crate::{
    scene::{GaussianScene, beside},
    work::Running,
};

/// The nodes of a world, and the chunks that they are cut from.
#[derive(Component, Default)]
pub(super) struct Tree {
    /// The levels of detail that the nodes are of.
    pub(super) levels: Option<Arc<Levels>>,
    /// The manifest's path.
    pub(super) path: Option<AssetPath<'static>>,
    pub(super) nodes: Vec<Node>,
    /// Gaussians of each chunk, as far as the nodes want them.
    pub(super) chunk_sizes: Vec<usize>,
    /// The chunks that are read, or were a short time ago, by their index in the manifest.
    pub(super) chunks: HashMap<usize, Chunk>,
    /// The surroundings, if there are any.
    pub(super) environment: Option<(Entity, Handle<GaussianScene>)>,
    /// The scene in whose manner it is painted, once it is styled.
    pub(super) reference: Option<Reference>,
    /// Whether no levels were chosen yet.
    pub(super) is_new: bool,
    /// The files whose failure was told.
    pub(super) told: HashSet<String>,
}

/// A part of a world.
pub(super) struct Node {
    /// Gaussians at each level: 0 if it has none, or if they cannot be had.
    pub(super) counts: Vec<usize>,
    /// The level that the cut asks for, or `None` for nothing.
    pub(super) wanted: Option<usize>,
    /// Pixels along it in the view that is nearest to it, or that was a moment ago.
    pub(super) pixels: f32,
    /// Whether a camera sees it, or is about to.
    pub(super) is_seen: bool,
    pub(super) shown: Option<Shown>,
    pub(super) coming: Option<Coming>,
    /// The way in which the run that is shown has come, until it is there.
    pub(super) fading: Option<Fading>,
}

/// A run that fades in over the one before, which then fades out.
pub(super) struct Fading {
    pub(super) since: Duration,
    pub(super) before: Option<Shown>,
}

/// A run that is shown.
#[derive(Clone, Copy)]
pub(super) struct Shown {
    pub(super) level: usize,
    pub(super) entity: Entity,
}

/// A run that takes the place of the one that is shown.
pub(super) struct Coming {
    pub(super) level: usize,
    pub(super) stage: Stage,
}

/// The way of a run onto the screen.
pub(super) enum Stage {
    /// It waits for its chunk, or for others to leave.
    Waiting,
    /// A task cuts it out of its chunk.
    Cutting(Running<Result<GaussianScene, String>>),
    /// Its entity is hidden until it can be drawn.
    Hidden(Entity),
}

/// A chunk in memory, or on its way.
pub(super) struct Chunk {
    pub(super) handle: Handle<GaussianScene>,
    /// When a node last wanted it.
    pub(super) used: Duration,
}

/// A run of a world, and its child.
#[derive(Component)]
pub(super) struct Run {
    pub(super) world: Entity,
    /// The node, or `None` for the surroundings.
    pub(super) node: Option<usize>,
    /// Whether it is on the GPU, and so is what draws it.
    pub(super) is_drawable: bool,
}

/// A turn, by which runs are sorted.
pub(super) type Turn = (Reverse<bool>, Reverse<u32>);

impl Tree {
    /// The nodes of a manifest, none of which is shown.
    pub(super) fn new(levels: &Arc<Levels>, path: Option<AssetPath<'static>>) -> Self {
        let node = |node: &stylegaussian_files::world::Node| Node {
            counts: node.levels.iter().map(|run| run.as_ref().map_or(0, |run| run.range.len())).collect(),
            wanted: None,
            pixels: 0.0,
            is_seen: false,
            shown: None,
            coming: None,
            fading: None,
        };
        let mut chunk_sizes = vec![0; levels.files.len()];
        for run in levels.nodes.iter().flat_map(|node| node.levels.iter().flatten()) {
            if let Some(size) = chunk_sizes.get_mut(run.file) {
                *size = run.range.end.max(*size);
            }
        }
        Self {
            nodes: levels.nodes.iter().map(node).collect(),
            levels: Some(Arc::clone(levels)),
            path,
            chunk_sizes,
            is_new: true,
            ..Self::default()
        }
    }

    /// The path of a file that the manifest names.
    pub(super) fn path_of(&self, file: &str) -> AssetPath<'static> {
        match &self.path {
            Some(path) => beside(path, file),
            None => AssetPath::from_path_buf(file.into()),
        }
    }

    /// Whether the nodes are of these levels.
    pub(super) fn is_of(&self, levels: &Arc<Levels>) -> bool {
        self.levels.as_ref().is_some_and(|own| Arc::ptr_eq(own, levels))
    }

    /// Gaussians of the surroundings, once they are loaded.
    pub(super) fn n_around(&self, scenes: &Assets<GaussianScene>) -> usize {
        let scene = self.environment.as_ref().and_then(|(_, handle)| scenes.get(handle));
        scene.map_or(0, |scene| scene.scene().len())
    }

    /// All entities that it has.
    pub(super) fn entities(&self) -> impl Iterator<Item = Entity> {
        let coming = |node: &Node| node.coming.as_ref().and_then(Coming::entity);
        let before = |node: &Node| node.fading.as_ref()?.before.map(|before| before.entity);
        let of_node = move |node: &Node| [node.shown.map(|shown| shown.entity), coming(node), before(node)];
        let reference = match self.reference {
            Some(Reference::There { child, .. }) => Some(child),
            _ => None,
        };
        let others = self.environment.iter().map(|(entity, _)| *entity).chain(reference);
        self.nodes.iter().flat_map(of_node).flatten().chain(others)
    }

    /// The nodes that are to show another level, those in which the present one is worst first.
    pub(super) fn waiting(&self) -> Vec<usize> {
        let mut waiting: Vec<usize> = (0..self.nodes.len()).filter(|&i| self.nodes[i].is_waiting()).collect();
        // A hole is worse than anything. Errors are not negative, and the bits of such floats sort as they do.
        waiting.sort_by_cached_key(|&i| {
            (self.nodes[i].shown.is_some(), Reverse(self.nodes[i].error().to_bits()))
        });
        waiting
    }

    /// The turn of a run of a node in what is done for runs one after another: those that are seen come first,
    /// and of these the largest on screen. Surroundings, which have no node, are everywhere.
    pub(super) fn turn(&self, node: Option<usize>) -> Turn {
        let node = node.and_then(|node| self.nodes.get(node));
        let (is_seen, pixels) = node.map_or((true, f32::MAX), |node| (node.is_seen, node.pixels));
        // Pixels are not negative, and the bits of such floats sort as they do.
        (Reverse(is_seen), Reverse(pixels.to_bits()))
    }

    /// Notes that a chunk cannot be had. What is shown of it stays.
    pub(super) fn give_up_chunk(&mut self, file: usize) {
        let Some(levels) = &self.levels else { return };
        for (node, of_file) in self.nodes.iter_mut().zip(&levels.nodes) {
            for (level, run) in of_file.levels.iter().enumerate() {
                if run.as_ref().is_some_and(|run| run.file == file) {
                    node.give_up(level);
                }
            }
        }
        self.chunks.remove(&file);
    }
}

impl Node {
    /// Gaussians that are shown, or will be once those on their way have taken their place, if these are more.
    /// Fewer count once they are there: until then, what they replace is drawn.
    pub(super) fn committed(&self) -> usize {
        match &self.coming {
            Some(Coming { level, stage: Stage::Cutting(_) | Stage::Hidden(_) }) => {
                self.counts[*level].max(self.n_shown())
            }
            _ => self.n_shown(),
        }
    }

    /// Gaussians that are shown.
    pub(super) fn n_shown(&self) -> usize {
        self.shown.map_or(0, |shown| self.counts[shown.level])
    }

    /// Gaussians in memory that are not shown yet, or not much longer.
    pub(super) fn n_beside(&self) -> usize {
        let coming = self.coming.as_ref().filter(|coming| coming.entity().is_some());
        let before = self.fading.as_ref().and_then(|fading| fading.before);
        let levels = [coming.map(|coming| coming.level), before.map(|before| before.level)];
        levels.into_iter().flatten().map(|level| self.counts[level]).sum()
    }

    /// The level to show next, or `None` for nothing. The fewest Gaussians come first, so that something is
    /// there soon.
    pub(super) fn next(&self) -> Option<usize> {
        let wanted = self.wanted?;
        if self.shown.is_some() { Some(wanted) } else { cut::fewest(&self.counts) }
    }

    /// Whether another level is to be shown.
    pub(super) fn is_waiting(&self) -> bool {
        self.wanted != self.shown.map(|shown| shown.level)
    }

    /// The distance of the shown Gaussians in pixels.
    fn error(&self) -> f32 {
        cut::error(self.pixels, self.n_shown())
    }

    /// An entity that has some of its Gaussians.
    pub(super) fn entity(&self) -> Option<Entity> {
        self.shown.map(|shown| shown.entity).or_else(|| self.coming.as_ref()?.entity())
    }

    /// Notes that a level cannot be had.
    pub(super) fn give_up(&mut self, level: usize) {
        if self.shown.is_none_or(|shown| shown.level != level) {
            self.counts[level] = 0;
            self.wanted = self.wanted.filter(|wanted| *wanted != level);
            self.wanted = self.wanted.or(self.shown.map(|shown| shown.level));
        }
    }

    /// Takes away all that it has.
    pub(super) fn drop_all(&mut self, commands: &mut Commands) {
        self.drop_coming(commands);
        let before = self.fading.take().and_then(|fading| fading.before);
        for run in self.shown.take().into_iter().chain(before) {
            commands.entity(run.entity).try_despawn();
        }
    }

    /// Takes back what is on its way.
    pub(super) fn drop_coming(&mut self, commands: &mut Commands) {
        if let Some(entity) = self.coming.take().and_then(|coming| coming.entity()) {
            commands.entity(entity).try_despawn();
        }
    }
}

impl Coming {
    /// Its entity, if it has one.
    fn entity(&self) -> Option<Entity> {
        match self.stage {
            Stage::Hidden(entity) => Some(entity),
            Stage::Waiting | Stage::Cutting(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use stylegaussian_files::world::{Node as Cell, Run as Place};

    use super::*;

    /// Three nodes of two levels in two chunks, 100 and 10 Gaussians each, that cover so many pixels.
    fn tree(pixels: [f32; 3]) -> Tree {
        let cell = |i: usize| Cell {
            bounds: [Vec3::ZERO, Vec3::ONE],
            levels: vec![
                Some(Place { file: 0, range: 100 * i..100 * (i + 1) }),
                Some(Place { file: 1, range: 10 * i..10 * (i + 1) }),
            ],
        };
        let levels = Levels {
            n_levels: 2,
            files: vec!["0/meta.json".into(), "1/meta.json".into()],
            environment: None,
            nodes: (0..3).map(cell).collect(),
        };
        let mut tree = Tree::new(&Arc::new(levels), None);
        for (node, pixels) in tree.nodes.iter_mut().zip(pixels) {
            (node.pixels, node.wanted) = (pixels, Some(0));
        }
        tree
    }

    fn shown(level: usize) -> Option<Shown> {
        Some(Shown { level, entity: Entity::PLACEHOLDER })
    }

    #[test]
    fn holes_come_first_and_then_the_parts_that_are_worst() {
        let mut tree = tree([5.0, 90.0, 10.0]);
        assert_eq!(tree.chunk_sizes, [300, 30]);
        assert_eq!(tree.waiting(), [1, 2, 0]);
        assert_eq!(tree.nodes[0].next(), Some(1), "the fewest first");
        (tree.nodes[1].shown, tree.nodes[2].shown) = (shown(1), shown(1));
        assert_eq!(tree.waiting(), [0, 1, 2]);
        assert_eq!(tree.nodes[1].next(), Some(0));
        tree.nodes[1].shown = shown(0);
        assert_eq!(tree.waiting(), [0, 2]);
        assert_eq!(tree.nodes.iter().map(Node::n_shown).collect::<Vec<_>>(), [0, 100, 10]);
    }

    #[test]
    fn what_is_seen_comes_before_what_is_large() {
        let mut tree = tree([5.0, 90.0, 10.0]);
        (tree.nodes[0].is_seen, tree.nodes[2].is_seen) = (true, true);
        let mut nodes = [Some(0), Some(1), Some(2), None];
        nodes.sort_by_key(|node| tree.turn(*node));
        assert_eq!(nodes, [None, Some(2), Some(0), Some(1)]);
    }

    #[test]
    fn what_cannot_be_had_is_waited_for_no_longer() {
        let mut tree = tree([5.0, 90.0, 10.0]);
        (tree.nodes[0].shown, tree.nodes[1].shown) = (shown(1), shown(0));
        tree.give_up_chunk(0);
        // What is shown of the chunk stays, and a node that shows nothing waits for the next cut.
        let counts: Vec<_> = tree.nodes.iter().map(|node| node.counts.clone()).collect();
        assert_eq!(counts, [[0, 10], [100, 10], [0, 10]]);
        assert_eq!(tree.nodes[0].wanted, Some(1));
        assert!(tree.waiting().is_empty() && tree.nodes[2].wanted.is_none());
    }

    #[test]
    fn files_lie_beside_the_manifest() {
        let plain = tree([0.0; 3]);
        assert_eq!(plain.path_of("0/meta.json").to_string(), "0/meta.json");
        let path = AssetPath::parse("http://b.org/city/lod-meta.json").into_owned();
        let tree = Tree { path: Some(path), ..plain };
        assert_eq!(tree.path_of("0/meta.json").to_string(), "http://b.org/city/0/meta.json");
    }
}
