//! Styles in space: volumes, waves and strengths, as colors on the GPU against the mix of the CPU.

use std::time::Duration;

use bevy::{
    math::Affine3A,
    prelude::*,
    render::{
        RenderApp,
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntity,
    },
    time::TimeUpdateStrategy,
};
use stylegaussian::{
    Look, Scene,
    layers::{Layer, Region, Shape, mix_layers},
    look::MadeFrom,
    mask::Brush,
};

use crate::{
    GaussianSceneReady, GaussianSplats, HiddenUntilStyled, StyleApplied, StyleFailed, StyleSource,
    StyleTransition, StyleVolume,
    colors::ShownColors,
    mask::StyleMask,
    style::{StyleLook, TransitionClock, decoder::StyleBackend},
};

use crate::tests::world::{rendering::*, *};

mod random;

const N: usize = 400;
const STEP: Duration = Duration::from_millis(100);

/// An app in which each update takes a tenth of a second, a scene in it, and flat looks of the scene.
struct Stage {
    app: App,
    scene: Scene,
    splats: GaussianSplats,
}

impl Stage {
    fn new() -> Option<Self> {
        let mut app = app_with_rendering(StyleBackend::Cpu)?;
        app.insert_resource(TimeUpdateStrategy::ManualDuration(STEP));
        let image = render_target(&mut app, UVec2::splat(8));
        app.world_mut().spawn((Camera3d::default(), target(&image), Transform::from_xyz(0.0, 0.0, 5.0)));
        let scene = Scene { features: None, decoder: None, ..small_scene(N, 1) };
        let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
        Some(Self { app, scene, splats })
    }

    /// A look of one color.
    fn look(&mut self, color: [f32; 3]) -> StyleSource {
        let look = Look::new(&self.scene, &vec![color; N], MadeFrom::default());
        StyleSource::look(add(&mut self.app, StyleLook(look.into())))
    }

    fn set(&mut self, entity: Entity, source: StyleSource) {
        *self.app.world_mut().get_mut(entity).unwrap() = source;
    }

    fn updates(&mut self, n: usize) {
        (0..n).for_each(|_| self.app.update());
    }

    fn until_applied(&mut self, entity: Entity) {
        update_until(&mut self.app, "StyleApplied", |world| {
            let applied: Vec<_> = world.resource_mut::<Messages<StyleApplied>>().drain().collect();
            applied.iter().any(|event| event.entity == entity)
        });
    }

    /// The colors that are drawn, or captured ones.
    fn shown(&self, entity: Entity) -> Vec<[f32; 4]> {
        let world = self.app.sub_app(RenderApp).world();
        let (device, queue) = (world.resource::<RenderDevice>(), world.resource::<RenderQueue>());
        match world.resource::<ShownColors>().shown(MainEntity::from(entity)) {
            Some(colors) => colors.read_premultiplied(device.wgpu_device(), queue).unwrap(),
            None => vec![[0.0; 4]; N],
        }
    }

    /// Checks what an entity shows against layers of flat colors, the lowest first: `None` for the captured
    /// ones.
    fn check(&self, name: &str, entity: Entity, layers: &[(Option<[f32; 3]>, Region, f32)]) {
        let flat = |[r, g, b]: [f32; 3]| vec![[r, g, b, 1.0]; N];
        let colors: Vec<_> = layers.iter().map(|(color, ..)| color.map(flat)).collect();
        let layers: Vec<_> = layers
            .iter()
            .zip(&colors)
            .map(|(&(_, region, strength), look)| Layer {
                look: look.as_deref(),
                region,
                strength,
                mask: None,
            })
            .collect();
        let expected = mix_layers(&self.scene.means, &layers);
        let error = difference(&self.shown(entity), &expected);
        // Looks are stored in 8 bits and mixed in f16.
        assert!(error < 5e-3, "{name}: {error}");
    }
}

