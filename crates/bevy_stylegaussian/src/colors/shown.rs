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
use stylegaussian::{Scene, strokes::StrokeKnobs};
use stylegaussian_gpu::{
    colors::GaussianColors,
    layers::{MixedLayers, StrokeMix},
    splat::CloudColors,
    strokes::{GaussianStrokes, StrokeStore},
};

use crate::scene::{DeviceServes, RenderClouds};

use super::{
    extract::{RenderColors, WantedColors},
    layers::{ColorLayer, ColorLayers, LayerColors, Mix},
    strokes::{StrokeTextures, StrokesReady, UploadedStrokes},
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
    strokes: UploadedStrokes,
    /// Mixes that layers are made of, by their address.
    pub(super) mixes: HashMap<usize, (Weak<Mix>, FrozenMix)>,
    /// Buffers of former mixes, to be used again.
    spare: Vec<GaussianColors>,
    /// Whether everything that is wished for is shown. False on a new device.
    pub(super) settled: bool,
}

/// A style on the GPU, or on its way there.
struct StyleOnGpu {
    style: Weak<StyleColors>,
    colors: Option<GaussianColors>,
    strokes: Option<GaussianStrokes>,
    is_complete: bool,
}

/// The mixed layers of an entity: colors, and which layers they hold; strokes, which know that themselves.
pub(super) struct OwnMix {
    pub(super) colors: GaussianColors,
    pub(super) mixed: MixedLayers,
    pub(super) strokes: StrokeMix,
}

/// Layers that were mixed once.
pub(super) struct FrozenMix {
    pub(super) colors: GaussianColors,
    pub(super) strokes: Option<GaussianStrokes>,
}

/// The colors of an entity.
#[derive(Default)]
struct EntityColors {
    /// The generation that is shown, or `None` if there is none.
    generation: Option<u64>,
    /// The scene that the colors belong to.
    scene: Option<Arc<Scene>>,
    shown: Shown,
    knobs: StrokeKnobs,
    /// The state of the mask that was mixed in, or `None` if there was none.
    mask: Option<u64>,
    is_hidden: bool,
}

/// The colors that are drawn.
#[derive(Default)]
pub(super) enum Shown {
    #[default]
    Captured,
    /// Colors of a style, which other entities may show too, and its strokes.
    Style(GaussianColors, Option<GaussianStrokes>),
    /// The entity's own.
    Mixed(Box<OwnMix>),
}

impl Shown {
    /// The colors, or `None` for the captured ones.
    fn colors(&self) -> Option<&GaussianColors> {
        match self {
            Self::Captured => None,
            Self::Style(colors, _) => Some(colors),
            Self::Mixed(own) => Some(&own.colors),
        }
    }

    /// The strokes over them.
    fn strokes(&self) -> Option<&GaussianStrokes> {
        match self {
            Self::Captured => None,
            Self::Style(_, strokes) => strokes.as_ref(),
            Self::Mixed(own) => own.strokes.strokes(),
        }
    }
}

/// Uploads styles that come as colors, and drops unused colors. Folded styles are left to the style pass.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(crate) fn update_colors(
    clouds: Res<RenderClouds>,
    wishes: Res<RenderColors>,
    wanted: Res<WantedColors>,
    textures: Res<StrokeTextures>,
    strokes_ready: Res<StrokesReady>,
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
    colors.strokes.forget_unused();
    let gone = colors.mixes.extract_if(|_, (mix, _)| mix.strong_count() == 0);
    colors.spare.extend(gone.map(|(_, (_, mix))| mix.colors));
    // Transitions leave one behind in each frame and take it again in the next.
    colors.spare.truncate(MAX_SPARE);
    let mut styles = wanted.styles.clone();
    styles.extend(wishes.0.values().flat_map(|wish| all_styles(&wish.layers)));
    let gpu = Gpu { device: device.wgpu_device(), queue: &queue, store: &textures.0 };
    for style in styles {
        colors.prepare(&style, &gpu, strokes_ready.0);
    }
    for (&entity, cloud) in &clouds.0 {
        if let Some(wish) = wishes.0.get(&entity) {
            let entity = colors.of_entity.entry(entity).or_default();
            entity.reset_for_new_scene(cloud.scene.scene());
            entity.knobs = wish.knobs;
        }
    }
}

/// Refuses all styles, if the device cannot draw splats.
pub(super) fn refuse_colors(device: Res<DeviceServes>, wishes: Res<RenderColors>, wanted: Res<WantedColors>) {
    let Some(reason) = device.reason().filter(|_| wishes.is_changed() || wanted.is_changed()) else { return };
    let of_layers = wishes.0.values().flat_map(|wish| all_styles(&wish.layers));
    for style in of_layers.chain(wanted.styles.iter().cloned()) {
        style.answer(Err(reason.to_string()));
    }
}

