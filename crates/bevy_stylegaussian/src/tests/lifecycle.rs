//! Unusual events: scenes that are too large, assets and entities that come and go, a lost device. None may
//! cause a render error or a panic.

use bevy::{
    asset::{AssetId, AssetPlugin},
    camera::RenderTarget,
    prelude::*,
    render::{
        RenderApp,
        error_handler::{ErrorType, RenderErrorHandler, RenderErrorPolicy},
        render_resource::{Extent3d, PollType},
        renderer::{RenderAdapterInfo, RenderDevice},
        settings::{RenderCreation, WgpuLimits, WgpuSettings},
    },
};
use stylegaussian::{
    Layer, Scene,
    layers::Region,
    mask::{Combine, Selection},
    scene::Sh,
};
use stylegaussian_files::write_scene;

use crate::{
    GaussianScene, GaussianSceneFailed, GaussianSplats, StyleApplied, StyleFailed, StyleGaussianPlugin,
    StyleSource, StyleTransition,
    mask::{MaskVisibility, StyleMask},
    style::decoder::StyleBackend,
};

use super::{
    paint::noise,
    styles::until_applied,
    world::{rendering::*, *},
};

const SIZE: UVec2 = UVec2::new(32, 32);

/// An app with a camera that looks at the origin, and the camera's image.
fn app_with_camera(backend: StyleBackend, settings: WgpuSettings) -> Option<(App, Handle<Image>)> {
    Some(with_camera(app_with_settings(backend, settings)?))
}

fn with_camera(mut app: App) -> (App, Handle<Image>) {
    let image = render_target(&mut app, SIZE);
    app.world_mut().spawn((
        Camera3d::default(),
        Camera { clear_color: Color::BLACK.into(), ..default() },
        target(&image),
        Transform::from_xyz(0.0, 0.0, 4.0),
    ));
    (app, image)
}

fn app() -> Option<(App, Handle<Image>)> {
    app_with_camera(StyleBackend::Gpu, WgpuSettings::default())
}

fn spawn(app: &mut App, scene: Scene) -> Entity {
    let splats = GaussianSplats(add_scene(app, scene));
    app.world_mut().spawn(splats).id()
}

fn updates(app: &mut App, n: usize) {
    // Rendering is not pipelined here, so each update draws its own frame.
    (0..n).for_each(|_| app.update());
}

/// The image after a few frames.
fn picture(app: &mut App, image: &Handle<Image>) -> Vec<[f32; 4]> {
    updates(app, 3);
    read_back(app, image)
}

/// The sum of all of its colors.
fn light(app: &mut App, image: &Handle<Image>) -> f32 {
    picture(app, image).iter().map(|pixel| pixel[..3].iter().sum::<f32>()).sum()
}

/// A device with storage bindings of at most 1 MiB: 65,536 splats of 16 bytes.
fn small_device() -> WgpuSettings {
    let limits = WgpuLimits {
        max_storage_buffer_binding_size: 1 << 20,
        // As many as the adapter has. The default is none, and Bevy's materials bind arrays if the adapter can.
        max_binding_array_elements_per_shader_stage: u32::MAX,
        max_binding_array_sampler_elements_per_shader_stage: u32::MAX,
        ..WgpuLimits::default()
    };
    WgpuSettings { constrained_limits: Some(limits), ..default() }
}

