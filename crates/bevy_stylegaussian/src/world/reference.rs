//! The scene as a part of which all of a world is painted: some of the Gaussians of its coarsest levels.
//!
//! A part of a world that was painted alone would get the painting's colors by its own colors alone, and its
//! neighbor by others, so parts would not fit together. As parts of one painted scene, all of them have one
//! palette and one contrast, and the strokes of that scene: all levels of a part the same ones, which go on
//! over its borders. It is small, and whatever comes in whatever order is painted alike.

use std::sync::Arc;

use bevy::{prelude::*, window::RequestRedraw};
use stylegaussian::{
    Scene,
    work::{Canceled, Work},
};

use super::tree::{Run, Tree};
use crate::{
    scene::{GaussianScene, GaussianSplats, LoadedScene},
    style::{Beside, SharedStyle, StyleSource},
    work::{Lane, Running, Workers},
};

/// The most Gaussians of the scene. The demo scene, of which the README has the times of paint, has fewer.
const MOST: usize = 100_000;

/// The way of the scene.
pub(super) enum Reference {
    /// A task puts it together.
    Gathering(Running<GaussianScene>),
    /// It is a child, which is hidden.
    There { child: Entity, painted: Option<Painted> },
    /// There will be none. Parts are painted alone.
    Absent,
}

/// The scene in a style.
pub(super) struct Painted {
    pub(super) style: Arc<SharedStyle>,
    /// Facts for its parts, or `None` if it is not painted.
    pub(super) beside: Option<Arc<Beside>>,
}

/// Marks the scene's entity.
#[derive(Component)]
pub(super) struct IsReference;

/// Makes the scenes of worlds that are styled, once all of their parts are there. Asks for another frame while
/// one is put together.
pub(super) fn make_references(
    mut commands: Commands,
    mut worlds: Query<(Entity, &mut Tree, Option<&StyleSource>)>,
    runs: Query<&LoadedScene, With<Run>>,
    mut scenes: ResMut<Assets<GaussianScene>>,
    workers: Res<Workers>,
    mut redraw: MessageWriter<RequestRedraw>,
) {
    for (entity, mut tree, source) in &mut worlds {
        // Looks are painted already, and what is mixed with them is painted alone.
        if source.is_none_or(|source| source.is_none() || source.folder_of_looks().is_some()) {
            continue;
        }
        match &tree.reference {
            None => {
                let Some(parts) = tree.parts(&runs) else { continue };
                let gathering = workers.start(Lane::Scenes, move |work| {
                    GaussianScene::new_if_wanted(gathered(&parts, MOST, work)?, work)
                });
                tree.reference = Some(Reference::Gathering(gathering));
                redraw.write(RequestRedraw);
            }
            Some(Reference::Gathering(running)) => match running.get() {
                None => {
                    redraw.write(RequestRedraw);
                }
                Some(Ok(scene)) => {
                    let splats = GaussianSplats(scenes.add(scene.clone()));
                    let parts = (splats, IsReference, Visibility::Hidden, ChildOf(entity));
                    let child = commands.spawn(parts).id();
                    tree.reference = Some(Reference::There { child, painted: None });
                }
                Some(Err(_)) => tree.reference = Some(Reference::Absent),
            },
            Some(Reference::There { .. } | Reference::Absent) => {}
        }
    }
}

impl Tree {
    /// A scene of each part, or `None` until all of them are there.
    fn parts(&self, runs: &Query<&LoadedScene, With<Run>>) -> Option<Vec<Arc<Scene>>> {
        let is_here = |run: Option<Entity>| runs.get(run?).ok().map(|loaded| Arc::clone(loaded.scene()));
        let wanted = self.nodes.iter().filter(|node| node.wanted.is_some());
        let parts: Option<Vec<_>> = wanted.map(|node| is_here(node.entity())).collect();
        parts.filter(|parts| !parts.is_empty())
    }
}

/// Gaussians of several scenes in their base colors, `most` of them, spread evenly.
fn gathered(scenes: &[Arc<Scene>], most: usize, work: &Work) -> Result<Scene, Canceled> {
    let n: usize = scenes.iter().map(|scene| scene.len()).sum();
    let every = n.div_ceil(most.max(1)).max(1);
    let (mut gathered, mut colors, mut passed) = (Scene::default(), Vec::new(), 0_usize);
    for scene in scenes {
        work.check()?;
        let base = scene.base_colors();
        // As if all scenes were one.
        for i in (passed.next_multiple_of(every) - passed..scene.len()).step_by(every) {
            gathered.means.push(scene.means[i]);
            gathered.rotations.push(scene.rotations[i]);
            // Those that are left cover the area of all.
            gathered.scales.push(scene.scales[i] * (every as f32).sqrt());
            gathered.opacities.push(scene.opacities[i]);
            colors.push(base[i]);
        }
        passed += scene.len();
    }
    let n = gathered.means.len();
    // Most chunks do not tell it. Then the surface guesses it, from all of them together.
    let up = scenes.first().and_then(|scene| scene.up);
    let mut gathered = Scene { order: (0..n as u32).collect(), n_source: n, up, ..gathered };
    gathered.set_colors(&colors);
    Ok(gathered)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::world::small_scene;

    #[test]
    fn some_of_each_scene_are_gathered() {
        let (scenes, work) = ([10, 4, 0, 7].map(|n| Arc::new(small_scene(n, n as u64))), Work::default());
        let all = gathered(&scenes, 100, &work).unwrap();
        assert_eq!(all.len(), 21);
        assert_eq!((all.means[10], all.scales[14]), (scenes[1].means[0], scenes[3].scales[0]));
        let close = |a: [f32; 3], b: [f32; 3]| Vec3::from(a).abs_diff_eq(Vec3::from(b), 1e-5);
        assert!(close(all.base_colors()[15], scenes[3].base_colors()[1]));
        // Every third of 21.
        let some = gathered(&scenes, 8, &work).unwrap();
        assert!(some.validate().is_ok());
        assert_eq!(some.means, (0..21).step_by(3).map(|i| all.means[i]).collect::<Vec<_>>());
        assert!(gathered(&[], 8, &work).unwrap().is_empty());
        work.cancel();
        assert_eq!(gathered(&scenes, 8, &work).err(), Some(Canceled));
    }
}
