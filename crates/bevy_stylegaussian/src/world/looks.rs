//! Looks of chunks: each run gets its own part of its chunk's look.

use std::sync::Arc;

use bevy::{asset::LoadState, ecs::system::SystemParam, prelude::*, window::RequestRedraw};
use stylegaussian::{Look, Scene, work::Canceled};
use stylegaussian_files::world::{Run as Place, look_of};

use super::{
    failure::WorldFailures,
    tree::{Coming, Run, Stage as OnItsWay, Tree},
};
use crate::{
    scene::GaussianScene,
    style::{StyleLook, StyleSource},
    work::{Lane, Running, Workers},
};

/// Runs whose looks are read or cut at a time. What waits longer can be overtaken by what a camera turned to.
const AT_ONCE: usize = 8;

/// The look of a run.
#[derive(Component)]
pub(super) struct RunLook {
    /// The folder of the looks of chunks.
    folder: String,
    stage: Stage,
}

/// The way of a look to its run.
enum Stage {
    /// The look of the chunk is read, and the chunk, which tells whether they belong together. Mostly it is in
    /// memory still.
    Reading { place: Place, chunk: Handle<GaussianScene>, of_chunk: Handle<StyleLook> },
    /// A task cuts the part out.
    Cutting { running: Running<Result<Arc<Look>, String>>, of_chunk: Handle<StyleLook> },
    /// The chunk's stays with it, for other runs of the chunk.
    There { own: Handle<StyleLook>, _of_chunk: Handle<StyleLook> },
    /// It cannot be had.
    Absent,
}

/// What a run has of its world's looks of chunks.
pub(super) enum Given<'a> {
    /// The look, or `None` if the style of the world has no such looks.
    There(Option<&'a Handle<StyleLook>>),
    /// It is on its way.
    Awaited,
    /// It cannot be had.
    Absent,
}

impl<'a> Given<'a> {
    /// What a run with this look has of those that `source` names.
    pub(super) fn of(source: &StyleSource, look: Option<&'a RunLook>) -> Self {
        let Some(folder) = source.folder_of_looks() else { return Self::There(None) };
        match look.filter(|look| look.folder == folder).map(|look| &look.stage) {
            Some(Stage::There { own, .. }) => Self::There(Some(own)),
            Some(Stage::Absent) => Self::Absent,
            Some(Stage::Reading { .. } | Stage::Cutting { .. }) | None => Self::Awaited,
        }
    }
}

/// Parameters of the system that cuts looks.
#[derive(SystemParam)]
pub(super) struct Sources<'w, 's> {
    commands: Commands<'w, 's>,
    scenes: Res<'w, Assets<GaussianScene>>,
    looks: ResMut<'w, Assets<StyleLook>>,
    server: Res<'w, AssetServer>,
    workers: Res<'w, Workers>,
    failures: WorldFailures<'w, 's>,
    redraw: MessageWriter<'w, RequestRedraw>,
}

/// Gives runs their looks: those that are largest on screen first, a few at a time.
pub(super) fn cut_looks(
    mut worlds: Query<(&mut Tree, Option<&StyleSource>), Without<Run>>,
    mut runs: Query<(Entity, &Run, Option<&mut RunLook>)>,
    mut sources: Sources,
) {
    let (mut waiting, mut n_busy) = (Vec::new(), 0);
    for (entity, run, look) in &mut runs {
        let Ok((mut tree, source)) = worlds.get_mut(run.world) else { continue };
        let Some(folder) = source.and_then(StyleSource::folder_of_looks) else {
            if look.is_some() {
                sources.commands.entity(entity).try_remove::<RunLook>();
            }
            continue;
        };
        match look.filter(|look| look.folder == folder) {
            Some(mut look) => {
                match sources.next(&look.stage) {
                    Ok(None) => {}
                    Ok(Some(stage)) => look.stage = stage,
                    Err((file, error)) => {
                        sources.failures.send(run.world, &mut tree.told, file, error);
                        look.stage = Stage::Absent;
                    }
                }
                n_busy += usize::from(matches!(look.stage, Stage::Reading { .. } | Stage::Cutting { .. }));
            }
            None => {
                let node = run.node.and_then(|node| tree.nodes.get(node));
                waiting.push((node.map_or(f32::MAX, |node| node.pixels), entity, run.world, run.node));
            }
        }
    }
    if n_busy > 0 || !waiting.is_empty() {
        sources.redraw.write(RequestRedraw);
    }
    waiting.sort_by(|(a, first, ..), (b, second, ..)| b.total_cmp(a).then(first.cmp(second)));
    for (_, entity, world, node) in waiting.into_iter().take(AT_ONCE.saturating_sub(n_busy)) {
        let Ok((tree, Some(source))) = worlds.get(world) else { continue };
        let Some(folder) = source.folder_of_looks() else { continue };
        let stage = match node {
            Some(node) => match tree.place(node, entity) {
                Some(place) => sources.reading(tree, folder, place),
                // It is about to leave.
                None => continue,
            },
            // The surroundings are of no level and have no look.
            None => Some(Stage::Absent),
        };
        if let Some(stage) = stage {
            sources.commands.entity(entity).try_insert(RunLook { folder: folder.into(), stage });
        }
    }
}

