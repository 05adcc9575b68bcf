//! Ray casts.

use bevy::{
    ecs::{query::QueryData, system::SystemParam},
    prelude::*,
};
use stylegaussian::raycast::{Hit, Ray};

use crate::{mask::HiddenFromRays, scene::LoadedScene};

use super::index::RayIndexes;
use crate::work::Workers;

/// Casts rays at splats, as Bevy's `MeshRayCast` does at meshes.
///
/// A ray hits where half of its light is gone, by the alpha of the draw: see [`stylegaussian::raycast`]. It
/// passes what a [`MaskVisibility`](crate::mask::MaskVisibility) has hidden since the last frame. A system that
/// casts rays may paint a [`StyleMask`](crate::mask::StyleMask), too.
///
/// A scene's Gaussians are indexed in the background when the first ray asks for it, which takes some tenths of
/// a second for a large scene. Until then rays pass it: call [`prepare`](Self::prepare) early.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::SplatRayCast;
/// fn click(mut rays: SplatRayCast, camera: Single<(&Camera, &GlobalTransform)>, window: Single<&Window>) {
///     let (camera, place) = *camera;
///     let Some(cursor) = window.cursor_position() else { return };
///     let Ok(ray) = camera.viewport_to_world(place, cursor) else { return };
///     if let Some(hit) = rays.cast_ray(ray) {
///         info!("{} at {}", hit.entity, hit.position);
///     }
/// }
/// ```
#[derive(SystemParam)]
pub struct SplatRayCast<'w, 's> {
    clouds: Query<'w, 's, Cloud>,
    indexes: ResMut<'w, RayIndexes>,
    workers: Res<'w, Workers>,
}

/// An entity's splats, as rays see them.
#[derive(QueryData)]
struct Cloud {
    entity: Entity,
    scene: &'static LoadedScene,
    transform: &'static GlobalTransform,
    visibility: &'static InheritedVisibility,
    hidden: Option<&'static HiddenFromRays>,
}

/// The place at which a ray hits an entity's splats.
#[derive(Clone, Copy, Debug, PartialEq, Reflect)]
#[reflect(Clone, Debug, PartialEq)]
pub struct SplatHit {
    /// The entity.
    pub entity: Entity,
    /// Distance from the ray's origin, in world units.
    pub distance: f32,
    /// The point, in world space.
    pub position: Vec3,
    /// An estimate of the surface's normal in world space, of length 1.
    pub normal: Vec3,
    /// The Gaussian that contributes most: its index in the scene in memory.
    pub gaussian: u32,
    /// The index of that Gaussian in the file that the scene was read from.
    pub source_gaussian: u32,
}

impl SplatRayCast<'_, '_> {
    /// Begins to index the scenes of all visible entities. Returns whether all are ready.
    pub fn prepare(&mut self) -> bool {
        let mut all_ready = true;
        for cloud in &self.clouds {
            // Each is asked for, also after one that is not ready.
            all_ready &= !cloud.visibility.get() || self.indexes.get(cloud.scene, &self.workers).is_some();
        }
        all_ready
    }

    /// The nearest hit on the splats of visible entities. Entities in front of others do not add up to a hit
    /// together.
    pub fn cast_ray(&mut self, ray: Ray3d) -> Option<SplatHit> {
        self.cast_ray_at(ray, |_| true)
    }

    /// As [`cast_ray`](Self::cast_ray), at the entities that `chosen` returns true for.
    pub fn cast_ray_at(&mut self, ray: Ray3d, chosen: impl Fn(Entity) -> bool) -> Option<SplatHit> {
        self.hits(ray, chosen).min_by(|a, b| a.distance.total_cmp(&b.distance))
    }

    /// The hit on each visible entity that `chosen` returns true for, in no order.
    pub(super) fn hits(
        &mut self,
        ray: Ray3d,
        chosen: impl Fn(Entity) -> bool,
    ) -> impl Iterator<Item = SplatHit> {
        let Self { clouds, indexes, workers } = self;
        clouds.iter().filter_map(move |cloud| {
            if !cloud.visibility.get() || !chosen(cloud.entity) {
                return None;
            }
            let scene_from_world = cloud.transform.affine().inverse();
            // The direction keeps the world's length, so that distances do.
            let local = Ray {
                origin: scene_from_world.transform_point3(ray.origin),
                direction: scene_from_world.transform_vector3(*ray.direction),
            };
            let index = indexes.get(cloud.scene, workers)?;
            let hit = match cloud.hidden.and_then(|hidden| hidden.of(cloud.scene.scene())) {
                Some(visibility) => index.cast_through(local, |i| visibility.share(i)),
                None => index.cast(local),
            }?;
            Some(in_world(cloud.entity, cloud.scene, ray, hit, scene_from_world.matrix3.into()))
        })
    }
}

