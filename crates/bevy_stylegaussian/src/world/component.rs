//! The components of a world, and the event of its failures.

use bevy::prelude::*;

use super::{asset::WorldManifest, tree::Tree};

/// Shows a [`WorldManifest`]: a capture that is larger than a GPU, at levels of detail that follow the cameras.
///
/// It is placed by the entity's `Transform`; in its files, -y is up. Its Gaussians come and go as children of
/// the entity, each with a [`GaussianSplats`](crate::GaussianSplats) of its own: a part of the capture at one
/// level. So rays, picking, volumes, eyes and depth see a world as they see any scene. The children are the
/// plugin's, and a saved game need not have them.
///
/// These components of the entity hold for all of its children, and for those to come: `RenderLayers`,
/// [`SplatTint`](crate::SplatTint), [`SplatShadows`](crate::splats::SplatShadows),
/// [`SplatCaster`](crate::splats::SplatCaster), [`StyleSource`](crate::StyleSource),
/// [`StyleTransition`](crate::StyleTransition) and [`StyleDecoder`](crate::style::decoder::StyleDecoder). A
/// style reaches what is seen first, and of that what is largest on screen. Parts stay as they were until it
/// does. What arrives later is shown once it is painted; until then, the coarser level stays as it was painted.
/// With [`HiddenUntilStyled`](crate::HiddenUntilStyled), the first level of a part waits for its paint as well.
/// Pins are of single scenes, and do not fit a world. A [`WorldMask`](crate::mask::WorldMask) is the mask of a
/// world, and looks fit if each chunk has its own
/// ([`StyleSource::chunk_looks`](crate::StyleSource::chunk_looks)).
///
/// Some Gaussians of the coarsest levels are painted first, as one scene, and all parts are painted like it: in
/// one palette, in strokes of one size and contrast. Its strokes are those of all levels. So they stay where
/// they are while levels change, and go on over the borders of parts. What a finer level has farther than a
/// stroke away from all of that scene gets strokes of its own, at each level and in each part.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::{StyleSource, world::GaussianWorld};
/// # fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
/// commands.spawn((
///     GaussianWorld(assets.load("city/lod-meta.json")),
///     StyleSource::image(assets.load("starry.jpg")),
/// ));
/// # }
/// ```
#[derive(Component, Clone, Debug, Default, PartialEq, Eq, Reflect)]
#[require(Transform, Visibility, WorldState, Tree)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct GaussianWorld(pub Handle<WorldManifest>);

/// Counts of a [`GaussianWorld`], as of the last frame. For reading.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct WorldState {
    /// Parts of the capture, each of which is shown at one level at a time; 0 until the manifest is loaded.
    pub parts: usize,
    /// Parts that are shown at some level.
    pub shown_parts: usize,
    /// Gaussians that are shown.
    pub shown: usize,
    /// Gaussians in memory beside those: levels that take the place of others once they are complete, and
    /// those that fade out.
    pub arriving: usize,
    /// Files that are being read.
    pub loading: usize,
    /// Parts that are to be shown at another level. Parts whose files failed are not counted.
    pub waiting: usize,
    /// Parts that do not show the present [`StyleSource`](crate::StyleSource) yet.
    pub unstyled: usize,
}

impl WorldState {
    /// Whether all parts are as the cameras and the budget ask for, and in their style.
    pub fn is_settled(&self) -> bool {
        self.parts > 0 && self.waiting == 0 && self.unstyled == 0
    }
}

/// Sent if a file of a [`GaussianWorld`] cannot be shown: once for each file. The world stays as it is without
/// it, in coarser levels where there are any, and as captured without a look; the file is not tried again until
/// the manifest is reloaded.
///
/// Written as a message and triggered on the entity for observers.
#[derive(Message, EntityEvent, Clone, Debug, Reflect)]
#[reflect(Clone, Debug)]
pub struct GaussianWorldFailed {
    /// The entity of the world.
    pub entity: Entity,
    /// The file, as a path of an asset.
    pub file: String,
    /// The reason. It names the file, too.
    pub error: String,
}