#[test]
fn a_scene_too_large_for_the_device_is_refused_and_the_app_lives_on() {
    let Some((mut app, image)) = app_with_camera(StyleBackend::Gpu, small_device()) else { return };
    // Without features, no neighbors are searched.
    let large = Scene { features: None, decoder: None, ..small_scene(70_000, 1) };
    let large = GaussianSplats(add_scene(&mut app, large));
    // It is reported for both entities that show it.
    let refused = [0, 1].map(|_| app.world_mut().spawn(large.clone()).id());
    let mut told = Vec::new();
    update_until(&mut app, "GaussianSceneFailed twice", |world| {
        told.extend(world.resource_mut::<Messages<GaussianSceneFailed>>().drain());
        told.len() == 2
    });
    assert!(refused.iter().all(|entity| told.iter().any(|event| event.entity == *entity)));
    let message = told[0].error.to_string();
    // 70,000 splats of 16 bytes.
    assert!(message.contains("1120000 bytes") && message.contains("1048576"), "{message}");
    assert_eq!(light(&mut app, &image), 0.0);
    // Another scene is drawn beside it, and nothing is reported twice.
    spawn(&mut app, small_scene(100, 1));
    assert!(light(&mut app, &image) > 1.0);
    assert!(drain::<GaussianSceneFailed>(&mut app).is_empty());
    // Two scenes that fit alone but not together: the view reports it, and draws again once one of them is
    // gone. 40,000 splats fit into 65,536, and 80,000 do not.
    let half = Scene { features: None, decoder: None, ..small_scene(40_000, 1) };
    let halves = [0, 1].map(|_| spawn(&mut app, half.clone()));
    let mut told = Vec::new();
    update_until(&mut app, "GaussianSceneFailed of the view", |world| {
        told.extend(world.resource_mut::<Messages<GaussianSceneFailed>>().drain());
        !told.is_empty()
    });
    app.world_mut().despawn(halves[0]);
    assert!(light(&mut app, &image) > 1.0);
}

/// The device cannot bind the decoder's weights. This is an error if the GPU was asked for; otherwise the CPU
/// decodes.
#[test]
fn a_decoder_too_large_for_the_device_is_refused() {
    for backend in [StyleBackend::Gpu, StyleBackend::Auto] {
        let Some((mut app, image)) = app_with_camera(backend, small_device()) else { return };
        // `Auto` does not use the GPU on a software adapter, so pretend to be hardware.
        app.world_mut().resource_mut::<RenderAdapterInfo>().0.device_type = wgpu::DeviceType::DiscreteGpu;
        let mut scene = small_scene(50, 1);
        let decoder = scene.decoder.as_mut().unwrap();
        let layer = |d_in: usize, d_out: usize| Layer {
            weight: vec![0.0; d_out * decoder.k * d_in],
            // Weights of 0 leave the biases alone: every styled Gaussian has the same color.
            bias: vec![0.3; d_out],
            d_in,
            d_out,
        };
        // 3 * 512 * 512 weights of 4 bytes are 3 MiB, three times the limit.
        decoder.layers = vec![layer(8, 512), layer(512, 512), layer(512, 3)];
        let style = add_style(&mut app, small_style(1));
        let entity = spawn(&mut app, scene);
        let own = light(&mut app, &image);
        app.world_mut().entity_mut(entity).insert(StyleSource::preset(style));
        if backend == StyleBackend::Auto {
            let mut applied = Vec::new();
            update_until(&mut app, "StyleApplied", |world| {
                applied.extend(world.resource_mut::<Messages<StyleApplied>>().drain());
                !applied.is_empty()
            });
            assert_eq!(applied[0].backend, StyleBackend::Cpu);
            assert!((light(&mut app, &image) - own).abs() > 1.0, "the style is not seen");
        } else {
            let mut failed = Vec::new();
            update_until(&mut app, "StyleFailed", |world| {
                failed.extend(world.resource_mut::<Messages<StyleFailed>>().drain());
                !failed.is_empty()
            });
            let message = failed[0].error.to_string();
            let parts = ["weights of a layer", "3147776", "1048576", "StyleBackend::Cpu"];
            assert!(parts.iter().all(|part| message.contains(part)), "{message}");
            assert_eq!(light(&mut app, &image), own);
        }
    }
}

#[test]
fn scenes_of_no_and_of_one_gaussian() {
    let Some((mut app, image)) = app() else { return };
    let style = add_style(&mut app, small_style(1));
    let none = spawn(&mut app, small_scene(0, 1));
    app.world_mut().entity_mut(none).insert(StyleSource::preset(style.clone()));
    assert_eq!(light(&mut app, &image), 0.0);
    let mut one = small_scene(1, 1);
    // In the middle of the picture, wherever the seed would have put it.
    one.means[0] = Vec3::ZERO;
    let one = spawn(&mut app, one);
    assert!(light(&mut app, &image) > 0.1);
    app.world_mut().entity_mut(one).insert(StyleSource::preset(style));
    update_until(&mut app, "StyleApplied", |world| {
        let applied: Vec<_> = world.resource_mut::<Messages<StyleApplied>>().drain().collect();
        applied.iter().any(|event| event.entity == one)
    });
    assert!(light(&mut app, &image) > 0.1);
}

