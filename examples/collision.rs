//! Balls fall on a captured scene and bounce off its surfaces: boxes of occupied voxels, as a physics engine
//! would take them.
//!
//! ```sh
//! cargo run --release --example collision
//! cargo run --release --example collision -- FOLDER    # a world: the boxes of its parts come and go with them
//! ```

use std::{env, f32::consts::PI, fs};

use bevy::{
    asset::UnapprovedPathMode,
    core_pipeline::tonemapping::Tonemapping,
    math::bounding::Aabb3d,
    prelude::*,
    tasks::{AsyncComputeTaskPool, Task, futures::check_ready},
};
use bevy_stylegaussian::{
    prelude::*,
    stylegaussian::collision::{CollisionBox, CollisionError, VoxelSettings, Voxels},
    stylegaussian_files::world::FILE,
};

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// The edge of a voxel, in world units.
const VOXEL: f32 = 0.15;

/// The diagonal that a world gets, in world units: about that of the demo scene.
const SIZE: f32 = 12.0;

/// Radius of a ball, in world units, and the share of its speed that a bounce leaves.
const RADIUS: f32 = 0.15;
const BOUNCE: f32 = 0.6;

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin {
            file_path: ASSETS.into(),
            // The folder of a world may lie anywhere.
            unapproved_path_mode: UnapprovedPathMode::Allow,
            ..default()
        }))
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (setup, backdrop::spawn))
        .add_systems(Update, (fit_world, find_solids, take_solids, drop_balls))
        .add_systems(FixedUpdate, fall)
        .run()
}

/// The boxes of a scene or of a part of a world, in world space.
#[derive(Component)]
struct Solids(Vec<Aabb3d>);

/// The boxes of a scene, while a task finds them.
#[derive(Component)]
struct Finding(Task<Result<Vec<Aabb3d>, CollisionError>>);

/// A ball's velocity, in world units per second.
#[derive(Component)]
struct Velocity(Vec3);

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

/// Has boxes of a scene found once it is there. A part of a world is a scene, too: it is there before it is
/// shown, and its boxes go with it when another level takes its place.
fn find_solids(
    mut commands: Commands,
    mut ready: MessageReader<GaussianSceneReady>,
    splats: Query<(&GaussianSplats, &GlobalTransform)>,
    scenes: Res<Assets<GaussianScene>>,
) {
    for event in ready.read() {
        let Ok((splats, place)) = splats.get(event.entity) else { continue };
        let Some(scene) = scenes.get(&splats.0).cloned() else { continue };
        let place = *place;
        let solids = AsyncComputeTaskPool::get().spawn(async move {
            let (scale, rotation, _) = place.to_scale_rotation_translation();
            let solid = |CollisionBox { min, max }| {
                // The only turn is half a turn, after which a box still lies along the axes.
                let half = (rotation * (0.5 * scale * (max - min))).abs();
                Aabb3d::new(place.transform_point(0.5 * (min + max)), half)
            };
            Voxels::new(scene.scene(), &VoxelSettings { size: VOXEL / scale.x, ..default() })
                .map(|voxels| voxels.boxes().into_iter().map(solid).collect::<Vec<_>>())
        });
        commands.entity(event.entity).try_insert(Finding(solids));
    }
}

/// Takes over boxes that were found.
fn take_solids(mut commands: Commands, mut finding: Query<(Entity, &mut Finding)>) -> Result {
    for (entity, mut finding) in &mut finding {
        let Some(solids) = check_ready(&mut finding.0) else { continue };
        commands.entity(entity).try_remove::<Finding>().try_insert(Solids(solids?));
    }
    Ok(())
}

/// Drops the next ball, four times a second.
fn drop_balls(
    mut commands: Commands,
    mut n_balls: Local<u32>,
    time: Res<Time>,
    solids: Query<(), With<Solids>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    if solids.is_empty() || time.elapsed_secs() * 4.0 < *n_balls as f32 || *n_balls > 200 {
        return;
    }
    // Golden angles spread the balls evenly over a disk.
    let (angle, distance) = (2.4 * *n_balls as f32, 0.3 * (*n_balls as f32).sqrt());
    let place = Transform::from_xyz(distance * angle.cos(), 5.0, distance * angle.sin());
    let color = materials.add(Color::hsl(angle.to_degrees() % 360.0, 0.8, 0.5));
    commands.spawn((
        Mesh3d(meshes.add(Sphere::new(RADIUS))),
        MeshMaterial3d(color),
        place,
        Velocity(Vec3::ZERO),
    ));
    *n_balls += 1;
}

fn fall(mut balls: Query<(&mut Transform, &mut Velocity)>, solids: Query<&Solids>, time: Res<Time>) {
    for (mut place, mut velocity) in &mut balls {
        velocity.0.y -= 9.81 * time.delta_secs();
        place.translation += velocity.0 * time.delta_secs();
        for solid in solids.iter().flat_map(|solids| &solids.0) {
            let apart = place.translation - Vec3::from(solid.closest_point(place.translation));
            let Some(out) = apart.try_normalize().filter(|_| apart.length() < RADIUS) else { continue };
            place.translation += (RADIUS - apart.length()) * out;
            let inward = velocity.0.dot(out).min(0.0);
            velocity.0 -= (1.0 + BOUNCE) * inward * out;
        }
    }
}