fn difference(a: &[[f32; 4]], b: &[[f32; 4]]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

const RED: [f32; 3] = [0.8, 0.2, 0.1];
const GREEN: [f32; 3] = [0.1, 0.6, 0.2];
const BLUE: [f32; 3] = [0.2, 0.1, 0.9];
const ALL: Region = Region::EVERYWHERE;

/// The region of a shape at a place of the world, for a cloud at another.
fn region(shape: Shape, at: Transform, cloud: Transform, softness: f32) -> Region {
    let shape_from_scene: Affine3A = at.compute_affine().inverse() * cloud.compute_affine();
    Region { shape, shape_from_scene, softness }
}

/// Volumes lie over the cloud's own style by their priority, follow their transforms and the cloud's, and go
/// with their entity.
#[test]
fn volumes_restyle_what_is_within() {
    let Some(mut stage) = Stage::new() else { return };
    let [red, green, blue] = [RED, GREEN, BLUE].map(|color| stage.look(color));
    let place = Transform::from_xyz(1.0, 0.0, 0.5)
        .with_rotation(Quat::from_rotation_z(0.4))
        .with_scale(Vec3::new(1.0, 2.0, 1.0));
    let cloud = stage.app.world_mut().spawn((stage.splats.clone(), red, place)).id();
    stage.until_applied(cloud);
    stage.check("no volume", cloud, &[(Some(RED), ALL, 1.0)]);

    let ball = StyleVolume::new(Sphere::new(0.4)).with_softness(0.3).with_priority(1);
    let at = Transform::from_xyz(1.2, 0.3, 0.5);
    let volume = stage.app.world_mut().spawn((ball, green, at.with_scale(Vec3::splat(2.0)))).id();
    stage.until_applied(volume);
    let sphere = Shape::Ellipsoid { radii: Vec3::splat(0.8) };
    stage.check(
        "a ball",
        cloud,
        &[(Some(RED), ALL, 1.0), (Some(GREEN), region(sphere, at, place, 0.3), 1.0)],
    );

    // As captured, below the ball, in half of the strength.
    let half_space = StyleVolume::half_space().with_softness(0.5);
    let source = StyleSource::none().with_strength(0.5);
    let below = stage.app.world_mut().spawn((half_space, source, Transform::from_xyz(0.0, -0.2, 0.0))).id();
    stage.until_applied(below);
    let plane = |y: f32| region(Shape::HalfSpace, Transform::from_xyz(0.0, y, 0.0), place, 0.5);
    let ball = (Some(GREEN), region(sphere, at, place, 0.3), 1.0);
    stage.check("two volumes", cloud, &[(Some(RED), ALL, 1.0), (None, plane(-0.2), 0.5), ball]);

    // All of it moves in the same frame.
    stage.app.world_mut().get_mut::<Transform>(below).unwrap().translation.y = 0.4;
    let place = Transform::from_xyz(0.5, 0.2, 0.0);
    *stage.app.world_mut().get_mut(cloud).unwrap() = place;
    stage.app.update();
    let plane = region(Shape::HalfSpace, Transform::from_xyz(0.0, 0.4, 0.0), place, 0.5);
    let ball = (Some(GREEN), region(sphere, at, place, 0.3), 1.0);
    stage.check("moved", cloud, &[(Some(RED), ALL, 1.0), (None, plane, 0.5), ball]);

    // The ball's style changes, then the priorities.
    stage.set(volume, blue);
    stage.until_applied(volume);
    let ball = (Some(BLUE), ball.1, 1.0);
    stage.check("another style", cloud, &[(Some(RED), ALL, 1.0), (None, plane, 0.5), ball]);
    stage.app.world_mut().get_mut::<StyleVolume>(below).unwrap().priority = 7;
    stage.app.update();
    stage.check("another order", cloud, &[(Some(RED), ALL, 1.0), ball, (None, plane, 0.5)]);

    // One goes, one leaves, and one is for another cloud.
    stage.app.world_mut().despawn(below);
    stage.app.update();
    stage.check("one gone", cloud, &[(Some(RED), ALL, 1.0), ball]);
    stage.app.world_mut().get_mut::<StyleVolume>(volume).unwrap().cloud = Some(volume);
    stage.app.update();
    stage.check("not for this cloud", cloud, &[(Some(RED), ALL, 1.0)]);
    stage.app.world_mut().get_mut::<StyleVolume>(volume).unwrap().cloud = Some(cloud);
    stage.until_applied(volume);
    stage.check("for this cloud", cloud, &[(Some(RED), ALL, 1.0), ball]);
    stage.app.world_mut().entity_mut(volume).remove::<StyleVolume>();
    stage.app.update();
    stage.check("no volume any more", cloud, &[(Some(RED), ALL, 1.0)]);
}

/// A cloud without a style of its own takes those of volumes, and shares the look with a cloud that wears it.
#[test]
fn volumes_need_no_style_below() {
    let Some(mut stage) = Stage::new() else { return };
    let red = stage.look(RED);
    let cloud = stage.app.world_mut().spawn(stage.splats.clone()).id();
    let volume =
        stage.app.world_mut().spawn((StyleVolume::new(Cuboid::new(1.0, 9.0, 9.0)), red.clone())).id();
    stage.until_applied(volume);
    let cuboid = Shape::Cuboid { half_size: Vec3::new(0.5, 4.5, 4.5) };
    let within = region(cuboid, Transform::IDENTITY, Transform::IDENTITY, 0.0);
    stage.check("a box", cloud, &[(Some(RED), within, 1.0)]);
    let shown = stage.shown(cloud);
    let n_within = shown.iter().filter(|color| color[3] == 1.0).count();
    assert!((N / 3..2 * N / 3).contains(&n_within), "{n_within}");
    // A volume that goes on to hold everything leaves the cloud with the look's own buffer.
    stage.app.world_mut().get_mut::<StyleVolume>(volume).unwrap().shape = default();
    stage.app.update();
    stage.check("everything", cloud, &[(Some(RED), ALL, 1.0)]);
}

/// The first style of a volume fades in over whatever lies below, and the next one sweeps through what the
/// volume shows.
#[test]
fn later_styles_of_a_volume_come_in_shape() {
    let Some(mut stage) = Stage::new() else { return };
    let [red, green] = [RED, GREEN].map(|color| stage.look(color));
    let cloud = stage.app.world_mut().spawn(stage.splats.clone()).id();
    let front = StyleTransition::front(Dir3::Y, Duration::from_secs(1)).with_softness(0.0);
    let ball = StyleVolume::new(Sphere::new(0.8));
    let volume = stage.app.world_mut().spawn((ball, red, front)).id();
    let ball = Region { shape: Shape::Ellipsoid { radii: Vec3::splat(0.8) }, ..ALL };
    stage.until_applied(volume);
    stage.updates(5);
    let share = stage.shown(cloud).iter().map(|color| color[3]).fold(0.0, f32::max);
    assert!((0.3..0.9).contains(&share), "{share}");
    stage.check("half faded in", cloud, &[(Some(RED), ball, share)]);
    stage.updates(10);
    stage.check("the first one", cloud, &[(Some(RED), ball, 1.0)]);

    stage.set(volume, green);
    stage.until_applied(volume);
    stage.updates(5);
    let shown = stage.shown(cloud);
    let is = |color: [f32; 3]| {
        let near = |shown: &&[f32; 4]| (shown[0] - color[0]).abs() + (shown[1] - color[1]).abs() < 1e-2;
        shown.iter().filter(|shown| shown[3] == 1.0).filter(near).count()
    };
    let n_within = shown.iter().filter(|color| color[3] > 0.0).count();
    assert!(is(RED) > 20 && is(GREEN) > 20, "{} red, {} green", is(RED), is(GREEN));
    assert_eq!(is(RED) + is(GREEN), n_within);
    stage.updates(10);
    stage.check("the second one", cloud, &[(Some(GREEN), ball, 1.0)]);
}

/// A strength multiplies what is shown, at once and without a new style.
#[test]
fn a_strength_leads_from_captured_to_styled() {
    let Some(mut stage) = Stage::new() else { return };
    let red = stage.look(RED);
    let cloud = stage.app.world_mut().spawn((stage.splats.clone(), red)).id();
    stage.until_applied(cloud);
    for strength in [0.75, 0.5, 0.0, 1.0, -3.0, f32::NAN, f32::INFINITY] {
        stage.app.world_mut().get_mut::<StyleSource>(cloud).unwrap().strength = strength;
        stage.app.update();
        let usual = if strength.is_nan() { 0.0 } else { strength.clamp(0.0, 1.0) };
        stage.check(&format!("strength {strength}"), cloud, &[(Some(RED), ALL, usual)]);
        stage.updates(5);
        assert!(drain::<StyleApplied>(&mut stage.app).is_empty());
    }
}

/// Each kind of transition goes from the old colors to the new without a jump, and a change in between goes on
/// from what is shown.
#[test]
fn transitions_never_jump() {
    let Some(mut stage) = Stage::new() else { return };
    let looks = [RED, GREEN, BLUE].map(|color| stage.look(color));
    let cloud = stage.app.world_mut().spawn((stage.splats.clone(), looks[0].clone())).id();
    stage.until_applied(cloud);
    let center = stage.app.world_mut().spawn(Transform::from_xyz(2.0, 0.0, 0.0)).id();
    let second = Duration::from_secs(1);
    let shapes = [
        StyleTransition::fade(second),
        StyleTransition::sphere(Vec3::ZERO, second).with_softness(2.0),
        StyleTransition::sphere(center, second).with_softness(2.0),
        StyleTransition::front(Dir3::NEG_Y, second).with_softness(2.0),
        StyleTransition::dissolve(0.5, second).with_softness(1.0),
    ];
    let mut n_changes = 0;
    for shape in shapes {
        stage.app.world_mut().entity_mut(cloud).insert(shape.clone());
        // More changes than lie on one another: the lower ones are frozen.
        for change in 0..8 {
            let before = stage.shown(cloud);
            // While time stands still, nothing that is shown may change.
            stage.app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO));
            n_changes += 1;
            stage.set(cloud, looks[n_changes % 3].clone());
            stage.until_applied(cloud);
            let step = difference(&before, &stage.shown(cloud));
            assert!(step < 5e-3, "{shape:?}, change {change}: {step}");
            stage.app.insert_resource(TimeUpdateStrategy::ManualDuration(STEP));
            stage.updates(3);
            assert!(difference(&before, &stage.shown(cloud)) > 0.0, "{shape:?} goes on");
        }
        let last = [RED, GREEN, BLUE][n_changes % 3];
        stage.updates(15);
        stage.check(&format!("{shape:?}"), cloud, &[(Some(last), ALL, 1.0)]);
    }
}

