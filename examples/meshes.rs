//! Splats among meshes: lit cubes circle in front of a styled scene, behind it and through it. Cubes cover
//! splats behind them and cast shadows on others, and splats do the same to cubes. A pane of glass in front
//! tints the scene, and the scene stands in water. The splats write depth, so they hide the water behind them,
//! and depth of field blurs what is near and far.
//!
//! ```sh
//! cargo run --release --example meshes
//! ```

use std::f32::consts::TAU;

#[cfg(not(target_family = "wasm"))]
use bevy::post_process::dof::DepthOfField;
use bevy::prelude::*;
use bevy_stylegaussian::prelude::*;

#[path = "backdrop/mod.rs"]
mod backdrop;

/// Height of the water, in scene units.
const WATER_LEVEL: f32 = -0.6;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// A circle around the middle of the scene that an entity follows.
#[derive(Component)]
struct Circle {
    /// In scene units. The scene's radius is about 4.6.
    radius: f32,
    height: f32,
    /// Angle to the horizontal, in radians.
    tilt: f32,
    /// Revolutions per second.
    speed: f32,
    /// Start, in revolutions.
    start: f32,
}

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin { file_path: ASSETS.into(), ..default() }))
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (spawn_scene, spawn_cubes, backdrop::spawn))
        .add_systems(Update, follow_circles)
        .run()
}

fn spawn_scene(mut commands: Commands, assets: Res<AssetServer>) {
    let camera = Transform::from_xyz(0.0, 4.2, 11.0).looking_at(Vec3::ZERO, Vec3::Y);
    commands.spawn((
        Camera3d::default(),
        SplatDepth::default(),
        // The middle of the scene is sharp.
        #[cfg(not(target_family = "wasm"))]
        DepthOfField { focal_distance: camera.translation.length(), aperture_f_stops: 0.1, ..default() },
        AmbientLight { brightness: 400.0, ..default() },
        camera,
    ));
    commands.spawn((
        DirectionalLight { illuminance: 8_000.0, shadow_maps_enabled: true, ..default() },
        Transform::from_xyz(4.0, 8.0, 6.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    commands.spawn((
        GaussianSplats(assets.load("demo.sgs")),
        StyleSource::preset(assets.load("styles/strokes.style.safetensors")),
        SplatShadows::default(),
        SplatCaster::default(),
        HiddenUntilStyled,
    ));
}

fn spawn_cubes(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let cube = meshes.add(Cuboid::from_length(1.0));
    let pane = meshes.add(Cuboid::new(1.8, 1.8, 0.06));
    let surface = meshes.add(Plane3d::new(Vec3::Y, Vec2::splat(9.0)));
    let around = Circle { radius: 5.6, height: 0.4, tilt: 0.0, speed: 0.06, start: 0.25 };
    let opposite = Circle { start: 0.75, ..around };
    let through = Circle { radius: 2.6, height: 0.3, tilt: 0.5, speed: 0.09, start: 0.1 };
    let mut material = |base_color, alpha_mode| {
        materials.add(StandardMaterial { base_color, alpha_mode, perceptual_roughness: 0.4, ..default() })
    };
    let red = material(Color::srgb(0.85, 0.20, 0.15), AlphaMode::Opaque);
    let yellow = material(Color::srgb(0.95, 0.70, 0.15), AlphaMode::Opaque);
    let blue = material(Color::srgb(0.15, 0.40, 0.85), AlphaMode::Opaque);
    let tinted = material(Color::srgba(0.30, 0.90, 0.60, 0.35), AlphaMode::Blend);
    let water = material(Color::srgba(0.10, 0.35, 0.45, 0.6), AlphaMode::Blend);
    commands.spawn((Transform::from_xyz(0.0, WATER_LEVEL, 0.0), Mesh3d(surface), MeshMaterial3d(water)));
    commands.spawn((around, Mesh3d(cube.clone()), MeshMaterial3d(red)));
    commands.spawn((opposite, Mesh3d(cube.clone()), MeshMaterial3d(yellow)));
    commands.spawn((through, Mesh3d(cube), MeshMaterial3d(blue)));
    commands.spawn((Transform::from_xyz(-1.7, 1.4, 5.0), Mesh3d(pane), MeshMaterial3d(tinted)));
}

fn follow_circles(mut circles: Query<(&Circle, &mut Transform)>, time: Res<Time>) {
    for (circle, mut transform) in &mut circles {
        let angle = TAU * (circle.start + circle.speed * time.elapsed_secs());
        let level = Vec3::new(circle.radius * angle.cos(), circle.height, circle.radius * angle.sin());
        transform.translation = Quat::from_rotation_z(circle.tilt) * level;
        // Turning about a second axis shows that edges against the splats are right at any angle.
        transform.rotation = Quat::from_rotation_y(-angle) * Quat::from_rotation_x(0.5 * angle);
    }
}
