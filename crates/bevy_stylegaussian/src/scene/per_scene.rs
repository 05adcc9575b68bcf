//! Values that are computed once for each scene that is shown.

use std::sync::Arc;

use bevy::{
    platform::collections::{HashMap, HashSet},
    prelude::*,
};
use stylegaussian::Scene;

use super::{asset::GaussianScene, attach::LoadedScene};

/// A value for each scene, by asset and version: an asset that changes keeps its id and gets new data.
pub(crate) struct PerScene<T>(HashMap<AssetId<GaussianScene>, (Arc<Scene>, T)>);

impl<T> Default for PerScene<T> {
    fn default() -> Self {
        Self(HashMap::default())
    }
}

impl<T> PerScene<T> {
    /// The value of a scene, made now if there is none.
    pub(crate) fn get_or_insert_with(&mut self, loaded: &LoadedScene, make: impl FnOnce() -> T) -> &mut T {
        let scene = loaded.scene();
        // The data that it was made from went.
        if self.0.get(&loaded.id).is_some_and(|(of, _)| !Arc::ptr_eq(of, scene)) {
            self.0.remove(&loaded.id);
        }
        &mut self.0.entry(loaded.id).or_insert_with(|| (Arc::clone(scene), make())).1
    }

    /// The value of a scene, or `None` if there is none.
    pub(crate) fn get(&self, loaded: &LoadedScene) -> Option<&T> {
        let (scene, value) = self.0.get(&loaded.id)?;
        Arc::ptr_eq(scene, loaded.scene()).then_some(value)
    }

    /// Forgets the values of scenes that nothing `shown` is of, and those that are not to be kept.
    pub(crate) fn retain<'a>(
        &mut self,
        shown: impl Iterator<Item = &'a LoadedScene>,
        mut keep: impl FnMut(&mut T) -> bool,
    ) {
        if self.0.is_empty() {
            return;
        }
        let shown: HashSet<*const Scene> = shown.map(|shown| Arc::as_ptr(shown.scene())).collect();
        self.0.retain(|_, (scene, value)| shown.contains(&Arc::as_ptr(scene)) && keep(value));
    }

    /// Whether there is none.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All values.
    #[cfg(test)]
    pub(crate) fn values(&self) -> impl Iterator<Item = &T> {
        self.0.values().map(|(_, value)| value)
    }
}
