//! Tints, shadows, fog and atmospheres: splats against meshes of the same color at the same place, and against
//! formulas.

use bevy::{
    camera::Hdr,
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    light::{
        Atmosphere, CascadeShadowConfigBuilder, DirectionalLightShadowMap, atmosphere::ScatteringMedium,
    },
    pbr::{AtmosphereMode, AtmosphereSettings, DistanceFog, FogFalloff},
    prelude::*,
    render::{RenderApp, renderer::RenderAdapterInfo},
};

use crate::{
    GaussianSceneReady, SplatTint, StyleVolume,
    splats::{Held, SplatDepth, SplatShadows, SplatTonemapping},
};

use super::{
    pictures::{EYE, RED, SIZE, Studio, pixel},
    world::{rendering::render_target, *},
};

/// The pixel in the middle of the mesh, and of the splats at its mirror image.
const MESH: UVec2 = UVec2::new(39, 32);
const SPLATS: UVec2 = UVec2::new(24, 32);

fn at(picture: &[[f32; 3]], UVec2 { x, y }: UVec2) -> [f32; 3] {
    pixel(picture, x, y)
}

/// Splats at a place, three of them, so that nothing shines through.
fn solid(mean: Vec3, color: [f32; 3]) -> stylegaussian::Scene {
    balls(&[Ball { mean, scale: 0.5, opacity: 0.99, color }; 3])
}

#[track_caller]
fn near(what: &str, found: [f32; 3], expected: [f32; 3], steps: f32) {
    let error = (0..3).map(|i| (found[i] - expected[i]).abs()).fold(0.0, f32::max);
    assert!(error <= steps / 255.0, "{what}: found {found:?}, expected {expected:?}");
}

fn fogs() -> [DistanceFog; 4] {
    let fog = |falloff| DistanceFog { color: Color::srgba(0.3, 0.5, 0.6, 0.9), falloff, ..default() };
    [
        fog(FogFalloff::Linear { start: 5.0, end: 15.0 }),
        DistanceFog {
            directional_light_color: Color::srgba(1.0, 0.8, 0.5, 0.5),
            directional_light_exponent: 5.0,
            ..fog(FogFalloff::Exponential { density: 0.04 })
        },
        fog(FogFalloff::ExponentialSquared { density: 0.08 }),
        fog(FogFalloff::Atmospheric {
            extinction: Vec3::new(0.02, 0.05, 0.1),
            inscattering: Vec3::new(0.1, 0.05, 0.02),
        }),
    ]
}

/// A mesh, and splats of the color that it has without fog, have one color in each fog and by each camera.
#[test]
fn fog_reaches_splats_as_it_reaches_meshes() {
    let Some(mut studio) = Studio::new() else { return };
    studio.cuboid(Vec3::new(1.0, 1.0, 0.02), Vec3::new(1.0, 0.0, -0.01), RED, 1.0);
    // Behind what the camera sees, so that fog glows there.
    let sun = Transform::from_xyz(0.5, 1.0, -5.0).looking_at(Vec3::ZERO, Vec3::Y);
    studio.app.world_mut().spawn((DirectionalLight { illuminance: 300.0, ..default() }, sun));
    // The table of a tone mapping undoes it to some steps.
    let cases = [
        (Tonemapping::None, false, SplatTonemapping::Invert, 2.0),
        (Tonemapping::Reinhard, true, SplatTonemapping::Invert, 2.0),
        (Tonemapping::ReinhardLuminance, true, SplatTonemapping::Bypass, 2.0),
        (Tonemapping::AcesFitted, true, SplatTonemapping::Invert, 12.0),
        (Tonemapping::TonyMcMapface, false, SplatTonemapping::Invert, 12.0),
    ];
    for (i, (tonemapping, hdr, choice, steps)) in cases.into_iter().enumerate() {
        let camera = studio.camera(EYE, (Msaa::Off, tonemapping, choice, DebandDither::Disabled));
        if hdr {
            studio.app.world_mut().entity_mut(camera).insert(Hdr);
        }
        let color = at(&studio.shoot(), MESH);
        let splats = studio.splats(solid(Vec3::new(-1.0, 0.0, 0.0), color), Transform::default());
        while drain::<GaussianSceneReady>(&mut studio.app).is_empty() {
            studio.app.update();
        }
        let plain = studio.shoot();
        near("without fog", at(&plain, SPLATS), color, steps);
        for fog in [fogs()[i % 4].clone(), fogs()[(i + 1) % 4].clone()] {
            let what = format!("{tonemapping:?}, HDR {hdr}, {:?}", fog.falloff);
            studio.app.world_mut().entity_mut(camera).insert(fog);
            let picture = studio.shoot();
            let expected = at(&picture, MESH);
            let change = (0..3).map(|i| (expected[i] - color[i]).abs()).fold(0.0, f32::max);
            assert!(change > 0.1, "{what}: fog is hardly seen, {color:?} and {expected:?}");
            near(&what, at(&picture, SPLATS), expected, steps);
        }
        studio.app.world_mut().entity_mut(camera).remove::<DistanceFog>();
        assert!(studio.shoot() == plain, "{tonemapping:?}: fog that is gone leaves something");
        studio.app.world_mut().despawn(camera);
        studio.app.world_mut().despawn(splats);
    }
}