/// A wave reaches what is near its center first, in world units, whatever the place of the cloud.
#[test]
fn a_wave_spreads_from_its_center() {
    let Some(mut stage) = Stage::new() else { return };
    let [red, green] = [RED, GREEN].map(|color| stage.look(color));
    let place = Transform::from_xyz(1.0, 2.0, 3.0).with_scale(Vec3::splat(2.0));
    let cloud = stage.app.world_mut().spawn((stage.splats.clone(), red, place)).id();
    stage.until_applied(cloud);
    let center = Vec3::new(1.0, 2.0, 5.0);
    let wave = StyleTransition::sphere(center, Duration::from_secs(1)).with_softness(0.0);
    stage.app.world_mut().entity_mut(cloud).insert((wave, green));
    stage.until_applied(cloud);
    stage.updates(3);
    let shown = stage.shown(cloud);
    let distance = |i: usize| place.transform_point(stage.scene.means[i]).distance(center);
    let of = |color: [f32; 3]| (0..N).filter(move |&i| (shown[i][0] - color[0]).abs() < 0.01).map(distance);
    let farthest_new = of(GREEN).fold(0.0, f32::max);
    let shown = stage.shown(cloud);
    let of = |color: [f32; 3]| (0..N).filter(move |&i| (shown[i][0] - color[0]).abs() < 0.01).map(distance);
    let nearest_old = of(RED).fold(f32::INFINITY, f32::min);
    assert!(farthest_new > 0.0 && nearest_old.is_finite(), "both are seen");
    assert!(farthest_new <= nearest_old, "{farthest_new} {nearest_old}");
}

