//! Masks on the GPU.

use bevy::{
    platform::collections::HashSet,
    prelude::*,
    render::{
        Extract,
        renderer::{RenderDevice, RenderQueue},
        sync_world::{MainEntity, MainEntityHashMap},
    },
};
use stylegaussian_gpu::{mask::GaussianMask, splat::CloudVisibility};

use super::{
    StyleMask,
    component::{MaskVisibility, Painted},
};

/// The masks of all entities that have one.
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
    /// The mask of an entity, or `None` if it has none that is ready. Its [`version`](GaussianMask::version) tells of changes;
    /// another mask of the entity is another buffer.
    // Drawing needs no more than `visibility`; mixing layers is what this is for.
    #[cfg_attr(not(test), expect(dead_code, reason = "for the mix of layers"))]
    pub(crate) fn get(&self, entity: MainEntity) -> Option<&GaussianMask> {
        self.0.get(&entity)?.gpu.as_ref()
    }

    /// The mask by which an entity of `n` Gaussians is hidden, or `None` if all of it is drawn.
    pub(crate) fn visibility(&self, entity: MainEntity, n: usize) -> Option<CloudVisibility<'_>> {
        let RenderMask { gpu, visibility, .. } = self.0.get(&entity)?;
        let ((channel, is), mask) = (visibility.as_ref()?.parts(), gpu.as_ref()?);
        // Of another scene if the new one is not on the GPU yet.
        (mask.n_gaussians() == n).then_some(CloudVisibility { mask, channel, is })
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
    if masks.0.is_empty() && all.is_empty() {
        return;
    }
    let masks = &mut masks.0;
    let mut present = HashSet::new();
    for (entity, mask, visibility) in &all {
        let (entity, Some(painted)) = (MainEntity::from(entity), &mask.painted) else { continue };
        present.insert(entity);
        let former = masks.remove(&entity);
        let gpu = match former {
            Some(former) if former.is_of(painted) => {
                if let Some(gpu) = &former.gpu {
                    update(gpu, former.revision, painted, &queue);
                }
                former.gpu
            }
            _ => create(painted, &device, &queue),
        };
        masks.insert(entity, RenderMask { gpu, revision: painted.revision, visibility: visibility.copied() });
    }
    masks.retain(|entity, _| present.contains(entity));
}

impl RenderMask {
    /// Whether the weights can be brought up to date: as many, or refused before.
    fn is_of(&self, painted: &Painted) -> bool {
        match &self.gpu {
            Some(gpu) => gpu.n_gaussians() == painted.mask().len(),
            None => self.revision == painted.revision,
        }
    }
}

fn create(painted: &Painted, device: &RenderDevice, queue: &RenderQueue) -> Option<GaussianMask> {
    let created = GaussianMask::new(device.wgpu_device(), queue, &painted.mask().weights);
    // A scene of so many Gaussians is refused as well, and that is reported.
    created.inspect_err(|error| error!("a mask cannot be used on this GPU: {error}")).ok()
}

/// Uploads what changed since `revision`.
fn update(gpu: &GaussianMask, revision: u64, painted: &Painted, queue: &RenderQueue) {
    if revision == painted.revision {
        return;
    }
    let weights = &painted.mask().weights;
    match painted.changes_since(revision) {
        Some(ranges) => {
            for range in ranges {
                gpu.write_range(queue, range.start, &weights[range.clone()]);
            }
        }
        None => gpu.write(queue, weights),
    }
}