/// Half of the light is half of it, and a tint that changes nothing costs nothing.
#[test]
fn tints_change_light_and_idle_ones_nothing() {
    let Some(mut studio) = Studio::new() else { return };
    studio.camera(EYE, Msaa::Off);
    let splats = studio.splats(solid(Vec3::ZERO, RED), Transform::default());
    let n_pipelines =
        |studio: &mut Studio| Held::of(studio.app.sub_app_mut(RenderApp).world_mut()).n_pipelines;
    let plain = studio.shoot();
    let before = n_pipelines(&mut studio);
    studio.app.world_mut().entity_mut(splats).insert(SplatTint::default());
    assert!(studio.shoot() == plain);
    assert_eq!(n_pipelines(&mut studio), before);

    let linear = RED.map(Srgba::gamma_function);
    let shown = |light: [f32; 3]| light.map(Srgba::gamma_function_inverse);
    let mut check = |what: &str, tint: SplatTint, expected: [f32; 3]| {
        studio.app.world_mut().entity_mut(splats).insert(tint);
        near(what, pixel(&studio.shoot(), 32, 32), expected, 2.0);
    };
    let darker = SplatTint { exposure: -1.0, ..default() };
    check("darker", darker, shown(linear.map(|light| 0.5 * light)));
    let green = SplatTint { color: Color::linear_rgb(0.2, 1.0, 0.5), ..default() };
    check("green", green, shown([0.2 * linear[0], linear[1], 0.5 * linear[2]]));
    let luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
    check("gray", SplatTint { saturation: 0.0, ..default() }, shown([luminance; 3]));
    assert_eq!(n_pipelines(&mut studio), before + 1);
    studio.app.world_mut().entity_mut(splats).remove::<SplatTint>();
    assert!(studio.shoot() == plain);
}

/// A volume tints the splats within, softly at its edge and whatever their style, over the tint of their
/// entity. A volume that tints nothing costs nothing, and what is tinted has its colors back afterwards.
#[test]
fn volumes_tint_what_is_within() {
    let Some(mut studio) = Studio::new() else { return };
    studio.camera(EYE, Msaa::Off);
    let splats = studio.splats(solid(Vec3::new(-1.0, 0.0, 0.0), RED), Transform::default());
    studio.splats(solid(Vec3::new(1.0, 0.0, 0.0), RED), Transform::default());
    let n_pipelines =
        |studio: &mut Studio| Held::of(studio.app.sub_app_mut(RenderApp).world_mut()).n_pipelines;
    let (plain, before) = (studio.shoot(), n_pipelines(&mut studio));
    let ball = StyleVolume::new(Sphere::new(1.0)).with_softness(0.4);
    let place = Transform::from_xyz(-1.0, 0.0, 0.0);
    let volume = studio.app.world_mut().spawn((ball.clone().with_tint(SplatTint::default()), place)).id();
    assert!(studio.shoot() == plain, "a tint that is none changes something");
    assert_eq!(n_pipelines(&mut studio), before);

    let darker = |factor: f32| RED.map(|c| Srgba::gamma_function_inverse(factor * Srgba::gamma_function(c)));
    let half = SplatTint { exposure: -1.0, ..default() };
    studio.app.world_mut().entity_mut(volume).insert(ball.clone().with_tint(half));
    let picture = studio.shoot();
    near("within", at(&picture, SPLATS), darker(0.5), 2.0);
    near("beside it", at(&picture, MESH), RED, 2.0);
    assert_eq!(n_pipelines(&mut studio), before + 1);
    studio.app.world_mut().entity_mut(splats).insert(half);
    near("over another tint", at(&studio.shoot(), SPLATS), darker(0.25), 2.0);
    studio.app.world_mut().entity_mut(splats).remove::<SplatTint>();
    // The means of the splats are in the middle of the edge.
    studio.app.world_mut().entity_mut(volume).insert(Transform::from_xyz(-2.0, 0.0, 0.0));
    near("at the edge", at(&studio.shoot(), SPLATS), darker(0.75), 2.0);
    // Other entities, and volumes of a mask.
    let other = ball.clone().with_tint(half).for_cloud(volume);
    studio.app.world_mut().entity_mut(volume).insert((other, place));
    assert!(studio.shoot() == plain, "a volume for another entity");
    let painted = StyleVolume { mask: Some(0), ..ball.with_tint(half) };
    studio.app.world_mut().entity_mut(volume).insert(painted);
    assert!(studio.shoot() == plain, "a volume that follows a mask");
    studio.app.world_mut().despawn(volume);
    assert!(studio.shoot() == plain);
}

