//! Rays cast at splats by game code, and with the feature `picking` by pointers.
//!
//! [`SplatRayCast`] is the parameter of systems that casts them, and [`SplatHit`] is what it returns.
//! `SplatPickingPlugin` adds Bevy's pointer events.

// An index of a scene's Gaussians is built in the background when the first ray asks for it (`index`), and
// shared by all entities that show the scene. Nothing is built in apps that cast no ray.

use bevy::prelude::*;

mod index;
#[cfg(feature = "picking")]
mod pointer;
mod raycast;

use index::RayIndexes;
#[cfg(feature = "picking")]
pub use pointer::{SplatPickingCamera, SplatPickingPlugin, SplatPickingSettings};
pub use raycast::{SplatHit, SplatRayCast};

/// Keeps the indexes that rays ask for.
pub(crate) struct PickingPlugin;

impl Plugin for PickingPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<RayIndexes>()
            .register_type::<SplatHit>()
            .add_systems(Last, index::forget_unused_indexes.run_if(not(are_empty)));
    }
}

/// Whether there is no index.
fn are_empty(indexes: Res<RayIndexes>) -> bool {
    indexes.is_empty()
}
