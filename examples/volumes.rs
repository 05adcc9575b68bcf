//! Volumes: balls of paint that circle through a captured scene, a sheet of ink that rises and sinks, and a
//! middle that stays as it was.
//!
//! ```sh
//! cargo run --release --example volumes
//! ```

use std::f32::consts::TAU;

use bevy::{core_pipeline::tonemapping::Tonemapping, prelude::*};
use bevy_stylegaussian::prelude::*;

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// The styles of the balls, in `assets/styles`.
const BALLS: [&str; 3] = ["mosaic", "print", "strokes"];

/// Circles around the middle, by its angle at the beginning.
#[derive(Component)]
struct Circling(f32);

/// Rises and sinks.
#[derive(Component)]
struct Tide;

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin { file_path: ASSETS.into(), ..default() }))
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (setup, backdrop::spawn))
        .add_systems(Update, (circle, rise))
        .run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    commands.spawn((
        Camera3d::default(),
        Tonemapping::None,
        Msaa::Off,
        Transform::from_xyz(0.0, 4.5, 11.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    commands.spawn(GaussianSplats(assets.load("demo.sgs")));
    let style = |name: &str| StyleSource::preset(assets.load(format!("styles/{name}.style.safetensors")));
    // Everything below the tide is ink.
    commands.spawn((StyleVolume::half_space().with_softness(0.3), style("ink"), Tide));
    // Volumes of a higher priority lie over it.
    for (i, name) in BALLS.iter().enumerate() {
        let ball = StyleVolume::new(Sphere::new(1.8)).with_softness(0.4).with_priority(1);
        commands.spawn((ball, style(name), Circling(TAU * i as f32 / BALLS.len() as f32)));
    }
    // A volume without a style shows the captured colors.
    commands.spawn(StyleVolume::new(Cylinder::new(0.9, 12.0)).with_softness(0.2).with_priority(2));
}

fn circle(mut balls: Query<(&mut Transform, &Circling)>, time: Res<Time>) {
    for (mut transform, Circling(angle)) in &mut balls {
        let (sin, cos) = (angle + 0.5 * time.elapsed_secs()).sin_cos();
        transform.translation = Vec3::new(3.5 * cos, 0.5, 3.5 * sin);
    }
}

fn rise(mut tide: Single<&mut Transform, With<Tide>>, time: Res<Time>) {
    tide.translation.y = 1.2 * (0.3 * time.elapsed_secs()).sin() - 0.6;
}
