//! Masks on the GPU.

use bevy::{
    prelude::*,
    render::{
        Extract,
        renderer::{RenderDevice, RenderQueue},
        sync_world::{MainEntity, MainEntityHashMap},
    },
};
use stylegaussian_gpu::{mask::GaussianMask, splat::CloudVisibility};

use super::component::{MaskVisibility, Painted, StyleMask};

/// The masks of all entities that have one. It counts as changed if weights did.
#[derive(Resource, Default)]
pub(crate) struct RenderMasks(MainEntityHashMap<RenderMask>);

/// The mask of an entity.
struct RenderMask {
    /// The weights, or `None` if the device cannot take so many.
    gpu: Option<GaussianMask>,
    revision: u64,
    visibility: Option<MaskVisibility>,
}

impl RenderMasks {
    /// Whether no entity has a mask.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The mask of an entity of `n` Gaussians, and a number that every change of its weights changes; `None` if
    /// it has no mask that is ready.
    pub(crate) fn get(&self, entity: MainEntity, n: usize) -> Option<(&GaussianMask, u64)> {
        let mask = self.0.get(&entity)?;
        // Of another scene if the new one is not on the GPU yet.
        let gpu = mask.gpu.as_ref().filter(|gpu| gpu.n_gaussians() == n)?;
        Some((gpu, mask.revision))
    }

    /// The mask by which an entity of `n` Gaussians is hidden, or `None` if all of it is drawn.
    pub(crate) fn visibility(&self, entity: MainEntity, n: usize) -> Option<CloudVisibility<'_>> {
        let mask = self.0.get(&entity)?;
        let (channel, is) = mask.visibility?.parts();
        let gpu = mask.gpu.as_ref().filter(|gpu| gpu.n_gaussians() == n)?;
        Some(CloudVisibility { mask: gpu, channel, is })
    }
}

/// Uploads the weights that changed since the last frame, and drops the masks of entities that lost theirs.
///
/// Upload happens here and not later, since the weights would have to be copied otherwise.
pub(super) fn extract_masks(
    mut masks: ResMut<RenderMasks>,
    all: Extract<Query<(Entity, &StyleMask, Option<&MaskVisibility>)>>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let mut is_changed = false;
    // Mixing layers again because a mask was borrowed mutably would cost more than the mask.
    let of_entity = &mut masks.bypass_change_detection().0;
    of_entity.retain(|entity, _| {
        let stays = all.get(entity.id()).is_ok_and(|(_, mask, _)| mask.weights.painted.is_some());
        is_changed |= !stays;
        stays
    });
    for (entity, mask, visibility) in &all {
        let Some(painted) = &mask.weights.painted else { continue };
        let visibility = visibility.copied();
        match of_entity.get_mut(&MainEntity::from(entity)) {
            Some(known) if known.is_of(painted) => {
                known.visibility = visibility;
                is_changed |= known.update(painted, &queue);
            }
            _ => {
                let (gpu, revision) = (create(painted, &device, &queue), painted.revision);
                of_entity.insert(entity.into(), RenderMask { gpu, revision, visibility });
                is_changed = true;
            }
        }
    }
    if is_changed {
        masks.set_changed();
    }
}

impl RenderMask {
    /// Whether the weights can be brought up to date: as many, or refused before.
    fn is_of(&self, painted: &Painted) -> bool {
        match &self.gpu {
            Some(gpu) => gpu.n_gaussians() == painted.mask().len(),
            None => self.revision == painted.revision,
        }
    }

    /// Uploads the changes since the last time, and returns whether there were any.
    fn update(&mut self, painted: &Painted, queue: &RenderQueue) -> bool {
        let revision = std::mem::replace(&mut self.revision, painted.revision);
        let Some(gpu) = self.gpu.as_ref().filter(|_| revision != painted.revision) else { return false };
        let weights = &painted.mask().weights;
        match painted.changes_since(revision) {
            Some(ranges) => {
                for range in ranges {
                    gpu.write_range(queue, range.start, &weights[range.clone()]);
                }
            }
            None => gpu.write(queue, weights),
        }
        true
    }
}

fn create(painted: &Painted, device: &RenderDevice, queue: &RenderQueue) -> Option<GaussianMask> {
    let created = GaussianMask::new(device.wgpu_device(), queue, &painted.mask().weights);
    // A scene of so many Gaussians is refused as well, and that is reported.
    created.inspect_err(|error| error!("a mask cannot be used on this GPU: {error}")).ok()
}