/// A slab above one of two balls of splats casts a shadow on it, and goes away with it.
#[test]
fn meshes_cast_shadows_on_splats_that_receive_them() {
    let Some(mut studio) = Studio::new() else { return };
    studio.app.insert_resource(DirectionalLightShadowMap { size: 256 });
    studio.camera(EYE, Msaa::Off);
    let cascades = CascadeShadowConfigBuilder { num_cascades: 2, maximum_distance: 30.0, ..default() };
    let sun = DirectionalLight { shadow_maps_enabled: true, ..default() };
    let above = Transform::from_xyz(0.0, 5.0, 0.01).looking_at(Vec3::ZERO, Vec3::Z);
    studio.app.world_mut().spawn((sun, cascades.build(), above));
    studio.cuboid(Vec3::new(2.0, 0.2, 2.0), Vec3::new(-1.0, 2.0, 0.0), RED, 1.0);
    let left = studio.splats(solid(Vec3::new(-1.0, 0.0, 0.0), RED), Transform::default());
    let right = studio.splats(solid(Vec3::new(1.0, 0.0, 0.0), RED), Transform::default());
    let plain = studio.shoot();
    for entity in [left, right] {
        studio.app.world_mut().entity_mut(entity).insert(SplatShadows { amount: 0.75 });
    }
    let picture = studio.shoot();
    let dark = RED.map(|channel| Srgba::gamma_function_inverse(0.25 * Srgba::gamma_function(channel)));
    near("under the slab", at(&picture, SPLATS), dark, 2.0);
    near("beside it", at(&picture, MESH), RED, 2.0);
    for entity in [left, right] {
        studio.app.world_mut().entity_mut(entity).remove::<SplatShadows>();
    }
    assert!(studio.shoot() == plain);
}

/// The light of a sun in these tests, in lux. It is weak, so that nothing is white.
const SUNLIGHT: f32 = 5000.0;

/// Whether Bevy's atmosphere can be drawn. If it cannot, it prints `SKIPPED`.
fn can_draw_atmospheres(studio: &Studio) -> bool {
    let adapter = &studio.app.world().resource::<RenderAdapterInfo>().name;
    // Mesa's driver of LLVM 15 ends the process when it draws Bevy's atmosphere. SwiftShader draws it.
    let can = !adapter.starts_with("llvmpipe");
    if !can {
        eprintln!("SKIPPED: an atmosphere is not safe to draw on {adapter}");
    }
    can
}

/// Spawns a sun at `sun`, and an atmosphere of the earth where a unit of the world is so many meters and the
/// origin is as many above the ground.
fn add_atmosphere(studio: &mut Studio, sun: Vec3, meters: f32) {
    let medium = add(&mut studio.app, ScatteringMedium::default());
    let earth = Atmosphere::earth(medium);
    let center = Vec3::NEG_Y * (earth.inner_radius / meters + 1.0);
    let place = Transform::from_translation(center).with_scale(Vec3::splat(1.0 / meters));
    let light = DirectionalLight { illuminance: SUNLIGHT, ..default() };
    let world = studio.app.world_mut();
    world.spawn((light, Transform::from_translation(sun).looking_at(Vec3::ZERO, Vec3::Y)));
    world.spawn((earth, place, GlobalTransform::from(place)));
}

