//! Masks: fitted to scenes, painted, undone, uploaded, and drawn.

use std::{fs, sync::Arc};

use bevy::{
    asset::AssetPlugin,
    camera::Viewport,
    core_pipeline::tonemapping::Tonemapping,
    prelude::*,
    render::{
        RenderApp,
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntity,
    },
};
use stylegaussian::{
    Mask, Scene, StoredMask,
    layers::Region,
    mask::{Brush, Combine, Selection},
    random::Random,
};
use stylegaussian_files::{read_scene, write_mask, write_scene};

use crate::{
    GaussianScene, GaussianSceneFailed, GaussianSplats,
    mask::{
        MaskEdit, MaskVisibility, RenderMasks, SavedMask, StyleMask, StyleMaskFailed, WorldMask,
        lasso_in_view,
    },
    style::decoder::StyleBackend,
    world::WorldPart,
};

use super::world::{rendering::*, *};

fn mask_of(app: &mut App, entity: Entity) -> Mut<'_, StyleMask> {
    app.world_mut().get_mut::<StyleMask>(entity).expect("a mask")
}

fn weights(app: &App, entity: Entity) -> Option<Vec<[u8; 4]>> {
    Some(app.world().get::<StyleMask>(entity)?.mask()?.weights.clone())
}

fn everything() -> Selection {
    Selection::Region(Region::EVERYWHERE)
}

/// A mask with a pattern that no two Gaussians share.
fn patterned(n: usize) -> Mask {
    let mut mask = Mask::new(n);
    (0..n).for_each(|i| mask.weights[i] = [i as u8, 0, 255 - i as u8, 0]);
    mask
}

#[test]
fn parts_take_over_the_mask_of_their_world_whenever_they_arrive() {
    let mut app = app_without_rendering();
    let world = app.world_mut().spawn((WorldMask::default(), MaskVisibility::Hide(0))).id();
    let arrive = |app: &mut App, seed: u64| {
        let splats = GaussianSplats(add_scene(app, small_scene(60, seed)));
        app.world_mut().spawn((splats, WorldPart { world, part: seed as usize, level: 0 })).id()
    };
    let dab = |at: Vec3| (Brush { radius: 1.2, softness: 0.3, strength: 0.7, ..default() }, at);
    let dabs = [dab(Vec3::ZERO), dab(Vec3::splat(0.5)), dab(Vec3::splat(99.0))];
    // The first dabs, with an inverted channel before them.
    let expected = |seed: u64, n: usize| {
        let (scene, mut mask) = (small_scene(60, seed), Mask::new(60));
        mask.invert(1);
        for (brush, at) in &dabs[..n] {
            mask.paint(&scene.means, brush, &[*at]);
        }
        Some(mask.weights)
    };
    let change = |app: &mut App, change: &dyn Fn(&mut WorldMask)| {
        change(&mut app.world_mut().get_mut::<WorldMask>(world).unwrap());
        app.update();
        app.update();
    };
    let paint = |n: usize| {
        let (brush, at) = dabs[n];
        move |mask: &mut WorldMask| mask.edit(MaskEdit::Paint { brush, centers: vec![at] })
    };
    change(&mut app, &|mask| mask.edit(MaskEdit::Invert { channel: 1 }));
    change(&mut app, &paint(0));
    let first = arrive(&mut app, 1);
    change(&mut app, &|_| {});
    assert_eq!(weights(&app, first), expected(1, 1));
    assert_eq!(app.world().get::<MaskVisibility>(first), Some(&MaskVisibility::Hide(0)));
    change(&mut app, &paint(1));
    let second = arrive(&mut app, 2);
    change(&mut app, &|_| {});
    // One that is far away changes nothing, and neither does undoing it.
    let last_changed = |app: &App| {
        [first, second].map(|part| app.world().entity(part).get_ref::<StyleMask>().unwrap().last_changed())
    };
    let before = last_changed(&app);
    change(&mut app, &paint(2));
    change(&mut app, &|mask| assert!(mask.undo()));
    change(&mut app, &|mask| assert!(mask.redo()));
    assert!(last_changed(&app) == before);
    for (part, seed) in [(first, 1), (second, 2)] {
        assert_eq!(weights(&app, part), expected(seed, 2));
    }
    change(&mut app, &|mask| assert!(mask.undo() && mask.undo()));
    for (part, seed) in [(first, 1), (second, 2)] {
        assert_eq!(weights(&app, part), expected(seed, 1));
    }
    change(&mut app, &|mask| assert!(mask.redo() && mask.edits().count() == 3));
    assert_eq!(weights(&app, first), expected(1, 2));
    // A new change takes the place of those that are undone.
    change(&mut app, &paint(2));
    change(&mut app, &|mask| assert!(!mask.redo() && mask.edits().count() == 4));
    app.world_mut().entity_mut(world).remove::<WorldMask>();
    app.update();
    assert_eq!((weights(&app, first), app.world().get::<MaskVisibility>(second)), (None, None));
}

