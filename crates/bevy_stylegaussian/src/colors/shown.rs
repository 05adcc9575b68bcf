//! The colors on the GPU.

use std::sync::{Arc, Weak};

use bevy::{
    platform::collections::HashMap,
    prelude::*,
    render::{
        renderer::{RenderDevice, RenderQueue},
        sync_world::{MainEntity, MainEntityHashMap},
    },
};
use stylegaussian::Scene;
use stylegaussian_gpu::{colors::GaussianColors, layers::MixedLayers, splat::CloudColors};

use crate::scene::RenderClouds;

use super::{
    extract::{RenderColors, WantedColors},
    layers::{ColorLayer, ColorLayers, LayerColors, Mix},
    styles::{ColorSource, StyleColors},
};

/// Whether all pipelines are there that the views need to draw their splats.
#[derive(Resource)]
pub(crate) struct PipelinesReady(pub(crate) bool);

impl Default for PipelinesReady {
    /// True: without a view, nothing is waited for.
    fn default() -> Self {
        Self(true)
    }
}

/// The colors of all entities that show a scene, and the styles and mixes that they are made of.
#[derive(Resource, Default)]
pub(crate) struct ShownColors {
    of_entity: MainEntityHashMap<EntityColors>,
    /// By the address of the style. The weak reference keeps the address from being used again.
    styles: HashMap<usize, StyleOnGpu>,
    /// Mixes that layers are made of, by their address.
    pub(super) mixes: HashMap<usize, (Weak<Mix>, GaussianColors)>,
    /// Buffers of former mixes, to be used again.
    spare: Vec<GaussianColors>,
    /// Whether everything that is wished for is shown. False on a new device.
    pub(super) settled: bool,
}

/// A style on the GPU, or on its way there.
struct StyleOnGpu {
    style: Weak<StyleColors>,
    colors: Option<GaussianColors>,
    is_complete: bool,
}

/// The colors of an entity.
#[derive(Default)]
struct EntityColors {
    /// The generation that is shown, or `None` if there is none.
    generation: Option<u64>,
    /// The scene that the colors belong to.
    scene: Option<Arc<Scene>>,
    shown: Shown,
    /// The state of the mask that was mixed in, or `None` if there was none.
    mask: Option<u64>,
    is_hidden: bool,
}

/// The colors that are drawn.
#[derive(Default)]
pub(super) enum Shown {
    #[default]
    Captured,
    /// Those of a style, which other entities may show too.
    Style(GaussianColors),
    /// The entity's own, and the layers that they hold.
    Mixed(GaussianColors, MixedLayers),
}

/// Uploads styles that come as colors, and drops colors that nobody refers to any more. Folded styles are left to the
/// style pass.
pub(crate) fn update_colors(
    clouds: Res<RenderClouds>,
    wishes: Res<RenderColors>,
    wanted: Res<WantedColors>,
    mut colors: ResMut<ShownColors>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    // Reading `settled` does not mark `ShownColors` as changed. The style pass relies on that to stay idle.
    if colors.settled && !clouds.is_changed() && !wishes.is_changed() && !wanted.is_changed() {
        return;
    }
    let colors = &mut *colors;
    colors.settled = true;
    colors.of_entity.retain(|entity, _| clouds.0.contains_key(entity) && wishes.0.contains_key(entity));
    colors.styles.retain(|_, style| style.style.strong_count() > 0);
    let spare = &mut colors.spare;
    colors.mixes.retain(|_, (mix, buffer)| {
        let is_alive = mix.strong_count() > 0;
        if !is_alive {
            spare.push(buffer.clone());
        }
        is_alive
    });
    // Transitions leave one behind in each frame and take it again in the next.
    spare.truncate(MAX_SPARE);
    let mut styles = wanted.0.clone();
    styles.extend(wishes.0.values().flat_map(|wish| all_styles(&wish.layers)));
    for style in styles {
        colors.prepare(&style, device.wgpu_device(), &queue);
    }
    for (&entity, cloud) in &clouds.0 {
        if wishes.0.contains_key(&entity) {
            colors.of_entity.entry(entity).or_default().reset_for_new_scene(cloud.scene.scene());
        }
    }
}

/// Buffers that are kept for further mixes.
const MAX_SPARE: usize = 4;

/// The styles that layers are made of.
fn all_styles(layers: &[ColorLayer]) -> Vec<Arc<StyleColors>> {
    let styles = |layer: &ColorLayer| match &layer.colors {
        LayerColors::Captured => Vec::new(),
        LayerColors::Style(style) => vec![Arc::clone(style)],
        LayerColors::Mix(mix) => all_styles(&mix.layers()),
    };
    layers.iter().flat_map(styles).collect()
}

/// The key of a style or of a mix.
pub(super) fn address<T>(shared: &Arc<T>) -> usize {
    Arc::as_ptr(shared) as usize
}

