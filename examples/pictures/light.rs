//! Pictures of light: splats among meshes, in fog, water and shadows, by several cameras.

use anyhow::Result;
use bevy::{
    camera::Viewport,
    core_pipeline::tonemapping::Tonemapping,
    light::{Atmosphere, atmosphere::ScatteringMedium},
    pbr::{AtmosphereSettings, DistanceFog, FogFalloff, ScreenSpaceAmbientOcclusion},
    post_process::dof::DepthOfField,
    prelude::*,
    render::renderer::RenderAdapterInfo,
};
use bevy_stylegaussian::prelude::*;

use super::{EYE, MIDDLE, SIZE, Studio, beside};

const RED: Color = Color::srgb(0.85, 0.2, 0.15);
const YELLOW: Color = Color::srgb(0.95, 0.7, 0.15);
const WHITE: Color = Color::srgb(0.9, 0.9, 0.88);
/// Dark, since light that bounces off a bright surface fills its corners.
const STONE: Color = Color::srgb(0.4, 0.4, 0.42);
const GLASS: Color = Color::srgba(0.2, 0.9, 0.5, 0.45);
const WATER: Color = Color::srgba(0.1, 0.35, 0.45, 0.6);

/// The side that the sun usually comes from.
const SUN: Vec3 = Vec3::new(4.0, 8.0, 6.0);

/// The windmill on its hill.
const MILL: Vec3 = Vec3::new(1.75, 1.1, -1.85);

/// A cloud above the island.
const CLOUD: Vec3 = Vec3::new(-0.75, 3.0, -0.9);

/// Three cubes in a row, from near to far.
fn cubes(studio: &mut Studio) {
    for (at, color) in [
        (Vec3::new(2.4, 0.9, 4.2), RED),
        (Vec3::new(0.9, 0.8, 0.6), YELLOW),
        (Vec3::new(0.7, 2.0, -4.6), RED),
    ] {
        studio.mesh(Cuboid::from_length(0.9), color, at);
    }
}

/// A fog that reaches from the near cube to behind the far one.
fn haze() -> DistanceFog {
    let falloff = FogFalloff::Linear { start: 4.0, end: 20.0 };
    DistanceFog { color: Color::srgb(0.72, 0.79, 0.84), falloff, ..default() }
}

pub fn fog(studio: &mut Studio) -> Result<()> {
    studio.camera(EYE, MIDDLE, haze());
    studio.sun(SUN);
    studio.garden(());
    cubes(studio);
    studio.shoot_and_save("fog")
}

/// The island as if it were forty kilometers wide, early in the morning.
pub fn air(studio: &mut Studio) -> Result<()> {
    // Mesa's driver of LLVM 15 ends the process when it draws Bevy's atmosphere.
    let adapter = &studio.app.world().resource::<RenderAdapterInfo>().name;
    if adapter.starts_with("llvmpipe") {
        eprintln!("SKIPPED: air, since an atmosphere is not safe to draw on {adapter}");
        return Ok(());
    }
    const METERS: f32 = 4000.0;
    let (eye, to) = (Vec3::new(0.0, 2.2, 9.6), Vec3::new(0.0, 1.1, 0.0));
    studio.camera(eye, to, (AtmosphereSettings::default(), Tonemapping::TonyMcMapface));
    let medium =
        studio.app.world_mut().resource_mut::<Assets<ScatteringMedium>>().add(ScatteringMedium::default());
    let earth = Atmosphere::earth(medium);
    let center = Vec3::NEG_Y * (earth.inner_radius / METERS + 1.0);
    studio.spawn((earth, Transform::from_translation(center).with_scale(Vec3::splat(1.0 / METERS))));
    let light = DirectionalLight { illuminance: 8000.0, ..default() };
    studio.spawn((light, Transform::from_xyz(-5.0, 1.6, 5.0).looking_at(Vec3::ZERO, Vec3::Y)));
    studio.insert(studio.sky, Visibility::Hidden);
    studio.garden(());
    cubes(studio);
    studio.shoot_and_save("air")?;
    studio.insert(studio.sky, Visibility::Inherited);
    Ok(())
}