#[test]
fn masks_are_ready_with_their_scene_and_can_be_undone() {
    let mut app = app_without_rendering();
    let entity = app.world_mut().spawn(StyleMask::default()).id();
    let brush = Brush { radius: 9.0, softness: 0.0, ..default() };
    app.update();
    assert!(!mask_of(&mut app, entity).paint(&brush, &[Vec3::ZERO]), "there is no scene");
    let scene = small_scene(50, 1);
    let splats = GaussianSplats(add_scene(&mut app, scene));
    app.world_mut().entity_mut(entity).insert(splats);
    app.update();
    let mut mask = mask_of(&mut app, entity);
    assert!(mask.paint(&brush, &[Vec3::ZERO]));
    // Three points of one stroke are one step.
    let eraser = Brush { erases: true, ..brush };
    (0..3).for_each(|i| assert!(mask.stroke_to(&eraser, Vec3::X * i as f32)));
    mask.end_stroke();
    assert_eq!((mask.mask().unwrap().weights[7], mask.undo_len()), ([0; 4], (2, 0)));
    assert!(mask.undo());
    assert_eq!(mask.mask().unwrap().weights[7], [255, 0, 0, 0]);
    assert!(mask.undo() && !mask.undo() && mask.redo() && mask.redo() && !mask.redo());
    // A stroke that is under way ends with whatever comes next.
    mask.stroke_to(&brush, Vec3::ZERO);
    mask.select(3, &everything(), Combine::Replace);
    assert!(mask.set_name(3, "hidden") && mask.invert(3) && mask.undo_len() == (5, 0));
    let scene = mask.masked_scene().unwrap();
    assert_eq!(scene.mask.unwrap().names[3], "hidden");

    // The same Gaussians in another asset keep their paint, others begin anew.
    let before = weights(&app, entity);
    let same = GaussianSplats(add_scene(&mut app, Scene { features: None, ..small_scene(50, 1) }));
    app.world_mut().entity_mut(entity).insert(same);
    app.update();
    assert_eq!(weights(&app, entity), before);
    let other = GaussianSplats(add_scene(&mut app, small_scene(30, 2)));
    app.world_mut().entity_mut(entity).insert(other);
    app.update();
    assert_eq!(weights(&app, entity).unwrap(), [[0; 4]; 30]);
    assert_eq!(mask_of(&mut app, entity).undo_len(), (0, 0));
}

fn until_failed(app: &mut App) -> Vec<StyleMaskFailed> {
    let failed = |world: &mut World| !world.resource::<Messages<StyleMaskFailed>>().is_empty();
    update_until(app, "StyleMaskFailed", failed);
    drain(app)
}

