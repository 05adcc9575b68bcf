//! The shortest app that shows a painted scene: the plugin, a camera, and one entity.
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
    // Splats have soft edges, so multisampling would only take time.
    let view = Transform::from_xyz(0.0, 4.5, 11.0).looking_at(Vec3::ZERO, Vec3::Y);
    commands.spawn((Camera3d::default(), Msaa::Off, view));
    // Any capture will do, and any painting: also `StyleSource::image(assets.load("starry.png"))`.
    commands.spawn((
        GaussianSplats(assets.load("demo.sgs")),
        StyleSource::preset(assets.load("styles/strokes.style.safetensors")),
        HiddenUntilStyled,
    ));
}
