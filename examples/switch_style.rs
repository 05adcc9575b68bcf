//! A scene painted anew at the press of a key: 1 to 8 for the shipped styles, 0 for none. The old look stays
//! until the new one is complete, then fades into it. The keys + and - make more and less of the strokes, at
//! once.
//!
//! ```sh
//! cargo run --release --example switch_style
//! ```

use std::time::Duration;

use bevy::{core_pipeline::tonemapping::Tonemapping, prelude::*};
use bevy_stylegaussian::prelude::*;

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// The keys and their styles in `assets/styles`.
const STYLES: [(KeyCode, &str); 8] = [
    (KeyCode::Digit1, "cubist"),
    (KeyCode::Digit2, "dots"),
    (KeyCode::Digit3, "halftone"),
    (KeyCode::Digit4, "ink"),
    (KeyCode::Digit5, "mosaic"),
    (KeyCode::Digit6, "print"),
    (KeyCode::Digit7, "strokes"),
    (KeyCode::Digit8, "watercolor"),
];

fn main() -> AppExit {
    let window = Window {
        title: "Press 1 to 8 for a style, 0 for none, + and - for more and less paint".into(),
        ..default()
    };
    App::new()
        .add_plugins(
            DefaultPlugins
                .set(AssetPlugin { file_path: ASSETS.into(), ..default() })
                .set(WindowPlugin { primary_window: Some(window), ..default() }),
        )
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (setup, backdrop::spawn))
        .add_systems(Update, (switch, thicken, turn))
        .add_observer(|applied: On<StyleApplied>| info!("restyled after {:?}", applied.elapsed))
        .run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    commands.spawn((
        Camera3d::default(),
        Tonemapping::None,
        Msaa::Off,
        Transform::from_xyz(0.0, 4.5, 11.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    commands.spawn((
        GaussianSplats(assets.load("demo.sgs")),
        StyleSource::none(),
        StyleTransition::fade(Duration::from_millis(800)),
        // So that the first key is answered as soon as the others.
        StylePrepare,
    ));
}

/// Paints the scene anew: changing the component is enough.
fn switch(mut source: Single<&mut StyleSource>, keys: Res<ButtonInput<KeyCode>>, assets: Res<AssetServer>) {
    if keys.just_pressed(KeyCode::Digit0) {
        **source = StyleSource::none();
    }
    for (key, style) in STYLES {
        if keys.just_pressed(key) {
            **source = StyleSource::preset(assets.load(format!("styles/{style}.style.safetensors")));
        }
    }
}

/// Changes how strokes are drawn, for which nothing is computed.
fn thicken(mut source: Single<&mut StyleSource>, keys: Res<ButtonInput<KeyCode>>, time: Res<Time>) {
    let is_down = |keys: &ButtonInput<KeyCode>, of: [KeyCode; 2]| f32::from(u8::from(keys.any_pressed(of)));
    let change = is_down(&keys, [KeyCode::Equal, KeyCode::NumpadAdd])
        - is_down(&keys, [KeyCode::Minus, KeyCode::NumpadSubtract]);
    if change != 0.0 {
        source.paint = (source.paint + change * time.delta_secs()).clamp(0.0, 3.0);
    }
}

fn turn(mut splats: Single<&mut Transform, With<GaussianSplats>>, time: Res<Time>) {
    splats.rotate_y(0.15 * time.delta_secs());
}