pub fn two_clouds(studio: &mut Studio) -> Result<()> {
    studio.camera(EYE, MIDDLE, haze());
    studio.sun(SUN);
    studio.garden(());
    let style = StyleSource::preset(studio.style("strokes"));
    // Turned and aside, so that hills, trees and houses of each stand in those of the other.
    let place = Transform::from_xyz(1.6, 0.25, 0.8).with_rotation(Quat::from_rotation_y(0.9));
    let painted = studio.garden((style, place));
    studio.until_applied(&[painted])?;
    cubes(studio);
    studio.shoot_and_save("two_clouds")
}

pub fn depth_of_field(studio: &mut Studio) -> Result<()> {
    let (eye, to) = (Vec3::new(1.2, 1.9, 6.2), Vec3::new(0.0, 0.7, 0.0));
    // The cottage is sharp.
    let lens = DepthOfField { focal_distance: eye.distance(to), aperture_f_stops: 0.03, ..default() };
    studio.camera(eye, to, (SplatDepth::default(), lens));
    studio.sun(SUN);
    studio.garden(());
    cubes(studio);
    studio.shoot_and_save("depth_of_field")
}

/// Without the depth of splats, and with it.
fn without_and_with_depth(studio: &mut Studio, camera: Entity, name: &str) -> Result<()> {
    let without = studio.shoot()?;
    studio.insert(camera, SplatDepth::default());
    let with = studio.shoot()?;
    studio.save(name, &beside(&[without, with]))
}

pub fn ambient_occlusion(studio: &mut Studio) -> Result<()> {
    // Ambient light alone, which is what it changes.
    let light = AmbientLight { brightness: 2500.0, ..default() };
    let more = (ScreenSpaceAmbientOcclusion { constant_object_thickness: 4.0, ..default() }, light);
    let camera = studio.camera(Vec3::new(0.4, 2.9, 5.4), Vec3::new(-0.4, 0.5, 0.0), more);
    studio.garden(());
    studio.mesh(Cuboid::from_length(0.6), STONE, Vec3::new(0.9, 0.6, 1.6));
    // A floor on the island, out of which trees and houses stand.
    studio.mesh(Plane3d::new(Vec3::Y, Vec2::splat(9.0)), STONE, Vec3::new(0.0, 0.3, 0.0));
    without_and_with_depth(studio, camera, "ambient_occlusion")
}

pub fn water(studio: &mut Studio) -> Result<()> {
    let camera = studio.camera(EYE, MIDDLE, ());
    studio.sun(SUN);
    studio.garden(());
    studio.mesh(Plane3d::new(Vec3::Y, Vec2::splat(9.0)), WATER, Vec3::new(0.0, -0.6, 0.0));
    // One pane before the scene and one behind it.
    studio.mesh(Cuboid::new(1.4, 1.4, 0.05), GLASS, Vec3::new(-0.6, 1.4, 4.6));
    studio.mesh(Cuboid::new(2.4, 2.4, 0.05), GLASS, Vec3::new(0.4, 1.2, -2.6));
    without_and_with_depth(studio, camera, "water")
}

pub fn order(studio: &mut Studio) -> Result<()> {
    let camera = studio.camera(CLOUD + Vec3::new(0.6, 0.3, 3.2), CLOUD, ());
    studio.sun(SUN);
    studio.garden(());
    studio.mesh(Cuboid::new(1.0, 1.0, 0.02), GLASS, CLOUD);
    without_and_with_depth(studio, camera, "order")
}

pub fn shadows_on_splats(studio: &mut Studio) -> Result<()> {
    studio.camera(EYE, MIDDLE, ());
    // Low, so that shadows are long.
    studio.sun(Vec3::new(8.0, 4.5, 3.0));
    studio.garden(SplatShadows { amount: 0.8 });
    studio.mesh(Cuboid::new(0.3, 2.4, 1.2), RED, Vec3::new(2.7, 1.3, 1.4));
    studio.mesh(Torus::new(0.35, 0.6), YELLOW, Vec3::new(1.4, 2.1, -0.4));
    studio.shoot_and_save("shadows_on_splats")
}

