//! The style pass: decodes folded styles on the GPU, once for each change, before any camera draws.

use std::{sync::Arc, time::Duration};

use bevy::{
    prelude::*,
    render::{
        diagnostic::{DiagnosticsRecorder, RecordDiagnostics},
        renderer::{RenderAdapterInfo, RenderContext, RenderDevice, RenderQueue},
        sync_world::MainEntity,
    },
};
use stylegaussian_gpu::{
    device::is_software,
    style::{GpuDecoder, StyleInputs, StylePass, StyleProgress, StyleScene, WorkMeter},
};

use crate::{
    background::{Background, SynchronousCompilation},
    colors::{ColorReport, ColorSource, EntityColors, FadeClock, FoldedStyle, RenderWishes, ShownColors},
    reports::Reports,
};

use super::settings::StyleBudget;

/// Time for which scratch memory is kept after a style pass. While a slider is dragged, the next pass follows soon.
const SCRATCH_IS_KEPT: Duration = Duration::from_secs(2);

/// The style pass on the present device.
#[derive(Resource, Default)]
pub(super) struct StylePasses {
    /// The pipelines, or `None` if none were needed yet.
    // Shared, because `advance` borrows all of `self` while it encodes with the pass.
    pass: Option<Background<Arc<StylePass>>>,
    scenes: Vec<StyledScene>,
    /// Measures the work of each frame against the [`StyleBudget`].
    meter: Option<WorkMeter>,
    /// Whether all wishes are fulfilled. False on a new device, and while a style is under way or waits for pipelines.
    settled: bool,
    /// Time of the last style pass, or `None` if its scratch memory was released.
    last_run: Option<Duration>,
    /// Styles that were decoded completely.
    #[cfg(test)]
    pub(super) n_decoded: u64,
}

/// A scene whose features are on the GPU.
struct StyledScene {
    inputs: Arc<StyleInputs>,
    scene: StyleScene,
    /// The style that is being decoded: one at a time, since styles of one scene share scratch memory.
    under_way: Option<UnderWay>,
}

/// A style that may take several frames.
struct UnderWay {
    entity: MainEntity,
    generation: u64,
    // Every style has its own weights: two entities may change in one frame, and all weights are written before it runs.
    weights: GpuDecoder,
    progress: StyleProgress,
    /// Index of the color buffer that it is decoded into.
    buffer: usize,
}

/// A wish for a folded style.
#[derive(Clone, Copy)]
struct FoldedWish<'a> {
    entity: MainEntity,
    generation: u64,
    style: &'a FoldedStyle,
    fade: Duration,
}

/// Access to the GPU while encoding.
struct Gpu<'a> {
    device: &'a wgpu::Device,
    queue: &'a wgpu::Queue,
    encoder: &'a mut wgpu::CommandEncoder,
    diagnostics: Option<&'a DiagnosticsRecorder>,
}

/// Decodes the folded styles that entities wish for. Does nothing if nothing changed.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(super) fn decode_styles(
    wishes: Res<RenderWishes>,
    mut colors: ResMut<ShownColors>,
    mut passes: ResMut<StylePasses>,
    synchronous: Res<SynchronousCompilation>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    clock: Res<FadeClock>,
    reports: Res<Reports<ColorReport>>,
    budget: Res<StyleBudget>,
    adapter: Res<RenderAdapterInfo>,
    mut context: RenderContext,
) {
    // Before the early return: memory is released in frames in which nothing changes.
    passes.release_scratch(clock.0);
    // `ShownColors` changes with every wish and every scene.
    if passes.settled && !colors.is_changed() {
        return;
    }
    let device = device.wgpu_device();
    // Before anything is encoded, so that a style that nobody wants any more does not hold up its scene.
    passes.forget_unwanted(&wishes, &colors);
    // The app may change its budget at any time, so each frame gets the present one.
    passes.begin_frame(device, &queue, &adapter, budget.ms_per_frame);
    passes.settled = true;
    let diagnostics = context.diagnostic_recorder();
    for (&entity, colors) in &mut colors.of_entity {
        let Some(wished) = wishes.0.get(&entity) else { continue };
        let (ColorSource::Folded(style), generation) = (&wished.wish.source, wished.wish.generation) else {
            continue;
        };
        if colors.generation == Some(generation) {
            continue;
        }
        let Some(pass) = passes.pass(*synchronous, device) else {
            // Without pipelines there is nothing to do for the other entities either.
            passes.settled = false;
            return;
        };
        let wish = FoldedWish { entity, generation, style, fade: wished.fade };
        let encoder = context.command_encoder();
        let mut gpu = Gpu { device, queue: &queue, encoder, diagnostics: diagnostics.as_deref() };
        let result = match passes.advance(&pass, &mut gpu, wish, colors) {
            Ok(None) => {
                passes.ran(clock.0, false);
                continue;
            }
            Ok(Some(index)) => {
                passes.ran(clock.0, true);
                colors.show(Some(index), wish.fade, clock.0, generation);
                Ok(())
            }
            Err(reason) => {
                // A refused wish counts as answered: it would fail in every frame.
                colors.generation = Some(generation);
                Err(reason)
            }
        };
        // Only for complete or refused styles: the main world waits for one answer per generation.
        reports.push(ColorReport { entity: entity.id(), generation, result });
    }
}

