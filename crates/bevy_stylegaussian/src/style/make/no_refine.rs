//! Takes the place of refining in a build without the feature `refine`.

use bevy::prelude::*;

/// Progress of a refinement, of which there is none.
#[derive(Component)]
pub(crate) enum Refinement {}

impl Refinement {
    /// As that of a build with the feature.
    pub(crate) fn progress(&self) -> Option<f32> {
        match *self {}
    }
}