#[test]
fn entities_scenes_and_targets_come_and_go() {
    let Some((mut app, image)) = app() else { return };
    let style = add_style(&mut app, small_style(1));
    let entity = spawn(&mut app, small_scene(100, 1));
    let source = StyleSource::preset(style);
    app.world_mut().entity_mut(entity).insert((source.clone(), StyleTransition::default()));
    let first = light(&mut app, &image);
    assert!(first > 1.0);

    // The scene is replaced by one of another size while the style is computed or fades in.
    let handle = app.world().get::<GaussianSplats>(entity).unwrap().0.clone();
    // More and fewer Gaussians than before, so that buffers of the old size would be found out.
    for (n, seed) in [(150, 2), (20, 3), (300, 4), (20, 5)] {
        let scene = GaussianScene::new(small_scene(n, seed));
        app.world_mut().resource_mut::<Assets<GaussianScene>>().insert(&handle, scene).unwrap();
        assert!(light(&mut app, &image) > 1.0);
        updates(&mut app, seed as usize);
    }
    // Another handle.
    let other = add_scene(&mut app, small_scene(60, 6));
    app.world_mut().get_mut::<GaussianSplats>(entity).unwrap().0 = other;
    assert!(light(&mut app, &image) > 1.0);
    // The asset is removed, and nothing is drawn.
    let id: AssetId<GaussianScene> = app.world().get::<GaussianSplats>(entity).unwrap().0.id();
    app.world_mut().resource_mut::<Assets<GaussianScene>>().remove(id);
    assert_eq!(light(&mut app, &image), 0.0);

    // The entity is despawned at different stages of its style.
    // 0 is before the scene is attached, the others are while its style is computed or decoded.
    for n_updates in 0..4 {
        let brief = spawn(&mut app, small_scene(50, 7));
        app.world_mut().entity_mut(brief).insert(source.clone());
        updates(&mut app, n_updates);
        app.world_mut().despawn(brief);
        updates(&mut app, 2);
    }
    // The component is removed, and with it the entity's scene and bounds.
    let plain = spawn(&mut app, small_scene(50, 7));
    assert!(light(&mut app, &image) > 1.0);
    app.world_mut().entity_mut(plain).remove::<GaussianSplats>();
    assert_eq!(light(&mut app, &image), 0.0);

    // The target is resized, like a window.
    spawn(&mut app, small_scene(100, 1));
    // Smaller, larger, a single pixel, and not a multiple of a tile.
    for side in [16, 64, 1, 33] {
        let size = Extent3d { width: side, height: side, depth_or_array_layers: 1 };
        app.world_mut().resource_mut::<Assets<Image>>().get_mut(&image).unwrap().resize(size);
        assert!(light(&mut app, &image) > 0.1, "{side} pixels");
    }
}