impl StylePasses {
    /// The pipelines, or `None` while they are compiled. The first call starts that.
    fn pass(&mut self, synchronous: SynchronousCompilation, device: &wgpu::Device) -> Option<Arc<StylePass>> {
        let device = device.clone();
        let compile = move || Arc::new(StylePass::new(&device));
        self.pass.get_or_insert_with(|| Background::start(synchronous, compile)).poll().cloned()
    }

    /// Grants a frame its budget.
    fn begin_frame(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        adapter: &wgpu::AdapterInfo,
        ms_per_frame: f32,
    ) {
        let meter = self.meter.get_or_insert_with(|| {
            let meter = WorkMeter::new(ms_per_frame);
            // Timestamps of a software adapter measure the load of the CPU, not the speed of the pass.
            if is_software(adapter) { meter } else { meter.timed(device, queue) }
        });
        meter.ms_per_frame = ms_per_frame;
        meter.begin_frame();
    }

    /// Encodes as much of an entity's style as the budget allows. Returns the index of its color buffer once it is complete.
    fn advance(
        &mut self,
        pass: &StylePass,
        gpu: &mut Gpu,
        wish: FoldedWish,
        colors: &mut EntityColors,
    ) -> Result<Option<usize>, String> {
        let Some(meter) = &mut self.meter else { return Ok(None) };
        let inputs = &wish.style.inputs;
        // A short list: one entry per scene and decoder that is styled. Equal `Arc`s mean equal features on the GPU.
        let index = match self.scenes.iter().position(|scene| Arc::ptr_eq(&scene.inputs, inputs)) {
            Some(index) => index,
            None => {
                let scene = StyleScene::upload(gpu.device, gpu.queue, inputs).map_err(text)?;
                self.scenes.push(StyledScene { inputs: Arc::clone(inputs), scene, under_way: None });
                self.scenes.len() - 1
            }
        };
        let styled = &mut self.scenes[index];
        // Taken out, so that an error on the way drops it.
        let mut under_way = match styled.under_way.take() {
            Some(under_way) if under_way.entity == wish.entity => under_way,
            // Not an error: the entity's turn comes once the other style is complete.
            Some(of_another) => {
                styled.under_way = Some(of_another);
                return Ok(None);
            }
            None => UnderWay {
                entity: wish.entity,
                generation: wish.generation,
                weights: GpuDecoder::new(gpu.device, gpu.queue, &wish.style.layers).map_err(text)?,
                progress: StyleProgress::default(),
                // The shown colors stay until all of them are replaced.
                buffer: colors.next_index(colors.fades(wish.fade) || meter.is_limited()),
            },
        };
        let UnderWay { weights, progress, buffer, .. } = &mut under_way;
        // Chosen once at the beginning: what is shown may change before the style is complete.
        let buffer = *buffer;
        let target = colors.buffer(gpu.device, buffer).map_err(text)?;
        let span = gpu.diagnostics.time_span(gpu.encoder, "style_pass");
        let encoded =
            pass.encode_some(gpu.device, gpu.encoder, &styled.scene, weights, target, progress, meter);
        // Ended before an early return: a span that is left open would be logged as an error.
        span.end(gpu.encoder);
        encoded.map_err(text)?;
        if progress.is_done() {
            return Ok(Some(buffer));
        }
        styled.under_way = Some(under_way);
        Ok(None)
    }

    /// Notes that the pass ran at `now`, and whether a style is complete.
    fn ran(&mut self, now: Duration, is_complete: bool) {
        self.last_run = Some(now);
        self.settled &= is_complete;
        #[cfg(test)]
        {
            self.n_decoded += u64::from(is_complete);
        }
    }

    /// Frees the scratch memory if no style pass ran for a while.
    fn release_scratch(&mut self, now: Duration) {
        // By the clock and not by frames: a slow adapter would otherwise free and allocate for each step of a slider.
        if self.last_run.is_some_and(|last_run| now > last_run + SCRATCH_IS_KEPT) {
            self.scenes.iter().for_each(|scene| scene.scene.release_scratch());
            self.last_run = None;
        }
    }

    /// Frees scenes that no wish is decoded from, and drops styles under way that nobody wishes for any more.
    fn forget_unwanted(&mut self, wishes: &RenderWishes, colors: &ShownColors) {
        let generation = |entity: &MainEntity, scene: &StyledScene| {
            let wish = &wishes.0.get(entity)?.wish;
            match &wish.source {
                ColorSource::Folded(style) if Arc::ptr_eq(&style.inputs, &scene.inputs) => {
                    Some(wish.generation)
                }
                _ => None,
            }
        };
        // A scene stays while any entity wishes for one of its styles, also if that style is complete: the next one
        // needs the same features.
        self.scenes.retain_mut(|scene| {
            let is_wanted = |under_way: &UnderWay| {
                colors.of_entity.contains_key(&under_way.entity)
                    && generation(&under_way.entity, scene) == Some(under_way.generation)
            };
            if !scene.under_way.as_ref().is_some_and(is_wanted) {
                scene.under_way = None;
            }
            colors.of_entity.keys().any(|entity| generation(entity, scene).is_some())
        });
    }
}

// Reports cross to the main world, which knows no errors of the GPU crate.
fn text(error: impl std::error::Error) -> String {
    error.to_string()
}
