//! Shadows that splats cast, on meshes and on splats.

use bevy::{
    light::{CascadeShadowConfigBuilder, DirectionalLightShadowMap, PointLightShadowMap},
    prelude::*,
    render::RenderApp,
};
use stylegaussian::Scene;

use crate::splats::{Held, SplatCaster, SplatFade, SplatShadows};

use super::{
    pictures::{EYE, RED, Studio, pixel},
    world::*,
};

/// Splats at a place, three of them, so that nothing shines through. Their core has a radius of 0.83, and 1.66
/// is the radius of all that is seen.
fn solid(mean: Vec3) -> Scene {
    balls(&[Ball { mean, scale: 0.5, opacity: 0.99, color: RED }; 3])
}

/// The z of a wall that faces the camera.
const WALL: f32 = -3.0;

/// A camera, and a wall of a white material behind the origin.
fn studio_with_wall() -> Option<Studio> {
    let mut studio = Studio::new()?;
    studio.app.insert_resource(DirectionalLightShadowMap { size: 512 });
    studio.app.insert_resource(PointLightShadowMap { size: 256 });
    studio.camera(EYE, Msaa::Off);
    let wall = add(&mut studio.app, Mesh::from(Plane3d::new(Vec3::Z, Vec2::splat(9.0))));
    let material = StandardMaterial { perceptual_roughness: 1.0, reflectance: 0.0, ..default() };
    let material = add(&mut studio.app, material);
    let place = Transform::from_xyz(0.0, 0.0, WALL);
    studio.app.world_mut().spawn((Mesh3d(wall), MeshMaterial3d(material), place));
    Some(studio)
}

/// The brightness of the wall at a height of 0.
fn wall_at(picture: &[[f32; 3]], x: f32) -> f32 {
    // The wall is 13 away from the eye, and the picture 0.8 radians high and as wide.
    let half = (EYE.z - WALL) * (0.4_f32).tan();
    let [red, green, blue] = pixel(picture, (32.0 + 32.0 * x / half) as u32, 32);
    (red + green + blue) / 3.0
}

fn held(studio: &mut Studio) -> Held {
    Held::of(studio.app.sub_app_mut(RenderApp).world_mut())
}

fn sun(from: Vec3) -> impl Bundle {
    let cascades = CascadeShadowConfigBuilder { num_cascades: 2, maximum_distance: 30.0, ..default() };
    let light = DirectionalLight { illuminance: 2_000.0, shadow_maps_enabled: true, ..default() };
    (light, cascades.build(), Transform::from_translation(from).looking_at(Vec3::ZERO, Vec3::Z))
}

/// Splats before a wall, and others behind the camera, which lie before the near planes of the sun's shadow
/// maps: both cast the same shadow, and only with the component.
#[test]
fn splats_cast_shadows_of_the_sun_on_meshes() {
    let Some(mut studio) = studio_with_wall() else { return };
    studio.app.world_mut().spawn(sun(Vec3::new(1.0, 0.0, 1.0)));
    for mean in [Vec3::ZERO, Vec3::new(20.0, 0.0, 20.0)] {
        let splats = studio.splats(solid(mean), Transform::default());
        let (plain, before) = (studio.shoot(), held(&mut studio));
        studio.app.world_mut().entity_mut(splats).insert(SplatCaster::default());
        let picture = studio.shoot();
        let (shadow, beside) = (wall_at(&picture, WALL), wall_at(&picture, -WALL));
        assert!(shadow < beside - 0.2, "{mean}: {shadow} in shadow, {beside} beside it");
        assert!((wall_at(&plain, WALL) - beside).abs() < 0.05, "{mean}: dark without the component");
        assert!(held(&mut studio).n_casts > before.n_casts);
        studio.app.world_mut().entity_mut(splats).insert(Visibility::Hidden);
        assert!(wall_at(&studio.shoot(), WALL) > beside - 0.05, "{mean}: hidden splats cast a shadow");
        studio.app.world_mut().entity_mut(splats).remove::<SplatCaster>().insert(Visibility::Inherited);
        assert!(studio.shoot() == plain, "{mean}: the component is gone, and something stays");
        studio.app.world_mut().despawn(splats);
    }
}

/// Without the component, no draw is compiled and no shadow map has casters.
#[test]
fn captures_cast_no_shadows_at_no_cost() {
    let Some(mut studio) = studio_with_wall() else { return };
    studio.app.world_mut().spawn(sun(Vec3::new(1.0, 0.0, 1.0)));
    studio.splats(solid(Vec3::ZERO), Transform::default());
    studio.shoot();
    assert_eq!(held(&mut studio).n_casts, 0);
}

/// A place beside the camera, turned to the origin.
fn beside_the_camera() -> Transform {
    Transform::from_xyz(4.5, 0.0, 5.0).looking_at(Vec3::ZERO, Vec3::Y)
}

fn spot_light() -> SpotLight {
    SpotLight { intensity: 4e6, shadow_maps_enabled: true, outer_angle: 0.6, ..default() }
}

