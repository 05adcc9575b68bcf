//! Balls fall on a captured scene and bounce off its surfaces: boxes of occupied voxels, as a physics engine
//! would take them.
//!
//! ```sh
//! cargo run --release --example collision
//! ```

use bevy::{core_pipeline::tonemapping::Tonemapping, math::bounding::Aabb3d, prelude::*};
use bevy_stylegaussian::{
    prelude::*,
    stylegaussian::collision::{VoxelSettings, Voxels},
};

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// Radius of a ball, in world units, and the share of its speed that a bounce leaves.
const RADIUS: f32 = 0.15;
const BOUNCE: f32 = 0.6;

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin { file_path: ASSETS.into(), ..default() }))
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (setup, backdrop::spawn))
        .add_systems(Update, (find_solids, drop_balls))
        .add_systems(FixedUpdate, fall)
        .run()
}

/// The scene's boxes, in world space.
#[derive(Resource)]
struct Solids(Vec<Aabb3d>);

/// A ball's velocity, in world units per second.
#[derive(Component)]
struct Velocity(Vec3);

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

/// Makes boxes of the scene once it is there. It stands at the world's origin.
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
        let solids =
            voxels.boxes().into_iter().map(|solid| Aabb3d { min: solid.min.into(), max: solid.max.into() });
        commands.insert_resource(Solids(solids.collect()));
    }
    Ok(())
}

/// Drops the next ball, four times a second.
fn drop_balls(
    mut commands: Commands,
    mut n_balls: Local<u32>,
    time: Res<Time>,
    solids: Option<Res<Solids>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    if solids.is_none() || time.elapsed_secs() * 4.0 < *n_balls as f32 || *n_balls > 200 {
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

fn fall(mut balls: Query<(&mut Transform, &mut Velocity)>, solids: Option<Res<Solids>>, time: Res<Time>) {
    let Some(solids) = solids else { return };
    for (mut place, mut velocity) in &mut balls {
        velocity.0.y -= 9.81 * time.delta_secs();
        place.translation += velocity.0 * time.delta_secs();
        for solid in &solids.0 {
            let apart = place.translation - Vec3::from(solid.closest_point(place.translation));
            let Some(out) = apart.try_normalize().filter(|_| apart.length() < RADIUS) else { continue };
            place.translation += (RADIUS - apart.length()) * out;
            let inward = velocity.0.dot(out).min(0.0);
            velocity.0 -= (1.0 + BOUNCE) * inward * out;
        }
    }
}