/// A hit in world space.
fn in_world(entity: Entity, scene: &LoadedScene, ray: Ray3d, hit: Hit, scene_from_world: Mat3) -> SplatHit {
    let Hit { distance, normal, gaussian, .. } = hit;
    // Normals go by the inverse transpose.
    let normal = (scene_from_world.transpose() * normal).normalize_or(-*ray.direction);
    let source_gaussian = scene.scene().order.get(gaussian as usize).copied().unwrap_or(gaussian);
    SplatHit { entity, distance, position: ray.get_point(distance), normal, gaussian, source_gaussian }
}

#[cfg(test)]
mod tests {
    use stylegaussian::mask::Brush;

    use super::*;
    use crate::{
        GaussianSplats,
        mask::{MaskVisibility, StyleMask},
        tests::world::*,
    };

    #[derive(Resource)]
    struct Asked(Ray3d);

    #[derive(Resource, Default)]
    struct Found(Option<SplatHit>, bool);

    fn app() -> App {
        let mut app = app_without_rendering();
        app.insert_resource(Asked(Ray3d::new(Vec3::new(0.0, 0.0, 10.0), Dir3::NEG_Z)))
            .init_resource::<Found>()
            .add_systems(Last, |mut rays: SplatRayCast, asked: Res<Asked>, mut found: ResMut<Found>| {
                *found = Found(rays.cast_ray(asked.0), rays.prepare());
            });
        app
    }

    fn cast(app: &mut App) -> Option<SplatHit> {
        app.update();
        update_until(app, "the index", |world| world.resource::<Found>().1);
        app.world().resource::<Found>().0
    }

    /// Rays follow an entity's transform, and pass hidden entities.
    #[test]
    fn rays_hit_where_splats_are() {
        let mut app = app();
        let ball = |mean: Vec3| Ball { mean, scale: 0.1, opacity: 0.9, color: [0.5; 3] };
        let splats =
            GaussianSplats(add_scene(&mut app, balls(&[ball(Vec3::Z), ball(Vec3::new(0.0, 1.0, 0.0))])));
        let place = Transform::from_xyz(0.0, 0.0, -1.0).with_scale(Vec3::new(2.0, 2.0, 3.0));
        let far = app.world_mut().spawn((splats.clone(), place, InheritedVisibility::VISIBLE)).id();
        let hit = cast(&mut app).unwrap();
        assert_eq!((hit.entity, hit.gaussian, hit.source_gaussian), (far, 0, 0));
        assert!(
            (hit.position - Vec3::new(0.0, 0.0, 2.0)).length() < 1e-5 && (hit.distance - 8.0).abs() < 1e-5,
            "{hit:?}"
        );
        // Another entity of the same scene in front of it, then hidden.
        let before = Transform::from_xyz(0.0, 0.0, 5.0);
        let near = app.world_mut().spawn((splats, before, InheritedVisibility::VISIBLE)).id();
        assert_eq!(cast(&mut app).map(|hit| hit.entity), Some(near));
        // As Bevy's visibility sets it, which is no part of this app.
        *app.world_mut().get_mut(near).unwrap() = InheritedVisibility::HIDDEN;
        assert_eq!(cast(&mut app).map(|hit| hit.entity), Some(far));
        // Past everything, and at a place without a volume.
        app.world_mut().resource_mut::<Asked>().0.origin.x = 3.0;
        assert_eq!(cast(&mut app), None);
        app.world_mut().get_mut::<Transform>(far).unwrap().scale = Vec3::ZERO;
        assert_eq!(cast(&mut app), None);
    }

    /// A system paints the splats that its rays hit, and rays then pass them.
    #[test]
    fn rays_pass_what_is_painted_away() {
        let mut app = app_without_rendering();
        app.add_message::<Painted>().add_systems(Update, paint_away);
        let ball = Ball { mean: Vec3::ZERO, scale: 0.1, opacity: 0.9, color: [0.5; 3] };
        let splats = GaussianSplats(add_scene(&mut app, balls(&[ball])));
        let cloud =
            app.world_mut().spawn((splats, MaskVisibility::Hide(0), InheritedVisibility::VISIBLE)).id();
        update_until(&mut app, "a hit", |world| !world.resource::<Messages<Painted>>().is_empty());
        (0..3).for_each(|_| app.update());
        app.world_mut().resource_mut::<Messages<Painted>>().clear();
        (0..3).for_each(|_| app.update());
        assert!(app.world().resource::<Messages<Painted>>().is_empty(), "a ray hit what is hidden");
        app.world_mut().entity_mut(cloud).remove::<MaskVisibility>();
        (0..3).for_each(|_| app.update());
        assert!(!app.world().resource::<Messages<Painted>>().is_empty());
    }

    #[derive(Message)]
    struct Painted;

    fn paint_away(
        mut rays: SplatRayCast,
        mut mask: Single<&mut StyleMask>,
        mut painted: MessageWriter<Painted>,
    ) {
        if let Some(hit) = rays.cast_ray(Ray3d::new(Vec3::new(0.0, 0.0, 10.0), Dir3::NEG_Z))
            && mask.paint(&Brush { softness: 0.0, ..Brush::default() }, &[hit.position])
        {
            painted.write(Painted);
        }
    }
}
