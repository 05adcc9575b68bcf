//! A brush: paint the scene in one of four styles by dragging, erase with the right button, undo with U.
//!
//! ```sh
//! cargo run --release --example brush
//! ```

use bevy::{core_pipeline::tonemapping::Tonemapping, prelude::*};
use bevy_stylegaussian::{prelude::*, stylegaussian::mask::Brush};

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// The keys of the mask's four channels, and the styles that they show.
const CHANNELS: [(KeyCode, &str); 4] = [
    (KeyCode::Digit1, "strokes"),
    (KeyCode::Digit2, "ink"),
    (KeyCode::Digit3, "mosaic"),
    (KeyCode::Digit4, "print"),
];

fn main() -> AppExit {
    let title = "Drag to paint, 1 to 4 for another style, right button to erase, U to undo";
    let window = Window { title: title.into(), ..default() };
    App::new()
        .add_plugins(
            DefaultPlugins
                .set(AssetPlugin { file_path: ASSETS.into(), ..default() })
                .set(WindowPlugin { primary_window: Some(window), ..default() }),
        )
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (setup, backdrop::spawn))
        .add_systems(Update, (choose, paint))
        .run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    commands.spawn((
        Camera3d::default(),
        Tonemapping::None,
        Msaa::Off,
        Transform::from_xyz(0.0, 4.5, 11.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    commands.spawn((GaussianSplats(assets.load("demo.sgs")), StyleMask::default()));
    // Each channel shows its style wherever it is painted.
    for (channel, (_, name)) in CHANNELS.iter().enumerate() {
        let style = StyleSource::preset(assets.load(format!("styles/{name}.style.safetensors")));
        commands.spawn((StyleVolume::painted(channel).with_priority(channel as i32), style));
    }
}

/// The channel that is painted.
fn choose(mut channel: Local<usize>, keys: Res<ButtonInput<KeyCode>>, mut commands: Commands) {
    if let Some(chosen) = CHANNELS.iter().position(|(key, _)| keys.just_pressed(*key)) {
        *channel = chosen;
    }
    // A channel takes the place of all others.
    let lessens = std::array::from_fn(|other| other != *channel);
    let brush = Brush { radius: 0.6, strength: 0.5, channel: *channel, lessens, ..default() };
    commands.insert_resource(Paint(brush));
}

#[derive(Resource)]
struct Paint(Brush);

fn paint(
    mut rays: SplatRayCast,
    mut mask: Single<(&mut StyleMask, &GlobalTransform)>,
    paint: Option<Res<Paint>>,
    camera: Single<(&Camera, &GlobalTransform)>,
    window: Single<&Window>,
    buttons: Res<ButtonInput<MouseButton>>,
    keys: Res<ButtonInput<KeyCode>>,
) {
    let (mask, transform) = &mut *mask;
    rays.prepare();
    if keys.just_pressed(KeyCode::KeyU) {
        mask.undo();
    }
    if buttons.any_just_released([MouseButton::Left, MouseButton::Right]) {
        mask.end_stroke();
    }
    let (camera, place) = *camera;
    let ray = window.cursor_position().and_then(|cursor| camera.viewport_to_world(place, cursor).ok());
    let is_down = buttons.any_pressed([MouseButton::Left, MouseButton::Right]);
    if let (Some(ray), Some(paint), true) = (ray, paint, is_down)
        && let Some(hit) = rays.cast_ray(ray)
    {
        let brush = Brush { erases: buttons.pressed(MouseButton::Right), ..paint.0 };
        // Masks live in the space of the scene.
        mask.stroke_to(&brush, transform.affine().inverse().transform_point3(hit.position));
    }
}
