//! Entities that fade in or out.

use bevy::{
    prelude::*,
    render::{
        Extract,
        sync_world::{MainEntity, MainEntityHashMap},
    },
};

/// The share of an entity's opacities that is left out while it fades, 0..1. Without it, nothing is.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub(crate) struct SplatFade(pub(crate) f32);

/// The shares of all entities that fade.
#[derive(Resource, Default)]
pub(super) struct CloudFades(MainEntityHashMap<f32>);

/// Copies the shares.
pub(super) fn extract_fades(mut fades: ResMut<CloudFades>, all: Extract<Query<(Entity, &SplatFade)>>) {
    fades.0.clear();
    fades.0.extend(all.iter().map(|(entity, fade)| (MainEntity::from(entity), fade.0)));
}

impl CloudFades {
    /// The share of each of these clouds; empty if none of them fades.
    pub(super) fn of(&self, clouds: &[MainEntity]) -> Vec<f32> {
        if !clouds.iter().any(|cloud| self.0.contains_key(cloud)) {
            return Vec::new();
        }
        clouds.iter().map(|cloud| self.share(*cloud)).collect()
    }

    /// The share of a cloud, 0 if it does not fade.
    pub(super) fn share(&self, cloud: MainEntity) -> f32 {
        self.0.get(&cloud).copied().unwrap_or(0.0)
    }
}
