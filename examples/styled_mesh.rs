//! Meshes in the same paint as a capture: skinned figures walk on the path of a painted garden, and the sky
//! above it is painted too. The figures are painted at rest, and strokes stay on them while they move.
//!
//! ```sh
//! cargo run --release --example styled_mesh
//! ```
//!
//! Space shows the meshes as they are.

use bevy::{mesh::skinning::SkinnedMeshInverseBindposes, prelude::*};
use bevy_stylegaussian::prelude::*;

#[path = "backdrop/mod.rs"]
mod backdrop;
#[path = "walker/mod.rs"]
mod walker;

use walker::Walker;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// Radius of the sky over the camera's distance from the garden: its strokes are as large on screen.
const SKY: f32 = 400.0 / 8.0;

/// The garden's path, x and z.
const PATH: [Vec2; 8] = [
    Vec2::new(-0.78, 0.68),
    Vec2::new(0.1, 0.45),
    Vec2::new(1.1, 0.25),
    Vec2::new(2.0, 0.4),
    Vec2::new(2.42, 0.95),
    Vec2::new(2.5, 2.1),
    Vec2::new(2.25, 2.6),
    Vec2::new(1.75, 3.0),
];

/// A height between the path and the crowns of trees.
const ABOVE_PATH: f32 = 0.9;

/// The garden, whose paint the meshes share.
#[derive(Resource)]
struct Garden(Entity);

/// A figure that walks to and fro, and its start, in ways there and back.
#[derive(Component)]
struct Figure(f32);

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin { file_path: ASSETS.into(), ..default() }))
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (spawn_garden, spawn_figures, backdrop::spawn).chain())
        .add_systems(Update, (paint_sky, walk, walker::swing, switch))
        .run()
}

fn spawn_garden(mut commands: Commands, assets: Res<AssetServer>) {
    let view = Transform::from_xyz(1.2, 2.6, 7.4).looking_at(Vec3::new(0.7, 0.0, 0.5), Vec3::Y);
    commands.spawn((Camera3d::default(), AmbientLight { brightness: 600.0, ..default() }, view));
    commands.spawn((
        DirectionalLight { illuminance: 7_000.0, ..default() },
        Transform::from_xyz(4.0, 8.0, 6.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    let style = StyleSource::preset(assets.load("styles/strokes.style.safetensors"));
    let garden = commands.spawn((GaussianSplats(assets.load("demo.sgs")), style, HiddenUntilStyled)).id();
    commands.insert_resource(Garden(garden));
}

fn spawn_figures(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut poses: ResMut<Assets<SkinnedMeshInverseBindposes>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    garden: Res<Garden>,
) {
    // Colors are the meshes' own.
    let material = materials.add(Color::WHITE);
    for (i, coat) in [(0.8, 0.2, 0.15), (0.2, 0.35, 0.75), (0.9, 0.7, 0.2)].into_iter().enumerate() {
        let colors = [Color::srgb(coat.0, coat.1, coat.2), Color::srgb(0.25, 0.22, 0.3)];
        let walker = Walker::new(colors, &mut meshes, &mut poses);
        let place = (Transform::from_scale(Vec3::splat(0.38)), Visibility::default());
        let figure = commands.spawn((Figure(i as f32 / 3.0), StyledMesh::like(garden.0), place)).id();
        walker.spawn(&mut commands, figure, &material);
    }
}

/// Paints the sky, which is the only mesh of no figure.
fn paint_sky(
    mut commands: Commands,
    skies: Query<Entity, (Added<Mesh3d>, Without<ChildOf>)>,
    garden: Res<Garden>,
) {
    for sky in &skies {
        commands.entity(sky).insert(StyledMesh::like(garden.0).with_stroke_scale(SKY));
    }
}

fn walk(mut figures: Query<(&Figure, &mut Transform)>, mut rays: SplatRayCast, time: Res<Time>) {
    rays.prepare();
    for (Figure(start), mut place) in &mut figures {
        let round = (start + 0.02 * time.elapsed_secs()).fract();
        let way = (1.0 - (2.0 * round - 1.0).abs()) * (PATH.len() - 1) as f32;
        let from = (way as usize).min(PATH.len() - 2);
        let (a, b) = (PATH[from], PATH[from + 1]);
        let at = a.lerp(b, way - from as f32);
        let ahead = if round < 0.5 { b - a } else { a - b };
        (place.translation.x, place.translation.z) = (at.x, at.y);
        place.rotation = Quat::from_rotation_y(ahead.x.atan2(ahead.y));
        // On the ground, as far as splats are one.
        let above = Vec3::new(at.x, ABOVE_PATH, at.y);
        if let Some(hit) = rays.cast_ray(Ray3d::new(above, Dir3::NEG_Y)) {
            place.translation.y = hit.position.y;
        }
    }
}

/// Takes the paint off, or puts it on again.
fn switch(
    mut commands: Commands,
    figures: Query<(Entity, Has<StyledMesh>), With<Figure>>,
    keys: Res<ButtonInput<KeyCode>>,
    garden: Res<Garden>,
) {
    if !keys.just_pressed(KeyCode::Space) {
        return;
    }
    for (figure, is_painted) in &figures {
        if is_painted {
            commands.entity(figure).remove::<StyledMesh>();
        } else {
            commands.entity(figure).insert(StyledMesh::like(garden.0));
        }
    }
}
