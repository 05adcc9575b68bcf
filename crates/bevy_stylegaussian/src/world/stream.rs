//! From the levels that are wanted to those that are shown: chunks are read, runs are cut out of them and
//! uploaded while hidden, and then take the places of others.

use std::{sync::Arc, time::Duration};

use bevy::{
    asset::LoadState, ecs::system::SystemParam, prelude::*, render::renderer::RenderAdapterInfo,
    window::RequestRedraw,
};
use stylegaussian::work::{Canceled, Work};
use stylegaussian_files::{
    Mismatch,
    world::{Run as Place, World as Levels},
};

use super::{
    budget::{GaussianBudget, within},
    component::{GaussianWorld, WorldState},
    failure::WorldFailures,
    style::{StyleState, Styling},
    tree::{Chunk, Coming, Fading, Node, Run, Shown, Stage, Tree},
};
use crate::{
    GaussianSceneReady,
    scene::{GaussianScene, GaussianSplats, LoadedScene, WorldPart},
    splats::SplatFade,
    style::{HiddenUntilStyled, StyleSource},
    work::{Lane, Workers},
};

/// Time for which a chunk stays in memory after a node wanted it: the nodes beside it are often wanted next.
const KEPT: Duration = Duration::from_secs(5);

/// Time in which a run fades in, and as long again in which the one before fades out: a few frames.
const FADE: Duration = Duration::from_millis(120);

/// The Gaussians as which a smaller run counts in a frame: its entity and its buffers cost time whatever its
/// size. With the default budget, 61 runs are handed over in a frame at most.
const LEAST_HANDED: usize = 4096;

/// Notes which runs can be drawn.
pub(super) fn note_drawable_runs(
    mut ready: MessageReader<GaussianSceneReady>,
    mut runs: Query<(&mut Run, &LoadedScene)>,
    // Bevy puts a copy into the main world. It is absent if the app does not render.
    renderer: Option<Res<RenderAdapterInfo>>,
) {
    for event in ready.read() {
        if let Ok((mut run, _)) = runs.get_mut(event.entity) {
            run.is_drawable = true;
        }
    }
    // Without a renderer, nobody sends the event.
    if renderer.is_none() {
        for (mut run, _) in runs.iter_mut().filter(|(run, _)| !run.is_drawable) {
            run.is_drawable = true;
        }
    }
}

/// The components of a world that its runs come and go by.
type StreamedWorld = (
    Entity,
    &'static GaussianWorld,
    &'static mut Tree,
    &'static mut WorldState,
    Option<&'static StyleSource>,
    Has<HiddenUntilStyled>,
);

/// A run's entity.
type RunState = (&'static Run, Option<&'static LoadedScene>, StyleState);

/// Parameters of the system that makes runs.
#[derive(SystemParam)]
pub(super) struct Means<'w, 's> {
    commands: Commands<'w, 's>,
    scenes: ResMut<'w, Assets<GaussianScene>>,
    runs: Query<'w, 's, RunState>,
    server: Res<'w, AssetServer>,
    workers: Res<'w, Workers>,
    failures: WorldFailures<'w, 's>,
}

/// The rest of the budget in this frame.
struct Left {
    /// Gaussians that may be shown.
    shown: usize,
    /// Gaussians that are shown, or will be.
    committed: usize,
    /// Gaussians of the chunks that are being read, at most and at present.
    in_flight: (usize, usize),
    /// Gaussians that go to the GPU in this frame, at most and so far.
    handed: (usize, usize),
}

/// The world that a run is of.
struct Of<'a> {
    entity: Entity,
    styling: Styling<'a>,
    now: Duration,
    /// Whether the app draws.
    renders: bool,
}

