//! A figure for the examples: one mesh on a skeleton of eleven joints, and the walk that moves them.

use bevy::{
    mesh::{
        VertexAttributeValues,
        skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
    },
    prelude::*,
};

/// Joints of the skeleton: the one that each hangs on, its place at rest, and its part in a walk. Parents come
/// first. The figure is 1.8 units tall, stands on the ground and faces +z.
const JOINTS: [(Option<usize>, Vec3, Gait); 11] = [
    (None, Vec3::new(0.0, 0.92, 0.0), Gait::STILL),
    (Some(0), Vec3::new(0.0, 1.15, 0.0), Gait { rest: 0.05, ..Gait::STILL }),
    (Some(1), Vec3::new(0.0, 1.5, 0.0), Gait::STILL),
    (Some(1), Vec3::new(-0.24, 1.4, 0.0), Gait { side: -1.0, swing: -0.5, ..Gait::STILL }),
    (Some(3), Vec3::new(-0.24, 1.1, 0.0), Gait { side: 1.0, rest: -0.35, bend: -0.3, ..Gait::STILL }),
    (Some(1), Vec3::new(0.24, 1.4, 0.0), Gait { side: 1.0, swing: -0.5, ..Gait::STILL }),
    (Some(5), Vec3::new(0.24, 1.1, 0.0), Gait { side: -1.0, rest: -0.35, bend: -0.3, ..Gait::STILL }),
    (Some(0), Vec3::new(-0.11, 0.88, 0.0), Gait { side: -1.0, swing: 0.55, ..Gait::STILL }),
    (Some(7), Vec3::new(-0.11, 0.47, 0.0), Gait { side: -1.0, rest: 0.1, bend: 0.9, ..Gait::STILL }),
    (Some(0), Vec3::new(0.11, 0.88, 0.0), Gait { side: 1.0, swing: 0.55, ..Gait::STILL }),
    (Some(9), Vec3::new(0.11, 0.47, 0.0), Gait { side: 1.0, rest: 0.1, bend: 0.9, ..Gait::STILL }),
];

/// Half of the height over which one joint takes over from the next.
const BEND: f32 = 0.08;

/// The pace of the walk, in radians a second: two steps are a full turn.
const PACE: f32 = 6.0;

/// How a joint turns about its x axis in a walk, in radians.
#[derive(Component, Clone, Copy)]
pub struct Gait {
    /// 1 or -1: the two sides of the body take turns.
    side: f32,
    /// The middle of its turns.
    rest: f32,
    /// How far it swings to and fro.
    swing: f32,
    /// How far it bends while it comes forward.
    bend: f32,
}

impl Gait {
    const STILL: Self = Self { side: 1.0, rest: 0.0, swing: 0.0, bend: 0.0 };
}

/// Mesh and skeleton of a figure, which any number of entities may share.
pub struct Walker {
    mesh: Handle<Mesh>,
    inverse_bindposes: Handle<SkinnedMeshInverseBindposes>,
}

impl Walker {
    /// A figure in a coat and trousers of these colors.
    pub fn new(
        [coat, trousers]: [Color; 2],
        meshes: &mut Assets<Mesh>,
        poses: &mut Assets<SkinnedMeshInverseBindposes>,
    ) -> Self {
        let skin = Color::srgb(0.85, 0.65, 0.5);
        // A body part: its capsule's radius, length and middle, its color, and the joints above and below.
        let trunk = part((0.2, 0.34), Vec3::new(0.0, 1.16, 0.0), coat, [1, 0]);
        let head = part((0.15, 0.06), Vec3::new(0.0, 1.62, 0.0), skin, [2, 2]);
        let limbs = [(-1.0, 0), (1.0, 2)].into_iter().flat_map(|(side, i): (f32, u16)| {
            let arm = part((0.075, 0.52), Vec3::new(0.24 * side, 1.12, 0.0), coat, [3 + i, 4 + i]);
            let leg = part((0.1, 0.68), Vec3::new(0.11 * side, 0.45, 0.0), trousers, [7 + i, 8 + i]);
            [arm, leg]
        });
        let mut mesh = trunk;
        for part in limbs.chain([head]) {
            mesh.merge(&part).expect("all parts have the same attributes");
        }
        // At rest no joint is turned.
        let inverse: Vec<Mat4> = JOINTS.iter().map(|(_, at, _)| Mat4::from_translation(-*at)).collect();
        Self { mesh: meshes.add(mesh), inverse_bindposes: poses.add(inverse) }
    }

    /// Gives an entity the figure, as its children: a joint for each of the skeleton's, and the mesh.
    pub fn spawn(&self, commands: &mut Commands, figure: Entity, material: &Handle<StandardMaterial>) {
        let mut joints: Vec<Entity> = Vec::new();
        for (parent, at, gait) in JOINTS {
            let (above, from) = match parent {
                Some(parent) => (joints[parent], JOINTS[parent].1),
                None => (figure, Vec3::ZERO),
            };
            let place = Transform::from_translation(at - from);
            joints.push(commands.spawn((gait, place, Visibility::default(), ChildOf(above))).id());
        }
        commands.spawn((
            Mesh3d(self.mesh.clone()),
            MeshMaterial3d(material.clone()),
            SkinnedMesh { inverse_bindposes: self.inverse_bindposes.clone(), joints },
            ChildOf(figure),
        ));
    }
}

/// A capsule of a radius and a length around `middle`, with `color`. Its upper half moves with the first joint,
/// its lower half with the second, from the height of the second on.
fn part((radius, length): (f32, f32), middle: Vec3, color: Color, [upper, lower]: [u16; 2]) -> Mesh {
    let mesh = Capsule3d::new(radius, length).mesh().rings(12).longitudes(16).latitudes(10).build();
    let mesh = mesh.translated_by(middle);
    let knee = JOINTS[usize::from(lower)].1.y;
    let positions = mesh.attribute(Mesh::ATTRIBUTE_POSITION).and_then(VertexAttributeValues::as_float3);
    let weight = |at: &[f32; 3]| {
        let above = ((at[1] - knee) / (2.0 * BEND) + 0.5).clamp(0.0, 1.0);
        [above, 1.0 - above, 0.0, 0.0]
    };
    let weights: Vec<[f32; 4]> = positions.into_iter().flatten().map(weight).collect();
    let n = weights.len();
    let joints = VertexAttributeValues::Uint16x4(vec![[upper, lower, 0, 0]; n]);
    mesh.with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, vec![color.to_linear().to_f32_array(); n])
        .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT, weights)
        .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_INDEX, joints)
}

/// A system that moves the joints of all figures.
pub fn swing(mut joints: Query<(&Gait, &mut Transform)>, time: Res<Time>) {
    let (swing, forward) = (PACE * time.elapsed_secs()).sin_cos();
    for (gait, mut place) in &mut joints {
        // A leg comes forward while its angle falls.
        let bend = gait.bend * (-gait.side * forward).max(0.0);
        place.rotation = Quat::from_rotation_x(gait.rest + gait.side * gait.swing * swing + bend);
    }
}
