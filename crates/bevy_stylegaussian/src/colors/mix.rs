//! The mix of each entity's layers.

use std::sync::Arc;

use bevy::{
    prelude::*,
    render::{
        diagnostic::RecordDiagnostics,
        renderer::{RenderContext, RenderDevice, RenderQueue},
    },
};
use stylegaussian_gpu::{
    colors::GaussianColors,
    layers::{GaussianMask, GpuLayer, LayerMixer, MixedLayers},
    splat::GpuScene,
};

use crate::{
    background::{Background, SynchronousCompilation},
    mask::RenderMasks,
    scene::{GpuScenes, RenderClouds},
};

use super::{
    extract::RenderColors,
    layers::{ColorLayer, LayerColors},
    shown::{PipelinesReady, Shown, ShownColors, address},
};

/// The kernel on the present device, or `None` if it was not needed yet.
#[derive(Resource, Default)]
pub(crate) struct Mixer(Option<Background<Arc<LayerMixer>>>);

impl Mixer {
    /// The kernel, or `None` while it is compiled. The first call starts that.
    fn get(&mut self, synchronous: SynchronousCompilation, device: &wgpu::Device) -> Option<Arc<LayerMixer>> {
        let device = device.clone();
        let compile = move || Arc::new(LayerMixer::new(&device));
        self.0.get_or_insert_with(|| Background::start(synchronous, compile)).poll().cloned()
    }
}

/// Access to the GPU while layers are mixed.
struct Gpu<'a> {
    device: &'a wgpu::Device,
    queue: &'a wgpu::Queue,
    encoder: &'a mut wgpu::CommandEncoder,
    mixer: &'a LayerMixer,
    /// The entity's mask.
    mask: Option<&'a GaussianMask>,
}

/// The way in which layers are shown.
enum Way {
    /// A style is not complete.
    Wait,
    /// As captured.
    Captured,
    /// One style everywhere, which may be shared with other entities.
    Style(GaussianColors),
    /// Mixed.
    Mix,
}

/// Shows the layers that entities wish for. An entity whose layers are not complete keeps the colors that it has.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(crate) fn mix_colors(
    clouds: Res<RenderClouds>,
    scenes: Res<GpuScenes>,
    wishes: Res<RenderColors>,
    masks: Res<RenderMasks>,
    mut colors: ResMut<ShownColors>,
    mut mixer: ResMut<Mixer>,
    pipelines: Res<PipelinesReady>,
    synchronous: Res<SynchronousCompilation>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    mut context: RenderContext,
) {
    if colors.settled && !colors.is_changed() && !masks.is_changed() {
        return;
    }
    let (device, queue) = (device.wgpu_device(), &**queue);
    let diagnostics = context.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let mut is_begun = false;
    for (entity, wish) in &wishes.0 {
        let Some(cloud) = clouds.0.get(entity) else { continue };
        let Some(scene) = scenes.get(&cloud.scene) else {
            // Asked again once it is uploaded. A scene that the device refuses changes nothing any more.
            colors.settled &= colors.is_current(*entity, wish, None);
            continue;
        };
        let (mask, revision) = masks.get(*entity, scene.n_gaussians()).unzip();
        if !colors.is_current(*entity, wish, revision) {
            let shown = match colors.way(&wish.layers) {
                Way::Wait => {
                    colors.settled = false;
                    continue;
                }
                Way::Captured => Shown::Captured,
                Way::Style(style) => Shown::Style(style),
                Way::Mix => {
                    let Some(mixer) = mixer.get(*synchronous, device) else {
                        colors.settled = false;
                        continue;
                    };
                    if !std::mem::replace(&mut is_begun, true) {
                        mixer.begin_submission();
                    }
                    let own = colors.own_buffer(*entity, device, scene.n_gaussians());
                    let Some((target, mut mixed)) = own else { continue };
                    let encoder = context.command_encoder();
                    let span = diagnostics.time_span(encoder, "mix_layers");
                    let mut gpu = Gpu { device, queue, encoder, mixer: &mixer, mask };
                    gpu.mix(scene, &mut colors, &wish.layers, &target, &mut mixed);
                    span.end(context.command_encoder());
                    Shown::Mixed(target, mixed)
                }
            };
            colors.show(*entity, wish, shown, revision);
        }
        match pipelines.0 {
            true => wish.mark_drawn(),
            false => colors.settled = false,
        }
    }
}

impl ShownColors {
    /// The way to show layers.
    fn way(&self, layers: &[ColorLayer]) -> Way {
        if !self.are_complete(layers) {
            return Way::Wait;
        }
        match layers {
            [] => Way::Captured,
            [only] if only.covers_all() => match &only.colors {
                LayerColors::Captured => Way::Captured,
                LayerColors::Style(style) => self.style(style).cloned().map_or(Way::Wait, Way::Style),
                LayerColors::Mix(_) => Way::Mix,
            },
            _ => Way::Mix,
        }
    }

    /// Whether all styles of layers are there.
    fn are_complete(&self, layers: &[ColorLayer]) -> bool {
        layers.iter().all(|layer| match &layer.colors {
            LayerColors::Captured => true,
            LayerColors::Style(style) => self.style(style).is_some(),
            LayerColors::Mix(mix) => self.are_complete(&mix.layers()),
        })
    }
}

impl Gpu<'_> {
    /// Mixes layers into `target`, the mixes among them first.
    fn mix(
        &mut self,
        scene: &GpuScene,
        colors: &mut ShownColors,
        layers: &[ColorLayer],
        target: &GaussianColors,
        mixed: &mut MixedLayers,
    ) {
        for layer in layers {
            let LayerColors::Mix(inner) = &layer.colors else { continue };
            if !colors.mixes.contains_key(&address(inner)) {
                let Some(buffer) = colors.buffer(self.device, scene.n_gaussians()) else { continue };
                self.mix(scene, colors, &inner.layers(), &buffer, &mut MixedLayers::default());
                inner.forget_layers();
                colors.mixes.insert(address(inner), (Arc::downgrade(inner), buffer));
            }
        }
        let gpu_layers: Vec<GpuLayer> = layers
            .iter()
            // Nothing is painted on what has no mask. A mask has four channels.
            .filter(|layer| layer.mask.is_none_or(|channel| channel < 4 && self.mask.is_some()))
            .map(|layer| GpuLayer {
                look: match &layer.colors {
                    LayerColors::Captured => None,
                    LayerColors::Style(style) => colors.style(style),
                    LayerColors::Mix(mix) => colors.mixes.get(&address(mix)).map(|(_, buffer)| buffer),
                },
                strokes: None,
                region: layer.region,
                strength: layer.strength,
                mask: self.mask.zip(layer.mask),
            })
            .collect();
        self.mixer.encode(self.device, self.queue, self.encoder, scene, &gpu_layers, target, mixed);
    }
}