impl Sources<'_, '_> {
    /// Begins to read the look of a run's chunk.
    fn reading(&self, tree: &Tree, folder: &str, place: Place) -> Option<Stage> {
        let file = tree.levels.as_ref()?.files.get(place.file)?;
        let chunk = self.server.load(tree.path_of(file));
        let of_chunk = self.server.load(format!("{folder}/{}", look_of(file)));
        Some(Stage::Reading { place, chunk, of_chunk })
    }

    /// The stage after this one, or `None` if it lasts.
    ///
    /// # Errors
    /// The file that cannot be had, and the reason.
    fn next(&mut self, stage: &Stage) -> Result<Option<Stage>, (String, String)> {
        match stage {
            Stage::Reading { place, chunk, of_chunk } => {
                let Some(scene) = loaded(&self.server, &self.scenes, chunk)? else { return Ok(None) };
                let Some(look) = loaded(&self.server, &self.looks, of_chunk)? else { return Ok(None) };
                let (place, scene, look) = (place.clone(), Arc::clone(scene.scene()), Arc::clone(&look.0));
                let running = self
                    .workers
                    .start(Lane::Styles, move |_| Ok(part_of(&look, &scene, &place).map(Arc::new)));
                Ok(Some(Stage::Cutting { running, of_chunk: of_chunk.clone() }))
            }
            Stage::Cutting { running, of_chunk } => {
                let failed = |error: String| (name(of_chunk), error);
                match running.get() {
                    None => Ok(None),
                    Some(Ok(Ok(look))) => {
                        let own = self.looks.add(StyleLook(Arc::clone(look)));
                        Ok(Some(Stage::There { own, _of_chunk: of_chunk.clone() }))
                    }
                    Some(Ok(Err(error))) => Err(failed(error.clone())),
                    Some(Err(Canceled)) => {
                        Err(failed("cutting a part out of it ended early: the log says why".into()))
                    }
                }
            }
            Stage::There { .. } | Stage::Absent => Ok(None),
        }
    }
}

/// An asset, `None` while it is read, or its file and the reason why it cannot be.
fn loaded<'a, A: Asset>(
    server: &AssetServer,
    assets: &'a Assets<A>,
    handle: &Handle<A>,
) -> Result<Option<&'a A>, (String, String)> {
    if let Some(asset) = assets.get(handle) {
        return Ok(Some(asset));
    }
    match server.get_load_state(handle) {
        Some(LoadState::Failed(error)) => Err((name(handle), error.to_string())),
        _ => Ok(None),
    }
}

/// The file of an asset, for messages.
fn name<A: Asset>(handle: &Handle<A>) -> String {
    handle.path().map_or_else(|| "a look of a chunk".into(), ToString::to_string)
}

/// The part of a chunk's look that is a run's.
fn part_of(look: &Look, chunk: &Scene, place: &Place) -> Result<Look, String> {
    let found = place.of(chunk);
    let indices: Vec<u32> = (found.start as u32..found.end as u32).collect();
    look.subset(chunk, &indices).map_err(|error| error.to_string())
}

impl Tree {
    /// The place in its chunk of the run that an entity shows of a node, or `None` if it is of none any more.
    fn place(&self, node: usize, entity: Entity) -> Option<Place> {
        let state = self.nodes.get(node)?;
        let is_coming = |coming: &&Coming| matches!(coming.stage, OnItsWay::Hidden(own) if own == entity);
        let coming = state.coming.as_ref().filter(is_coming).map(|coming| coming.level);
        let before = state.fading.as_ref().and_then(|fading| fading.before);
        let shown = state.shown.into_iter().chain(before).find(|shown| shown.entity == entity);
        let level = coming.or(shown.map(|shown| shown.level))?;
        self.levels.as_ref()?.nodes.get(node)?.levels.get(level)?.clone()
    }
}

#[cfg(test)]
mod tests {
    use stylegaussian::look::MadeFrom;

    use super::*;
    use crate::tests::world::small_scene;

    #[test]
    fn a_run_has_its_part_of_the_look() {
        let scene = small_scene(10, 1);
        let colors: Vec<[f32; 3]> = (0..10).map(|i| [i as f32, 0.0, 1.0]).collect();
        let look = Look::new(&scene, &colors, MadeFrom::default());
        let place = Place { file: 0, range: 4..7 };
        let part = scene.subset(&[4, 5, 6]);
        assert_eq!(part_of(&look, &scene, &place).unwrap().colors_for(&part).unwrap(), colors[4..7]);
        let other = part_of(&look, &small_scene(10, 2), &place).unwrap_err();
        assert!(other.contains("of another scene"), "{other}");
    }
}