/// Moves runs on their way, and those that are complete onto the screen.
pub(super) fn stream_runs(
    mut worlds: Query<StreamedWorld>,
    mut means: Means,
    budget: Res<GaussianBudget>,
    time: Res<Time<Real>>,
    // Bevy puts a copy into the main world. It is absent if the app does not render.
    renderer: Option<Res<RenderAdapterInfo>>,
    mut redraw: MessageWriter<RequestRedraw>,
) {
    let mut left = Left {
        shown: budget.gaussians,
        committed: 0,
        in_flight: (budget.in_flight, 0),
        handed: (budget.per_frame, 0),
    };
    for (.., tree, _, _, _) in &worlds {
        let of_nodes: usize = tree.nodes.iter().map(Node::committed).sum();
        left.committed += tree.n_around(&means.scenes) + of_nodes;
        let loading = tree.chunks.iter().filter(|(_, chunk)| !means.scenes.contains(&chunk.handle));
        left.in_flight.1 += loading.map(|(file, _)| tree.chunk_sizes[*file]).sum::<usize>();
    }
    let now = time.elapsed();
    for (entity, _, mut tree, mut state, source, hides) in &mut worlds {
        let tree = &mut *tree;
        means.give_up_failed(entity, tree);
        let of = Of { entity, styling: Styling { source, hides }, now, renders: renderer.is_some() };
        for node in tree.waiting() {
            means.advance(&of, tree, node, &mut left);
        }
        for node in &mut tree.nodes {
            means.fade(&of, node);
        }
        for node in tree.nodes.iter_mut().filter(|node| !node.is_waiting()) {
            node.drop_coming(&mut means.commands);
        }
        tree.chunks.retain(|_, chunk| now.saturating_sub(chunk.used) < KEPT);
        let found = means.state(tree, of.styling);
        let is_fading = tree.nodes.iter().any(|node| node.fading.is_some());
        if found.waiting > 0 || found.loading > 0 || is_fading {
            redraw.write(RequestRedraw);
        }
        state.set_if_neq(found);
    }
}

impl Means<'_, '_> {
    /// Gives up chunks that failed.
    fn give_up_failed(&mut self, world: Entity, tree: &mut Tree) {
        let failed: Vec<(usize, String)> = tree
            .chunks
            .iter()
            .filter(|(_, chunk)| !self.scenes.contains(&chunk.handle))
            .filter_map(|(&file, chunk)| match self.server.get_load_state(&chunk.handle) {
                Some(LoadState::Failed(error)) => Some((file, error.to_string())),
                _ => None,
            })
            .collect();
        for (file, error) in failed {
            self.fail(world, tree, file, error);
        }
        if let Some((_, around)) = &tree.environment
            && !self.scenes.contains(around)
            && let Some(LoadState::Failed(error)) = self.server.get_load_state(around)
        {
            let file = around.path().map_or_else(|| "the surroundings".into(), ToString::to_string);
            self.failures.send(world, &mut tree.told, file, error.to_string());
        }
    }

    /// Gives up a chunk, and tells it.
    fn fail(&mut self, world: Entity, tree: &mut Tree, file: usize, error: String) {
        if let Some(name) = tree.levels.as_ref().and_then(|levels| levels.files.get(file)) {
            let path = tree.path_of(name).to_string();
            self.failures.send(world, &mut tree.told, path, error);
        }
        tree.give_up_chunk(file);
    }

    /// Brings a node nearer to the level that it is to show.
    fn advance(&mut self, of: &Of, tree: &mut Tree, index: usize, left: &mut Left) {
        let Some(levels) = tree.levels.clone() else { return };
        let node = &mut tree.nodes[index];
        // A chunk that has just failed may have changed what it waits for.
        if !node.is_waiting() {
            return;
        }
        let Some(wanted) = node.next() else {
            // The budget has no room for it at any level.
            node.drop_all(&mut self.commands);
            return;
        };
        // A run that is about to be shown is shown, even if another level is wanted by now.
        let is_kept = |coming: &Coming| coming.level == wanted || matches!(coming.stage, Stage::Hidden(_));
        if !node.coming.as_ref().is_some_and(is_kept) {
            let before = node.committed();
            node.coming = None;
            left.committed = left.committed.saturating_sub(before) + node.committed();
        }
        let coming = node.coming.take().unwrap_or(Coming { level: wanted, stage: Stage::Waiting });
        let Some(place) = levels.nodes[index].levels[coming.level].clone() else { return };
        let stage = match coming.stage {
            Stage::Waiting => self.begin(of, tree, index, (&levels, &place, coming.level), left),
            Stage::Cutting(running) => match running.get() {
                None => Ok(Some(Stage::Cutting(running))),
                Some(Ok(Ok(scene))) => match left.may_hand(scene.scene().len()) {
                    true => Ok(Some(Stage::Hidden(self.spawn(of, (index, coming.level), scene.clone())))),
                    false => Ok(Some(Stage::Cutting(running))),
                },
                Some(Ok(Err(error))) => Err(error.clone()),
                Some(Err(Canceled)) => Err("cutting a part out of it ended early: the log says why".into()),
            },
            Stage::Hidden(entity) => self.show(of, &mut tree.nodes[index], (coming.level, entity)),
        };
        match stage {
            Ok(stage) => {
                let level = coming.level;
                tree.nodes[index].coming = stage.map(|stage| Coming { level, stage });
            }
            Err(error) => self.fail(of.entity, tree, place.file, error),
        }
    }

