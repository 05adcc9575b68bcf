//! The components of masks.

use std::{
    collections::VecDeque,
    ops::Range,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use bevy::prelude::*;
use stylegaussian::{
    Mask, Scene, StoredMask,
    mask::{Brush, Combine, Edit, History, MaskUse, Selection, Stroke},
};

use super::{asset::SavedMask, weights::Weights};

/// Changes that are remembered for the upload. Between two frames there is one for each call of a method; the
/// GPU gets the whole mask if there were more.
const MOST_CHANGES: usize = 64;

/// Unpainted Gaussians between two painted ones that are uploaded with them, since each upload costs as much as
/// a few hundred weights; and the most uploads of one change.
const UPLOAD_GAP: usize = 256;
const MOST_UPLOADS: usize = 32;

/// Weights painted on the Gaussians of an entity's [`GaussianSplats`](crate::GaussianSplats), in four channels
/// of 8 bits.
///
/// Positions are in the space of the scene: the inverse of the entity's `GlobalTransform` leads there. A mask
/// is ready when the scene is; until then, painting does nothing and returns false. It begins as the scene's
/// own mask, if its `.sgs` carries one, as a [saved](Self::saved) one, or unpainted. If the entity shows other
/// Gaussians, it begins anew. To begin anew with another file, insert another component.
///
/// [`MaskVisibility`] hides painted splats or crops to them. Of a world, [`WorldMask`](super::WorldMask) is the
/// mask.
///
/// If a world is saved by reflection, the weights are part of it, compressed; steps that can be undone are not.
/// That takes as long as [`to_stored`](Self::to_stored). In the loaded world the mask is ready a moment after
/// its scene.
#[derive(Component, Clone, Default, Reflect)]
#[reflect(Component, Default, Clone)]
pub struct StyleMask {
    /// The file that the mask begins as.
    pub(super) saved: Option<Handle<SavedMask>>,
    pub(super) weights: Weights,
}

/// A mask that fits a scene.
#[derive(Clone)]
pub(super) struct Painted {
    pub(super) scene: Arc<Scene>,
    mask: Mask,
    history: History,
    /// The stroke that is not finished yet.
    stroke: Option<Stroke>,
    /// A number that no other state of any mask has.
    pub(super) revision: u64,
    /// The last changes, oldest first: the revision before each, and the weights that it changed.
    changes: VecDeque<(u64, Vec<Range<usize>>)>,
}

/// A number that was not returned before.
pub(super) fn next_revision() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    // Only compared for equality.
    NEXT.fetch_add(1, Ordering::Relaxed)
}

impl Painted {
    pub(super) fn new(scene: Arc<Scene>, mask: Mask) -> Self {
        Self {
            scene,
            mask,
            history: History::default(),
            stroke: None,
            revision: next_revision(),
            changes: VecDeque::new(),
        }
    }

    pub(super) fn mask(&self) -> &Mask {
        &self.mask
    }

    /// The weights in the order of the scene's source.
    pub(super) fn to_stored(&self) -> StoredMask {
        StoredMask::new(&self.scene, &self.mask)
    }

    /// The weights that changed since `revision`, or `None` if these changes were forgotten.
    pub(super) fn changes_since(&self, revision: u64) -> Option<impl Iterator<Item = &Range<usize>>> {
        let first = self.changes.iter().position(|(before, _)| *before == revision)?;
        Some(self.changes.range(first..).flat_map(|(_, ranges)| ranges))
    }

    /// Remembers that the weights in `ranges` have changed.
    fn note(&mut self, ranges: Vec<Range<usize>>) {
        if ranges.is_empty() {
            return;
        }
        self.changes.push_back((std::mem::replace(&mut self.revision, next_revision()), ranges));
        if self.changes.len() > MOST_CHANGES {
            self.changes.pop_front();
        }
    }

    fn finish_stroke(&mut self) {
        if let Some(stroke) = self.stroke.take() {
            self.history.push(stroke.finish());
        }
    }

    /// Makes a change that can be undone.
    fn edit(&mut self, change: impl FnOnce(&mut Mask, &[Vec3]) -> Edit) {
        self.finish_stroke();
        let edit = self.change(change);
        self.history.push(edit);
    }

    /// Makes a change, and returns it.
    pub(super) fn change(&mut self, change: impl FnOnce(&mut Mask, &[Vec3]) -> Edit) -> Edit {
        let edit = change(&mut self.mask, &self.scene.means);
        self.note(edit.ranges(UPLOAD_GAP, MOST_UPLOADS));
        edit
    }

    /// Undoes or makes again.
    fn step(&mut self, step: impl for<'a> FnOnce(&'a mut History, &mut Mask) -> Option<&'a Edit>) -> bool {
        self.finish_stroke();
        let Some(edit) = step(&mut self.history, &mut self.mask) else { return false };
        let ranges = edit.ranges(UPLOAD_GAP, MOST_UPLOADS);
        self.note(ranges);
        true
    }
}

