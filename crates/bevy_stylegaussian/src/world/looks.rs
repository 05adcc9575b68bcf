//! Looks of chunks: each run gets its own part of its chunk's look.

use std::{
    ptr,
    sync::{Arc, Mutex, OnceLock, PoisonError, Weak},
};

use bevy::{
    asset::{AssetPath, LoadState},
    ecs::system::SystemParam,
    platform::collections::HashSet,
    prelude::*,
    window::RequestRedraw,
};
use stylegaussian::{Look, Scene, look::OrderedLook, strokes::StrokeTexture, work::Canceled};
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

/// Runs whose looks are read or cut at a time, and the chunks that are read for them. What waits longer can be
/// overtaken by what a camera turned to. A frame begins the next ones, so as many runs fill a frame of 16 ms if
/// each takes a quarter of a millisecond. A chunk is many times as large as a run.
const AT_ONCE: usize = 64;
const CHUNKS_AT_ONCE: usize = 8;

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
    Cutting { running: Running<Result<Arc<Look>, String>>, of_chunk: Arc<ChunkLook> },
    /// The chunk's stays with it, for other runs of the chunk.
    There { own: Handle<StyleLook>, _of_chunk: Arc<ChunkLook> },
    /// It cannot be had.
    Absent,
}

/// The look of a chunk, for all of its runs.
struct ChunkLook {
    handle: Handle<StyleLook>,
    /// The look and the chunk that it was read for, which are only compared for identity.
    look: Weak<Look>,
    chunk: Weak<Scene>,
    /// The look in the order of the chunk, once a task has needed it. A coarse chunk has thousands of runs. So
    /// a run costs as much as its own Gaussians, and not as much as the chunk.
    ordered: OnceLock<Result<OrderedLook, String>>,
}

impl ChunkLook {
    /// The look of a chunk that no run has yet.
    fn new(handle: Handle<StyleLook>, look: &Arc<Look>, chunk: &Arc<Scene>) -> Self {
        let (look, chunk) = (Arc::downgrade(look), Arc::downgrade(chunk));
        Self { handle, look, chunk, ordered: OnceLock::new() }
    }

    fn is_of(&self, look: &Arc<Look>, chunk: &Arc<Scene>) -> bool {
        ptr::eq(self.look.as_ptr(), Arc::as_ptr(look)) && ptr::eq(self.chunk.as_ptr(), Arc::as_ptr(chunk))
    }

    /// The part of a run, cut from this look and this chunk, of which it is.
    fn part(&self, look: &Look, chunk: &Scene, place: &Place, textures: &Textures) -> Result<Look, String> {
        let ordered = self.ordered.get_or_init(|| {
            let mut ordered = look.ordered(chunk).map_err(|error| error.to_string())?;
            if let Some(strokes) = &mut ordered.strokes {
                textures.share(&mut strokes.textures);
            }
            Ok(ordered)
        });
        match ordered {
            Ok(ordered) => Ok(ordered.part(chunk, place.of(chunk))),
            Err(error) => Err(error.clone()),
        }
    }
}

/// Textures of paintings. The look of each chunk comes with a copy of its own, and the GPU would have a layer
/// for each.
#[derive(Clone, Default)]
struct Textures(Arc<Mutex<Vec<Weak<StrokeTexture>>>>);

impl Textures {
    /// Puts the textures that are in use in place of equal ones.
    fn share(&self, textures: &mut [Arc<StrokeTexture>]) {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|known| known.strong_count() > 0);
        for texture in textures {
            // The same one is equal at once.
            let found = known.iter().filter_map(Weak::upgrade).find(|known| *known == *texture);
            match found {
                Some(found) => *texture = found,
                None => known.push(Arc::downgrade(texture)),
            }
        }
    }
}

/// The look of a run, as far as it is there.
pub(super) enum Given<'a> {
    /// The look, or `None` if the style of the world has no such looks.
    There(Option<&'a Handle<StyleLook>>),
    /// It is on its way.
    Awaited,
    /// It cannot be had.
    Absent,
}

impl<'a> Given<'a> {
    /// Tells whether a run has the look that `source` names for it.
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
    /// The looks of chunks that runs have.
    of_chunks: Local<'s, Vec<Weak<ChunkLook>>>,
    textures: Local<'s, Textures>,
}