#[test]
fn masks_come_from_files_and_from_scenes() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let (scene, other) = (small_scene(20, 1), small_scene(20, 2));
    let mask = patterned(20);
    write_scene(&path("scene.sgs"), &scene).unwrap();
    write_scene(&path("masked.sgs"), &Scene { mask: Some(mask.clone()), ..scene.clone() }).unwrap();
    write_mask(&path("own.mask.safetensors"), &StoredMask::new(&scene, &mask)).unwrap();
    write_mask(&path("other.mask.safetensors"), &StoredMask::new(&other, &mask)).unwrap();
    let whole = fs::read(path("own.mask.safetensors")).unwrap();
    fs::write(path("cut.mask.safetensors"), &whole[..whole.len() - 1]).unwrap();
    let file_path = dir.path().to_string_lossy().into_owned();
    let mut app = app_with_assets(AssetPlugin { file_path, ..default() });
    let assets = app.world().resource::<AssetServer>().clone();
    let read = read_scene(&path("scene.sgs")).unwrap().scene;
    let expected = StoredMask::new(&scene, &mask).mask_for(&read).unwrap().weights;
    assert_ne!(expected, mask.weights, "files are in another order");

    for (scene, mask) in [
        ("scene.sgs", StyleMask::saved(assets.load("own.mask.safetensors"))),
        ("masked.sgs", StyleMask::default()),
    ] {
        let entity = app.world_mut().spawn((GaussianSplats(assets.load(scene)), mask)).id();
        update_until(&mut app, "a mask", |world| world.get::<StyleMask>(entity).unwrap().mask().is_some());
        assert_eq!(weights(&app, entity).unwrap(), expected, "{scene}");
    }
    assert!(drain::<StyleMaskFailed>(&mut app).is_empty());
    for (name, part) in [
        ("other.mask.safetensors", "found a mask of another scene (20@"),
        ("cut.mask.safetensors", "broken header"),
        ("absent.mask.safetensors", ""),
    ] {
        let parts = (GaussianSplats(assets.load("scene.sgs")), StyleMask::saved(assets.load(name)));
        let entity = app.world_mut().spawn(parts).id();
        let failures = until_failed(&mut app);
        let message = failures[0].error.to_string();
        assert!(message.contains(name) && message.contains(part), "{message}");
        assert_eq!((failures.len(), failures[0].entity), (1, entity));
        // The game goes on, and can paint.
        assert_eq!(weights(&app, entity).unwrap(), [[0; 4]; 20]);
        assert!(mask_of(&mut app, entity).select(0, &everything(), Combine::Add));
        (0..3).for_each(|_| app.update());
        assert!(drain::<StyleMaskFailed>(&mut app).is_empty());
    }
    // A mask that the program made.
    let made = add(&mut app, SavedMask(Arc::new(StoredMask::new(&other, &mask))));
    app.world_mut().spawn((GaussianSplats(assets.load("scene.sgs")), StyleMask::saved(made)));
    let message = until_failed(&mut app)[0].error.to_string();
    assert!(message.starts_with("a mask made by the program: found a mask of another scene"), "{message}");
    // One that tells the right scene, and has too few weights for it.
    let short = StoredMask { weights: vec![[255; 4]; 3], ..StoredMask::new(&scene, &mask) };
    let short = add(&mut app, SavedMask(Arc::new(short)));
    app.world_mut().spawn((GaussianSplats(assets.load("scene.sgs")), StyleMask::saved(short)));
    let message = until_failed(&mut app)[0].error.to_string();
    assert!(message.contains("(3@") && message.contains("(20@"), "{message}");
}

/// A mask has a byte for each Gaussian and channel, so that none is NaN. A program's scene with too few of them
/// is refused, and brushes that are no numbers paint nothing.
#[test]
fn odd_masks_of_a_program_are_refused_or_change_nothing() {
    let mut app = app_without_rendering();
    let scene = Scene { mask: Some(patterned(19)), ..small_scene(20, 1) };
    let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
    let entity = app.world_mut().spawn((splats, StyleMask::default())).id();
    app.update();
    let failed = drain::<GaussianSceneFailed>(&mut app);
    let message = failed[0].error.to_string();
    assert!(failed[0].entity == entity && message.contains("19 mask weights, expected 20"), "{message}");
    assert_eq!(weights(&app, entity), None);
    let whole = GaussianSplats(add_scene(&mut app, Scene { mask: Some(patterned(20)), ..scene }));
    app.world_mut().entity_mut(entity).insert(whole);
    app.update();
    let before = weights(&app, entity);
    assert_eq!(before, Some(patterned(20).weights));
    let brush = Brush { radius: 9.0, ..default() };
    for (brush, center) in [
        (Brush { radius: f32::NAN, ..brush }, Vec3::ZERO),
        (Brush { softness: f32::NAN, ..brush }, Vec3::ZERO),
        (Brush { strength: f32::NAN, ..brush }, Vec3::ZERO),
        (brush, Vec3::NAN),
        (brush, Vec3::INFINITY),
    ] {
        let mut mask = mask_of(&mut app, entity);
        assert!(mask.paint(&brush, &[center]) && mask.stroke_to(&brush, center));
        mask.end_stroke();
        assert_eq!(mask.undo_len(), (0, 0), "{brush:?} at {center}");
    }
    assert_eq!(weights(&app, entity), before);
    assert!(drain::<GaussianSceneFailed>(&mut app).is_empty());
}

/// The weights on the GPU, and their version. The revision that the mix of layers goes by changes with it.
pub(super) fn uploaded(app: &App, entity: Entity) -> Option<(Vec<[u8; 4]>, u64)> {
    let world = app.sub_app(RenderApp).world();
    let n = app.world().get::<StyleMask>(entity)?.mask()?.len();
    let (mask, _) = world.resource::<RenderMasks>().get(MainEntity::from(entity), n)?;
    let (device, queue) = (world.resource::<RenderDevice>(), world.resource::<RenderQueue>());
    Some((mask.read(device.wgpu_device(), queue).unwrap(), mask.version()))
}

