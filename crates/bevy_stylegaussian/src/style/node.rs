//! The style pass: once for each change of a look, before any camera draws.

use std::{sync::Arc, time::Duration};

use bevy::{
    platform::collections::{HashMap, hash_map::Entry},
    prelude::*,
    render::renderer::{RenderContext, RenderDevice, RenderQueue},
};
use stylegaussian_gpu::{
    colors::GaussianColors,
    style::{GpuDecoder, StyleInputs, StylePass, StyleScene, StyleSceneError},
};

use crate::{
    pipeline::{AtOnce, Built},
    splats::RenderClouds,
};

use super::{
    event::StylePassCount,
    look::{FoldedStyle, GpuReport, GpuReports, LookColors},
    looks::{CloudLook, CloudLooks, LookClock},
};

/// The pipelines of the style pass, and the scenes that it runs on, by the address of their packed inputs.
#[derive(Resource, Default)]
pub(super) struct StylePasses {
    pass: Option<Built<Arc<StylePass>>>,
    scenes: HashMap<usize, StyledScene>,
    /// Whether every look is up to date; not on a new device, nor while one waits for the pipelines.
    settled: bool,
    /// When the last style pass ran, while its scratch memory is kept.
    ran: Option<Duration>,
}

/// How long the memory that only style passes need is kept after the last: a slider that is dragged keeps asking.
const SCRATCH_IS_KEPT: Duration = Duration::from_secs(2);

struct StyledScene {
    /// Keeps the address taken.
    inputs: Arc<StyleInputs>,
    scene: StyleScene,
}

/// What a look needs of the renderer.
struct Gpu<'a> {
    device: &'a wgpu::Device,
    queue: &'a wgpu::Queue,
    encoder: &'a mut wgpu::CommandEncoder,
}

/// Brings each cloud's look up to date: uploads colors, runs style passes. Does nothing where nothing changed.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(super) fn update_looks(
    clouds: Res<RenderClouds>,
    mut looks: ResMut<CloudLooks>,
    mut passes: ResMut<StylePasses>,
    at_once: Res<AtOnce>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    clock: Res<LookClock>,
    reports: Res<GpuReports>,
    count: Res<StylePassCount>,
    mut context: RenderContext,
) {
    passes.release_scratch(clock.0);
    if passes.settled && !clouds.is_changed() {
        return;
    }
    looks.0.retain(|entity, _| clouds.0.contains_key(entity));
    passes.forget_unused(&clouds);
    passes.settled = true;
    for (&entity, cloud) in &clouds.0 {
        let look = looks.0.entry(entity).or_default();
        look.fit(&cloud.scene);
        let generation = cloud.look.generation;
        if look.generation == Some(generation) {
            continue;
        }
        let device = device.wgpu_device();
        let shown = match &cloud.look.colors {
            LookColors::Own => Ok(None),
            LookColors::Rgb(rgb) => upload(device, &queue, look, rgb, cloud.fade).map(Some),
            LookColors::Folded(style) => {
                let Some(pass) = passes.pass(at_once.0, device) else {
                    passes.settled = false;
                    continue;
                };
                let mut gpu = Gpu { device, queue: &queue, encoder: context.command_encoder() };
                let decoded = passes.decode(&pass, &mut gpu, style, look, cloud.fade);
                if decoded.is_ok() {
                    passes.ran = Some(clock.0);
                    count.add_one();
                    reports.push(GpuReport::Styled { entity: entity.id(), generation });
                }
                decoded.map(Some)
            }
        };
        match shown {
            Ok(index) => look.show(index, cloud.fade, clock.0, generation),
            Err(reason) => {
                look.generation = Some(generation);
                reports.push(GpuReport::StyleRefused { entity: entity.id(), generation, reason });
            }
        }
    }
}

/// Puts colors that are known into the look's next buffer, whose index it gives.
fn upload(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    look: &mut CloudLook,
    rgb: &[[f32; 3]],
    fade: Duration,
) -> Result<usize, String> {
    let (index, colors) = look.next(device, fade).map_err(|error| error.to_string())?;
    if colors.n_gaussians() != rgb.len() {
        return Err(format!("{} colors for {} Gaussians", rgb.len(), colors.n_gaussians()));
    }
    colors.write(queue, rgb);
    Ok(index)
}

impl StylePasses {
    /// The pipelines, once they are built; the first call starts that.
    fn pass(&mut self, at_once: bool, device: &wgpu::Device) -> Option<Arc<StylePass>> {
        let device = device.clone();
        let pass =
            self.pass.get_or_insert_with(|| Built::start(at_once, move || Arc::new(StylePass::new(&device))));
        pass.poll().cloned()
    }

    /// Encodes a style pass into the look's next buffer, whose index it gives.
    fn decode(
        &mut self,
        pass: &StylePass,
        gpu: &mut Gpu,
        style: &FoldedStyle,
        look: &mut CloudLook,
        fade: Duration,
    ) -> Result<usize, String> {
        let (index, colors) = look.next(gpu.device, fade).map_err(|error| error.to_string())?;
        self.encode(pass, gpu, style, colors).map_err(|error| error.to_string())?;
        Ok(index)
    }

    fn encode(
        &mut self,
        pass: &StylePass,
        gpu: &mut Gpu,
        style: &FoldedStyle,
        colors: &GaussianColors,
    ) -> Result<(), StyleSceneError> {
        let scene = match self.scenes.entry(Arc::as_ptr(&style.inputs).addr()) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => entry.insert(StyledScene {
                inputs: Arc::clone(&style.inputs),
                scene: StyleScene::upload(gpu.device, gpu.queue, &style.inputs)?,
            }),
        };
        // Not kept from style to style: two entities may change in one frame, and weights are written before either runs.
        let weights = GpuDecoder::new(gpu.device, gpu.queue, &style.layers)?;
        pass.encode(gpu.device, gpu.encoder, &scene.scene, &weights, colors)?;
        Ok(())
    }

    /// Gives back what only style passes need, once there was none for a while.
    fn release_scratch(&mut self, now: Duration) {
        if self.ran.is_some_and(|ran| now > ran + SCRATCH_IS_KEPT) {
            self.scenes.values().for_each(|scene| scene.scene.release_scratch());
            self.ran = None;
        }
    }

    /// Lets go of scenes that no look is decoded from.
    fn forget_unused(&mut self, clouds: &RenderClouds) {
        self.scenes.retain(|_, scene| {
            clouds.0.values().any(|cloud| match &cloud.look.colors {
                LookColors::Folded(style) => Arc::ptr_eq(&style.inputs, &scene.inputs),
                _ => false,
            })
        });
    }
}
