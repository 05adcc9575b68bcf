//! The levels that worlds should show: a cut through all of them, ten times a second.

use std::{sync::Arc, time::Duration};

use bevy::{
    asset::LoadState, camera::visibility::RenderLayers, math::Affine3A, prelude::*, window::RequestRedraw,
};
use stylegaussian::cut::{CutNode, CutView, cut};

use super::{
    asset::WorldManifest,
    budget::GaussianBudget,
    component::{GaussianWorld, WorldState},
    failure::WorldFailures,
    tree::{Run, Tree},
    views::Views,
};
use crate::scene::{GaussianScene, GaussianSplats};

/// Time between cuts. A camera's view hardly changes meanwhile, and a file takes longer to be read.
const INTERVAL: Duration = Duration::from_millis(100);

/// Share of a node's pixels that is left at the next cut once no view sees it: a tenth after a second. So the
/// nodes beside a view do not come and go while a camera looks around.
const MEMORY: f32 = 0.8;

/// The most pixels that count of a node that no view sees any more: as wide as a screen. A camera that was
/// inside of it saw more.
const WIDEST: f32 = 4096.0;

/// Takes over manifests that came or changed, and reports those that cannot be had.
pub(super) fn follow_manifests(
    mut commands: Commands,
    mut worlds: Query<(Entity, &GaussianWorld, &mut Tree)>,
    manifests: Res<Assets<WorldManifest>>,
    server: Res<AssetServer>,
    mut failures: WorldFailures,
    mut redraw: MessageWriter<RequestRedraw>,
) {
    for (entity, world, mut tree) in &mut worlds {
        let Some(manifest) = manifests.get(&world.0) else {
            match server.get_load_state(&world.0) {
                Some(LoadState::Failed(error)) => {
                    let file = world.0.path().map_or_else(|| "a manifest".into(), ToString::to_string);
                    failures.send(entity, &mut tree.told, file, error.to_string());
                }
                Some(LoadState::Loading) => {
                    redraw.write(RequestRedraw);
                }
                _ => {}
            }
            continue;
        };
        if tree.is_of(manifest.levels()) {
            continue;
        }
        for old in tree.entities() {
            commands.entity(old).try_despawn();
        }
        let levels = Arc::clone(manifest.levels());
        let path = world.0.path().cloned();
        *tree = Tree::new(&levels, path);
        if let Some(file) = &levels.environment {
            let scene: Handle<GaussianScene> = server.load(tree.path_of(file));
            let run = Run { world: entity, node: None, is_drawable: false };
            let child = commands.spawn((GaussianSplats(scene.clone()), run, ChildOf(entity))).id();
            tree.environment = Some((child, scene));
        }
    }
}

/// Takes everything away from entities that are no worlds any more.
pub(super) fn drop_removed_worlds(
    mut commands: Commands,
    mut removed: RemovedComponents<GaussianWorld>,
    worlds: Query<(), With<GaussianWorld>>,
    trees: Query<&Tree>,
) {
    // A component that was put back in the same frame is in `worlds`.
    for entity in removed.read().filter(|&entity| !worlds.contains(entity)) {
        let Ok(tree) = trees.get(entity) else { continue };
        for run in tree.entities() {
            commands.entity(run).try_despawn();
        }
        commands.entity(entity).try_remove::<(Tree, WorldState)>();
    }
}

/// The components of a world that say where it is and who sees it.
type PlacedWorld =
    (&'static GlobalTransform, Option<&'static RenderLayers>, &'static Visibility, &'static mut Tree);

/// Chooses the level of each node.
pub(super) fn choose_levels(
    mut worlds: Query<PlacedWorld>,
    mut views: Views,
    scenes: Res<Assets<GaussianScene>>,
    budget: Res<GaussianBudget>,
    time: Res<Time<Real>>,
    mut last: Local<Option<Duration>>,
) {
    if worlds.iter().all(|(.., tree)| tree.nodes.is_empty()) {
        return;
    }
    let passed = last.map_or(Duration::ZERO, |last| time.elapsed().saturating_sub(last));
    let is_new = worlds.iter().any(|(.., tree)| tree.is_new);
    if last.is_some() && passed < INTERVAL && !is_new {
        return;
    }
    *last = Some(time.elapsed());
    let layered = views.find(passed);
    let seeing = |layers: Option<&RenderLayers>, visibility: &Visibility| {
        let layers = layers.cloned().unwrap_or_default();
        let is_seen = *visibility != Visibility::Hidden;
        let seeing = layered.iter().filter(|views| is_seen && views.layers.intersects(&layers));
        seeing.flat_map(|views| views.views.iter().copied()).collect()
    };
    let of_worlds: Vec<Vec<CutView>> =
        worlds.iter().map(|(_, layers, visibility, _)| seeing(layers, visibility)).collect();
    let (mut nodes, mut before, mut n_around) = (Vec::new(), Vec::new(), 0);
    for ((place, _, _, tree), views) in worlds.iter().zip(&of_worlds) {
        n_around += tree.n_around(&scenes);
        let Some(levels) = &tree.levels else { continue };
        let place = place.affine();
        for (node, of_file) in tree.nodes.iter().zip(&levels.nodes) {
            let bounds = placed(of_file.bounds, &place);
            let least_pixels = MEMORY * node.pixels.min(WIDEST);
            nodes.push(CutNode { bounds, counts: &node.counts, views, least_pixels });
            before.push(node.wanted);
        }
    }
    let chosen = cut(&nodes, budget.gaussians.saturating_sub(n_around), &before);
    let is_short = |(node, level): (&CutNode, &Option<usize>)| {
        level.is_none() && node.counts.iter().any(|count| *count > 0)
    };
    if nodes.iter().zip(&chosen.levels).any(is_short) {
        warn_once!("parts of worlds are not shown: their fewest Gaussians exceed GaussianBudget");
    }
    let mut chosen = chosen.levels.into_iter().zip(chosen.pixels).zip(chosen.is_seen);
    for (.., mut tree) in &mut worlds {
        tree.is_new = false;
        for (node, ((level, pixels), is_seen)) in tree.nodes.iter_mut().zip(&mut chosen) {
            (node.wanted, node.pixels, node.is_seen) = (level, pixels, is_seen);
        }
    }
}

/// The box in the world around a box of a scene.
fn placed([min, max]: [Vec3; 2], place: &Affine3A) -> [Vec3; 2] {
    let half = 0.5 * (max - min);
    let matrix = place.matrix3;
    let half = matrix.x_axis.abs() * half.x + matrix.y_axis.abs() * half.y + matrix.z_axis.abs() * half.z;
    let (center, half) = (place.transform_point3(0.5 * (min + max)), Vec3::from(half));
    [center - half, center + half]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_placed_box_holds_its_corners() {
        let turn = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
        let place = Affine3A::from_scale_rotation_translation(Vec3::new(2.0, 1.0, -1.0), turn, Vec3::X);
        let [min, max] = placed([Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0)], &place);
        // x to y, twice as long; y to -x; z mirrored.
        assert!(min.abs_diff_eq(Vec3::new(-1.0, 0.0, -3.0), 1e-5), "{min}");
        assert!(max.abs_diff_eq(Vec3::new(1.0, 2.0, 0.0), 1e-5), "{max}");
    }
}
