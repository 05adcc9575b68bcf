//! The component that shows a scene, and the mark of those that are parts of a world.

use bevy::{
    asset::AsAssetId,
    camera::visibility::{VisibilityClass, add_visibility_class},
    prelude::*,
};

use super::asset::GaussianScene;

/// Shows a [`GaussianScene`] at the entity's `Transform`, which may scale and shear it. A scale of 0 along an
/// axis has no inverse, and shows nothing; a small one, such as 0.001, shows the scene flat.
///
/// Captures have the axes and the unit of the program that made them: most stand on their heads, anywhere and
/// in any size. [`FitScene`](super::FitScene) places one upright.
///
/// Splats are depth-tested against opaque meshes and drawn before transparent ones. They have the colors they
/// were captured with; lights do not change them. Any number of entities may share a scene. Splats of
/// overlapping scenes blend in the right order.
#[derive(Component, Clone, Debug, Default, PartialEq, Eq, Reflect)]
#[require(Transform, Visibility, VisibilityClass)]
#[component(on_add = add_visibility_class::<GaussianSplats>)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct GaussianSplats(pub Handle<GaussianScene>);

/// A part of a [`GaussianWorld`](crate::world::GaussianWorld) at one level: beside the [`GaussianSplats`] of an
/// entity that the plugin makes, from its first frame on. It is in the world's space. At first it is hidden,
/// while it is uploaded and painted. It is despawned soon after another level has taken its place.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorldPart {
    /// The entity of the world.
    pub world: Entity,
    /// The number of the part among those of the manifest.
    pub part: usize,
    /// Its level: 0 is the finest.
    pub level: usize,
}

impl AsAssetId for GaussianSplats {
    type Asset = GaussianScene;

    fn as_asset_id(&self) -> AssetId<GaussianScene> {
        self.0.id()
    }
}