/// On the game's clock, a transition stands still while the game is paused.
#[test]
fn a_paused_game_pauses_its_waves() {
    let Some(mut stage) = Stage::new() else { return };
    let red = stage.look(RED);
    let fade = StyleTransition::fade(Duration::from_secs(2)).with_clock(TransitionClock::Virtual);
    let cloud = stage.app.world_mut().spawn((stage.splats.clone(), red, fade)).id();
    stage.until_applied(cloud);
    stage.updates(5);
    stage.app.world_mut().resource_mut::<Time<Virtual>>().pause();
    stage.updates(2);
    let before = stage.shown(cloud);
    assert!((0.1..0.9).contains(&before[0][3]), "{}", before[0][3]);
    stage.updates(10);
    assert_eq!(stage.shown(cloud), before);
    stage.app.world_mut().resource_mut::<Time<Virtual>>().unpause();
    stage.updates(20);
    stage.check("after the pause", cloud, &[(Some(RED), ALL, 1.0)]);
}

/// An entity that waits for its style shows nothing, not even its captured colors, until it has one or fails.
#[test]
fn an_entity_may_wait_for_its_style() {
    let Some(mut stage) = Stage::new() else { return };
    let is_drawn = |stage: &Stage, entity: Entity| {
        let world = stage.app.sub_app(RenderApp).world();
        world.resource::<ShownColors>().get(MainEntity::from(entity)).is_some()
    };
    let look = stage.app.world().resource::<Assets<StyleLook>>().reserve_handle();
    let source = StyleSource::look(look.clone());
    let cloud = stage.app.world_mut().spawn((stage.splats.clone(), source, HiddenUntilStyled)).id();
    for _ in 0..10 {
        stage.app.update();
        assert!(!is_drawn(&stage, cloud));
    }
    let baked = Look::new(&stage.scene, &vec![RED; N], MadeFrom::default());
    stage.app.world_mut().resource_mut::<Assets<StyleLook>>().insert(&look, StyleLook(baked.into())).unwrap();
    stage.until_applied(cloud);
    assert!(is_drawn(&stage, cloud));
    stage.check("drawn", cloud, &[(Some(RED), ALL, 1.0)]);
    // A look of another scene.
    let other = Look::new(&small_scene(N, 9), &vec![RED; N], MadeFrom::default());
    let other = StyleSource::look(add(&mut stage.app, StyleLook(other.into())));
    let cloud = stage.app.world_mut().spawn((stage.splats.clone(), other, HiddenUntilStyled)).id();
    update_until(&mut stage.app, "StyleFailed", |world| {
        !world.resource::<Messages<StyleFailed>>().is_empty()
    });
    stage.updates(2);
    assert!(is_drawn(&stage, cloud));
}