/// Frames in which something moves project splats into a shadow map, and still ones do not.
#[test]
fn still_shadows_are_not_projected_again() {
    let Some(mut studio) = studio_with_wall() else { return };
    let splats = studio.splats(solid(Vec3::ZERO), Transform::default());
    studio.app.world_mut().entity_mut(splats).insert(SplatCaster::default());
    let n_after = |studio: &mut Studio| {
        studio.shoot();
        held(studio).n_projections
    };
    let sun = studio.app.world_mut().spawn(sun(Vec3::new(1.0, 0.0, 1.0))).id();
    studio.shoot();
    let n = n_after(&mut studio);
    assert!(n > 0, "a sun projects nothing");
    assert_eq!(n_after(&mut studio), n, "a still sun");
    studio.app.world_mut().despawn(sun);

    let lamp = studio.app.world_mut().spawn((beside_the_camera(), spot_light())).id();
    let mut last = n_after(&mut studio);
    assert!(last > 0, "a lamp projects nothing");
    let moved = |by: Vec3| Transform::from_translation(by);
    type Change<'a> = (&'a str, &'a dyn Fn(&mut World));
    let changes: [Change; 4] = [
        ("a lamp that moves", &|world| {
            world.entity_mut(lamp).insert(moved(Vec3::Y) * beside_the_camera());
        }),
        ("a cloud that moves", &|world| {
            world.entity_mut(splats).insert(moved(0.1 * Vec3::Y));
        }),
        ("another threshold", &|world| {
            world.entity_mut(splats).insert(SplatCaster { threshold: 0.5 });
        }),
        ("a fade", &|world| {
            world.entity_mut(splats).insert(SplatFade(0.2));
        }),
    ];
    for (what, change) in changes {
        change(studio.app.world_mut());
        let n = n_after(&mut studio);
        assert!(n > last, "{what}: {n} projections, {last} before");
        assert_eq!(n_after(&mut studio), n, "{what}, and nothing since");
        last = n;
    }
}

/// A lamp beside the camera, as a spot light and as a point light.
#[test]
fn splats_cast_shadows_of_lamps_on_meshes() {
    let Some(mut studio) = studio_with_wall() else { return };
    let splats = studio.splats(solid(Vec3::ZERO), Transform::default());
    let point = PointLight { intensity: 4e6, shadow_maps_enabled: true, ..default() };
    // From (4.5, 5) through the origin to the wall.
    let x = 4.5 * WALL / 5.0;
    for is_spot in [true, false] {
        let lamp = studio.app.world_mut().spawn(beside_the_camera()).id();
        let mut of_lamp = studio.app.world_mut().entity_mut(lamp);
        if is_spot {
            of_lamp.insert(spot_light())
        } else {
            of_lamp.insert(point)
        };
        let plain = wall_at(&studio.shoot(), x);
        studio.app.world_mut().entity_mut(splats).insert(SplatCaster::default());
        let shadow = wall_at(&studio.shoot(), x);
        assert!(shadow < plain - 0.2, "spot {is_spot}: {shadow} in shadow, {plain} without");
        studio.app.world_mut().entity_mut(splats).remove::<SplatCaster>();
        assert!((wall_at(&studio.shoot(), x) - plain).abs() < 0.01, "spot {is_spot}");
        studio.app.world_mut().despawn(lamp);
    }
}

/// One ball of splats above one of two others, which receive shadows.
#[test]
fn splats_cast_shadows_on_splats() {
    let Some(mut studio) = studio_with_wall() else { return };
    studio.app.world_mut().spawn(sun(Vec3::new(0.0, 5.0, 0.01)));
    let above = studio.splats(solid(Vec3::new(-1.0, 4.0, 0.0)), Transform::default());
    for x in [-1.0, 1.0] {
        let below = studio.splats(solid(Vec3::new(x, 0.0, 0.0)), Transform::default());
        studio.app.world_mut().entity_mut(below).insert(SplatShadows { amount: 0.75 });
    }
    let plain = studio.shoot();
    studio.app.world_mut().entity_mut(above).insert(SplatCaster::default());
    let picture = studio.shoot();
    let dark = Srgba::gamma_function_inverse(0.25 * Srgba::gamma_function(RED[0]));
    assert!((pixel(&picture, 24, 32)[0] - dark).abs() < 0.02, "{:?}", pixel(&picture, 24, 32));
    assert_eq!(pixel(&picture, 39, 32), pixel(&plain, 39, 32));
}

/// A box between a lamp and splats that receive shadows.
#[test]
fn meshes_cast_shadows_of_lamps_on_splats() {
    let Some(mut studio) = studio_with_wall() else { return };
    let splats = studio.splats(solid(Vec3::ZERO), Transform::default());
    studio.app.world_mut().entity_mut(splats).insert(SplatShadows { amount: 0.75 });
    let from = Vec3::new(4.5, 0.0, 5.0);
    studio.cuboid(Vec3::splat(0.8), 0.5 * from, RED, 1.0);
    let plain = studio.shoot();
    let place = Transform::from_translation(from).looking_at(Vec3::ZERO, Vec3::Y);
    let range = 12.0;
    // The fall of the lamp's light towards the end of its range.
    let share = (1.0 - (from.length() / range).powi(4)).powi(2);
    let dark = Srgba::gamma_function_inverse((1.0 - 0.75 * share) * Srgba::gamma_function(RED[0]));
    for is_spot in [true, false] {
        let lamp = studio.app.world_mut().spawn(place).id();
        let mut of_lamp = studio.app.world_mut().entity_mut(lamp);
        if is_spot {
            of_lamp.insert(SpotLight { range, shadow_maps_enabled: true, outer_angle: 0.6, ..default() });
        } else {
            of_lamp.insert(PointLight { range, shadow_maps_enabled: true, ..default() });
        }
        let found = pixel(&studio.shoot(), 32, 32)[0];
        assert!((found - dark).abs() < 0.02, "spot {is_spot}: found {found}, expected {dark}");
        studio.app.world_mut().despawn(lamp);
        assert_eq!(pixel(&studio.shoot(), 32, 32), pixel(&plain, 32, 32), "spot {is_spot}");
    }
}
