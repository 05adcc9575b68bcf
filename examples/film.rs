//! A film that is painted picture by picture: strokes boil, the low ground flows, and a sun that goes around
//! lights the thickness of the paint. Space pauses it, S lets strokes keep their size on screen, and the wheel
//! comes nearer.
//!
//! ```sh
//! cargo run --release --example film
//! ```

use bevy::{core_pipeline::tonemapping::Tonemapping, input::mouse::AccumulatedMouseScroll, prelude::*};
use bevy_stylegaussian::{
    prelude::*,
    style::{StyleMotion, StyleRelief},
};

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin { file_path: ASSETS.into(), ..default() }))
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (setup, backdrop::spawn))
        .add_systems(Update, (turn_sun, press_keys, come_nearer))
        .run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    let view = Transform::from_xyz(0.0, 4.5, 11.0).looking_at(Vec3::ZERO, Vec3::Y);
    commands.spawn((Camera3d::default(), Tonemapping::None, Msaa::Off, view));
    commands.spawn((DirectionalLight::default(), Transform::default()));
    let style = |name: &str| StyleSource::preset(assets.load(format!("styles/{name}.style.safetensors")));
    let film = style("strokes").with_motion(StyleMotion::boil(8.0)).with_relief(StyleRelief::sun());
    commands.spawn((GaussianSplats(assets.load("demo.sgs")), film, HiddenUntilStyled));
    // Volumes move in their own ways.
    let water = style("strokes").with_motion(StyleMotion::flow(0.4));
    let level = Transform::from_xyz(0.0, -0.6, 0.0);
    commands.spawn((StyleVolume::half_space().with_softness(0.3), water, level));
}

fn turn_sun(mut sun: Single<&mut Transform, With<DirectionalLight>>, time: Res<Time>) {
    let angle = 0.5 * time.elapsed_secs();
    let at = Vec3::new(angle.cos(), 0.7, angle.sin());
    **sun = Transform::from_translation(at).looking_at(Vec3::ZERO, Vec3::Y);
}

fn press_keys(
    keys: Res<ButtonInput<KeyCode>>,
    mut game: ResMut<Time<Virtual>>,
    mut film: Single<&mut StyleSource, With<GaussianSplats>>,
) {
    if keys.just_pressed(KeyCode::Space) {
        match game.is_paused() {
            true => game.unpause(),
            false => game.pause(),
        }
    }
    if keys.just_pressed(KeyCode::KeyS) {
        film.screen_stable = !film.screen_stable;
    }
}

fn come_nearer(mut view: Single<&mut Transform, With<Camera3d>>, wheel: Res<AccumulatedMouseScroll>) {
    if wheel.delta.y != 0.0 {
        view.translation *= 0.9_f32.powf(wheel.delta.y.signum());
    }
}
