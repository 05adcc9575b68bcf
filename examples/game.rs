//! Everything together, in the size of a first game: two captures, four volumes, a wave at a click, a brush,
//! two cameras.
//!
//! ```sh
//! cargo run --release --example game
//! ```
//!
//! A click on a splat casts a spell there, the right button paints cubes, and the arrow keys walk the lantern.

use std::time::Duration;

use bevy::{camera::Viewport, core_pipeline::tonemapping::Tonemapping, prelude::*};
use bevy_stylegaussian::{prelude::*, stylegaussian::mask::Brush};

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");
const SPELLS: [&str; 3] = ["strokes", "print", "watercolor"];

/// The player's lantern, a volume in which all is as it was captured.
#[derive(Component)]
struct Lantern;

/// The camera that the player looks through.
#[derive(Component)]
struct Eye;

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin { file_path: ASSETS.into(), ..default() }))
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (setup, backdrop::spawn))
        .init_resource::<Aim>()
        .add_systems(Update, (walk, place_map, (aim, act).chain()))
        .run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    let style = |name: &str| StyleSource::preset(assets.load(format!("styles/{name}.style.safetensors")));
    // Two cameras: the player's, and a map from above in a corner.
    let above = Transform::from_xyz(0.0, 30.0, 0.1).looking_at(Vec3::ZERO, Vec3::Y);
    let map = Camera { order: 1, clear_color: Color::BLACK.into(), ..default() };
    commands.spawn((Camera3d::default(), map, Tonemapping::None, Msaa::Off, above));
    let eye = Transform::from_xyz(0.0, 6.0, 15.0).looking_at(Vec3::ZERO, Vec3::Y);
    commands.spawn((Camera3d::default(), Eye, Tonemapping::None, Msaa::Off, eye));
    // Two captures, of which the second one appears in its style.
    let scene = assets.load("demo.sgs");
    let [left, right] = [-5.5, 5.5].map(|x| Transform::from_xyz(x, 0.0, 0.0));
    commands.spawn((GaussianSplats(scene.clone()), StyleSource::none(), StyleMask::default(), left));
    commands.spawn((
        GaussianSplats(scene),
        style("mosaic"),
        HiddenUntilStyled,
        StyleMask::default(),
        right.with_rotation(Quat::from_rotation_y(2.0)),
    ));
    // Four volumes: a door behind which all is ink, a dome, the painted area, and the lantern over all of them.
    let door =
        Transform::from_xyz(7.5, 0.0, 0.0).with_rotation(Quat::from_rotation_z(std::f32::consts::FRAC_PI_2));
    commands.spawn((StyleVolume::half_space().with_softness(0.3), style("ink"), door));
    let dome = StyleVolume::new(Sphere::new(2.5)).with_softness(0.5).with_priority(1);
    commands.spawn((dome, style("dots"), Transform::from_xyz(-7.0, 0.0, 1.0)));
    commands.spawn((StyleVolume::painted(0).with_priority(2), style("cubist")));
    let lantern = StyleVolume::new(Sphere::new(1.5)).with_softness(0.8).with_priority(3);
    commands.spawn((lantern, Lantern, Transform::from_xyz(-4.0, 0.5, 2.0)));
}

fn walk(
    mut lantern: Single<&mut Transform, With<Lantern>>,
    keys: Res<ButtonInput<KeyCode>>,
    time: Res<Time>,
) {
    let axis = |plus, minus| f32::from(i8::from(keys.pressed(plus)) - i8::from(keys.pressed(minus)));
    let step = Vec3::new(
        axis(KeyCode::ArrowRight, KeyCode::ArrowLeft),
        0.0,
        axis(KeyCode::ArrowDown, KeyCode::ArrowUp),
    );
    lantern.translation += 4.0 * time.delta_secs() * step;
}

/// Keeps the map in its corner: a quarter of the window.
fn place_map(mut map: Single<&mut Camera, Without<Eye>>, window: Single<&Window>) {
    let size = window.physical_size() / 4;
    let physical_position = UVec2::new(window.physical_width() - size.x, 0);
    map.viewport = Some(Viewport { physical_position, physical_size: size.max(UVec2::ONE), ..default() });
}

/// The splat under the cursor.
#[derive(Resource, Default)]
struct Aim(Option<SplatHit>);

fn aim(
    mut rays: SplatRayCast,
    mut aim: ResMut<Aim>,
    eye: Single<(&Camera, &GlobalTransform), With<Eye>>,
    window: Single<&Window>,
) {
    // The scene's index for rays is built in the background, long before the first click.
    rays.prepare();
    let (camera, place) = *eye;
    let ray = window.cursor_position().and_then(|cursor| camera.viewport_to_world(place, cursor).ok());
    aim.0 = ray.and_then(|ray| rays.cast_ray(ray));
}

/// Casts a spell where the player clicks, and paints where the right button is held.
fn act(
    mut commands: Commands,
    mut masks: Query<(&mut StyleMask, &GlobalTransform)>,
    mut n_spells: Local<usize>,
    aim: Res<Aim>,
    buttons: Res<ButtonInput<MouseButton>>,
    assets: Res<AssetServer>,
) {
    if buttons.just_released(MouseButton::Right) {
        masks.iter_mut().for_each(|(mut mask, _)| mask.end_stroke());
    }
    let Some(hit) = aim.0 else { return };
    if buttons.just_pressed(MouseButton::Left) {
        let spell = assets.load(format!("styles/{}.style.safetensors", SPELLS[*n_spells % SPELLS.len()]));
        *n_spells += 1;
        let wave = StyleTransition::sphere(hit.position, Duration::from_secs(2)).with_softness(1.0);
        commands.entity(hit.entity).insert((StyleSource::preset(spell), wave));
    }
    if let (true, Ok((mut mask, transform))) =
        (buttons.pressed(MouseButton::Right), masks.get_mut(hit.entity))
    {
        let at = transform.affine().inverse().transform_point3(hit.position);
        mask.stroke_to(&Brush { radius: 0.7, ..default() }, at);
    }
}