/// Lets a camera see the atmosphere.
fn enter_atmosphere(studio: &mut Studio, camera: Entity, rendering_method: AtmosphereMode) {
    let settings = AtmosphereSettings { rendering_method, ..default() };
    studio.app.world_mut().entity_mut(camera).insert(settings);
    // Its shaders are assets, which are loaded in the background.
    for _ in 0..40 {
        studio.app.update();
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

/// The sky of Bevy's atmosphere lies behind splats, with their depth or without, and is not added to them. Of
/// its air, the ten meters before them are not seen.
#[test]
fn the_sky_of_an_atmosphere_is_behind_splats() {
    let Some(mut studio) = Studio::new() else { return };
    if !can_draw_atmospheres(&studio) {
        return;
    }
    let camera = studio.camera(EYE, (Msaa::Off, Tonemapping::Reinhard, Hdr, DebandDither::Disabled));
    studio.splats(solid(Vec3::ZERO, RED), Transform::default());
    let plain = studio.shoot();
    add_atmosphere(&mut studio, Vec3::new(1.0, 4.0, 2.0), 1.0);
    enter_atmosphere(&mut studio, camera, AtmosphereMode::LookupTexture);
    for depth in [false, true] {
        if depth {
            studio.app.world_mut().entity_mut(camera).insert(SplatDepth::default());
        }
        let picture = studio.shoot();
        let sky = pixel(&picture, 2, 2);
        assert!(sky[2] > 0.1, "the sky is {sky:?}");
        near("before the sky", pixel(&picture, 32, 32), pixel(&plain, 32, 32), 2.0);
    }
}

/// A mesh and splats of its color, ten kilometers away, have one color in the air of Bevy's atmosphere, and the
/// splats have it once if they write depth. A camera outside of the atmosphere sees them as before.
#[test]
fn the_air_of_an_atmosphere_reaches_splats_as_it_reaches_meshes() {
    let Some(mut studio) = Studio::new() else { return };
    if !can_draw_atmospheres(&studio) {
        return;
    }
    studio.cuboid(Vec3::new(1.0, 1.0, 0.02), Vec3::new(1.0, 0.0, -0.01), RED, 1.0);
    let look = (Msaa::Off, Tonemapping::Reinhard, Hdr, DebandDither::Disabled);
    let camera = studio.camera(EYE, look);
    let outside = render_target(&mut studio.app, SIZE);
    studio.camera_on(&outside, EYE, look);
    let color = at(&studio.shoot(), MESH);
    studio.splats(solid(Vec3::new(-1.0, 0.0, 0.0), color), Transform::default());
    while drain::<GaussianSceneReady>(&mut studio.app).is_empty() {
        studio.app.update();
    }
    let plain = studio.shoot();
    let from_outside = studio.shoot_on(&outside);
    near("without air", at(&plain, SPLATS), color, 2.0);
    near("outside", at(&from_outside, SPLATS), color, 2.0);
    // Both are at one angle to the sun.
    add_atmosphere(&mut studio, Vec3::new(0.0, 1.0, -1.0), 1000.0);
    for (method, steps) in [(AtmosphereMode::LookupTexture, 8.0), (AtmosphereMode::Raymarched, 15.0)] {
        enter_atmosphere(&mut studio, camera, method);
        let what = ["tables", "marched rays"][method as usize];
        studio.app.world_mut().entity_mut(camera).remove::<SplatDepth>();
        let picture = studio.shoot();
        let expected = at(&picture, MESH);
        let change = (0..3).map(|i| (expected[i] - color[i]).abs()).fold(0.0, f32::max);
        assert!(change > 0.1, "{what}: air is hardly seen, {color:?} and {expected:?}");
        let found = at(&picture, SPLATS);
        near(what, found, expected, steps);
        studio.app.world_mut().entity_mut(camera).insert(SplatDepth::default());
        near("with depth", at(&studio.shoot(), SPLATS), found, 1.0);
    }
    assert!(studio.shoot_on(&outside) == from_outside, "a camera outside of the atmosphere sees it");
}
