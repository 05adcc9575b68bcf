//! The shortest app that shows a styled scene: the plugin, a camera, and one entity.
//!
//! ```sh
//! cargo run --release --example minimal
//! ```

use bevy::prelude::*;
use bevy_stylegaussian::prelude::*;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin { file_path: ASSETS.into(), ..default() }))
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, setup)
        .run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    commands
        .spawn((Camera3d::default(), Transform::from_xyz(0.0, 4.5, 11.0).looking_at(Vec3::ZERO, Vec3::Y)));
    commands.spawn((
        GaussianSplats(assets.load("demo.sgs")),
        StyleSource::preset(assets.load("styles/strokes.style.safetensors")),
    ));
}