impl StyleMask {
    /// A mask that begins as a saved one. If that belongs to another scene or cannot be loaded, the entity gets
    /// a [`StyleMaskFailed`](super::StyleMaskFailed) and the mask is unpainted.
    pub fn saved(mask: Handle<SavedMask>) -> Self {
        Self { saved: Some(mask), ..Self::default() }
    }

    /// The weights, in the order of the scene in memory, or `None` if the mask is not ready.
    pub fn mask(&self) -> Option<&Mask> {
        self.weights.painted.as_ref().map(Painted::mask)
    }

    /// Paints a dab at each of `centers`, as one step to undo. Returns whether the mask was ready.
    pub fn paint(&mut self, brush: &Brush, centers: &[Vec3]) -> bool {
        self.with(|painted| painted.edit(|mask, means| mask.paint(means, brush, centers)))
    }

    /// Begins a stroke at `point`, or goes on to it with dabs at even spacing. The stroke is one step to undo;
    /// it ends with [`end_stroke`](Self::end_stroke), with another brush or with any other change. Returns
    /// whether the mask was ready.
    pub fn stroke_to(&mut self, brush: &Brush, point: Vec3) -> bool {
        self.with(|painted| {
            if painted.stroke.as_ref().is_some_and(|stroke| stroke.brush() != brush) {
                painted.finish_stroke();
            }
            let stroke = painted.stroke.get_or_insert_with(|| Stroke::new(*brush));
            let edit = stroke.to(&mut painted.mask, &painted.scene.means, point);
            painted.note(edit.ranges(UPLOAD_GAP, MOST_UPLOADS));
        })
    }

    /// Ends the stroke that is under way. Without one it does nothing.
    pub fn end_stroke(&mut self) {
        self.with(Painted::finish_stroke);
    }

    /// Combines `channel` with a selection. Returns whether the mask was ready.
    pub fn select(&mut self, channel: usize, selection: &Selection, combine: Combine) -> bool {
        self.with(|painted| painted.edit(|mask, means| mask.select(means, channel, selection, combine)))
    }

    /// Inverts `channel`. Returns whether the mask was ready.
    pub fn invert(&mut self, channel: usize) -> bool {
        self.with(|painted| painted.edit(|mask, _| mask.invert(channel)))
    }

    /// Undoes the last change. Returns false if there is none.
    pub fn undo(&mut self) -> bool {
        self.weights.painted.as_mut().is_some_and(|painted| painted.step(History::undo))
    }

    /// Makes the change again that was undone last. Returns false if there is none.
    pub fn redo(&mut self) -> bool {
        self.weights.painted.as_mut().is_some_and(|painted| painted.step(History::redo))
    }

    /// The number of changes that can be undone, and of those that can be made again.
    pub fn undo_len(&self) -> (usize, usize) {
        self.weights.painted.as_ref().map_or((0, 0), |painted| painted.history.len())
    }

    /// Names a channel, for people. The name is saved. Returns whether the mask was ready; a channel beyond the
    /// fourth has no name.
    pub fn set_name(&mut self, channel: usize, name: impl Into<String>) -> bool {
        self.with(|painted| {
            if let Some(to) = painted.mask.names.get_mut(channel) {
                *to = name.into();
            }
        })
    }

    /// The mask for [`stylegaussian_files::write_mask`], or `None` if it is not ready. It sorts and hashes all
    /// means, which takes a fifth of a second for a million: not for every frame.
    pub fn to_stored(&self) -> Option<StoredMask> {
        self.weights.painted.as_ref().map(Painted::to_stored)
    }

    /// The scene with this mask, for [`stylegaussian_files::write_scene`] to a `.sgs`, or `None` if it is not
    /// ready. It copies the scene.
    pub fn masked_scene(&self) -> Option<Scene> {
        let painted = self.weights.painted.as_ref()?;
        Some(Scene { mask: Some(painted.mask.clone()), ..Scene::clone(&painted.scene) })
    }

    /// Whether the mask is fitted to `scene`.
    pub(super) fn is_of(&self, scene: &Arc<Scene>) -> bool {
        self.weights.painted.as_ref().is_some_and(|painted| Arc::ptr_eq(&painted.scene, scene))
    }

    /// Calls `change` if the mask is ready, and returns whether it is.
    fn with(&mut self, change: impl FnOnce(&mut Painted)) -> bool {
        self.weights.painted.as_mut().map(change).is_some()
    }
}

/// Hides a part of the splats by a channel of the entity's [`StyleMask`]. What is drawn and what rays hit is
/// concerned: bounds and styles stay as they are.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
#[require(StyleMask)]
pub enum MaskVisibility {
    /// Hides the splats that are painted in this channel, 0..4: opacities are multiplied by 1 - weight.
    Hide(usize),
    /// Splats that are not painted in this channel, 0..4, are hidden: opacities are multiplied by the weight.
    Crop(usize),
}

impl Default for MaskVisibility {
    fn default() -> Self {
        Self::Hide(0)
    }
}

impl MaskVisibility {
    /// The channel and its meaning.
    pub(super) fn parts(self) -> (usize, MaskUse) {
        match self {
            Self::Hide(channel) => (channel, MaskUse::Hide),
            Self::Crop(channel) => (channel, MaskUse::Crop),
        }
    }
}
