//! Balls fall on a captured scene: boxes of its occupied voxels are a collider of the physics engine avian.
//!
//! ```sh
//! cargo run --release --manifest-path examples/avian/Cargo.toml
//! cargo run --release --manifest-path examples/avian/Cargo.toml -- FOLDER    # a world
//! ```

use std::{env, f32::consts::PI, fs};

use avian3d::prelude::*;
use bevy::{
    asset::UnapprovedPathMode,
    core_pipeline::tonemapping::Tonemapping,
    prelude::*,
    tasks::{AsyncComputeTaskPool, Task, futures::check_ready},
};
use bevy_stylegaussian::{
    prelude::*,
    stylegaussian::collision::{CollisionBox, CollisionError, VoxelSettings, Voxels},
    stylegaussian_files::world::FILE,
};

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets");

/// The edge of a voxel, in world units.
const VOXEL: f32 = 0.15;

/// The diagonal that a world gets, in world units: about that of the demo scene.
const SIZE: f32 = 12.0;

/// Radius of a ball, in world units.
const RADIUS: f32 = 0.15;

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin {
            file_path: ASSETS.into(),
            // The folder of a world may lie anywhere.
            unapproved_path_mode: UnapprovedPathMode::Allow,
            ..default()
        }))
        .add_plugins((StyleGaussianPlugin::default(), PhysicsPlugins::default()))
        .add_systems(Startup, setup)
        .add_systems(Update, (fit_world, find_solids, take_solids, drop_balls))
        .run()
}

/// A collider, while a task makes it.
#[derive(Component)]
struct Finding(Task<Result<Collider, CollisionError>>);

fn setup(mut commands: Commands, assets: Res<AssetServer>) -> Result {
    commands.spawn((
        Camera3d::default(),
        Tonemapping::None,
        Transform::from_xyz(0.0, 4.5, 11.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    commands.spawn((
        DirectionalLight::default(),
        Transform::default().looking_to(Vec3::new(-1.0, -2.0, -1.0), Vec3::Y),
    ));
    match env::args().nth(1) {
        Some(folder) => {
            let manifest = fs::canonicalize(folder)?.join(FILE);
            commands.spawn(GaussianWorld(assets.load(manifest)));
        }
        None => {
            commands.spawn(GaussianSplats(assets.load("demo.sgs")));
        }
    }
    Ok(())
}

/// Places a world in the middle and upright: captures have any unit, and most have y down.
fn fit_world(
    mut worlds: Query<(&GaussianWorld, &mut Transform)>,
    manifests: Res<Assets<WorldManifest>>,
    mut is_placed: Local<bool>,
) {
    for (world, mut place) in &mut worlds {
        let bounds = manifests.get(&world.0).and_then(WorldManifest::bounds);
        let Some([min, max]) = bounds.filter(|_| !*is_placed) else { continue };
        let (scale, rotation) = (SIZE / (max - min).length(), Quat::from_rotation_x(PI));
        let translation = -(rotation * (0.5 * scale * (min + max)));
        *place = Transform { translation, rotation, scale: Vec3::splat(scale) };
        *is_placed = true;
    }
}

/// Has a collider made for a scene once it is there, or for a part of a world, which is there before it is
/// shown. Boxes are in its own space, as colliders are.
fn find_solids(
    mut commands: Commands,
    mut ready: MessageReader<GaussianSceneReady>,
    splats: Query<(&GaussianSplats, &GlobalTransform)>,
    scenes: Res<Assets<GaussianScene>>,
) {
    for event in ready.read() {
        let Ok((splats, place)) = splats.get(event.entity) else { continue };
        let Some(scene) = scenes.get(&splats.0).cloned() else { continue };
        let settings = VoxelSettings { size: VOXEL / place.scale().x, ..default() };
        let collider = AsyncComputeTaskPool::get().spawn(async move {
            let collider = |solid: CollisionBox| {
                let size = solid.max - solid.min;
                (solid.min + 0.5 * size, Quat::IDENTITY, Collider::cuboid(size.x, size.y, size.z))
            };
            Voxels::new(scene.scene(), &settings)
                .map(|voxels| Collider::compound(voxels.boxes().into_iter().map(collider).collect()))
        });
        commands.entity(event.entity).try_insert(Finding(collider));
    }
}

/// Takes over colliders that are made. That of a part of a world goes with it when another level takes its
/// place.
fn take_solids(mut commands: Commands, mut finding: Query<(Entity, &mut Finding)>) -> Result {
    for (entity, mut finding) in &mut finding {
        let Some(collider) = check_ready(&mut finding.0) else { continue };
        commands.entity(entity).try_remove::<Finding>().try_insert((RigidBody::Static, collider?));
    }
    Ok(())
}

/// Drops the next ball, four times a second.
fn drop_balls(
    mut commands: Commands,
    mut n_balls: Local<u32>,
    time: Res<Time>,
    solids: Query<(), (With<GaussianSplats>, With<Collider>)>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    if solids.is_empty() || time.elapsed_secs() * 4.0 < *n_balls as f32 || *n_balls > 200 {
        return;
    }
    // Golden angles spread the balls evenly over a disk.
    let (angle, distance) = (2.4 * *n_balls as f32, 0.3 * (*n_balls as f32).sqrt());
    commands.spawn((
        Mesh3d(meshes.add(Sphere::new(RADIUS))),
        MeshMaterial3d(materials.add(Color::hsl(angle.to_degrees() % 360.0, 0.8, 0.5))),
        Transform::from_xyz(distance * angle.cos(), 5.0, distance * angle.sin()),
        RigidBody::Dynamic,
        Collider::sphere(RADIUS),
        Restitution::new(0.6),
    ));
    *n_balls += 1;
}
