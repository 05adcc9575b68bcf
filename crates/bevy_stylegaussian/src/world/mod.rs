//! Worlds: captures that are larger than a GPU, at levels of detail that are streamed as cameras move.
//!
//! [`GaussianWorld`] shows a [`WorldManifest`] under one [`GaussianBudget`] for all worlds and cameras.
//! [`WorldState`] says what is there of it, and [`GaussianWorldFailed`] which files could not be had.
//!
//! A part of a capture is always shown at one level: the coarser one stays until the finer one can be drawn, in
//! its style if there is one, and fades in over it. Ten times a second, the Gaussians go where they are largest
//! on any screen ([`stylegaussian::cut`]), also where cameras are about to look. What was seen a moment ago
//! stays for a while.
//!
//! # Collision
//!
//! A part that is shown is an entity with a [`GaussianSplats`](crate::GaussianSplats) of its own, below that of
//! the world. So colliders are made as for any scene, in the space of the part's entity, and go with it when
//! another level takes its place. The coarser a level is, the thicker its boxes are. The example `collision`
//! takes a world.
//!
//! ```
//! # use bevy::prelude::*;
//! # use bevy_stylegaussian::{
//! #     prelude::*, stylegaussian::collision::{CollisionBox, VoxelSettings, Voxels},
//! # };
//! #[derive(Component)]
//! struct Boxes(Vec<CollisionBox>);
//!
//! fn make_boxes(
//!     mut commands: Commands,
//!     mut ready: MessageReader<GaussianSceneReady>,
//!     parts: Query<&GaussianSplats>,
//!     scenes: Res<Assets<GaussianScene>>,
//! ) -> Result {
//!     for event in ready.read() {
//!         let scene = parts.get(event.entity).ok().and_then(|part| scenes.get(&part.0));
//!         let Some(scene) = scene else { continue };
//!         let voxels = Voxels::new(scene.scene(), &VoxelSettings { size: 0.2, ..default() })?;
//!         commands.entity(event.entity).try_insert(Boxes(voxels.boxes()));
//!     }
//!     Ok(())
//! }
//! ```

// This is the top room. `plan` follows manifests and chooses levels; `stream` reads chunks, cuts runs out of
// them and swaps them, one child per run (`tree` has the state); `style` gives children what their world has,
// `reference` what they are painted like, and `looks` their parts of baked looks.

use bevy::{
    camera::visibility::{RenderLayers, VisibilitySystems},
    prelude::*,
};

use crate::{
    colors::SplatTint,
    loader::FileLoader,
    splats::{SplatCaster, SplatShadows},
    style::decoder::StyleDecoder,
    systems::StyleGaussianSystems,
};

mod asset;
mod budget;
mod component;
mod failure;
mod looks;
mod plan;
mod reference;
mod stream;
mod style;
mod tree;
mod views;

pub use asset::WorldManifest;
pub use budget::GaussianBudget;
pub use component::{GaussianWorld, GaussianWorldFailed, WorldState};

/// Loads and shows worlds.
pub(crate) struct WorldPlugin;

impl Plugin for WorldPlugin {
    fn build(&self, app: &mut App) {
        app.init_asset::<WorldManifest>()
            .init_asset_loader::<FileLoader<WorldManifest>>()
            .add_message::<GaussianWorldFailed>()
            .register_type::<WorldManifest>()
            .register_type::<GaussianWorld>()
            .register_type::<WorldState>()
            .register_type::<GaussianBudget>()
            .register_type::<GaussianWorldFailed>()
            .add_systems(
                PostUpdate,
                (
                    // Chained, so that what one system spawns is there for the next.
                    plan::drop_removed_worlds,
                    plan::follow_manifests,
                    stream::note_drawable_runs,
                    plan::choose_levels,
                    stream::stream_runs,
                    (
                        style::hand_down::<RenderLayers>,
                        style::hand_down::<SplatTint>,
                        style::hand_down::<SplatShadows>,
                        style::hand_down::<SplatCaster>,
                        style::hand_down::<StyleDecoder>,
                        style::hand_down_transitions,
                    ),
                    reference::make_references,
                    looks::cut_looks,
                    style::style_runs,
                )
                    .chain()
                    // A run that takes the place of another is seen in the frame in which the other goes.
                    .before(StyleGaussianSystems::Scenes)
                    .before(VisibilitySystems::VisibilityPropagate)
                    .before(TransformSystems::Propagate),
            );
    }

    // Not while plugins are built: the renderer is not there yet.
    fn finish(&self, app: &mut App) {
        budget::insert_usual_budget(app);
    }
}