/// When the masks of the render world changed last.
fn masks_changed(app: &mut App) -> bevy::ecs::change_detection::Tick {
    let world = app.sub_app(RenderApp).world();
    world.get_resource_ref::<RenderMasks>().expect("masks").last_changed()
}

/// After any number of operations between two frames, the GPU has the weights that the component has.
#[test]
fn what_is_painted_is_uploaded_and_no_more() {
    let Some(mut app) = app_with_rendering(StyleBackend::Cpu) else { return };
    let n = 20_000;
    let scene =
        |seed: u64| GaussianScene::new(Scene { features: None, decoder: None, ..small_scene(n, seed) });
    let splats = GaussianSplats(add(&mut app, scene(1)));
    let entity = app.world_mut().spawn((splats, StyleMask::default())).id();
    app.update();
    assert_eq!(uploaded(&app, entity).unwrap().0, vec![[0; 4]; n]);

    let mut random = Random::new(4);
    let mut last = uploaded(&app, entity).unwrap().1;
    let mut changed = masks_changed(&mut app);
    for round in 0..30 {
        // Some frames have no operation, and some more than the component remembers.
        let n_operations = [0, 1, 3, 100][random.below(4)];
        for _ in 0..n_operations {
            let point = Vec3::new(random.uniform(), random.uniform(), random.uniform()) * 2.0 - 1.0;
            let brush = Brush {
                radius: 0.2 * random.uniform(),
                strength: random.uniform(),
                channel: random.below(4),
                erases: random.below(4) == 0,
                ..default()
            };
            let mut mask = mask_of(&mut app, entity);
            match random.below(6) {
                0 => drop(mask.undo()),
                1 => drop(mask.redo()),
                2 => drop(mask.paint(&brush, &[point, -point])),
                _ => drop(mask.stroke_to(&brush, point)),
            }
        }
        app.update();
        let (found, version) = uploaded(&app, entity).unwrap();
        assert!(found == weights(&app, entity).unwrap(), "round {round}, {n_operations} operations");
        assert!(n_operations > 0 || version == last, "round {round}: an upload without a change");
        let now = masks_changed(&mut app);
        assert_eq!(now == changed, version == last, "round {round}");
        (last, changed) = (version, now);
    }
    // One dab of one Gaussian writes once.
    let mean = app.world().get::<StyleMask>(entity).unwrap().masked_scene().unwrap().means[7];
    let dot = Brush { radius: 1e-4, ..default() };
    mask_of(&mut app, entity).select(0, &everything(), Combine::Subtract);
    app.update();
    let before = uploaded(&app, entity).unwrap().1;
    mask_of(&mut app, entity).paint(&dot, &[mean]);
    app.update();
    assert_eq!(uploaded(&app, entity).unwrap().1, before + 1);

    // A component that is replaced, one that is removed, and another scene.
    app.world_mut().entity_mut(entity).insert(StyleMask::default());
    app.update();
    assert!(uploaded(&app, entity).unwrap().0 == vec![[0; 4]; n]);
    let smaller = GaussianSplats(add_scene(&mut app, small_scene(10, 5)));
    app.world_mut().entity_mut(entity).insert(smaller);
    app.update();
    assert_eq!(uploaded(&app, entity).unwrap().0, vec![[0; 4]; 10]);
    app.world_mut().entity_mut(entity).remove::<StyleMask>();
    app.update();
    let masks = app.sub_app(RenderApp).world().resource::<RenderMasks>();
    assert!(masks.get(MainEntity::from(entity), 10).is_none());
}

const RED: [f32; 3] = [0.8, 0.1, 0.1];
const BLUE: [f32; 3] = [0.1, 0.2, 0.9];

