//! Indexes of scenes' Gaussians, by asset.

use std::sync::Arc;

use bevy::prelude::*;
use stylegaussian::raycast::RayIndex;

use crate::{
    scene::{LoadedScene, PerScene},
    work::{Lane, Running, Workers},
};

/// The indexes that rays have asked for.
#[derive(Resource, Default)]
pub(super) struct RayIndexes(PerScene<Running<RayIndex>>);

impl RayIndexes {
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The index of a scene, or `None` while it is built. The first call starts that.
    pub(super) fn get(&mut self, loaded: &LoadedScene, workers: &Workers) -> Option<&RayIndex> {
        let begin = || {
            let scene = Arc::clone(loaded.scene());
            workers.start(Lane::Scenes, move |work| RayIndex::new(&scene, work))
        };
        self.0.get_or_insert_with(loaded, begin).get()?.as_ref().ok()
    }
}

/// Forgets the indexes of scenes that no entity shows.
pub(super) fn forget_unused_indexes(mut indexes: ResMut<RayIndexes>, shown: Query<&LoadedScene>) {
    indexes.bypass_change_detection().0.retain(shown.iter(), |_| true);
}
