//! One scene shown twice, in two styles. Both entities share the scene, in main memory and on the GPU. The
//! second one adds only its colors and strokes, 12 bytes per Gaussian.
//!
//! ```sh
//! cargo run --release --example two_styles
//! ```

use bevy::{core_pipeline::tonemapping::Tonemapping, prelude::*};
use bevy_stylegaussian::prelude::*;

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin { file_path: ASSETS.into(), ..default() }))
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (setup, backdrop::spawn))
        .add_systems(Update, turn)
        .run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    commands.spawn((
        Camera3d::default(),
        Tonemapping::None,
        Msaa::Off,
        Transform::from_xyz(0.0, 5.0, 14.3).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    let scene = assets.load("demo.sgs");
    for (x, style) in [(-5.0, "dots"), (5.0, "strokes")] {
        commands.spawn((
            GaussianSplats(scene.clone()),
            StyleSource::preset(assets.load(format!("styles/{style}.style.safetensors"))),
            HiddenUntilStyled,
            Transform::from_xyz(x, 0.0, 0.0),
        ));
    }
}

fn turn(mut splats: Query<&mut Transform, With<GaussianSplats>>, time: Res<Time>) {
    for mut transform in &mut splats {
        transform.rotate_y(0.2 * time.delta_secs());
    }
}
