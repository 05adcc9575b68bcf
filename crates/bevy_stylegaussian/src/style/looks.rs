//! The looks of clouds on the GPU: their colors, and the fades between them.

use std::{sync::Arc, time::Duration};

use bevy::{
    prelude::*,
    render::{
        Extract,
        sync_world::{MainEntity, MainEntityHashMap},
    },
};
use stylegaussian::Scene;
use stylegaussian_gpu::{
    colors::{GaussianColors, GaussianColorsError},
    splat::CloudColors,
};

/// Time since startup, by which looks fade: real time, so that they do in a paused game.
#[derive(Resource, Clone, Copy, Default)]
pub(crate) struct LookClock(pub(crate) Duration);

/// Takes over the main world's time.
pub(super) fn extract_clock(mut clock: ResMut<LookClock>, time: Extract<Res<Time<Real>>>) {
    clock.0 = time.elapsed();
}

/// The looks of all clouds.
#[derive(Resource, Default)]
pub(crate) struct CloudLooks(pub(super) MainEntityHashMap<CloudLook>);

/// The look of a cloud, and during a fade the one before it.
#[derive(Default)]
pub(super) struct CloudLook {
    /// Of the look that is on the GPU or was refused; `None` where the cloud is new to the GPU.
    pub(super) generation: Option<u64>,
    /// What the colors are for.
    scene: Option<Arc<Scene>>,
    /// The buffer in use, and where there are fades the one before.
    buffers: [Option<GaussianColors>; 2],
    /// Which of them is shown; `None` for the scene's own colors.
    shown: Option<usize>,
    fade: Option<Fade>,
}

/// A change from one look to the next.
struct Fade {
    from: Option<usize>,
    began: Duration,
    lasts: Duration,
}

impl CloudLooks {
    /// The colors to draw a cloud in, `now` being the time since startup.
    pub(crate) fn colors(&self, entity: MainEntity, now: Duration) -> CloudColors<'_> {
        let Some(look) = self.0.get(&entity) else { return CloudColors::Captured };
        let buffer = |index: Option<usize>| index.and_then(|index| look.buffers[index].as_ref());
        let progress = look.fade.as_ref().map(|fade| (fade.from, fade.progress(now)));
        match (progress, buffer(look.shown)) {
            (Some((from, t)), to) if t < 1.0 => CloudColors::Fade { from: buffer(from), to, t },
            (_, Some(colors)) => CloudColors::Rgb(colors),
            (_, None) => CloudColors::Captured,
        }
    }
}

impl Fade {
    /// 0 at its beginning, 1 at its end.
    fn progress(&self, now: Duration) -> f32 {
        now.saturating_sub(self.began).as_secs_f32() / self.lasts.as_secs_f32()
    }
}

impl CloudLook {
    /// Starts anew where the cloud has another scene, whose colors cannot fade from the last one's.
    pub(super) fn fit(&mut self, scene: &Arc<Scene>) {
        if !self.scene.as_ref().is_some_and(|present| Arc::ptr_eq(present, scene)) {
            *self = Self { scene: Some(Arc::clone(scene)), ..default() };
        }
    }

    /// The buffer that is shown, unless it is the scene's own colors.
    #[cfg(test)]
    pub(super) fn shown(&self) -> Option<&GaussianColors> {
        self.shown.and_then(|index| self.buffers[index].as_ref())
    }

    /// Where the next look goes: into the shown buffer, or into the other one where what is shown has to stay, to fade away
    /// or until the next look is complete.
    pub(super) fn next(&self, stays: bool) -> usize {
        match self.shown {
            Some(shown) if stays => 1 - shown,
            Some(shown) => shown,
            None => 0,
        }
    }

    /// The buffer `index`, made where there is none.
    ///
    /// # Errors
    /// When the device cannot take it.
    pub(super) fn buffer(
        &mut self,
        device: &wgpu::Device,
        index: usize,
    ) -> Result<&GaussianColors, GaussianColorsError> {
        let buffer = match self.buffers[index].take() {
            Some(buffer) => buffer,
            None => GaussianColors::new(device, self.scene.as_ref().map_or(0, |scene| scene.len()))?,
        };
        Ok(self.buffers[index].insert(buffer))
    }

    /// The first look that the GPU learns of (also after a lost device) is there at once.
    pub(super) fn fades(&self, lasts: Duration) -> bool {
        !lasts.is_zero() && self.generation.is_some()
    }

    /// Shows the buffer `index`, or the scene's own colors, from `now` on.
    pub(super) fn show(&mut self, index: Option<usize>, lasts: Duration, now: Duration, generation: u64) {
        self.fade = self.fades(lasts).then_some(Fade { from: self.shown, began: now, lasts });
        self.shown = index;
        self.generation = Some(generation);
        if index.is_none() && self.fade.is_none() {
            self.buffers = default();
        }
    }
}
