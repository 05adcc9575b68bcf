//! The colors on the GPU.

use std::{sync::Arc, time::Duration};

use bevy::{
    prelude::*,
    render::{
        renderer::{RenderDevice, RenderQueue},
        sync_world::{MainEntity, MainEntityHashMap},
    },
};
use stylegaussian::Scene;
use stylegaussian_gpu::{buffers::TooLarge, colors::GaussianColors, splat::CloudColors};

use crate::{reports::Reports, scene::RenderClouds};

use super::{ColorReport, ColorSource, FadeClock, RenderWishes, fade::Fade};

/// The colors of all entities that show a scene and have a wish.
#[derive(Resource, Default)]
pub(crate) struct ShownColors {
    pub(crate) of_entity: MainEntityHashMap<EntityColors>,
    /// Whether all captured and known colors are applied. False on a new device.
    settled: bool,
}

/// The colors of an entity. During a fade, these are two sets.
#[derive(Default)]
pub(crate) struct EntityColors {
    /// Generation of the wish that was applied or refused last, or `None` if there was none.
    pub(crate) generation: Option<u64>,
    /// The scene that the colors belong to.
    scene: Option<Arc<Scene>>,
    /// The buffer in use. The second one holds the other side of a fade, or colors that are not complete yet.
    buffers: [Option<GaussianColors>; 2],
    /// Index of the buffer that is shown, or `None` for the captured colors.
    shown: Option<usize>,
    fade: Option<Fade>,
}

/// Applies captured colors and colors that are known. Folded styles are left to the style pass.
pub(crate) fn update_colors(
    clouds: Res<RenderClouds>,
    wishes: Res<RenderWishes>,
    mut colors: ResMut<ShownColors>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    clock: Res<FadeClock>,
    reports: Res<Reports<ColorReport>>,
) {
    // Reading `settled` does not mark `ShownColors` as changed. The style pass relies on that to stay idle.
    if colors.settled && !clouds.is_changed() && !wishes.is_changed() {
        return;
    }
    colors.settled = true;
    // Frees the buffers of entities that are gone. A wish outlives its style, so most entries go with their scene.
    colors.of_entity.retain(|entity, _| clouds.0.contains_key(entity) && wishes.0.contains_key(entity));
    for (&entity, wished) in &wishes.0 {
        let Some(cloud) = clouds.0.get(&entity) else { continue };
        let colors = colors.of_entity.entry(entity).or_default();
        colors.reset_for_new_scene(cloud.scene.scene());
        let generation = wished.wish.generation;
        if colors.generation == Some(generation) {
            continue;
        }
        let shown = match &wished.wish.source {
            ColorSource::Captured => Ok(None),
            ColorSource::Rgb(rgb) => colors.upload(device.wgpu_device(), &queue, rgb, wished.fade).map(Some),
            // The old colors stay until the style pass has decoded the new ones.
            ColorSource::Folded(_) => continue,
        };
        match shown {
            Ok(index) => colors.show(index, wished.fade, clock.0, generation),
            Err(reason) => {
                // The refused wish counts as answered. Otherwise it would be tried and reported again in each frame
                // that has a change.
                colors.generation = Some(generation);
                reports.push(ColorReport { entity: entity.id(), generation, result: Err(reason) });
            }
        }
    }
}

impl ShownColors {
    /// The colors to draw an entity's splats in. `now` is the time of the [`FadeClock`].
    pub(crate) fn get(&self, entity: MainEntity, now: Duration) -> CloudColors<'_> {
        let Some(colors) = self.of_entity.get(&entity) else { return CloudColors::Captured };
        let buffer = |index: Option<usize>| index.and_then(|index| colors.buffers[index].as_ref());
        // The extraction's clock and not the render world's own, so that all views of a frame see the same step of a
        // fade.
        let progress = colors.fade.as_ref().map(|fade| (fade.from, fade.progress(now)));
        match (progress, buffer(colors.shown)) {
            // A fade that is over is not removed. It only stops being drawn, and the next `show` replaces it.
            (Some((from, t)), to) if t < 1.0 => CloudColors::Fade { from: buffer(from), to, t },
            (_, Some(rgb)) => CloudColors::Rgb(rgb),
            (_, None) => CloudColors::Captured,
        }
    }
}

impl EntityColors {
    /// Forgets everything if the entity shows another scene: colors of other Gaussians are no start for a fade.
    fn reset_for_new_scene(&mut self, scene: &Arc<Scene>) {
        if !self.scene.as_ref().is_some_and(|present| Arc::ptr_eq(present, scene)) {
            // This also forgets the generation, so the wish is applied again, at once and without a fade.
            *self = Self { scene: Some(Arc::clone(scene)), ..default() };
        }
    }

    /// Writes known colors to the next buffer and returns its index.
    fn upload(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        rgb: &[[f32; 3]],
        fade: Duration,
    ) -> Result<usize, String> {
        // Known colors are complete at once: without a fade, they overwrite the buffer that is shown.
        let index = self.next_index(self.fades(fade));
        let buffer = self.buffer(device, index).map_err(|error| error.to_string())?;
        if buffer.n_gaussians() != rgb.len() {
            return Err(format!("{} colors for {} Gaussians", rgb.len(), buffer.n_gaussians()));
        }
        buffer.write(queue, rgb);
        Ok(index)
    }

    /// The buffer that is shown, or `None` for the captured colors.
    #[cfg(test)]
    pub(crate) fn shown(&self) -> Option<&GaussianColors> {
        self.shown.and_then(|index| self.buffers[index].as_ref())
    }

    /// Index of the buffer for the next colors. It is the shown buffer unless that must be kept, either for a fade or until
    /// the next colors are complete.
    pub(crate) fn next_index(&self, keep_shown: bool) -> usize {
        match self.shown {
            Some(shown) if keep_shown => 1 - shown,
            Some(shown) => shown,
            None => 0,
        }
    }

    /// The buffer `index`, created if it does not exist.
    ///
    /// # Errors
    /// If the buffer is too large for the device.
    pub(crate) fn buffer(
        &mut self,
        device: &wgpu::Device,
        index: usize,
    ) -> Result<&GaussianColors, TooLarge> {
        // Taken out and put back, because `get_or_insert_with` cannot return the error.
        let buffer = match self.buffers[index].take() {
            Some(buffer) => buffer,
            None => GaussianColors::new(device, self.scene.as_ref().map_or(0, |scene| scene.len()))?,
        };
        Ok(self.buffers[index].insert(buffer))
    }

    /// Whether the next change fades. The first colors of an entity are immediate, also after a lost device.
    pub(crate) fn fades(&self, duration: Duration) -> bool {
        !duration.is_zero() && self.generation.is_some()
    }

    /// Shows the buffer `index`, or the captured colors if it is `None`, from `now` on.
    pub(crate) fn show(&mut self, index: Option<usize>, duration: Duration, now: Duration, generation: u64) {
        // `fades` looks at the generation, so it comes before the new one is stored.
        self.fade = self.fades(duration).then_some(Fade { from: self.shown, began: now, duration });
        self.shown = index;
        self.generation = Some(generation);
        // No side of a fade needs them.
        if index.is_none() && self.fade.is_none() {
            self.buffers = default();
        }
    }
}
