//! From the styles of clouds and volumes to the layers of each cloud.
//!
//! An entity shows a list of layers, lowest first. The first are the styles that it wears, each over a region
//! that grows during its transition. The next is a top layer of captured colors with opacity 1 - strength. The
//! volumes that touch the entity follow by priority. The list is made anew in each frame, and the kernel
//! `mix_layers` runs if it differs from the last one. One style over all of a scene needs no mix: the splat
//! pass then reads the style's own buffer, which other entities may read too.

use bevy::{camera::primitives::Aabb, prelude::*};
use stylegaussian::{
    layers::Region,
    light::TintVolume,
    strokes::{StrokeKnobs, StrokeMotion},
};

use crate::{
    colors::{ColorLayer, ColorLayers, LayerColors, TintedParts},
    scene::LoadedScene,
    style::{
        make::job::{StyleJob, StyleJobs},
        show::{place::Place, sun::Sun, volume::StyleVolume, worn::Passed},
        wish::{
            applied::AppliedStyle,
            relief::StyleRelief,
            source::{HiddenUntilStyled, StyleSource},
        },
    },
};

/// A cloud's radius is multiplied by this where volumes ask for it: they compute their styles before they
/// arrive.
const NEAR: f32 = 2.0;

/// A cloud in the world.
#[derive(Clone, Copy)]
struct PlacedCloud<'a> {
    entity: Entity,
    scene: &'a LoadedScene,
    /// A ball around it.
    center: Vec3,
    radius: f32,
}

/// The components of a cloud that say where it is.
type CloudPlace = (Entity, &'static LoadedScene, &'static Aabb, &'static GlobalTransform);

/// The components of a volume.
type Volume =
    (Entity, &'static StyleVolume, &'static GlobalTransform, &'static mut StyleJobs, &'static StyleSource);

fn placed<'a>(
    (entity, scene, bounds, transform): (Entity, &'a LoadedScene, &Aabb, &GlobalTransform),
) -> PlacedCloud<'a> {
    let center = transform.affine().transform_point3a(bounds.center);
    let radius = transform.affine().matrix3 * bevy::math::Mat3A::from_diagonal(bounds.half_extents.into());
    // The corners' distance from the center, at most.
    let radius = radius.x_axis.length() + radius.y_axis.length() + radius.z_axis.length();
    PlacedCloud { entity, scene, center: center.into(), radius }
}

/// The scene came or changed, or the style came.
type ShowsAnother = Or<(Changed<LoadedScene>, Changed<StyleSource>)>;

/// Gives clouds a job for the scene that they show. A new scene starts in its captured colors.
pub(crate) fn find_scenes_of_clouds(
    mut commands: Commands,
    mut clouds: Query<(Entity, &LoadedScene, &mut StyleJobs), (Without<StyleVolume>, ShowsAnother)>,
    mut gone: RemovedComponents<LoadedScene>,
    mut jobs: Query<&mut StyleJobs, (Without<LoadedScene>, Without<StyleVolume>)>,
) {
    for entity in gone.read() {
        if let Ok(mut jobs) = jobs.get_mut(entity) {
            jobs.of_scene.clear();
            commands.entity(entity).try_remove::<AppliedStyle>();
        }
    }
    for (entity, scene, mut jobs) in &mut clouds {
        if jobs.of_scene.iter().any(|job| job.is_of(scene)) {
            continue;
        }
        if !jobs.of_scene.is_empty() {
            commands.entity(entity).try_remove::<AppliedStyle>();
        }
        // Drops the old jobs' tasks too, which cancels them: their colors would be of the old Gaussians.
        jobs.of_scene = vec![StyleJob::new(entity, scene)];
    }
}

/// Gives volumes a job for each scene that they come near, and drops those of scenes that they have left.
pub(crate) fn find_scenes_of_volumes(
    clouds: Query<CloudPlace>,
    mut volumes: Query<Volume>,
    mut gone: RemovedComponents<StyleVolume>,
    mut others: Query<&mut StyleJobs, Without<StyleVolume>>,
) {
    for entity in gone.read() {
        if let Ok(mut jobs) = others.get_mut(entity) {
            jobs.of_scene.clear();
        }
    }
    if volumes.is_empty() {
        return;
    }
    let clouds: Vec<_> = clouds.iter().map(placed).collect();
    for (_, volume, transform, mut jobs, _) in &mut volumes {
        let is_near = |cloud: &&PlacedCloud| {
            volume.cloud.is_none_or(|only| only == cloud.entity)
                && volume.may_touch(transform, cloud.center, NEAR * cloud.radius)
        };
        let near: Vec<_> = clouds.iter().filter(is_near).collect();
        let is_current = jobs.of_scene.iter().all(|job| near.iter().any(|cloud| job.is_of(cloud.scene)))
            && near.iter().all(|cloud| jobs.of_scene.iter().any(|job| job.is_of(cloud.scene)));
        if is_current {
            continue;
        }
        jobs.of_scene.retain(|job| near.iter().any(|cloud| job.is_of(cloud.scene)));
        for cloud in near {
            if !jobs.of_scene.iter().any(|job| job.is_of(cloud.scene)) {
                jobs.of_scene.push(StyleJob::new(cloud.entity, cloud.scene));
            }
        }
    }
}

