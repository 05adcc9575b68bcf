//! An easel in the garden: paint on its canvas with the mouse, and the garden follows the brush.
//!
//! ```sh
//! cargo run --release --example easel
//! ```
//!
//! The canvas is an image of the game, which the quad on the easel and the style share. It begins with a
//! painting, since strokes find their places in the first picture.

use std::time::Duration;

use bevy::{asset::RenderAssetUsages, core_pipeline::tonemapping::Tonemapping, prelude::*};
use bevy_stylegaussian::prelude::*;

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// The keys of the colors on the palette.
const COLORS: [(KeyCode, [u8; 3]); 5] = [
    (KeyCode::Digit1, [214, 60, 40]),
    (KeyCode::Digit2, [240, 190, 50]),
    (KeyCode::Digit3, [40, 90, 190]),
    (KeyCode::Digit4, [245, 240, 225]),
    (KeyCode::Digit5, [30, 28, 40]),
];

/// Radius of the brush, in pixels of the canvas.
const BRUSH: f32 = 11.0;

/// Width and height of the canvas in the scene.
const CANVAS: Vec2 = Vec2::splat(2.6);

fn main() -> AppExit {
    let title = "Drag on the canvas to paint, 1 to 5 for another color, R for a fresh canvas";
    let window = Window { title: title.into(), ..default() };
    App::new()
        .add_plugins(
            DefaultPlugins
                .set(AssetPlugin { file_path: ASSETS.into(), ..default() })
                .set(WindowPlugin { primary_window: Some(window), ..default() }),
        )
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (setup, backdrop::spawn))
        .add_systems(Update, (begin, choose, paint, refresh))
        .run()
}

/// The painting that the canvas begins with.
#[derive(Resource)]
struct Beginning(Handle<Image>);

/// The canvas on the easel.
#[derive(Component)]
struct Canvas(Handle<Image>);

