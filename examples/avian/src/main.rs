//! Balls fall on a captured scene: boxes of its occupied voxels are a collider of the physics engine avian.
//!
//! ```sh
//! cargo run --release --manifest-path examples/avian/Cargo.toml
//! ```

use avian3d::prelude::*;
use bevy::{core_pipeline::tonemapping::Tonemapping, prelude::*};
use bevy_stylegaussian::{
    prelude::*,
    stylegaussian::collision::{VoxelSettings, Voxels},
};

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets");

/// Radius of a ball, in world units.
const RADIUS: f32 = 0.15;

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin { file_path: ASSETS.into(), ..default() }))
        .add_plugins((StyleGaussianPlugin::default(), PhysicsPlugins::default()))
        .add_systems(Startup, setup)
        .add_systems(Update, (find_solids, drop_balls))
        .run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    commands.spawn((
        Camera3d::default(),
        Tonemapping::None,
        Transform::from_xyz(0.0, 4.5, 11.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    commands.spawn((
        DirectionalLight::default(),
        Transform::default().looking_to(Vec3::new(-1.0, -2.0, -1.0), Vec3::Y),
    ));
    commands.spawn(GaussianSplats(assets.load("demo.sgs")));
}

/// Gives the scene a collider once it is there. Boxes are in its own space, as colliders are.
fn find_solids(
    mut commands: Commands,
    mut ready: MessageReader<GaussianSceneReady>,
    splats: Query<&GaussianSplats>,
    scenes: Res<Assets<GaussianScene>>,
) -> Result {
    for event in ready.read() {
        let Some(scene) = splats.get(event.entity).ok().and_then(|splats| scenes.get(&splats.0)) else {
            continue;
        };
        let voxels = Voxels::new(scene.scene(), &VoxelSettings { size: 0.15, ..default() })?;
        let boxes = voxels.boxes().into_iter().map(|solid| {
            let size = solid.max - solid.min;
            (solid.min + 0.5 * size, Quat::IDENTITY, Collider::cuboid(size.x, size.y, size.z))
        });
        commands.entity(event.entity).insert((RigidBody::Static, Collider::compound(boxes.collect())));
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
