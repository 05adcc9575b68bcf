//! The style pass: decodes folded styles on the GPU, once for each change, before any camera draws.

use std::{
    sync::{Arc, Weak},
    time::Duration,
};

use bevy::{platform::time::Instant, prelude::*, render::renderer::RenderAdapterInfo};
use stylegaussian_gpu::{
    colors::GaussianColors,
    device::is_software,
    style::{GpuDecoder, StyleInputs, StylePass, StyleProgress, StyleScene, WorkMeter},
};

use crate::{
    colors::{ColorSource, FoldedStyle, ShownColors, StyleColors},
    commands::GpuCommands,
    style::wish::settings::StyleBudget,
    work::{Background, SynchronousCompilation},
};

/// Time for which scratch memory is kept after a style pass. While a slider is dragged, the next pass follows
/// soon.
const SCRATCH_IS_KEPT: Duration = Duration::from_secs(2);

/// The style pass on the present device.
#[derive(Resource, Default)]
pub(crate) struct StylePasses {
    /// The pipelines, or `None` if none were needed yet.
    // Shared, because `advance` borrows all of `self` while it encodes with the pass.
    pass: Option<Background<Arc<StylePass>>>,
    scenes: Vec<StyledScene>,
    /// Measures the work of each frame against the [`StyleBudget`].
    meter: Option<WorkMeter>,
    /// Whether all wishes are fulfilled. False on a new device, and while a style is under way or waits for
    /// pipelines.
    settled: bool,
    /// Time of the last style pass, or `None` if its scratch memory was released.
    last_run: Option<Instant>,
    /// Styles that were decoded completely.
    #[cfg(test)]
    pub(crate) n_decoded: u64,
}

/// A scene whose features are on the GPU.
struct StyledScene {
    /// The features that were uploaded. The weak reference keeps their address from being used again.
    inputs: Weak<StyleInputs>,
    scene: StyleScene,
    /// The style that is being decoded: one at a time, since styles of one scene share scratch memory.
    under_way: Option<UnderWay>,
}

/// A style that may take several frames.
struct UnderWay {
    style: Arc<StyleColors>,
    /// The colors that it is decoded into. Nobody sees them before they are complete.
    target: GaussianColors,
    // Every style has its own weights: two may be decoded in one frame, and all weights are written before it
    // runs.
    weights: GpuDecoder,
    progress: StyleProgress,
}

/// Decodes the folded styles that are wanted. Does nothing if nothing changed.
pub(crate) fn decode_styles(
    mut colors: ResMut<ShownColors>,
    mut passes: ResMut<StylePasses>,
    synchronous: Res<SynchronousCompilation>,
    budget: Res<StyleBudget>,
    adapter: Res<RenderAdapterInfo>,
    mut gpu: GpuCommands,
) {
    // Before the early return: memory is released in frames in which nothing changes.
    passes.release_scratch();
    // `ShownColors` changes with every wish and every scene.
    if passes.settled && !colors.is_changed() {
        return;
    }
    // Before anything is encoded, so that a style that nobody wants any more does not hold up its scene.
    passes.forget_unwanted();
    // The app may change its budget at any time, so each frame gets the present one.
    passes.begin_frame(gpu.device(), &gpu.queue, &adapter, budget.ms_per_frame);
    passes.settled = true;
    for (style, target) in colors.to_decode() {
        let ColorSource::Folded(folded) = &style.source else { continue };
        let Some(pass) = passes.pass(*synchronous, gpu.device()) else {
            // Without pipelines there is nothing to do for the other styles either.
            passes.settled = false;
            return;
        };
        match passes.advance(&pass, &mut gpu, &style, folded, &target) {
            Ok(is_complete) => {
                passes.ran(is_complete);
                if is_complete {
                    colors.decoded(&style, Ok(()));
                }
            }
            Err(reason) => colors.decoded(&style, Err(reason)),
        }
    }
}