/// The color on the brush.
#[derive(Resource)]
struct Brush([u8; 3]);

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    commands.spawn((
        Camera3d::default(),
        Tonemapping::None,
        Msaa::Off,
        Transform::from_xyz(0.0, 4.5, 11.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    commands.spawn(GaussianSplats(assets.load("demo.sgs")));
    commands.insert_resource(Beginning(assets.load("styles/strokes.jpg")));
    commands.insert_resource(Brush(COLORS[0].1));
}

/// Sets up the easel and the style once the first painting is loaded.
fn begin(
    mut commands: Commands,
    beginning: Res<Beginning>,
    splats: Single<Entity, (With<GaussianSplats>, Without<StyleSource>)>,
    mut images: ResMut<Assets<Image>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let Some(first) = images.get(&beginning.0) else { return };
    // A copy of its own, in both worlds: the game writes its pixels, and the GPU draws them.
    let canvas = Image { asset_usage: RenderAssetUsages::default(), ..first.clone() };
    let canvas = images.add(canvas);
    commands.entity(*splats).insert((
        StyleSource::image(canvas.clone()),
        StyleLiving { base_colors_every: Duration::from_millis(700) },
    ));
    let mut plain = |color: StandardMaterial| {
        materials.add(StandardMaterial { unlit: true, cull_mode: None, fog_enabled: false, ..color })
    };
    let picture = plain(StandardMaterial { base_color_texture: Some(canvas.clone()), ..default() });
    let wood = plain(StandardMaterial { base_color: Color::srgb(0.36, 0.24, 0.15), ..default() });
    // Beside the camera's view of the garden, turned to the player.
    let place = Transform::from_xyz(-2.7, 2.4, 5.2).looking_to(Vec3::new(-0.2, -0.12, -1.0), Vec3::Y);
    let easel = commands
        .spawn((
            Canvas(canvas),
            Mesh3d(meshes.add(Rectangle::from_size(CANVAS))),
            MeshMaterial3d(picture),
            place,
        ))
        .id();
    let back = meshes.add(Cuboid::new(CANVAS.x + 0.16, CANVAS.y + 0.16, 0.06));
    let leg = meshes.add(Cuboid::new(0.12, 2.6, 0.08));
    let part = |mesh: &Handle<Mesh>, at: Vec3| {
        (Mesh3d(mesh.clone()), MeshMaterial3d(wood.clone()), Transform::from_translation(at), ChildOf(easel))
    };
    commands.spawn(part(&back, Vec3::new(0.0, 0.0, -0.05)));
    for x in [-1.2, 1.2] {
        commands.spawn(part(&leg, Vec3::new(x, -2.2, -0.1)));
    }
}

fn choose(keys: Res<ButtonInput<KeyCode>>, mut brush: ResMut<Brush>) {
    if let Some((_, color)) = COLORS.iter().find(|(key, _)| keys.just_pressed(*key)) {
        brush.0 = *color;
    }
}

/// Paints a line from where the brush was to where the pointer is.
fn paint(
    mut last: Local<Option<Vec2>>,
    canvas: Single<(&Canvas, &GlobalTransform)>,
    camera: Single<(&Camera, &GlobalTransform), With<Camera3d>>,
    window: Single<&Window>,
    buttons: Res<ButtonInput<MouseButton>>,
    brush: Res<Brush>,
    mut images: ResMut<Assets<Image>>,
) {
    let (canvas, easel) = *canvas;
    let (camera, eye) = *camera;
    let cursor = window.cursor_position().filter(|_| buttons.pressed(MouseButton::Left));
    let ray = cursor.and_then(|cursor| camera.viewport_to_world(eye, cursor).ok());
    let at = ray.and_then(|ray| {
        let plane = InfinitePlane3d::new(easel.back());
        let hit = ray.plane_intersection_point(easel.translation(), plane)?;
        let local = easel.affine().inverse().transform_point3(hit).truncate() / CANVAS;
        // From the upper left corner, 0 to 1.
        let at = Vec2::new(local.x + 0.5, 0.5 - local.y);
        (at.cmpge(Vec2::ZERO).all() && at.cmple(Vec2::ONE).all()).then_some(at)
    });
    let Some(at) = at else {
        *last = None;
        return;
    };
    let from = last.replace(at).unwrap_or(at);
    // Only where something is painted: an image that is borrowed mutably counts as changed.
    if let Some(mut image) = images.get_mut(&canvas.0) {
        let size = image.size().as_vec2();
        line(&mut image, from * size, at * size, brush.0);
    }
}

/// Draws a line with a bristly edge.
fn line(image: &mut Image, from: Vec2, to: Vec2, color: [u8; 3]) {
    let size = image.size();
    let Some(data) = &mut image.data else { return };
    let (low, high) = (from.min(to) - BRUSH, from.max(to) + BRUSH);
    let range = |low: f32, high: f32, side: u32| low.max(0.0) as u32..(high.max(0.0) as u32 + 1).min(side);
    for y in range(low.y, high.y, size.y) {
        for x in range(low.x, high.x, size.x) {
            let pixel = Vec2::new(x as f32, y as f32);
            let along = (to - from).normalize_or_zero();
            let nearest = from + along * (pixel - from).dot(along).clamp(0.0, from.distance(to));
            let away = pixel - nearest;
            // Bristles lie beside one another across the stroke.
            let bristle = 0.5 + 0.5 * (1.7 * along.perp_dot(pixel)).sin();
            let share = ((BRUSH - away.length()) / 4.0).clamp(0.0, 1.0) * (0.55 + 0.45 * bristle);
            let place = 4 * (y * size.x + x) as usize;
            if let Some(texel) = data.get_mut(place..place + 3) {
                for (old, new) in texel.iter_mut().zip(color) {
                    *old = (f32::from(*old) + share * (f32::from(new) - f32::from(*old))).round() as u8;
                }
            }
        }
    }
}

/// Puts the first painting back on the canvas.
fn refresh(
    keys: Res<ButtonInput<KeyCode>>,
    canvas: Single<&Canvas>,
    beginning: Res<Beginning>,
    mut images: ResMut<Assets<Image>>,
) {
    if !keys.just_pressed(KeyCode::KeyR) {
        return;
    }
    let first = images.get(&beginning.0).and_then(|first| first.data.clone());
    if let Some(mut image) = images.get_mut(&canvas.0) {
        image.data = first;
    }
}
