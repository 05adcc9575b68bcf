//! Styles whose images change while they are shown.

use std::time::Duration;

use bevy::prelude::*;

/// Lets the strokes of an entity's [`StyleSource`](crate::StyleSource) follow its images while these change:
/// the frames of a video, a camera, a canvas that the player paints on, or a texture that the GPU draws.
/// Without it, an image that changes is a new painting, which is laid on anew in the background.
///
/// Strokes stay where they are, each at its place in the image. Their detail is that of the image in each
/// frame. The colors below them follow at an interval, faded, and are computed in the background.
///
/// A texture that the GPU may write ([`TextureUsages`](bevy::render::render_resource::TextureUsages) for
/// rendering or storage) counts as changed in each frame. Pixels that are on the GPU alone are copied to main
/// memory for the colors; no frame waits for them. Such a texture is first painted with once it shows more than
/// one color.
///
/// Transparent parts of an image that is followed count as white. A part of an image
/// ([`crop`](crate::style::WeightedStyle::crop)) is not followed: each change is a new painting. Strokes in the
/// colors of a [`palette`](crate::StyleSource::palette) are laid on anew at the interval, and a palette that is
/// such an image stays that of its first picture.
///
/// An image lives for all entities that show it if it does for one of them. If it shrinks to less than 8 pixels
/// on a side, gets a format that shaders cannot read as colors, or goes away, its last picture stays, and
/// [`StyleFailed`](crate::StyleFailed) says why, once.
///
/// No event is sent when colors follow. [`AppliedStyle`](crate::AppliedStyle) holds the latest of them. Colors
/// that `StyleRefine` baked stay as they are, and those of the decoder are decoded anew for each change.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::{GaussianSplats, StyleSource, style::StyleLiving};
/// # fn system(mut commands: Commands, assets: Res<AssetServer>, canvas: Handle<Image>) {
/// commands.spawn((
///     GaussianSplats(assets.load("garden.ply")),
///     StyleSource::image(canvas),
///     StyleLiving::default(),
/// ));
/// # }
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleLiving {
    /// Time from one change of the colors below the strokes to the next, at least. A second by default.
    pub base_colors_every: Duration,
}

impl Default for StyleLiving {
    fn default() -> Self {
        Self { base_colors_every: Duration::from_secs(1) }
    }
}
