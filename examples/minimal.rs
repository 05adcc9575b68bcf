//! The shortest app that shows a styled scene: the plugin, a camera, and one entity.
//!
//! ```sh
//! cargo run --release --example minimal
//! cargo xtask web --example minimal --serve    # the same in a browser
//! ```

use bevy::prelude::*;
use bevy_stylegaussian::prelude::*;

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins)
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