/// Gives runs their looks, some at a time: those that are seen first, and of these the largest on screen.
pub(super) fn cut_looks(
    mut worlds: Query<(&mut Tree, Option<&StyleSource>), Without<Run>>,
    mut runs: Query<(Entity, &Run, Option<&mut RunLook>)>,
    with_looks: Query<(), With<RunLook>>,
    mut sources: Sources,
) {
    // Most worlds have no looks, and thousands of runs.
    let folder = worlds.iter().find_map(|(_, source)| source?.folder_of_looks());
    if with_looks.is_empty() && folder.is_none() {
        return;
    }
    let (mut waiting, mut n_busy, mut reading) = (Vec::new(), 0, HashSet::new());
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
                if let Stage::Reading { place, .. } = &look.stage {
                    reading.insert((run.world, place.file));
                }
            }
            None => waiting.push((tree.turn(run.node), entity, run.world, run.node)),
        }
    }
    if n_busy > 0 || !waiting.is_empty() {
        sources.redraw.write(RequestRedraw);
    }
    waiting.sort_unstable();
    for (_, entity, world, node) in waiting {
        if n_busy >= AT_ONCE {
            break;
        }
        let Ok((tree, Some(source))) = worlds.get(world) else { continue };
        let Some(folder) = source.folder_of_looks() else { continue };
        let stage = match node {
            Some(node) => match tree.place(node, entity) {
                Some(place) => {
                    let chunk = (world, place.file);
                    if reading.len() >= CHUNKS_AT_ONCE && !reading.contains(&chunk) {
                        continue;
                    }
                    let stage = sources.reading(tree, folder, place);
                    if matches!(stage, Some(Stage::Reading { .. })) {
                        n_busy += 1;
                        reading.insert(chunk);
                    }
                    stage
                }
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
    /// Begins to read the look of a run's chunk, unless it is known that it cannot be had.
    fn reading(&self, tree: &Tree, folder: &str, place: Place) -> Option<Stage> {
        let file = tree.levels.as_ref()?.files.get(place.file)?;
        let look = AssetPath::from(format!("{folder}/{}", look_of(file)));
        // Bevy would read it again.
        if tree.told.contains(&look.to_string()) {
            return Some(Stage::Absent);
        }
        let chunk = self.server.load(tree.path_of(file));
        Some(Stage::Reading { place, chunk, of_chunk: self.server.load(look) })
    }

    /// The look of a chunk as all of its runs share it: the known one, or a new one.
    fn of_chunk(
        &mut self,
        handle: &Handle<StyleLook>,
        look: &Arc<Look>,
        chunk: &Arc<Scene>,
    ) -> Arc<ChunkLook> {
        self.of_chunks.retain(|known| known.strong_count() > 0);
        let found = self.of_chunks.iter().filter_map(Weak::upgrade).find(|known| known.is_of(look, chunk));
        found.unwrap_or_else(|| {
            let new = Arc::new(ChunkLook::new(handle.clone(), look, chunk));
            self.of_chunks.push(Arc::downgrade(&new));
            new
        })
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
                let of_chunk = self.of_chunk(of_chunk, &look, &scene);
                let (common, textures) = (Arc::clone(&of_chunk), Textures::clone(&self.textures));
                let running = self.workers.start(Lane::Styles, move |work| {
                    work.check()?;
                    Ok(common.part(&look, &scene, &place, &textures).map(Arc::new))
                });
                Ok(Some(Stage::Cutting { running, of_chunk }))
            }
            Stage::Cutting { running, of_chunk } => {
                let failed = |error: String| (name(&of_chunk.handle), error);
                match running.get() {
                    None => Ok(None),
                    Some(Ok(Ok(look))) => {
                        let own = self.looks.add(StyleLook(Arc::clone(look)));
                        Ok(Some(Stage::There { own, _of_chunk: Arc::clone(of_chunk) }))
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

impl Tree {
    /// The place of a run in its chunk, or `None` if the node has let go of the run's entity.
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
    use stylegaussian::{
        look::MadeFrom,
        strokes::{StrokeSeed, Strokes},
    };

    use super::*;
    use crate::tests::world::small_scene;

    /// The look of a chunk that no run has yet.
    fn of_chunk(look: &Arc<Look>, chunk: &Arc<Scene>) -> ChunkLook {
        ChunkLook::new(Handle::default(), look, chunk)
    }

    #[test]
    fn a_run_has_its_part_of_the_look() {
        let (scene, other) = (Arc::new(small_scene(10, 1)), Arc::new(small_scene(10, 2)));
        let colors: Vec<[f32; 3]> = (0..10).map(|i| [i as f32, 0.0, 1.0]).collect();
        let look = Arc::new(Look::new(&scene, &colors, MadeFrom::default()));
        let part = |chunk: &Arc<Scene>, place: &Place| {
            of_chunk(&look, chunk).part(&look, chunk, place, &Textures::default())
        };
        let place = Place { file: 0, range: 4..7 };
        let own = scene.subset(&[4, 5, 6]);
        assert_eq!(part(&scene, &place).unwrap().colors_for(&own).unwrap(), colors[4..7]);
        let error = part(&other, &place).unwrap_err();
        assert!(error.contains("of another scene"), "{error}");
        let of_chunk = of_chunk(&look, &scene);
        assert!(of_chunk.is_of(&look, &scene) && !of_chunk.is_of(&look, &other));
    }

    #[test]
    fn looks_of_one_painting_share_its_texture() {
        let texture =
            |value: i8| StrokeTexture { fine: vec![vec![[value; 4]]], wide: vec![vec![[value; 4]]] };
        let (textures, chunk) = (Textures::default(), Arc::new(small_scene(4, 1)));
        let texture_of_part = |value: i8| {
            let strokes = Strokes {
                seeds: vec![StrokeSeed::default()],
                words: vec![0; 4],
                textures: vec![Arc::new(texture(value))],
            };
            let look = Look::new(&chunk, &[[0.5; 3]; 4], MadeFrom::default()).with_strokes(&chunk, &strokes);
            let look = Arc::new(look);
            let place = Place { file: 0, range: 1..3 };
            let part = of_chunk(&look, &chunk).part(&look, &chunk, &place, &textures).unwrap();
            Arc::clone(&part.strokes.unwrap().textures[0])
        };
        let (first, other, second) = (texture_of_part(1), texture_of_part(2), texture_of_part(1));
        assert!(Arc::ptr_eq(&first, &second) && !Arc::ptr_eq(&first, &other));
        assert_eq!((&*first, &*other), (&texture(1), &texture(2)));
        // What nobody uses is forgotten.
        drop((first, other, second));
        let _third = texture_of_part(3);
        assert_eq!(textures.0.lock().unwrap().len(), 1);
    }
}
