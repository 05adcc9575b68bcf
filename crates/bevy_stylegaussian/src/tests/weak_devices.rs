//! Devices below the needs of the kernels, and at them.

use bevy::{
    prelude::*,
    render::{
        RenderApp,
        renderer::RenderDevice,
        settings::{WgpuLimits, WgpuSettings},
    },
};

use super::{
    paint::noise,
    world::{rendering::*, *},
};
use crate::{
    GaussianSceneFailed, GaussianSceneReady, GaussianSplats, StyleApplied, StyleFailed, StyleSource,
    mask::StyleMask,
    scene::gpu_needs,
    style::{StyleMethod, decoder::StyleBackend},
};

const SIZE: UVec2 = UVec2::new(32, 32);

/// A device of no larger limits.
fn limited(limits: WgpuLimits) -> WgpuSettings {
    let limits = WgpuLimits {
        // As many as the adapter has: Bevy's materials bind arrays if the adapter can.
        max_binding_array_elements_per_shader_stage: u32::MAX,
        max_binding_array_sampler_elements_per_shader_stage: u32::MAX,
        ..limits
    };
    WgpuSettings {
        limits: WgpuLimits::downlevel_webgl2_defaults(),
        constrained_limits: Some(limits),
        ..default()
    }
}

/// An app with a camera that looks at the origin, and the camera's image.
fn app(limits: WgpuLimits) -> Option<(App, Handle<Image>)> {
    let mut app = app_with_settings(StyleBackend::Auto, limited(limits))?;
    let image = render_target(&mut app, SIZE);
    app.world_mut().spawn((
        Camera3d::default(),
        Camera { clear_color: Color::BLACK.into(), ..default() },
        target(&image),
        Transform::from_xyz(0.0, 0.0, 4.0),
    ));
    Some((app, image))
}

fn light(app: &mut App, image: &Handle<Image>) -> f32 {
    (0..3).for_each(|_| app.update());
    read_back(app, image).iter().map(|pixel| pixel[..3].iter().sum::<f32>()).sum()
}

/// Set for a test that runs in a process of its own.
const ALONE: &str = "STYLEGAUSSIAN_TEST_ALONE";

/// Every render error fails this test, as in all apps of `rendering`. It runs this file's own binary again:
/// Bevy decides once per process whether skins lie in storage buffers, by the first device.
#[test]
fn a_device_below_the_needs_refuses_splats_and_draws_the_rest() {
    if std::env::var_os(ALONE).is_none() {
        let name = "tests::weak_devices::a_device_below_the_needs_refuses_splats_and_draws_the_rest";
        let mut again = std::process::Command::new(std::env::current_exe().unwrap());
        let output = again.args(["--exact", name, "--nocapture"]).env(ALONE, "1").output().unwrap();
        let told = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{}{told}", String::from_utf8_lossy(&output.stdout));
        eprint!("{told}");
        return;
    }
    let Some((mut app, image)) = app(WgpuLimits::downlevel_webgl2_defaults()) else { return };
    let limits = app.sub_app(RenderApp).world().resource::<RenderDevice>().limits();
    assert_eq!(limits.max_storage_buffers_per_shader_stage, 0, "the device is not that weak");
    let scene = GaussianSplats(add_scene(&mut app, small_scene(100, 1)));
    let style = add_style(&mut app, small_style(1));
    let entities = [0, 1].map(|_| {
        let parts = (scene.clone(), StyleMask::default(), StyleSource::preset(style.clone()));
        app.world_mut().spawn(parts).id()
    });
    let (mut failed, mut unstyled) = (Vec::new(), Vec::new());
    update_until(&mut app, "two failures of each kind", |world| {
        failed.extend(world.resource_mut::<Messages<GaussianSceneFailed>>().drain());
        unstyled.extend(world.resource_mut::<Messages<StyleFailed>>().drain());
        failed.len() >= 2 && unstyled.len() >= 2
    });
    assert_eq!(light(&mut app, &image), 0.0);
    failed.extend(drain::<GaussianSceneFailed>(&mut app));
    assert_eq!(failed.len(), 2, "each entity hears of it once");
    assert!(entities.iter().all(|entity| failed.iter().any(|event| event.entity == *entity)));
    for message in [failed[0].error.to_string(), unstyled[0].error.to_string()] {
        let part = "found max_storage_buffers_per_shader_stage = 0, expected at least 8";
        assert!(message.contains(part), "{message}");
    }
    assert!(drain::<GaussianSceneReady>(&mut app).is_empty() && drain::<StyleApplied>(&mut app).is_empty());
    // An entity that comes later hears of it too.
    let late = app.world_mut().spawn(scene).id();
    (0..3).for_each(|_| app.update());
    let failed = drain::<GaussianSceneFailed>(&mut app);
    assert_eq!(failed.iter().map(|event| event.entity).collect::<Vec<_>>(), [late]);
    // The game's own things are drawn.
    let mesh = add(&mut app, Mesh::from(Sphere::new(0.8)));
    let material = add(&mut app, StandardMaterial { unlit: true, ..StandardMaterial::from(Color::WHITE) });
    app.world_mut().spawn((Mesh3d(mesh), MeshMaterial3d(material)));
    assert!(light(&mut app, &image) > 10.0, "the mesh is not drawn");
}

#[test]
fn a_device_of_little_more_than_the_needs_draws_decodes_and_paints() {
    let all = WgpuLimits::default();
    let limits = WgpuLimits {
        // Bevy's own kernels, which it makes if a device has any compute shaders.
        max_compute_workgroup_size_y: all.max_compute_workgroup_size_y,
        max_compute_workgroup_size_z: all.max_compute_workgroup_size_z,
        max_storage_textures_per_shader_stage: all.max_storage_textures_per_shader_stage,
        max_compute_workgroup_storage_size: all.max_compute_workgroup_storage_size,
        ..gpu_needs::least_limits()
    };
    let Some((mut app, image)) = app(limits) else { return };
    let limits = app.sub_app(RenderApp).world().resource::<RenderDevice>().limits();
    assert_eq!(limits.max_storage_buffers_per_shader_stage, 8, "the device is larger");
    assert_eq!(limits.max_storage_buffer_binding_size, 1 << 20, "the device is larger");
    app.insert_resource(StyleBackend::Gpu);
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(100, 1)));
    let entity = app.world_mut().spawn((splats, StyleMask::default())).id();
    let captured = light(&mut app, &image);
    assert!(captured > 1.0);
    let painting = add(&mut app, noise(1, [200, 40, 30], [20, 40, 180]));
    for source in [StyleSource::preset(style), StyleSource::image(painting)] {
        let is_paint = matches!(source.styles[0].input, crate::style::StyleInput::Image(_));
        if is_paint {
            // A scene with a decoder of its own would be decoded.
            let scene = stylegaussian::Scene { features: None, decoder: None, ..small_scene(100, 1) };
            let splats = GaussianSplats(add_scene(&mut app, scene));
            app.world_mut().entity_mut(entity).insert(splats);
            app.insert_resource(StyleMethod::Paint);
        }
        app.world_mut().entity_mut(entity).insert(source.with_strength(0.8));
        update_until(&mut app, "StyleApplied", |world| {
            !world.resource_mut::<Messages<StyleApplied>>().drain().collect::<Vec<_>>().is_empty()
        });
        assert!((light(&mut app, &image) - captured).abs() > 0.5, "the style is not seen");
        assert!(drain::<GaussianSceneFailed>(&mut app).is_empty());
    }
}