#[test]
fn degenerate_transforms_and_cameras() {
    let Some((mut app, image)) = app() else { return };
    let other = spawn(&mut app, small_scene(100, 2));
    let alone = picture(&mut app, &image);
    let entity = spawn(&mut app, small_scene(100, 1));
    assert!(picture(&mut app, &image) != alone, "it is not seen beside the other one");
    // A scale of 0 along an axis, or along all of them, shows nothing of it, and all of what is beside it.
    for axis in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE] {
        *app.world_mut().get_mut::<Transform>(entity).unwrap() = Transform::from_scale(Vec3::ONE - axis);
        assert!(picture(&mut app, &image) == alone, "it is seen without a scale along {axis}");
    }
    app.world_mut().despawn(other);
    let huge = Transform::from_scale(Vec3::splat(1e30));
    let tiny = Transform::from_scale(Vec3::splat(1e-30));
    let far = Transform::from_xyz(1e30, 0.0, 0.0);
    for transform in [huge, tiny, far] {
        *app.world_mut().get_mut::<Transform>(entity).unwrap() = transform;
        updates(&mut app, 2);
    }
    *app.world_mut().get_mut::<Transform>(entity).unwrap() = Transform::default();
    // The camera in the middle of the scene.
    let camera = app.world_mut().query_filtered::<Entity, With<Camera3d>>().single(app.world()).unwrap();
    *app.world_mut().get_mut::<Transform>(camera).unwrap() = Transform::default();
    assert!(light(&mut app, &image) > 1.0);
    // The camera at the mean of one Gaussian.
    let mean = small_scene(100, 1).means[7];
    *app.world_mut().get_mut::<Transform>(camera).unwrap() = Transform::from_translation(mean);
    updates(&mut app, 2);
    // A target without pixels, like a minimized window.
    app.world_mut().spawn((Camera3d::default(), RenderTarget::None { size: UVec2::ZERO }));
    updates(&mut app, 2);
}

/// Memory after fifty scenes is that after ten.
#[test]
fn fifty_scenes_come_and_go_and_leave_nothing() {
    let Some((mut app, image)) = app_with_camera(StyleBackend::Cpu, WgpuSettings::default()) else { return };
    let style = add_style(&mut app, small_style(1));
    let mut before = None;
    for round in 0..50 {
        let entity = spawn(&mut app, small_scene(200, round));
        let parts = (StyleSource::preset(style.clone()), StyleMask::default(), MaskVisibility::Hide(0));
        app.world_mut().entity_mut(entity).insert(parts);
        until_applied(&mut app);
        app.world_mut().despawn(entity);
        updates(&mut app, 3);
        // Waits for the GPU, so that no frame in flight holds buffers.
        let now = allocations(&app);
        if round == 9 {
            before = now;
        }
    }
    assert_eq!(light(&mut app, &image), 0.0);
    assert!(app.world().resource::<Assets<GaussianScene>>().is_empty());
    let (Some(before), Some(after)) = (before, allocations(&app)) else { return };
    // Forty scenes are at least as many buffers, and 256 kB.
    assert!(after.n_buffers < before.n_buffers + 10, "{after:?}, before {before:?}");
    assert!(after.buffer_bytes < before.buffer_bytes + 65_536, "{after:?}, before {before:?}");
    assert!(after.texture_bytes <= before.texture_bytes, "{after:?}, before {before:?}");
}

/// An app with a camera and the assets of a folder. It shows `a.ply`, half in the style of a painting.
fn app_with_painted_file(folder: &std::path::Path) -> Option<(App, Handle<Image>, Entity)> {
    if !has_adapter() {
        return None;
    }
    let file_path = folder.to_string_lossy().into_owned();
    let mut app = app_of_settings(WgpuSettings::default(), AssetPlugin { file_path, ..default() });
    app.insert_resource(QUICK_THREADS);
    app.add_plugins(StyleGaussianPlugin { synchronous_pipeline_compilation: true });
    let (mut app, image) = with_camera(finish(app));
    let painting = add(&mut app, noise(1, [200, 40, 30], [20, 40, 180]));
    let splats = GaussianSplats(app.world().resource::<AssetServer>().load("a.ply"));
    let source = StyleSource::image(painting).with_strength(0.5);
    let entity = app.world_mut().spawn((splats, source, StyleMask::default())).id();
    until_applied(&mut app);
    Some((app, image, entity))
}

