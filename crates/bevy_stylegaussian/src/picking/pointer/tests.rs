//! Pointers over splats, without a window.

use bevy::{
    camera::{CameraProjection, ComputedCameraValues, RenderTarget, RenderTargetInfo},
    input::InputPlugin,
    picking::{
        DefaultPickingPlugins,
        pointer::{Location, PointerId, PointerLocation},
    },
    window::ExitCondition,
};
use stylegaussian::{
    mask::Brush,
    raycast::{Ray, RayIndex},
    work::Work,
};

use super::*;
use crate::{
    GaussianSplats, StyleGaussianPlugin,
    mask::{MaskVisibility, StyleMask},
    tests::world::*,
};

/// Width and height of the view, in pixels.
const SIZE: u32 = 100;

/// Observed events: their name, the entity, and the hit.
#[derive(Resource, Default)]
struct Seen(Vec<(&'static str, Entity, HitData)>);

/// An app with a camera at z = 5 that looks at the origin, and a pointer in the middle of its picture.
fn app() -> (App, Entity) {
    let mut app = App::new();
    let window = WindowPlugin { exit_condition: ExitCondition::DontExit, ..default() };
    app.add_plugins((MinimalPlugins, AssetPlugin::default(), TransformPlugin, InputPlugin, window))
        .init_asset::<Image>()
        .add_plugins((StyleGaussianPlugin::default(), DefaultPickingPlugins, SplatPickingPlugin))
        .init_resource::<Seen>();
    let mut app = rendering::finish(app);
    let projection = PerspectiveProjection { aspect_ratio: 1.0, ..default() };
    let target = RenderTarget::None { size: UVec2::splat(SIZE) };
    // What Bevy's camera systems compute, which are no part of this app.
    let computed = ComputedCameraValues {
        clip_from_view: projection.get_clip_from_view(),
        target_info: Some(RenderTargetInfo { physical_size: UVec2::splat(SIZE), scale_factor: 1.0 }),
        ..default()
    };
    let camera = Camera { computed, order: 3, ..default() };
    let place = Transform::from_xyz(0.0, 0.0, 5.0);
    let camera = app.world_mut().spawn((camera, target.clone(), place)).id();
    let location = Location {
        target: target.normalize(None).expect("it names no window"),
        position: Vec2::splat(SIZE as f32 / 2.0),
    };
    app.world_mut()
        .spawn((PointerId::Custom(bevy::asset::uuid::Uuid::nil()), PointerLocation::new(location)));
    app.add_observer(|over: On<Pointer<Over>>, mut seen: ResMut<Seen>| {
        seen.0.push(("over", over.entity, over.hit.clone()));
    });
    app.add_observer(|out: On<Pointer<Out>>, mut seen: ResMut<Seen>| {
        seen.0.push(("out", out.entity, out.hit.clone()));
    });
    (app, camera)
}

/// Splats in front of the camera, in an order of their own.
fn spawn(app: &mut App, z: f32) -> Entity {
    let mut scene = small_scene(400, 5);
    scene.order.reverse();
    let splats = GaussianSplats(add_scene(app, scene));
    app.world_mut().spawn((splats, Transform::from_xyz(0.0, 0.0, z), InheritedVisibility::VISIBLE)).id()
}

/// The last hits that were sent, after enough updates for indexes to be built.
fn hits(app: &mut App) -> Option<PointerHits> {
    drain::<PointerHits>(app);
    let mut all_ready = false;
    for _ in 0..2000 {
        app.update();
        all_ready =
            app.world_mut().run_system_cached(|mut rays: SplatRayCast| rays.prepare()).unwrap_or(false);
        if all_ready {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert!(all_ready, "indexes are ready");
    drain::<PointerHits>(app);
    app.update();
    drain::<PointerHits>(app).pop()
}

/// The hit has the camera, its order and the place that the scene's own ray cast gives; observers see it.
#[test]
fn pointers_hit_splats() {
    let (mut app, camera) = app();
    assert!(hits(&mut app).is_none(), "nothing is there");
    let cloud = spawn(&mut app, 0.0);
    let found = hits(&mut app).expect("a hit");
    let scene = small_scene(400, 5);
    let ray = Ray { origin: Vec3::new(0.0, 0.0, 5.0 - 0.1), direction: Vec3::NEG_Z };
    let expected = RayIndex::new(&scene, &Work::default()).unwrap().cast(ray).expect("a hit");
    let (entity, hit) = found.picks[0].clone();
    assert_eq!((found.picks.len(), entity, found.order, hit.camera), (1, cloud, 3.0, camera));
    let near = |a: Option<Vec3>, b: Vec3| a.is_some_and(|a| a.abs_diff_eq(b, 1e-4));
    assert!(
        near(hit.position, expected.position) && near(hit.normal, expected.normal),
        "{hit:?} {expected:?}"
    );
    assert!((hit.depth - expected.distance).abs() < 1e-4, "{hit:?} {expected:?}");
    let extra = hit.extra_as::<SplatHit>().expect("our data");
    assert_eq!((extra.gaussian, extra.source_gaussian), (expected.gaussian, 399 - expected.gaussian));
    let (name, entity, seen) = app.world().resource::<Seen>().0[0].clone();
    assert_eq!((name, entity, seen.position), ("over", cloud, hit.position));
    app.world_mut().despawn(cloud);
    assert!(hits(&mut app).is_none(), "the splats are gone");
}

/// The nearest entity is over the others, unless it lets pointers pass; markers and layers decide who takes
/// part.
#[test]
fn entities_choose_whether_they_are_picked() {
    let (mut app, camera) = app();
    let (far, near) = (spawn(&mut app, -3.0), spawn(&mut app, 0.0));
    let entities = |app: &mut App| {
        let mut entities: Vec<_> =
            hits(app).into_iter().flat_map(|hits| hits.picks).map(|pick| pick.0).collect();
        entities.sort();
        entities
    };
    let mut both = [far, near];
    both.sort();
    assert_eq!(entities(&mut app), both);
    // The far one's index may have been ready first.
    let over = app.world().resource::<Seen>().0.iter().rfind(|seen| seen.0 == "over").map(|seen| seen.1);
    assert_eq!(over, Some(near), "the nearer one blocks the other");
    app.world_mut().entity_mut(near).insert(Pickable::IGNORE);
    assert_eq!(entities(&mut app), [far]);
    app.world_mut().entity_mut(far).insert(RenderLayers::layer(1));
    assert_eq!(entities(&mut app), []);
    app.world_mut().entity_mut(camera).insert(RenderLayers::layer(1));
    assert_eq!(entities(&mut app), [far]);
    app.world_mut().resource_mut::<SplatPickingSettings>().require_markers = true;
    assert_eq!(entities(&mut app), []);
    app.world_mut().entity_mut(camera).insert(SplatPickingCamera);
    assert_eq!(entities(&mut app), []);
    app.world_mut().entity_mut(far).insert(Pickable::default());
    assert_eq!(entities(&mut app), [far]);
    // As Bevy's visibility sets it.
    *app.world_mut().get_mut(far).expect("it is there") = InheritedVisibility::HIDDEN;
    assert_eq!(entities(&mut app), []);
}

/// Pointers pass what a mask hides.
#[test]
fn hidden_splats_are_not_hit() {
    let (mut app, _) = app();
    let cloud = spawn(&mut app, 0.0);
    app.world_mut().entity_mut(cloud).insert(MaskVisibility::Hide(1));
    let at = |app: &mut App| hits(app).and_then(|hits| hits.picks[0].1.position);
    let first = at(&mut app).expect("nothing is painted");
    let brush = Brush { radius: 0.3, softness: 0.0, strength: 1.0, channel: 1, ..default() };
    let mut mask = app.world_mut().get_mut::<StyleMask>(cloud).expect("it is required");
    assert!(mask.paint(&brush, &[first]));
    let second = at(&mut app);
    assert!(second.is_none_or(|second| second.z < first.z - 0.05), "{second:?} behind {first}");
    app.world_mut().entity_mut(cloud).insert(MaskVisibility::Crop(2));
    assert_eq!(at(&mut app), None, "nothing is left");
    app.world_mut().entity_mut(cloud).remove::<MaskVisibility>();
    assert_eq!(at(&mut app), Some(first), "all is shown again");
}