    /// Begins to cut a run out of its chunk, or to read the chunk.
    fn begin(
        &mut self,
        of: &Of,
        tree: &mut Tree,
        index: usize,
        (levels, place, level): (&Arc<Levels>, &Place, usize),
        left: &mut Left,
    ) -> Result<Option<Stage>, String> {
        let node = &tree.nodes[index];
        let (n, replaced) = (node.counts[level], node.committed());
        let committed = left.committed.saturating_add(n.saturating_sub(replaced));
        // Coarser levels free what finer ones wait for, once they are there.
        if n > replaced && committed > left.shown && node.shown.is_some() {
            return Ok(None);
        }
        if let Some(chunk) = tree.chunks.get_mut(&place.file) {
            chunk.used = of.now;
            let Some(scene) = self.scenes.get(&chunk.handle).cloned() else {
                return Ok(Some(Stage::Waiting));
            };
            left.committed = committed;
            let (levels, place, n) = (Arc::clone(levels), place.clone(), tree.chunk_sizes[place.file]);
            let cutting = self.workers.start(Lane::Scenes, move |work| {
                let part = part_of(&scene, &levels, &place, n, work);
                work.check()?;
                Ok(part.map_err(|mismatch| mismatch.to_string()))
            });
            return Ok(Some(Stage::Cutting(cutting)));
        }
        let size = tree.chunk_sizes[place.file];
        if left.may_read(size) {
            let handle = self.server.load(tree.path_of(&levels.files[place.file]));
            tree.chunks.insert(place.file, Chunk { handle, used: of.now });
        }
        Ok(Some(Stage::Waiting))
    }

    /// Makes the entity of a run, which is hidden.
    fn spawn(&mut self, of: &Of, (part, level): (usize, usize), scene: GaussianScene) -> Entity {
        let splats = GaussianSplats(self.scenes.add(scene));
        let run = Run { world: of.entity, node: Some(part), is_drawable: false };
        let of_world = (WorldPart { world: of.entity, part, level }, ChildOf(of.entity));
        self.commands.spawn((splats, run, of_world, Visibility::Hidden)).id()
    }

    /// Shows a run in place of the one before, once it can be drawn as it should.
    fn show(
        &mut self,
        of: &Of,
        node: &mut Node,
        (level, entity): (usize, Entity),
    ) -> Result<Option<Stage>, String> {
        // Somebody else may have despawned it: it begins anew.
        let Ok((run, loaded, worn)) = self.runs.get(entity) else { return Ok(None) };
        if loaded.is_some_and(|loaded| loaded.asset.is_refused()) {
            self.commands.entity(entity).try_despawn();
            return Err("the GPU cannot take a part of it".into());
        }
        let is_complete = run.is_drawable && of.styling.allows(&worn, node.shown.is_none());
        if !is_complete || node.fading.is_some() {
            return Ok(Some(Stage::Hidden(entity)));
        }
        self.commands.entity(entity).try_insert((Visibility::Inherited, SplatFade(1.0)));
        let before = node.shown.replace(Shown { level, entity });
        node.fading = Some(Fading { since: of.now, before });
        Ok(None)
    }

    /// Lets the run that is shown come in, and then the one before go. So there is never less than before.
    fn fade(&mut self, of: &Of, node: &mut Node) {
        let (Some(shown), Some(fading)) = (node.shown, &node.fading) else { return };
        let passed = of.now.saturating_sub(fading.since).as_secs_f32() / FADE.as_secs_f32();
        // Nobody sees it without a renderer.
        let passed = if of.renders { passed } else { 2.0 };
        if passed < 1.0 {
            self.commands.entity(shown.entity).try_insert(SplatFade(1.0 - passed));
            return;
        }
        self.commands.entity(shown.entity).try_remove::<SplatFade>();
        match fading.before {
            Some(before) if passed < 2.0 => {
                self.commands.entity(before.entity).try_insert(SplatFade(passed - 1.0));
            }
            before => {
                if let Some(before) = before {
                    self.commands.entity(before.entity).try_despawn();
                }
                node.fading = None;
            }
        }
    }

