//! Pointer events on splats, as on meshes: a needle shows the surface under the pointer, and a click drives it
//! in.
//!
//! ```sh
//! cargo run --release --example picking
//! ```

use bevy::{core_pipeline::tonemapping::Tonemapping, prelude::*};
use bevy_stylegaussian::prelude::*;

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

fn main() -> AppExit {
    let window = Window { title: "Click on the scene".into(), ..default() };
    App::new()
        .add_plugins(
            DefaultPlugins
                .set(AssetPlugin { file_path: ASSETS.into(), ..default() })
                .set(WindowPlugin { primary_window: Some(window), ..default() }),
        )
        .add_plugins((StyleGaussianPlugin::default(), SplatPickingPlugin))
        .add_systems(Startup, (setup, backdrop::spawn))
        .run()
}

/// The needle that follows the pointer.
#[derive(Component)]
struct Needle;

fn setup(
    mut commands: Commands,
    assets: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    commands.spawn((
        Camera3d::default(),
        Tonemapping::None,
        Transform::from_xyz(0.0, 4.5, 11.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    let red =
        materials.add(StandardMaterial { base_color: Color::srgb(0.9, 0.1, 0.1), unlit: true, ..default() });
    let mesh = meshes.add(Cone::new(0.08, 0.8));
    commands.spawn((Needle, Mesh3d(mesh), MeshMaterial3d(red), Visibility::Hidden));
    commands.spawn(GaussianSplats(assets.load("demo.sgs"))).observe(follow).observe(hide).observe(drive_in);
}

/// A needle's place: its point at the hit, and it along the normal.
fn on_surface(hit: &bevy::picking::backend::HitData) -> Option<Transform> {
    let (position, normal) = (hit.position?, hit.normal?);
    // A cone points along +y, and into the surface here.
    let rotation = Quat::from_rotation_arc(Vec3::Y, -normal);
    Some(Transform::from_translation(position + 0.4 * normal).with_rotation(rotation))
}

fn follow(pointer: On<Pointer<Move>>, mut needle: Single<(&mut Transform, &mut Visibility), With<Needle>>) {
    if let Some(place) = on_surface(&pointer.hit) {
        *needle.0 = place;
        *needle.1 = Visibility::Visible;
    }
}

fn hide(_: On<Pointer<Out>>, mut needle: Single<&mut Visibility, With<Needle>>) {
    **needle = Visibility::Hidden;
}

fn drive_in(
    click: On<Pointer<Click>>,
    mut commands: Commands,
    needle: Single<(&Mesh3d, &MeshMaterial3d<StandardMaterial>), With<Needle>>,
) {
    let Some(place) = on_surface(&click.hit) else { return };
    commands.spawn((needle.0.clone(), needle.1.clone(), place));
    if let Some(hit) = click.hit.extra_as::<SplatHit>() {
        info!("Gaussian {} of the file, at {}", hit.source_gaussian, hit.position);
    }
}