/// Lets time pass for all transitions.
pub(crate) fn advance_transitions(
    mut jobs: Query<(&mut StyleJobs, Has<StyleVolume>)>,
    real: Res<Time<Real>>,
    game: Res<Time<Virtual>>,
) {
    let passed = Passed { real: real.delta(), game: game.delta() };
    for (mut jobs, is_volume) in &mut jobs {
        // Nothing watches for changes of jobs.
        for job in &mut jobs.bypass_change_detection().of_scene {
            job.worn.advance(passed, !is_volume);
        }
    }
}

/// The components of a cloud that its layers are set on.
type LayeredCloud = (
    Entity,
    &'static LoadedScene,
    &'static Aabb,
    &'static GlobalTransform,
    &'static mut ColorLayers,
    Has<HiddenUntilStyled>,
);

/// Sets the layers of all clouds: their own style, and those of the volumes that touch them. Finds the volumes
/// that tint them.
pub(crate) fn compose_layers(
    mut clouds: Query<LayeredCloud>,
    mut volumes: Query<Volume>,
    mut own: Query<(&mut StyleJobs, Option<&StyleSource>), Without<StyleVolume>>,
    places: Query<&GlobalTransform>,
    sun: Res<Sun>,
    mut tinted: ResMut<TintedParts>,
) {
    tinted.0.clear();
    let mut volumes: Vec<_> = volumes.iter_mut().collect();
    volumes.sort_by_key(|(entity, volume, ..)| (volume.priority, *entity));
    let place_of = |entity: Entity| Some(places.get(entity).ok()?.translation());
    for (entity, scene, bounds, transform, mut layers, hides) in &mut clouds {
        let world_from_scene = transform.affine();
        let all = [Vec3::from(bounds.min()), Vec3::from(bounds.max())];
        let place = Place::new(world_from_scene, scene.asset.usual_bounds().unwrap_or(all), all, &place_of);
        let (mut found, mut is_hidden, mut knobs) = (Vec::new(), false, layers.knobs);
        let mut relief = StyleRelief::default();
        let mut motion = layers.layers.first().map_or(StrokeMotion::Still, |layer| layer.motion);
        if let Ok((mut jobs, source)) = own.get_mut(entity)
            && let Some(job) = jobs.bypass_change_detection().of_scene.iter_mut().find(|job| job.is_of(scene))
        {
            is_hidden = hides && job.is_unstyled() && !job.is_settled();
            found = job.worn.layers(&place);
            // A style that goes, goes as it was drawn.
            if let Some(source) = source.filter(|source| !source.is_none()) {
                relief = source.relief;
                let light = relief.to_light(&world_from_scene, sun.0);
                knobs = StrokeKnobs { light, ..source.knobs() };
                motion = source.motion.usual();
            }
            found.iter_mut().for_each(|layer| layer.motion = motion);
            let strength = source.map_or(1.0, StyleSource::usual_strength);
            if strength < 1.0 && !found.is_empty() {
                // Colors are premultiplied: captured colors of the rest over them multiply them by the
                // strength.
                found.push(ColorLayer::everywhere(LayerColors::Captured, 1.0 - strength));
            }
        }
        let cloud = placed((entity, scene, bounds, transform));
        for (_, volume, at, jobs, source) in &mut volumes {
            if volume.cloud.is_some_and(|only| only != entity)
                || !volume.may_touch(at, cloud.center, cloud.radius)
            {
                continue;
            }
            let region = volume.region(at);
            // Tints are found by view, which has no masks.
            let tint = volume
                .tint
                .filter(|_| volume.mask.is_none())
                .map(|tint| TintVolume { region, tint: tint.into() });
            if let Some(tint) = tint.filter(|tint| tint.change().is_some()) {
                tinted.0.entry(entity).or_default().push(tint);
            }
            let shape_from_scene = match volume.is_everything() {
                true => Region::EVERYWHERE.shape_from_scene,
                false => region.shape_from_scene * world_from_scene,
            };
            let region = Region { shape_from_scene, ..region };
            let jobs = &mut jobs.bypass_change_detection().of_scene;
            // A volume that changes what is there shows captured colors nowhere.
            if let Some(job) = jobs.iter_mut().find(|job| job.is_of(scene))
                && !(volume.is_change() && source.is_none())
            {
                let layer = job.worn.volume_layer(&place, region, source.usual_strength(), volume.channel());
                found.extend(layer.map(|layer| ColorLayer { motion: source.motion.usual(), ..layer }));
            }
            // Captured colors have no strokes.
            if let Some(strokes) = &volume.strokes
                && !found.is_empty()
            {
                let factors = strokes.usual(&world_from_scene, at);
                found.push(ColorLayer { region, mask: volume.channel(), ..ColorLayer::change(factors) });
            }
        }
        let adds_relief =
            |layer: &ColorLayer| layer.factors.is_some_and(|factors| factors.added_relief > 0.0);
        if found.iter().any(adds_relief) {
            knobs.light = relief.to_any_light(&world_from_scene, sun.0);
        }
        // A layer that covers all hides those below.
        if let Some(top) = found.iter().rposition(ColorLayer::covers_all) {
            found.drain(..top);
        }
        ColorLayers::set(&mut layers, found, knobs, is_hidden);
    }
}
