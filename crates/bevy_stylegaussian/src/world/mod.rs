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
//! A part is an entity with a [`WorldPart`] and a [`GaussianSplats`](crate::GaussianSplats) of its own, below
//! that of the world. So colliders are made as for any scene, in the space of the part's entity, and go with it
//! when another level takes its place. A part arrives before it is shown. If an observer begins then, in a
//! task, the boxes are mostly there before those of the coarser level go. The coarser a level is, the thicker
//! its boxes are. The examples `collision` and `avian` take a world.
//!
//! ```
//! # use bevy::{prelude::*, tasks::{AsyncComputeTaskPool, Task, futures::check_ready}};
//! # use bevy_stylegaussian::{
//! #     prelude::*, stylegaussian::collision::{CollisionBox, CollisionError, VoxelSettings, Voxels},
//! # };
//! #[derive(Component)]
//! struct Finding(Task<Result<Vec<CollisionBox>, CollisionError>>);
//!
//! #[derive(Component)]
//! struct Boxes(Vec<CollisionBox>);
//!
//! fn find_boxes(
//!     arrived: On<Add, WorldPart>,
//!     mut commands: Commands,
//!     parts: Query<&GaussianSplats>,
//!     scenes: Res<Assets<GaussianScene>>,
//! ) {
//!     let Some(scene) = parts.get(arrived.entity).ok().and_then(|part| scenes.get(&part.0)) else { return };
//!     let scene = scene.clone();
//!     let boxes = AsyncComputeTaskPool::get().spawn(async move {
//!         let settings = VoxelSettings { size: 0.2, ..default() };
//!         Voxels::new(scene.scene(), &settings).map(|voxels| voxels.boxes())
//!     });
//!     commands.entity(arrived.entity).try_insert(Finding(boxes));
//! }
//!
//! fn take_boxes(mut commands: Commands, mut finding: Query<(Entity, &mut Finding)>) -> Result {
//!     for (part, mut finding) in &mut finding {
//!         let Some(boxes) = check_ready(&mut finding.0) else { continue };
//!         commands.entity(part).try_remove::<Finding>().try_insert(Boxes(boxes?));
//!     }
//!     Ok(())
//! }
//! # App::new().add_observer(find_boxes).add_systems(Update, take_boxes);
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

#[doc(inline)]
pub use crate::scene::WorldPart;

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
