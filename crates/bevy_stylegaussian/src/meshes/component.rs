//! The components that a game asks by.

use bevy::prelude::*;

/// Paints a mesh in the strokes of a style: its `Mesh3d` with a `MeshMaterial3d<StandardMaterial>`, and those
/// of all of its descendants, such as the root of a glTF scene. Strokes are sampled by the pixel, as those of
/// splats. Lights, shadows, normal maps and all else of the material stay, and fall on the painted base color.
/// Skinned and morphed meshes are painted at rest, and their strokes move with them. If the component is
/// removed, the meshes are as they were.
///
/// With [`like`](Self::like), a mesh is painted as a capture is, and belongs to it: strokes are as large, and
/// what is red there and here becomes the same. Without, it has a [`StyleSource`](crate::StyleSource) of its
/// own beside this component, and is painted as if it were a scene that fills the picture.
///
/// [`paint`](crate::StyleSource::paint), [`protection`](crate::StyleSource::protection),
/// [`stroke_scale`](crate::StyleSource::stroke_scale), [`strength`](crate::StyleSource::strength) and the
/// amount of [`relief`](crate::StyleSource::relief) are shown at once. Relief is in the game's own lights.
/// Motions, pins, looks, volumes, masks and images that change are of splats alone. A capture that shows a
/// look, or is decoded, paints no mesh.
///
/// Once a mesh is painted, [`StyleApplied`](crate::StyleApplied) is sent for its entity, or
/// [`StyleFailed`](crate::StyleFailed). A mesh must be a list of triangles, and it and its base color texture
/// must be in main memory. It is split until its triangles are smaller than strokes, up to 262,144 of them.
/// Meshes that share mesh, material and style share the result. Others are painted one after another, and each
/// has a material and a texture of seeds of its own; the textures of a painting are there once. The material
/// has two textures more for its fragments than Bevy's own, and is drawn forward. While it is painted, an
/// entity has another mesh and material; games that save their worlds remove this component first.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::{GaussianSplats, StyleSource, StyledMesh};
/// # fn system(
/// #     mut commands: Commands,
/// #     mut meshes: ResMut<Assets<Mesh>>,
/// #     mut materials: ResMut<Assets<StandardMaterial>>,
/// #     assets: Res<AssetServer>,
/// # ) {
/// let style = StyleSource::image(assets.load("starry.jpg"));
/// let garden = commands.spawn((GaussianSplats(assets.load("garden.ply")), style)).id();
/// commands.spawn((
///     Mesh3d(meshes.add(Capsule3d::default())),
///     MeshMaterial3d(materials.add(Color::srgb(0.8, 0.2, 0.1))),
///     StyledMesh::like(garden),
/// ));
/// # }
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyledMesh {
    /// The entity of a painted capture whose style it has, or `None` for a [`StyleSource`](crate::StyleSource)
    /// of its own.
    #[entities]
    pub like: Option<Entity>,
    /// Size of its strokes, as a factor of those of the capture or of the source, 0.01 to 100. For a sky that
    /// is a large sphere, it is the sphere's radius over the usual distance of the camera from the capture.
    pub stroke_scale: f32,
}

impl Default for StyledMesh {
    /// A style of its own.
    fn default() -> Self {
        Self { like: None, stroke_scale: 1.0 }
    }
}

impl StyledMesh {
    /// A mesh in the paint of a capture.
    pub fn like(capture: Entity) -> Self {
        Self { like: Some(capture), ..Self::default() }
    }

    /// The same with this factor of the size of its strokes.
    pub fn with_stroke_scale(self, stroke_scale: f32) -> Self {
        Self { stroke_scale, ..self }
    }

    /// The factor within its range; 1 if it is no number.
    pub(super) fn usual_scale(&self) -> f32 {
        if self.stroke_scale.is_nan() { 1.0 } else { self.stroke_scale.clamp(0.01, 100.0) }
    }
}
