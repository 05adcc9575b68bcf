//! Extraction of color wishes: copies changes since the last frame to the render world.

use std::time::Duration;

use bevy::{
    prelude::*,
    render::{
        Extract,
        sync_world::{MainEntity, MainEntityHashMap},
    },
};

use super::{ColorWish, StyleTransition};

/// The wishes of all entities. GPU state is rebuilt from it after a lost device.
#[derive(Resource, Default)]
pub(crate) struct RenderWishes(pub(crate) MainEntityHashMap<RenderWish>);

/// An entity's wish.
#[derive(Default)]
pub(crate) struct RenderWish {
    pub(crate) wish: ColorWish,
    /// Duration of a change of colors.
    pub(crate) fade: Duration,
}

/// A wish and its fade.
type WishParts = (Entity, &'static ColorWish, Option<&'static StyleTransition>);

/// The wish or its fade changed.
type WishChanged = Or<(Changed<ColorWish>, Changed<StyleTransition>)>;

/// Copies wishes that came, changed or went. Marks the resource as changed only then.
pub(super) fn extract_wishes(
    mut wishes: ResMut<RenderWishes>,
    changed: Extract<Query<WishParts, WishChanged>>,
    all: Extract<Query<(), With<ColorWish>>>,
    mut removed: Extract<RemovedComponents<ColorWish>>,
    mut transitions: Extract<RemovedComponents<StyleTransition>>,
) {
    // A component that was removed and put back in the same frame is in `all`, and its entry is overwritten below.
    for entity in removed.read().filter(|&entity| !all.contains(entity)) {
        wishes.0.remove(&MainEntity::from(entity));
    }
    // No `Changed` filter sees a component that is gone.
    for entity in transitions.read() {
        if let Some(wish) = wishes.0.get_mut(&MainEntity::from(entity)) {
            wish.fade = Duration::ZERO;
        }
    }
    for (entity, wish, transition) in &changed {
        let fade = transition.map_or(Duration::ZERO, |transition| transition.duration);
        wishes.0.insert(entity.into(), RenderWish { wish: wish.clone(), fade });
    }
}