impl ShownColors {
    /// The colors to draw an entity's splats in, or `None` if they are not drawn.
    pub(crate) fn get(&self, entity: MainEntity) -> Option<CloudColors<'_>> {
        let Some(colors) = self.of_entity.get(&entity) else { return Some(CloudColors::Captured) };
        match &colors.shown {
            _ if colors.is_hidden => None,
            Shown::Captured => Some(CloudColors::Captured),
            Shown::Style(shown) | Shown::Mixed(shown, _) => Some(CloudColors::Rgb(shown)),
        }
    }

    /// The colors of an entity, or `None` for the captured ones.
    #[cfg(test)]
    pub(crate) fn shown(&self, entity: MainEntity) -> Option<&GaussianColors> {
        match &self.of_entity.get(&entity)?.shown {
            Shown::Captured => None,
            Shown::Style(shown) | Shown::Mixed(shown, _) => Some(shown),
        }
    }

    /// Makes an entry for a style, and uploads it if its colors are known.
    fn prepare(&mut self, style: &Arc<StyleColors>, device: &wgpu::Device, queue: &wgpu::Queue) {
        let on_gpu = self.styles.entry(address(style)).or_insert_with(|| {
            let colors = GaussianColors::new(device, style.n).map_err(|error| error.to_string());
            let style_on_gpu = StyleOnGpu {
                style: Arc::downgrade(style),
                colors: colors.as_ref().ok().cloned(),
                is_complete: false,
            };
            if let Err(reason) = colors {
                style.answer(Err(reason));
            }
            style_on_gpu
        });
        if let (ColorSource::Rgb(rgb), Some(colors), false) =
            (&style.source, &on_gpu.colors, on_gpu.is_complete)
        {
            colors.write(queue, rgb);
            on_gpu.is_complete = true;
            style.answer(Ok(()));
        }
    }

    /// The folded styles that are not decoded yet, with the colors that they go to.
    pub(crate) fn to_decode(&self) -> Vec<(Arc<StyleColors>, GaussianColors)> {
        let undecoded = |style: &StyleOnGpu| match &style.colors {
            Some(colors) if !style.is_complete => Some((style.style.upgrade()?, colors.clone())),
            _ => None,
        };
        self.styles.values().filter_map(undecoded).collect()
    }

    /// Notes that a style is decoded, or why it cannot be.
    pub(crate) fn decoded(&mut self, style: &Arc<StyleColors>, result: Result<(), String>) {
        if let Some(on_gpu) = self.styles.get_mut(&address(style)) {
            on_gpu.is_complete = result.is_ok();
            if result.is_err() {
                on_gpu.colors = None;
            }
        }
        style.answer(result);
    }

    /// The colors of a style, or `None` if they are not complete. A style that the device refuses never is.
    pub(super) fn style(&self, style: &Arc<StyleColors>) -> Option<&GaussianColors> {
        self.styles.get(&address(style)).filter(|style| style.is_complete)?.colors.as_ref()
    }

    /// Whether an entity shows what it wishes for, with a mask in this state.
    pub(super) fn is_current(&self, entity: MainEntity, wish: &ColorLayers, mask: Option<u64>) -> bool {
        let is_masked = wish.layers.iter().any(|layer| layer.mask.is_some());
        self.of_entity.get(&entity).is_some_and(|colors| {
            colors.generation == Some(wish.generation) && (!is_masked || colors.mask == mask)
        })
    }

    /// Shows what an entity wishes for.
    pub(super) fn show(&mut self, entity: MainEntity, wish: &ColorLayers, shown: Shown, mask: Option<u64>) {
        let Some(colors) = self.of_entity.get_mut(&entity) else { return };
        colors.shown = shown;
        colors.mask = mask;
        colors.is_hidden = wish.is_hidden;
        colors.generation = Some(wish.generation);
    }

    /// Colors of an entity's own to mix its layers into, and what they hold: those that it shows if they are its own.
    pub(super) fn own_buffer(
        &mut self,
        entity: MainEntity,
        device: &wgpu::Device,
        n: usize,
    ) -> Option<(GaussianColors, MixedLayers)> {
        match self.of_entity.get_mut(&entity).map(|colors| &mut colors.shown) {
            Some(Shown::Mixed(own, mixed)) => Some((own.clone(), std::mem::take(mixed))),
            _ => Some((self.buffer(device, n)?, MixedLayers::default())),
        }
    }

    /// Colors of `n` Gaussians, to mix layers into, or `None` if they are too large for the device.
    pub(super) fn buffer(&mut self, device: &wgpu::Device, n: usize) -> Option<GaussianColors> {
        match self.spare.iter().position(|spare| spare.n_gaussians() == n) {
            Some(index) => Some(self.spare.swap_remove(index)),
            // A style of the same size has fitted, so this does too.
            None => GaussianColors::new(device, n).ok(),
        }
    }
}

impl EntityColors {
    /// Forgets everything if the entity shows another scene: colors of other Gaussians are none.
    fn reset_for_new_scene(&mut self, scene: &Arc<Scene>) {
        if !self.scene.as_ref().is_some_and(|present| Arc::ptr_eq(present, scene)) {
            *self = Self { scene: Some(Arc::clone(scene)), ..default() };
        }
    }
}
