//! The component that shows a scene.

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

impl AsAssetId for GaussianSplats {
    type Asset = GaussianScene;

    fn as_asset_id(&self) -> AssetId<GaussianScene> {
        self.0.id()
    }
}