    /// Counts a world.
    fn state(&self, tree: &Tree, styling: Styling) -> WorldState {
        let is_styled = styling.source.is_some_and(|source| !source.is_none());
        let is_unstyled =
            |shown: Shown| self.runs.get(shown.entity).is_ok_and(|(_, _, worn)| !styling.is_worn(&worn));
        let loading = tree.chunks.values().filter(|chunk| !self.scenes.contains(&chunk.handle));
        let mut state =
            WorldState { parts: tree.nodes.len(), loading: loading.count(), ..WorldState::default() };
        for node in &tree.nodes {
            state.shown_parts += usize::from(node.shown.is_some());
            state.shown += node.n_shown();
            state.arriving += node.n_beside();
            state.waiting += usize::from(node.is_waiting());
            state.unstyled += usize::from(is_styled && node.shown.is_some_and(is_unstyled));
        }
        state
    }
}

impl Left {
    /// Whether a chunk may be read now; then it counts.
    fn may_read(&mut self, size: usize) -> bool {
        within(&mut self.in_flight, size)
    }

    /// Whether a run may go to the GPU in this frame; then it counts.
    fn may_hand(&mut self, size: usize) -> bool {
        within(&mut self.handed, size.max(LEAST_HANDED))
    }
}

/// A run as a scene of its own, whose source is the run.
fn part_of(
    chunk: &GaussianScene,
    levels: &Levels,
    place: &Place,
    n_wanted: usize,
    work: &Work,
) -> Result<GaussianScene, Mismatch> {
    let scene = chunk.scene();
    if scene.n_source < n_wanted {
        // It walks all nodes.
        levels.check_chunk(place.file, scene)?;
    }
    let found = place.of(scene);
    if found.len() == scene.len() && place.range.len() == scene.n_source {
        return Ok(chunk.clone());
    }
    let indices: Vec<u32> = (found.start as u32..found.end as u32).collect();
    let mut part = scene.subset(&indices);
    part.order.iter_mut().for_each(|row| *row -= place.range.start as u32);
    part.n_source = place.range.len();
    Ok(GaussianScene::new_if_wanted(part, work)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::world::small_scene;
    use stylegaussian::Scene;

    fn levels(ranges: [std::ops::Range<usize>; 2]) -> Levels {
        let node = |range| stylegaussian_files::world::Node {
            bounds: [Vec3::NEG_ONE, Vec3::ONE],
            levels: vec![Some(Place { file: 0, range })],
        };
        Levels {
            n_levels: 1,
            files: vec!["0/meta.json".into()],
            environment: None,
            nodes: ranges.map(node).into(),
        }
    }

    #[test]
    fn a_run_is_a_scene_of_its_own() {
        // Rows 2 and 3 were dropped by the reader.
        let scene = Scene { features: None, decoder: None, ..small_scene(10, 1) };
        let kept: Vec<u32> = (0..10).filter(|i| ![2, 3].contains(i)).collect();
        let chunk = GaussianScene::new(scene.subset(&kept));
        let levels = levels([0..4, 4..10]);
        let part = |i: usize| {
            let place = levels.nodes[i].levels[0].clone().unwrap();
            part_of(&chunk, &levels, &place, 10, &Work::default()).unwrap()
        };
        assert_eq!(part(0).scene().means, scene.means[..2]);
        assert_eq!((&part(1).scene().means[..], part(1).scene().n_source), (&scene.means[4..], 6));
        assert_eq!(part(1).scene().order, [0, 1, 2, 3, 4, 5]);
        assert!(part(0).scene().validate().is_ok() && part(1).scene().validate().is_ok());
    }

    #[test]
    fn a_chunk_that_is_too_short_is_told() {
        let chunk = GaussianScene::new(small_scene(9, 1));
        let levels = levels([0..4, 4..10]);
        let place = levels.nodes[0].levels[0].clone().unwrap();
        let error = part_of(&chunk, &levels, &place, 10, &Work::default()).unwrap_err().to_string();
        assert!(error.contains("9 Gaussians") && error.contains("10"), "{error}");
    }
}
