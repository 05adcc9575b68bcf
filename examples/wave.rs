//! A wave of paint at each click: it spreads over the scene from the splat that was hit. A click during a wave
//! starts the next one at once.
//!
//! ```sh
//! cargo run --release --example wave
//! ```

use std::time::Duration;

use bevy::{core_pipeline::tonemapping::Tonemapping, math::curve::EaseFunction, prelude::*};
use bevy_stylegaussian::prelude::*;

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// The styles in `assets/styles`, one after the other.
const STYLES: [&str; 5] = ["strokes", "ink", "mosaic", "print", "watercolor"];

fn main() -> AppExit {
    let window = Window { title: "Click on the scene".into(), ..default() };
    App::new()
        .add_plugins(
            DefaultPlugins
                .set(AssetPlugin { file_path: ASSETS.into(), ..default() })
                .set(WindowPlugin { primary_window: Some(window), ..default() }),
        )
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (setup, backdrop::spawn))
        .add_systems(Update, cast)
        .run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    commands.spawn((
        Camera3d::default(),
        Tonemapping::None,
        Msaa::Off,
        Transform::from_xyz(0.0, 4.5, 11.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    commands.spawn((GaussianSplats(assets.load("demo.sgs")), StyleSource::none(), StylePrepare));
}

fn cast(
    mut commands: Commands,
    mut rays: SplatRayCast,
    mut n_casts: Local<usize>,
    camera: Single<(&Camera, &GlobalTransform)>,
    window: Single<&Window>,
    buttons: Res<ButtonInput<MouseButton>>,
    assets: Res<AssetServer>,
) {
    // The scene's index for rays is built in the background, long before the first click.
    rays.prepare();
    let (camera, place) = *camera;
    let ray = window.cursor_position().and_then(|cursor| camera.viewport_to_world(place, cursor).ok());
    let Some(ray) = ray.filter(|_| buttons.just_pressed(MouseButton::Left)) else { return };
    let Some(hit) = rays.cast_ray(ray) else { return };
    let style = assets.load(format!("styles/{}.style.safetensors", STYLES[*n_casts % STYLES.len()]));
    *n_casts += 1;
    let wave =
        StyleTransition::sphere(hit.position, Duration::from_secs(3)).with_easing(EaseFunction::QuadraticIn);
    commands.entity(hit.entity).insert((StyleSource::preset(style), wave));
}