/// A red ball before a blue one: hidden, cropped, half hidden, and all of it undone.
#[test]
fn hidden_splats_show_what_is_behind_them() {
    let Some(mut app) = app_with_rendering(StyleBackend::Cpu) else { return };
    let image = render_target(&mut app, UVec2::splat(16));
    app.world_mut().spawn((
        Camera3d::default(),
        Camera { clear_color: Color::BLACK.into(), ..default() },
        target(&image),
        Transform::from_xyz(0.0, 0.0, 5.0).looking_at(Vec3::ZERO, Vec3::Y),
        Tonemapping::None,
    ));
    let ball = |z: f32, color| Ball { mean: Vec3::Z * z, scale: 1.5, opacity: 0.99, color };
    let splats = GaussianSplats(add_scene(&mut app, balls(&[ball(-1.0, BLUE), ball(1.0, RED)])));
    // The entity is moved; masks are painted in the space of the scene.
    let entity =
        app.world_mut().spawn((splats, Transform::from_xyz(0.0, 0.0, -1.0), StyleMask::default())).id();
    let middle = |app: &mut App| -> [f32; 3] {
        (0..2).for_each(|_| app.update());
        let [r, g, b, _] = read_back(app, &image)[8 * 16 + 8];
        [r, g, b]
    };
    let near = |found: [f32; 3], expected: [f32; 3], what: &str| {
        // Opacity 0.99, at a pixel beside the middle.
        let error = (0..3).map(|i| (found[i] - expected[i]).abs()).fold(0.0, f32::max);
        assert!(error < 0.06, "{what}: {found:?}, expected {expected:?}");
    };
    near(middle(&mut app), RED, "unpainted");
    let dot = Brush { radius: 0.5, channel: 2, ..default() };
    mask_of(&mut app, entity).paint(&dot, &[Vec3::Z]);
    near(middle(&mut app), RED, "painted, which means nothing yet");
    app.world_mut().entity_mut(entity).insert(MaskVisibility::Hide(2));
    near(middle(&mut app), BLUE, "the red ball is hidden");
    mask_of(&mut app, entity).undo();
    near(middle(&mut app), RED, "undone");
    mask_of(&mut app, entity).redo();
    app.world_mut().entity_mut(entity).insert(MaskVisibility::Crop(2));
    near(middle(&mut app), RED, "cropped to the red ball");
    mask_of(&mut app, entity).invert(2);
    near(middle(&mut app), BLUE, "cropped to the blue ball");
    app.world_mut().entity_mut(entity).insert(MaskVisibility::Crop(0));
    near(middle(&mut app), [0.0; 3], "cropped to nothing");
    app.world_mut().entity_mut(entity).insert(MaskVisibility::Crop(9));
    near(middle(&mut app), [0.0; 3], "cropped to a channel that does not exist");
    app.world_mut().entity_mut(entity).remove::<MaskVisibility>();
    near(middle(&mut app), RED, "shown again");
    assert!(drain::<GaussianSceneFailed>(&mut app).is_empty());
}

/// A lasso of a pixel's size around the place where Bevy draws a point holds that point, and no other.
#[test]
fn lassos_lie_where_the_camera_draws() {
    let Some(mut app) = app_with_rendering(StyleBackend::Cpu) else { return };
    let image = render_target(&mut app, UVec2::new(200, 100));
    let viewport =
        Viewport { physical_position: UVec2::new(40, 10), physical_size: UVec2::new(120, 80), ..default() };
    let camera = (
        Camera3d::default(),
        Camera { viewport: Some(viewport), ..default() },
        target(&image),
        Transform::from_xyz(1.0, 2.0, 5.0).looking_at(Vec3::ZERO, Vec3::Y),
    );
    let camera = app.world_mut().spawn(camera).id();
    // Turned, moved and stretched.
    let splats = Transform::from_xyz(0.3, 0.1, -0.2)
        .with_rotation(Quat::from_rotation_x(0.7))
        .with_scale(Vec3::new(1.0, 2.0, 0.5));
    let splats = GlobalTransform::from(splats);
    (0..2).for_each(|_| app.update());
    let entity = app.world().entity(camera);
    let (camera, place) = (entity.get::<Camera>().unwrap(), *entity.get::<GlobalTransform>().unwrap());
    let mut next = numbers(3);
    let points: Vec<Vec3> = (0..100).map(|_| Vec3::new(next(), next(), next())).collect();
    let drawn = |point: Vec3| camera.world_to_viewport(&place, splats.transform_point(point)).unwrap();
    for &point in &points {
        let at = drawn(point);
        let corners = [Vec2::NEG_ONE, Vec2::new(1.0, -1.0), Vec2::ONE, Vec2::new(-1.0, 1.0)];
        let lasso = lasso_in_view(camera, &place, &splats, &corners.map(|corner| at + 0.5 * corner)).unwrap();
        for &other in &points {
            let is_inside = (drawn(other) - at).abs().max_element() < 0.5;
            assert_eq!(lasso.contains(other), is_inside, "{other} at {}, lasso at {at}", drawn(other));
        }
    }
    let parallel =
        (Camera3d::default(), target(&image), Projection::from(OrthographicProjection::default_3d()));
    let parallel = app.world_mut().spawn(parallel).id();
    app.update();
    let camera = app.world().get::<Camera>(parallel).unwrap();
    assert!(lasso_in_view(camera, &place, &splats, &[Vec2::ZERO; 3]).is_none());
}