impl StylePasses {
    /// The pipelines, or `None` while they are compiled. The first call starts that.
    fn pass(&mut self, synchronous: SynchronousCompilation, device: &wgpu::Device) -> Option<Arc<StylePass>> {
        let device = device.clone();
        let compile = move || Arc::new(StylePass::new(&device));
        self.pass.get_or_insert_with(|| Background::start(synchronous, compile)).get().cloned()
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

    /// Encodes as much of a style as the budget allows. Returns whether it is complete.
    fn advance(
        &mut self,
        pass: &StylePass,
        gpu: &mut GpuCommands,
        style: &Arc<StyleColors>,
        folded: &FoldedStyle,
        target: &GaussianColors,
    ) -> Result<bool, String> {
        let Some(meter) = &mut self.meter else { return Ok(false) };
        let inputs = &folded.inputs;
        // A short list: one entry per scene and decoder that is styled. Equal `Arc`s mean equal features on the
        // GPU.
        let index = match self.scenes.iter().position(|scene| is_same(&scene.inputs, inputs)) {
            Some(index) => index,
            None => {
                let scene = StyleScene::upload(gpu.device(), &gpu.queue, inputs).map_err(text)?;
                self.scenes.push(StyledScene { inputs: Arc::downgrade(inputs), scene, under_way: None });
                self.scenes.len() - 1
            }
        };
        let styled = &mut self.scenes[index];
        // Taken out, so that an error on the way drops it.
        let mut under_way = match styled.under_way.take() {
            Some(under_way) if Arc::ptr_eq(&under_way.style, style) => under_way,
            // Not an error: this style's turn comes once the other one is complete.
            Some(of_another) => {
                styled.under_way = Some(of_another);
                return Ok(false);
            }
            None => UnderWay {
                style: Arc::clone(style),
                target: target.clone(),
                weights: GpuDecoder::new(gpu.device(), &gpu.queue, &folded.layers).map_err(text)?,
                progress: StyleProgress::default(),
            },
        };
        let UnderWay { weights, progress, target, .. } = &mut under_way;
        let encoded = gpu.timed("style_pass", |gpu| {
            pass.encode_some(gpu.device, gpu.encoder, &styled.scene, weights, target, progress, meter)
        });
        encoded.map_err(text)?;
        if progress.is_done() {
            return Ok(true);
        }
        styled.under_way = Some(under_way);
        Ok(false)
    }

    /// Notes that the pass ran, and whether a style is complete.
    fn ran(&mut self, is_complete: bool) {
        self.last_run = Some(Instant::now());
        self.settled &= is_complete;
        #[cfg(test)]
        {
            self.n_decoded += u64::from(is_complete);
        }
    }

    /// Frees the scratch memory if no style pass ran for a while.
    fn release_scratch(&mut self) {
        // By the clock and not by frames: a slow adapter would otherwise free and allocate for each step of a
        // slider.
        if self.last_run.is_some_and(|last_run| last_run.elapsed() > SCRATCH_IS_KEPT) {
            self.scenes.iter().for_each(|scene| scene.scene.release_scratch());
            self.last_run = None;
        }
    }

    /// Frees scenes whose styles nobody keeps any more, and drops styles under way that nobody wants.
    fn forget_unwanted(&mut self) {
        // A scene stays while any of its folded styles does, also if that style is complete: the next one needs
        // the same features.
        self.scenes.retain_mut(|scene| {
            // One reference is that of the style under way itself.
            if scene.under_way.as_ref().is_some_and(|under_way| Arc::strong_count(&under_way.style) == 1) {
                scene.under_way = None;
            }
            scene.inputs.strong_count() > 0
        });
    }
}

/// Whether features on the GPU are these.
fn is_same(on_gpu: &Weak<StyleInputs>, inputs: &Arc<StyleInputs>) -> bool {
    std::ptr::eq(on_gpu.as_ptr(), Arc::as_ptr(inputs))
}

// Reports cross to the main world, which knows no errors of the GPU crate.
fn text(error: impl std::error::Error) -> String {
    error.to_string()
}
