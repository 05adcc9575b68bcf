//! Indexes of scenes' Gaussians, by asset.

use std::sync::Arc;

use bevy::{platform::collections::HashMap, prelude::*};
use stylegaussian::{Scene, raycast::RayIndex};

use crate::{
    background::Background,
    scene::{GaussianScene, LoadedScene},
};

/// The indexes that rays have asked for.
#[derive(Resource, Default)]
pub(super) struct RayIndexes(HashMap<AssetId<GaussianScene>, Indexed>);

struct Indexed {
    /// The data that is indexed. An asset that changes keeps its id.
    scene: Arc<Scene>,
    index: Background<RayIndex>,
}

impl RayIndexes {
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The index of a scene, or `None` while it is built. The first call starts that.
    pub(super) fn get(&mut self, loaded: &LoadedScene) -> Option<&RayIndex> {
        let scene = loaded.scene();
        let begin = || {
            let task = Arc::clone(scene);
            let index = Background::spawn(move || RayIndex::new(&task));
            Indexed { scene: Arc::clone(scene), index }
        };
        let indexed = self.0.entry(loaded.id).or_insert_with(begin);
        if !Arc::ptr_eq(&indexed.scene, scene) {
            *indexed = begin();
        }
        indexed.index.poll()
    }
}

/// Forgets the indexes of scenes that no entity shows.
pub(super) fn forget_unused_indexes(mut indexes: ResMut<RayIndexes>, shown: Query<&LoadedScene>) {
    let indexes = &mut indexes.bypass_change_detection().0;
    indexes.retain(|_, indexed| shown.iter().any(|shown| Arc::ptr_eq(shown.scene(), &indexed.scene)));
}