pub fn shadows_of_splats(studio: &mut Studio) -> Result<()> {
    studio.camera(Vec3::new(0.0, 6.8, 12.5), Vec3::new(-0.8, -1.6, 1.0), ());
    // From behind, so that the shadow lies before the island.
    studio.sun(Vec3::new(5.0, 7.0, -8.0));
    studio.garden(SplatCaster::default());
    studio.mesh(Plane3d::new(Vec3::Y, Vec2::splat(14.0)), WHITE, Vec3::new(0.0, -3.4, 0.0));
    studio.shoot_and_save("shadows_of_splats")
}

pub fn tint(studio: &mut Studio) -> Result<()> {
    studio.camera(EYE, MIDDLE, ());
    let night = SplatTint { color: Color::srgb(0.6, 0.7, 1.0), exposure: -2.0, saturation: 0.5 };
    studio.garden(night);
    let lamp = SplatTint { color: Color::srgb(1.0, 0.75, 0.45), exposure: 2.5, saturation: 1.6 };
    let around = StyleVolume::new(Sphere::new(1.5)).with_softness(1.2).with_tint(lamp);
    studio.spawn((around, Transform::from_xyz(-0.8, 0.5, 0.5)));
    studio.shoot_and_save("tint")
}

pub fn half_size(studio: &mut Studio) -> Result<()> {
    let camera = studio.camera(Vec3::new(1.2, 1.7, 1.6), MILL, ());
    studio.sun(SUN);
    studio.garden(());
    studio.mesh(Cuboid::from_length(0.4), RED, MILL + Vec3::new(0.1, -0.5, 0.7));
    let whole = studio.shoot()?;
    studio.insert(camera, SplatCuts { half_size: true, ..default() });
    let half = studio.shoot()?;
    studio.save("half_size", &beside(&[whole, half]))
}

pub fn msaa(studio: &mut Studio) -> Result<()> {
    let camera = studio.camera(Vec3::new(1.0, 1.9, 3.4), Vec3::new(0.0, 0.6, 0.0), ());
    studio.sun(SUN);
    studio.garden(());
    for (i, color) in [RED, YELLOW, WHITE].into_iter().enumerate() {
        let cube = studio.mesh(Cuboid::new(0.08, 1.6, 0.08), color, Vec3::ZERO);
        let turn = Quat::from_rotation_z(0.25 + 0.3 * i as f32);
        studio.insert(cube, Transform::from_xyz(0.3 * i as f32, 0.7, 0.6).with_rotation(turn));
    }
    let off = studio.shoot()?;
    studio.insert(camera, Msaa::Sample4);
    let on = studio.shoot()?;
    studio.save("msaa", &beside(&[off, on]))
}

pub fn eyes(studio: &mut Studio) -> Result<()> {
    let half = UVec2::new(SIZE.x / 2, SIZE.y);
    let mut first = None;
    for (i, x) in [-0.15_f32, 0.15].into_iter().enumerate() {
        let place = UVec2::new(i as u32 * half.x, 0);
        let camera = Camera {
            order: i as isize,
            viewport: Some(Viewport { physical_position: place, physical_size: half, ..default() }),
            // What the first camera drew stays.
            clear_color: if i == 0 { ClearColorConfig::Default } else { ClearColorConfig::None },
            ..default()
        };
        let aside = x * Vec3::X;
        let eye = studio.camera(Vec3::new(0.0, 4.8, 13.0) + aside, MIDDLE + aside, camera);
        match first {
            None => first = Some(eye),
            Some(other) => studio.insert(eye, SplatEyes(other)),
        }
    }
    studio.garden(());
    studio.shoot_and_save("eyes")
}