/// Where styles are uploaded to.
struct Gpu<'a> {
    device: &'a wgpu::Device,
    queue: &'a wgpu::Queue,
    store: &'a StrokeStore,
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
        let Some(EntityColors { shown, knobs, is_hidden, .. }) = self.of_entity.get(&entity) else {
            return Some(CloudColors::Captured);
        };
        let colors = shown.colors().map_or(CloudColors::Captured, CloudColors::Rgb);
        // Strokes of which nothing is seen cost nothing.
        let strokes = shown.strokes().filter(|_| knobs.amount > 0.0);
        let painted = strokes.map_or(colors, |strokes| colors.with_strokes(strokes, *knobs));
        (!is_hidden).then_some(painted)
    }

    /// Whether any entity shows strokes.
    pub(crate) fn has_strokes(&self) -> bool {
        self.of_entity.values().any(|colors| colors.shown.strokes().is_some())
    }

    /// The colors of an entity, or `None` for the captured ones.
    #[cfg(test)]
    pub(crate) fn shown(&self, entity: MainEntity) -> Option<&GaussianColors> {
        self.of_entity.get(&entity)?.shown.colors()
    }

    /// The strokes of an entity.
    #[cfg(all(test, feature = "images"))]
    pub(crate) fn shown_strokes(&self, entity: MainEntity) -> Option<&GaussianStrokes> {
        self.of_entity.get(&entity)?.shown.strokes()
    }

    /// Makes an entry for a style, and uploads it if its colors are known. It is complete once its strokes can
    /// be drawn.
    fn prepare(&mut self, style: &Arc<StyleColors>, gpu: &Gpu, strokes_ready: bool) {
        let Gpu { device, queue, store } = *gpu;
        let on_gpu = self.styles.entry(address(style)).or_insert_with(|| {
            let colors = GaussianColors::new(device, style.n).map_err(|error| error.to_string());
            let mut style_on_gpu = StyleOnGpu {
                style: Arc::downgrade(style),
                colors: colors.as_ref().ok().cloned(),
                strokes: None,
                is_complete: false,
            };
            match (colors, &style.source) {
                (Err(reason), _) => style.answer(Err(reason)),
                (Ok(colors), ColorSource::Rgb(rgb)) => {
                    colors.write(queue, rgb);
                    let strokes = style.strokes.as_ref();
                    style_on_gpu.strokes =
                        strokes.and_then(|strokes| self.strokes.get(store, device, queue, strokes));
                }
                (Ok(_), ColorSource::Folded(_)) => {}
            }
            style_on_gpu
        });
        if matches!(style.source, ColorSource::Rgb(_)) && on_gpu.colors.is_some() && !on_gpu.is_complete {
            match on_gpu.strokes.is_none() || strokes_ready {
                true => {
                    on_gpu.is_complete = true;
                    style.answer(Ok(()));
                }
                false => self.settled = false,
            }
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

    /// The colors and strokes of a style, or `None` if they are not complete. A style that the device refuses
    /// never is.
    pub(super) fn style(
        &self,
        style: &Arc<StyleColors>,
    ) -> Option<(&GaussianColors, Option<&GaussianStrokes>)> {
        let style = self.styles.get(&address(style)).filter(|style| style.is_complete)?;
        Some((style.colors.as_ref()?, style.strokes.as_ref()))
    }

    /// Whether an entity shows its wanted colors, with a mask in this state.
    pub(super) fn is_current(&self, entity: MainEntity, wish: &ColorLayers, mask: Option<u64>) -> bool {
        let is_masked = wish.layers.iter().any(|layer| layer.mask.is_some());
        self.of_entity.get(&entity).is_some_and(|colors| {
            colors.generation == Some(wish.generation) && (!is_masked || colors.mask == mask)
        })
    }

    /// Shows an entity's wanted colors.
    pub(super) fn show(&mut self, entity: MainEntity, wish: &ColorLayers, shown: Shown, mask: Option<u64>) {
        let Some(colors) = self.of_entity.get_mut(&entity) else { return };
        colors.shown = shown;
        colors.mask = mask;
        colors.is_hidden = wish.is_hidden;
        colors.generation = Some(wish.generation);
    }

    /// Buffers of an entity's own to mix its layers into: those that it shows if they are its own. `None` if
    /// they are too large for the device.
    pub(super) fn own_mix(
        &mut self,
        entity: MainEntity,
        device: &wgpu::Device,
        n: usize,
    ) -> Option<Box<OwnMix>> {
        let shown = self.of_entity.get_mut(&entity).map(|colors| &mut colors.shown);
        // The mix replaces the shown colors.
        if let Some(shown @ Shown::Mixed(_)) = shown
            && let Shown::Mixed(own) = std::mem::take(shown)
        {
            return Some(own);
        }
        Some(Box::new(OwnMix {
            colors: self.buffer(device, n)?,
            mixed: MixedLayers::default(),
            strokes: StrokeMix::default(),
        }))
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