/// A file is overwritten with fewer Gaussians of a higher degree while it is styled, and hidden by its mask.
#[test]
fn an_overwritten_file_is_shown_as_if_it_had_always_been_there() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.ply");
    let raw = |n: usize, seed: u64| Scene { features: None, decoder: None, ..small_scene(n, seed) };
    write_scene(&path, &raw(90, 1)).unwrap();
    let Some((mut app, image, entity)) = app_with_painted_file(dir.path()) else { return };
    app.world_mut().entity_mut(entity).insert(MaskVisibility::Hide(0));
    assert!(light(&mut app, &image) > 1.0);
    let everything = Selection::Region(Region::EVERYWHERE);
    app.world_mut().get_mut::<StyleMask>(entity).unwrap().select(0, &everything, Combine::Replace);
    assert_eq!(light(&mut app, &image), 0.0, "all is hidden");

    let mut next = numbers(3);
    // 16 coefficients of 3 colors.
    let coefficients = (0..60 * 48).map(|_| 0.3 * next()).collect();
    write_scene(&path, &Scene { sh: Some(Sh { degree: 3, coefficients }), ..raw(60, 2) }).unwrap();
    // What `watch_for_changes` does.
    app.world().resource::<AssetServer>().reload("a.ply");
    until_applied(&mut app);
    let mask = app.world().get::<StyleMask>(entity).unwrap().mask().unwrap();
    assert_eq!(mask.weights, [[0; 4]; 60], "the mask of other Gaussians begins anew");
    updates(&mut app, 3);
    let colors = |app: &App, image: &Handle<Image>| -> Vec<[f32; 3]> {
        read_back(app, image).iter().map(|&[r, g, b, _]| [r, g, b]).collect()
    };
    let found = colors(&app, &image);
    let Some((mut fresh, image, _)) = app_with_painted_file(dir.path()) else { return };
    updates(&mut fresh, 3);
    let expected = colors(&fresh, &image);
    let n_seen = expected.iter().filter(|color| color.iter().sum::<f32>() > 0.1).count();
    assert!(n_seen > 50, "hardly anything to compare: {n_seen} pixels");
    let psnr = psnr(&found, &expected, |_| true);
    assert!(psnr > 45.0, "{psnr:.1} dB");
}

/// Has Bevy make a new device if one is lost.
fn recover(app: &mut App) {
    app.insert_resource(RenderErrorHandler(|error, _, _| match error.ty {
        ErrorType::DeviceLost => RenderErrorPolicy::Recover(RenderCreation::default()),
        _ => panic!("{error:?}"),
    }));
}

/// Loses the device, and draws until Bevy has recovered. Neither camera nor entities move.
fn lose_device(app: &mut App) {
    let device = app.sub_app(RenderApp).world().resource::<RenderDevice>().clone();
    device.wgpu_device().destroy();
    // The loss is reported at the next poll.
    let _ = device.poll(PollType::Poll);
    // Bevy recovers in a later frame. Then scene and style are uploaded anew.
    updates(app, 10);
}

#[test]
fn a_lost_device_brings_hidden_splats_back_hidden() {
    let Some((mut app, image)) = app() else { return };
    recover(&mut app);
    let entity = spawn(&mut app, small_scene(100, 1));
    let all = light(&mut app, &image);
    // Nothing is painted, so nothing is left of it.
    app.world_mut().entity_mut(entity).insert((StyleMask::default(), MaskVisibility::Crop(0)));
    assert_eq!(light(&mut app, &image), 0.0);
    lose_device(&mut app);
    assert_eq!(light(&mut app, &image), 0.0);
    app.world_mut().entity_mut(entity).remove::<MaskVisibility>();
    let shown = light(&mut app, &image);
    assert!((shown - all).abs() < 0.01 * all, "{shown} after, {all} before");
}

#[test]
fn a_lost_device_brings_styled_scenes_back() {
    let Some((mut app, image)) = app() else { return };
    recover(&mut app);
    let style = add_style(&mut app, small_style(1));
    let entity = spawn(&mut app, small_scene(100, 1));
    let own = light(&mut app, &image);
    app.world_mut().entity_mut(entity).insert(StyleSource::preset(style));
    update_until(&mut app, "StyleApplied", |world| !world.resource::<Messages<StyleApplied>>().is_empty());
    let styled = light(&mut app, &image);
    assert!((styled - own).abs() > 1.0, "the style is not seen: {own} and {styled}");

    lose_device(&mut app);
    let recovered = light(&mut app, &image);
    assert!((recovered - styled).abs() < 0.01 * styled, "{recovered} after, {styled} before");
}
