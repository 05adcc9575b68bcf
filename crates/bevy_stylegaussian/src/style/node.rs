//! The style pass: once for each change of a look, before any camera draws.

use std::{sync::Arc, time::Duration};

use bevy::{
    platform::collections::{HashMap, hash_map::Entry},
    prelude::*,
    render::{
        renderer::{RenderAdapterInfo, RenderContext, RenderDevice, RenderQueue},
        sync_world::MainEntity,
    },
};
use stylegaussian_gpu::{
    device::is_software,
    style::{self, GpuDecoder, StyleInputs, StylePass, StyleProgress, StyleScene},
};

use crate::{
    pipeline::{AtOnce, Built},
    splats::{RenderCloud, RenderClouds},
};

use super::{
    event::StylePassCount,
    look::{FoldedStyle, GpuReport, GpuReports, LookColors},
    looks::{CloudLook, CloudLooks, LookClock},
    settings::StyleBudget,
};

/// The pipelines of the style pass, and the scenes that it runs on, by the address of their packed inputs.
#[derive(Resource, Default)]
pub(super) struct StylePasses {
    pass: Option<Built<Arc<StylePass>>>,
    scenes: HashMap<usize, StyledScene>,
    /// What a frame may take.
    budget: Option<style::WorkMeter>,
    /// Whether every look is up to date; not on a new device, nor while one is under way or waits for the pipelines.
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
    /// The look that is decoded from it: one at a time, since they share scratch memory.
    under_way: Option<UnderWay>,
}

/// A look that may take several frames.
struct UnderWay {
    entity: MainEntity,
    generation: u64,
    // Not kept from style to style: two entities may change in one frame, and weights are written before either runs.
    weights: GpuDecoder,
    progress: StyleProgress,
    /// The look's buffer that it is decoded into.
    buffer: usize,
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
    budget: Res<StyleBudget>,
    adapter: Res<RenderAdapterInfo>,
    mut context: RenderContext,
) {
    passes.release_scratch(clock.0);
    if passes.settled && !clouds.is_changed() {
        return;
    }
    looks.0.retain(|entity, _| clouds.0.contains_key(entity));
    passes.forget_unused(&clouds);
    passes.begin_frame(device.wgpu_device(), &queue, &adapter, budget.ms_per_frame);
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
            LookColors::Captured => Ok(None),
            LookColors::Rgb(rgb) => upload(device, &queue, look, rgb, cloud.fade).map(Some),
            LookColors::Folded(style) => {
                let Some(pass) = passes.pass(at_once.0, device) else {
                    passes.settled = false;
                    continue;
                };
                let mut gpu = Gpu { device, queue: &queue, encoder: context.command_encoder() };
                let advanced = passes.advance(&pass, &mut gpu, (entity, cloud), style, look);
                if advanced.is_ok() {
                    passes.ran = Some(clock.0);
                }
                match advanced {
                    Ok(None) => {
                        passes.settled = false;
                        continue;
                    }
                    Ok(Some(index)) => {
                        count.add_one();
                        reports.push(GpuReport::Styled { entity: entity.id(), generation });
                        Ok(Some(index))
                    }
                    Err(reason) => Err(reason),
                }
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
    let index = look.next(look.fades(fade));
    let colors = look.buffer(device, index).map_err(|error| error.to_string())?;
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

    /// Grants what a frame may take.
    fn begin_frame(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        adapter: &wgpu::AdapterInfo,
        ms_per_frame: f32,
    ) {
        let budget = self.budget.get_or_insert_with(|| {
            let budget = style::WorkMeter::new(ms_per_frame);
            if is_software(adapter) { budget } else { budget.timed(device, queue) }
        });
        budget.ms_per_frame = ms_per_frame;
        budget.begin_frame();
    }

    /// Encodes as much of an entity's next look as the budget allows. Gives the look's buffer once it is complete.
    fn advance(
        &mut self,
        pass: &StylePass,
        gpu: &mut Gpu,
        (entity, cloud): (MainEntity, &RenderCloud),
        style: &FoldedStyle,
        look: &mut CloudLook,
    ) -> Result<Option<usize>, String> {
        let Some(budget) = &mut self.budget else { return Ok(None) };
        let styled = match self.scenes.entry(Arc::as_ptr(&style.inputs).addr()) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => entry.insert(StyledScene {
                inputs: Arc::clone(&style.inputs),
                scene: StyleScene::upload(gpu.device, gpu.queue, &style.inputs).map_err(text)?,
                under_way: None,
            }),
        };
        let mut under_way = match styled.under_way.take() {
            Some(under_way) if under_way.entity == entity => under_way,
            Some(of_another) => {
                styled.under_way = Some(of_another);
                return Ok(None);
            }
            None => UnderWay {
                entity,
                generation: cloud.look.generation,
                weights: GpuDecoder::new(gpu.device, gpu.queue, &style.layers).map_err(text)?,
                progress: StyleProgress::default(),
                // What is shown stays until all of it is replaced.
                buffer: look.next(look.fades(cloud.fade) || budget.is_limited()),
            },
        };
        let UnderWay { weights, progress, buffer, .. } = &mut under_way;
        let buffer = *buffer;
        let colors = look.buffer(gpu.device, buffer).map_err(text)?;
        pass.encode_some(gpu.device, gpu.encoder, &styled.scene, weights, colors, progress, budget)
            .map_err(text)?;
        if progress.is_done() {
            return Ok(Some(buffer));
        }
        styled.under_way = Some(under_way);
        Ok(None)
    }

    /// Gives back what only style passes need, once there was none for a while.
    fn release_scratch(&mut self, now: Duration) {
        if self.ran.is_some_and(|ran| now > ran + SCRATCH_IS_KEPT) {
            self.scenes.values().for_each(|scene| scene.scene.release_scratch());
            self.ran = None;
        }
    }

    /// Lets go of scenes that no look is decoded from, and of looks under way that nobody wants any more.
    fn forget_unused(&mut self, clouds: &RenderClouds) {
        let wants = |cloud: &RenderCloud, scene: &StyledScene| match &cloud.look.colors {
            LookColors::Folded(style) => Arc::ptr_eq(&style.inputs, &scene.inputs),
            _ => false,
        };
        self.scenes.retain(|_, scene| {
            let is_wanted = |under_way: &UnderWay| {
                let cloud = clouds.0.get(&under_way.entity);
                cloud.is_some_and(|c| wants(c, scene) && c.look.generation == under_way.generation)
            };
            if !scene.under_way.as_ref().is_some_and(is_wanted) {
                scene.under_way = None;
            }
            clouds.0.values().any(|cloud| wants(cloud, scene))
        });
    }
}

fn text(error: impl std::error::Error) -> String {
    error.to_string()
}