/// Volumes without a size, of infinite size, at no place at all, and volumes whose style never comes: the
/// picture stays finite, and the others do their work.
#[test]
fn volumes_may_be_anything() {
    let Some(mut stage) = Stage::new() else { return };
    let [red, green] = [RED, GREEN].map(|color| stage.look(color));
    let cloud = stage.app.world_mut().spawn((stage.splats.clone(), red)).id();
    stage.until_applied(cloud);
    let sizes = [0.0, -1.0, f32::INFINITY, f32::NAN, f32::MIN_POSITIVE, f32::MAX];
    for size in sizes {
        let shapes = [
            StyleVolume::new(Sphere { radius: size }),
            StyleVolume::new(Cuboid { half_size: Vec3::splat(size) }),
            StyleVolume::new(Cylinder { radius: size, half_height: size }),
            StyleVolume::new(Capsule3d { radius: size, half_length: size }),
            StyleVolume::new(Cone { radius: size, height: size }),
            StyleVolume::new(Torus { minor_radius: size, major_radius: size }),
            StyleVolume::half_space(),
        ];
        for shape in shapes {
            let here = Transform::default();
            let nowhere = Transform::from_xyz(size, 0.0, 0.0);
            let flat = Transform::from_scale(Vec3::splat(size));
            for transform in [here, nowhere, flat] {
                let soft = shape.clone().with_softness(size);
                stage.app.world_mut().spawn((soft, transform, green.clone()));
                stage.app.world_mut().spawn((shape.clone(), transform, green.clone()));
            }
        }
    }
    let missing = stage.app.world().resource::<AssetServer>().load("no_such.look.safetensors");
    stage.app.world_mut().spawn((StyleVolume::everything().with_priority(9), StyleSource::look(missing)));
    stage.updates(30);
    let shown = stage.shown(cloud);
    assert!(shown.as_flattened().iter().all(|value| value.is_finite()));
    assert!(shown.iter().all(|color| (color[3] - 1.0).abs() < 5e-3), "one look or the other");
}

