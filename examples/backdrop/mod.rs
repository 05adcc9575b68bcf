//! A sky for the examples: a large sphere with a vertical color gradient.

use bevy::{
    camera::visibility::NoFrustumCulling, light::NotShadowCaster, mesh::VertexAttributeValues, prelude::*,
};

/// Radius of the sphere in scene units, larger than everything in the examples.
pub const RADIUS: f32 = 400.0;

/// sRGB colors by height on the unit sphere, from -1 (down) to 1 (up).
const FADE: [(f32, Vec3); 5] = [
    (-1.0, Vec3::new(0.17, 0.23, 0.34)),
    (-0.55, Vec3::new(0.29, 0.39, 0.52)),
    (0.0, Vec3::new(0.71, 0.79, 0.85)),
    (0.12, Vec3::new(0.86, 0.88, 0.87)),
    (1.0, Vec3::new(0.36, 0.55, 0.78)),
];

/// A startup system that spawns the sky. A camera with `Tonemapping::None` shows exactly these colors.
pub fn spawn(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let mut mesh = Sphere::new(RADIUS).mesh().uv(32, 96);
    let positions = mesh.attribute(Mesh::ATTRIBUTE_POSITION).and_then(VertexAttributeValues::as_float3);
    let colors: Vec<_> = positions.into_iter().flatten().map(|p| color_at(p[1] / RADIUS)).collect();
    mesh.insert_attribute(Mesh::ATTRIBUTE_COLOR, colors);
    // Seen from inside, so back faces must not be culled.
    let material = StandardMaterial { unlit: true, fog_enabled: false, cull_mode: None, ..default() };
    let (mesh, material) = (Mesh3d(meshes.add(mesh)), MeshMaterial3d(materials.add(material)));
    // Suns shine from outside of it, and its shadow would fall on everything.
    commands.spawn((mesh, material, NoFrustumCulling, NotShadowCaster));
}

/// The linear color at a height on the unit sphere.
fn color_at(height: f32) -> [f32; 4] {
    let above = FADE.iter().position(|&(stop, _)| height < stop).unwrap_or(FADE.len() - 1).max(1);
    let ((low, from), (high, to)) = (FADE[above - 1], FADE[above]);
    let color = from.lerp(to, ((height - low) / (high - low)).clamp(0.0, 1.0));
    Color::srgb(color.x, color.y, color.z).to_linear().to_f32_array()
}
