//! The mask as rays see it.

use std::sync::Arc;

use bevy::prelude::*;
use stylegaussian::{
    Scene,
    mask::{self, CHANNELS, MaskUse},
};

use super::component::{MaskVisibility, StyleMask};

/// The weights by which an entity's splats are hidden from rays, as of the last frame. A copy: game code that
/// casts rays also paints, and a system cannot read a component that it changes.
#[derive(Component)]
pub(crate) struct HiddenFromRays {
    scene: Arc<Scene>,
    weights: Vec<[u8; CHANNELS]>,
    /// The revision of the mask that the weights are from.
    revision: u64,
    channel: usize,
    is: MaskUse,
}

impl HiddenFromRays {
    /// The visibility of each of the scene's Gaussians, or `None` if the mask was of another scene.
    pub(crate) fn of(&self, scene: &Arc<Scene>) -> Option<mask::Visibility<'_>> {
        let Self { weights, channel, is, .. } = self;
        Arc::ptr_eq(&self.scene, scene).then_some(mask::Visibility { weights, channel: *channel, is: *is })
    }
}

/// A mask that hides or crops.
type Hiding = (Entity, &'static StyleMask, &'static MaskVisibility, Option<&'static mut HiddenFromRays>);

/// The paint or its meaning came or changed.
type HidesOtherwise = Or<(Changed<StyleMask>, Changed<MaskVisibility>)>;

/// Copies masks that hide or crop, if they changed.
pub(super) fn hide_from_rays(
    mut commands: Commands,
    mut hiding: Query<Hiding, HidesOtherwise>,
    mut shown: RemovedComponents<MaskVisibility>,
) {
    for entity in shown.read() {
        if let Ok(mut entity) = commands.get_entity(entity) {
            entity.try_remove::<HiddenFromRays>();
        }
    }
    for (entity, mask, visibility, hidden) in &mut hiding {
        let Some(painted) = &mask.weights.painted else {
            commands.entity(entity).try_remove::<HiddenFromRays>();
            continue;
        };
        let (channel, is) = visibility.parts();
        match hidden {
            Some(mut hidden) => {
                (hidden.channel, hidden.is) = (channel, is);
                if hidden.revision != painted.revision {
                    hidden.scene = Arc::clone(&painted.scene);
                    hidden.weights.clone_from(&painted.mask().weights);
                    hidden.revision = painted.revision;
                }
            }
            None => {
                let (scene, weights) = (Arc::clone(&painted.scene), painted.mask().weights.clone());
                let revision = painted.revision;
                commands.entity(entity).try_insert(HiddenFromRays { scene, weights, revision, channel, is });
            }
        }
    }
}
