//! The mix of each entity's layers.

use std::sync::Arc;

use bevy::prelude::*;
use stylegaussian_gpu::{
    colors::GaussianColors,
    device::GpuEncoder,
    layers::{GaussianMask, GpuLayer, LayerMixer, MixedLayers, StrokeMix},
    splat::GpuScene,
    strokes::GaussianStrokes,
};

use crate::{
    commands::GpuCommands,
    mask::RenderMasks,
    scene::{GpuScenes, RenderClouds},
    work::{Background, SynchronousCompilation},
};

use super::{
    extract::RenderColors,
    layers::{ColorLayer, LayerColors},
    shown::{FrozenMix, PipelinesReady, Shown, ShownColors, address},
};

/// The kernels on the present device, or `None` if they were not needed yet.
#[derive(Resource, Default)]
pub(crate) struct Mixer {
    of_colors: Option<Background<Arc<LayerMixer>>>,
    /// The kernel for strokes, which is a part of the mixer.
    of_strokes: Option<Background<()>>,
}

impl Mixer {
    /// The kernels, that for strokes too if `has_strokes`, or `None` while they are compiled. The first call
    /// starts that.
    fn get(
        &mut self,
        synchronous: SynchronousCompilation,
        device: &wgpu::Device,
        has_strokes: bool,
    ) -> Option<Arc<LayerMixer>> {
        let compile = {
            let device = device.clone();
            move || Arc::new(LayerMixer::new(&device))
        };
        let mixer = self.of_colors.get_or_insert_with(|| Background::start(synchronous, compile));
        let mixer = Arc::clone(mixer.get()?);
        if has_strokes {
            let compile = {
                let (device, mixer) = (device.clone(), Arc::clone(&mixer));
                move || mixer.prepare_strokes(&device)
            };
            self.of_strokes.get_or_insert_with(|| Background::start(synchronous, compile)).get()?;
        }
        Some(mixer)
    }
}

/// The mix of an entity's layers.
struct Mixing<'a, 'g> {
    gpu: &'a mut GpuEncoder<'g>,
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
    Style(GaussianColors, Option<GaussianStrokes>),
    /// Mixed.
    Mix,
}

/// Shows the layers that entities wish for. An entity whose layers are not complete keeps the colors that it
/// has.
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
    mut gpu: GpuCommands,
) {
    if colors.settled && !colors.is_changed() && !masks.is_changed() {
        return;
    }
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
                Way::Style(style, strokes) => Shown::Style(style, strokes),
                Way::Mix => {
                    let has_strokes = colors.have_strokes(&wish.layers);
                    let Some(mixer) = mixer.get(*synchronous, gpu.device(), has_strokes) else {
                        colors.settled = false;
                        continue;
                    };
                    if !std::mem::replace(&mut is_begun, true) {
                        mixer.begin_submission();
                    }
                    let own = colors.own_mix(*entity, gpu.device(), scene.n_gaussians());
                    let Some(mut own) = own else { continue };
                    let target = (&own.colors, &mut own.mixed, &mut own.strokes);
                    gpu.timed("mix_layers", |gpu| {
                        let mut mixing = Mixing { gpu, mixer: &mixer, mask };
                        mixing.mix(scene, &mut colors, &wish.layers, target);
                    });
                    Shown::Mixed(own)
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
                LayerColors::Style(style) => match self.style(style) {
                    Some((colors, strokes)) => {
                        Way::Style(colors.clone(), strokes.map(|strokes| strokes.moving(only.motion)))
                    }
                    None => Way::Wait,
                },
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

    /// Whether any of layers that are complete has strokes.
    fn have_strokes(&self, layers: &[ColorLayer]) -> bool {
        layers.iter().any(|layer| match &layer.colors {
            LayerColors::Captured => false,
            LayerColors::Style(style) => self.style(style).is_some_and(|(_, strokes)| strokes.is_some()),
            LayerColors::Mix(mix) => {
                let frozen = self.mixes.get(&address(mix));
                frozen.is_some_and(|(_, frozen)| frozen.strokes.is_some()) || self.have_strokes(&mix.layers())
            }
        })
    }
}

/// Where layers are mixed into.
type Target<'a> = (&'a GaussianColors, &'a mut MixedLayers, &'a mut StrokeMix);

impl Mixing<'_, '_> {
    /// Mixes layers into `target`, the mixes among them first.
    fn mix(
        &mut self,
        scene: &GpuScene,
        colors: &mut ShownColors,
        layers: &[ColorLayer],
        (target, mixed, strokes): Target,
    ) {
        for layer in layers {
            let LayerColors::Mix(inner) = &layer.colors else { continue };
            if !colors.mixes.contains_key(&address(inner)) {
                let Some(buffer) = colors.buffer(self.gpu.device, scene.n_gaussians()) else { continue };
                let mut strokes = StrokeMix::default();
                let target = (&buffer, &mut MixedLayers::default(), &mut strokes);
                self.mix(scene, colors, &inner.layers(), target);
                inner.forget_layers();
                let frozen = FrozenMix { colors: buffer, strokes: strokes.strokes().cloned() };
                colors.mixes.insert(address(inner), (Arc::downgrade(inner), frozen));
            }
        }
        let shown: Vec<_> = layers
            .iter()
            // Without a mask nothing is painted. A mask has four channels.
            .filter(|layer| layer.mask.is_none_or(|channel| channel < 4 && self.mask.is_some()))
            .map(|layer| {
                let (look, strokes) = match &layer.colors {
                    LayerColors::Captured => (None, None),
                    LayerColors::Style(style) => colors.style(style).unzip(),
                    LayerColors::Mix(mix) => {
                        let mix = colors.mixes.get(&address(mix)).map(|(_, frozen)| frozen);
                        mix.map(|frozen| (&frozen.colors, frozen.strokes.as_ref())).unzip()
                    }
                };
                (layer, look, strokes.flatten().map(|strokes| strokes.moving(layer.motion)))
            })
            .collect();
        let gpu_layers: Vec<GpuLayer> = shown
            .iter()
            .map(|(layer, look, strokes)| GpuLayer {
                look: *look,
                strokes: strokes.as_ref(),
                region: layer.region,
                strength: layer.strength,
                mask: self.mask.zip(layer.mask),
                factors: layer.factors,
            })
            .collect();
        let Self { gpu, mixer, .. } = self;
        mixer.encode(gpu, scene, &gpu_layers, target, mixed);
        if let Err(error) = mixer.encode_strokes(gpu, scene, &gpu_layers, strokes) {
            warn_once!("mixed styles are shown without their strokes: {error}");
        }
    }
}
