//! Values that are computed once for each scene that is shown.

use std::sync::Arc;

use bevy::platform::collections::{HashMap, HashSet};
use stylegaussian::Scene;

use super::attach::LoadedScene;

/// A value for each scene, by the address of its data, which the entry keeps taken. An asset that changes keeps
/// its id and gets new data: both versions have a value while both are shown.
pub(crate) struct PerScene<T>(HashMap<usize, (Arc<Scene>, T)>);

fn address(loaded: &LoadedScene) -> usize {
    Arc::as_ptr(loaded.scene()).addr()
}

impl<T> Default for PerScene<T> {
    fn default() -> Self {
        Self(HashMap::default())
    }
}

impl<T> PerScene<T> {
    /// The value of a scene, made now if there is none.
    pub(crate) fn get_or_insert_with(&mut self, loaded: &LoadedScene, make: impl FnOnce() -> T) -> &mut T {
        let new = || (Arc::clone(loaded.scene()), make());
        &mut self.0.entry(address(loaded)).or_insert_with(new).1
    }

    /// The value of a scene, or `None` if there is none.
    pub(crate) fn get(&self, loaded: &LoadedScene) -> Option<&T> {
        self.0.get(&address(loaded)).map(|(_, value)| value)
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
        let shown: HashSet<usize> = shown.map(address).collect();
        self.0.retain(|scene, (_, value)| shown.contains(scene) && keep(value));
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

#[cfg(test)]
mod tests {
    use bevy::asset::AssetId;

    use super::*;
    use crate::{GaussianScene, tests::world::small_scene};

    fn loaded(seed: u64) -> LoadedScene {
        LoadedScene { id: AssetId::default(), asset: GaussianScene::new(small_scene(4, seed)) }
    }

    #[test]
    fn each_version_of_an_asset_has_its_own_value_while_it_is_shown() {
        // One asset, before and after a change.
        let (old, new) = (loaded(1), loaded(2));
        let mut values = PerScene::default();
        assert_eq!(*values.get_or_insert_with(&old, || 1), 1);
        assert_eq!((values.get(&old), values.get(&new)), (Some(&1), None));
        assert_eq!(*values.get_or_insert_with(&new, || 2), 2);
        // One entity shows the old one until the GPU has the new one, which another shows already.
        for _ in 0..2 {
            values.retain([&old, &new].into_iter(), |_| true);
            assert_eq!(*values.get_or_insert_with(&old, || 3), 1);
            assert_eq!(*values.get_or_insert_with(&new, || 3), 2);
        }
        values.retain([&new, &new].into_iter(), |_| true);
        assert_eq!((values.get(&old), values.get(&new)), (None, Some(&2)));
    }

    #[test]
    fn a_value_keeps_its_scene_until_nothing_shows_it_or_it_is_not_to_be_kept() {
        let (a, b) = (loaded(1), loaded(2));
        let of_a = Arc::downgrade(a.scene());
        let mut values = PerScene::default();
        for (scene, value) in [(&a, 1), (&b, 2)] {
            values.get_or_insert_with(scene, || value);
        }
        // The same data in another asset.
        let copy = LoadedScene { id: AssetId::invalid(), asset: a.asset.clone() };
        drop(a);
        assert_eq!(values.get(&copy), Some(&1));
        drop(copy);
        assert!(of_a.upgrade().is_some(), "another scene could take the address");
        values.retain([&b].into_iter(), |_| true);
        assert!(of_a.upgrade().is_none());
        values.retain([&b].into_iter(), |value| *value == 2);
        assert_eq!(values.get(&b), Some(&2));
        values.retain([&b].into_iter(), |value| *value == 1);
        assert!(values.is_empty());
    }
}
