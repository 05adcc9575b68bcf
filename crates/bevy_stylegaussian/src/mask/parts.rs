//! Masks of worlds: changes in space, which each part takes over when it arrives.

use std::sync::{Arc, Weak};

use bevy::{camera::primitives::Aabb, math::Vec3A, prelude::*};
use stylegaussian::{
    Mask, Scene,
    mask::{Brush, Combine, Edit, Selection},
};

use super::component::{MaskVisibility, Painted, StyleMask, next_revision};
use crate::scene::{LoadedScene, WorldPart};

/// A mask of all parts of a [`GaussianWorld`](crate::world::GaussianWorld), at all levels, on the world's
/// entity: the list of its changes, which are in the world's space. Each part has a [`StyleMask`] that all of
/// them are made in, one after another, also those from before it arrived. [`MaskVisibility`] on the world's
/// entity holds for its parts, and volumes follow the mask's channels
/// ([`StyleVolume::painted`](crate::StyleVolume::painted)).
///
/// The surroundings of a world have no mask. The time in which a part arrives grows with the number of changes
/// that reach it, and undoing one makes the others again in the parts that it reaches. The list is not saved by
/// reflection: a game keeps [`edits`](Self::edits) itself.
#[derive(Component, Clone, Debug, Default)]
pub struct WorldMask {
    /// The changes, and numbers that no others have. Those that are undone come last.
    edits: Vec<(u64, MaskEdit)>,
    n_undone: usize,
}

/// A change of a [`WorldMask`], in the world's space.
#[derive(Clone, Debug)]
pub enum MaskEdit {
    /// Paints a dab at each of some places, as [`StyleMask::paint`] does.
    Paint {
        /// The brush.
        brush: Brush,
        /// Centers of the dabs.
        centers: Vec<Vec3>,
    },
    /// Combines a channel with a selection.
    Select {
        /// The channel, 0..4.
        channel: usize,
        /// The selection.
        selection: Selection,
        /// The change that it makes.
        combine: Combine,
    },
    /// Inverts a channel.
    Invert {
        /// The channel, 0..4.
        channel: usize,
    },
}

/// The changes that the mask of a part has.
#[derive(Component, Default)]
pub(super) struct TakenOver {
    /// The scene whose mask they were made in.
    scene: Weak<Scene>,
    /// The world's changes so far, and the number of the last one.
    n: usize,
    last: Option<u64>,
    /// The numbers of those that reach the part, which are made.
    made: Vec<u64>,
}

impl WorldMask {
    /// Makes a change, which is one step to undo. Those that were undone are gone.
    pub fn edit(&mut self, edit: MaskEdit) {
        self.edits.truncate(self.edits.len() - self.n_undone);
        self.n_undone = 0;
        self.edits.push((next_revision(), edit));
    }

    /// Undoes the last change. Returns false if there is none.
    pub fn undo(&mut self) -> bool {
        let can = !self.done().is_empty();
        self.n_undone += usize::from(can);
        can
    }

    /// Makes the change again that was undone last. Returns false if there is none.
    pub fn redo(&mut self) -> bool {
        let can = self.n_undone > 0;
        self.n_undone -= usize::from(can);
        can
    }

    /// The changes that are made, the first one first.
    pub fn edits(&self) -> impl Iterator<Item = &MaskEdit> {
        self.done().iter().map(|(_, edit)| edit)
    }

    fn done(&self) -> &[(u64, MaskEdit)] {
        &self.edits[..self.edits.len() - self.n_undone]
    }
}

impl MaskEdit {
    /// Makes the change in the mask of Gaussians with these means `[N]`.
    fn make(&self, mask: &mut Mask, means: &[Vec3]) -> Edit {
        match self {
            Self::Paint { brush, centers } => mask.paint(means, brush, centers),
            Self::Select { channel, selection, combine } => mask.select(means, *channel, selection, *combine),
            Self::Invert { channel } => mask.invert(*channel),
        }
    }

    /// Whether it may change what is seen in a box. A world has thousands of parts, and a brush reaches a few.
    fn reaches(&self, bounds: &Aabb) -> bool {
        let Self::Paint { brush, centers } = self else { return true };
        let (min, max) = (bounds.min() - brush.radius, bounds.max() + brush.radius);
        centers.iter().any(|center| {
            let center = Vec3A::from(*center);
            center.cmpge(min).all() && center.cmple(max).all()
        })
    }
}

/// Gives parts of masked worlds a mask, and takes it from those whose world has none any more.
pub(super) fn give_masks(
    mut commands: Commands,
    worlds: Query<Option<&MaskVisibility>, With<WorldMask>>,
    parts: Query<(Entity, &WorldPart, Has<TakenOver>, Option<&MaskVisibility>)>,
    mut were_masked: Local<bool>,
) {
    let had_any = std::mem::replace(&mut *were_masked, !worlds.is_empty());
    if worlds.is_empty() && !had_any {
        return;
    }
    for (entity, part, is_masked, own) in &parts {
        let mut entity = commands.entity(entity);
        match worlds.get(part.world) {
            Ok(visibility) => {
                if !is_masked {
                    entity.try_insert((StyleMask::default(), TakenOver::default()));
                }
                match visibility {
                    Some(visibility) if own != Some(visibility) => {
                        entity.try_insert(*visibility);
                    }
                    None if own.is_some() => {
                        entity.try_remove::<MaskVisibility>();
                    }
                    _ => {}
                }
            }
            Err(_) if is_masked => {
                entity.try_remove::<(StyleMask, TakenOver, MaskVisibility)>();
            }
            Err(_) => {}
        }
    }
}

/// Makes the changes of worlds in the masks of their parts.
pub(super) fn take_over_edits(
    worlds: Query<&WorldMask>,
    mut parts: Query<(&WorldPart, &mut StyleMask, &mut TakenOver, &LoadedScene)>,
) {
    for (part, mut mask, mut taken, loaded) in &mut parts {
        let (Ok(world), scene) = (worlds.get(part.world), loaded.scene()) else { continue };
        if !mask.is_of(scene) {
            continue;
        }
        let (done, n) = (world.done(), taken.n);
        let last = |n: usize| Some(done.get(n.checked_sub(1)?)?.0);
        let is_known = taken.scene.as_ptr() == Arc::as_ptr(scene);
        let goes_on = is_known && last(n) == taken.last;
        if goes_on && n == done.len() {
            continue;
        }
        let bounds = loaded.asset.bounds().ok().flatten();
        let reaches = |edit: &MaskEdit| bounds.as_ref().is_none_or(|bounds| edit.reaches(bounds));
        let new = if goes_on { &done[n..] } else { done };
        let mut to_make: Vec<_> = new.iter().filter(|(_, edit)| reaches(edit)).collect();
        let mut made = std::mem::take(&mut taken.made);
        let mut begins_anew = false;
        if !goes_on {
            // What was undone may not have reached it.
            let is_made = is_known && to_make.iter().map(|(number, _)| number).take(made.len()).eq(&made);
            begins_anew = !is_made && !made.is_empty();
            if is_made {
                to_make.drain(..made.len());
            }
        }
        // Borrowed mutably only if something changes.
        if (begins_anew || !to_make.is_empty())
            && let Some(painted) = &mut mask.weights.painted
        {
            if begins_anew {
                *painted = Painted::new(Arc::clone(scene), Mask::new(scene.len()));
                made.clear();
            }
            for (number, edit) in to_make {
                painted.change(|mask, means| edit.make(mask, means));
                made.push(*number);
            }
        }
        let last = last(done.len());
        *taken = TakenOver { scene: Arc::downgrade(scene), n: done.len(), last, made };
    }
}