/// A scene is announced once it can be drawn, and again if it is replaced.
#[test]
fn a_scene_tells_that_it_can_be_drawn() {
    let Some(mut stage) = Stage::new() else { return };
    let cloud = stage.app.world_mut().spawn(stage.splats.clone()).id();
    for seed in 0..2 {
        update_until(&mut stage.app, "GaussianSceneReady", |world| {
            let ready: Vec<_> = world.resource_mut::<Messages<GaussianSceneReady>>().drain().collect();
            ready.iter().any(|event| event.entity == cloud)
        });
        stage.updates(5);
        assert!(drain::<GaussianSceneReady>(&mut stage.app).is_empty(), "once");
        let other = add_scene(&mut stage.app, small_scene(9, seed));
        stage.app.world_mut().get_mut::<GaussianSplats>(cloud).unwrap().0 = other;
    }
}

/// A style shows where its channel of the mask is painted, from the frame in which that changes.
#[test]
fn a_brush_paints_styles() {
    let Some(mut stage) = Stage::new() else { return };
    let [red, green] = [RED, GREEN].map(|color| stage.look(color));
    let cloud = stage.app.world_mut().spawn((stage.splats.clone(), red, StyleMask::default())).id();
    let plain = stage.app.world_mut().spawn(stage.splats.clone()).id();
    let volume = stage.app.world_mut().spawn((StyleVolume::painted(2), green)).id();
    stage.until_applied(volume);
    stage.check("unpainted", cloud, &[(Some(RED), ALL, 1.0)]);
    let brush = Brush { radius: 0.8, channel: 2, ..Brush::default() };
    let paint = |stage: &mut Stage, change: &dyn Fn(&mut StyleMask) -> bool| {
        let mut mask = stage.app.world_mut().get_mut::<StyleMask>(cloud).unwrap();
        assert!(change(&mut mask));
        let weights = mask.mask().unwrap().weights.clone();
        stage.app.update();
        weights
    };
    let strokes: [&dyn Fn(&mut StyleMask) -> bool; 4] = [
        &|mask| mask.paint(&brush, &[Vec3::new(0.5, 0.0, 0.0)]),
        &|mask| mask.paint(&brush, &[Vec3::new(-0.5, 0.3, 0.0)]),
        &|mask| mask.undo(),
        &|mask| mask.redo(),
    ];
    for stroke in strokes {
        let weights = paint(&mut stage, stroke);
        assert!(weights.iter().any(|weights| weights[2] > 0));
        let flat = |[r, g, b]: [f32; 3]| vec![[r, g, b, 1.0]; N];
        let (red, green) = (flat(RED), flat(GREEN));
        let layer = |look, mask| Layer { look: Some(look), region: ALL, strength: 1.0, mask };
        let layers = [layer(&red[..], None), layer(&green[..], Some((&weights[..], 2)))];
        let error = difference(&stage.shown(cloud), &mix_layers(&stage.scene.means, &layers));
        assert!(error < 5e-3, "{error}");
    }
    stage.check("no mask", plain, &[]);
    // A channel that does not exist is never painted.
    stage.app.world_mut().get_mut::<StyleVolume>(volume).unwrap().mask = Some(9);
    stage.app.update();
    stage.check("no such channel", cloud, &[(Some(RED), ALL, 1.0)]);
}
