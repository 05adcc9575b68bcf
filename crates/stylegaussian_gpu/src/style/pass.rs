//! The style pass as a whole: its pipelines, and the buffers of each dispatch.

use std::sync::atomic::{AtomicU64, Ordering};

use stylegaussian::Activation;
use stylegaussian_shaders::style::KnnLayer;

use super::{
    error::StyleSceneError,
    options::Precision,
    pipelines::{N_STORAGE, Pipelines},
    plan::{Step, StepKind},
    scene::StyleScene,
    scratch::Scratch,
    weights::GpuDecoder,
    work_meter::{StyleProgress, WorkMeter},
};
use crate::{bindings::stride, colors::GaussianColors};

/// The pipelines of the style pass on one device.
#[derive(Debug)]
pub struct StylePass {
    pipelines: Pipelines,
    precision: Precision,
    dispatches: AtomicU64,
}

impl StylePass {
    /// Compiles the kernels for scenes of the default [`Precision`].
    pub fn new(device: &wgpu::Device) -> Self {
        Self::with_precision(device, Precision::default())
    }

    /// Compiles the kernels for scenes of `precision`.
    pub fn with_precision(device: &wgpu::Device, precision: Precision) -> Self {
        Self { pipelines: Pipelines::new(device, precision), precision, dispatches: AtomicU64::new(0) }
    }

    /// The number of dispatches encoded so far. A frame in which nothing changed adds none.
    pub fn dispatches(&self) -> u64 {
        self.dispatches.load(Ordering::Relaxed)
    }

    /// Encodes the decoder's layers on `scene`. The result replaces `colors`. Returns the number of dispatches.
    ///
    /// # Errors
    /// If the weights or the colors do not fit the scene.
    pub fn encode(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        scene: &StyleScene,
        weights: &GpuDecoder,
        colors: &GaussianColors,
    ) -> Result<u64, StyleSceneError> {
        let (mut progress, mut budget) = (StyleProgress::default(), WorkMeter::unlimited());
        self.encode_some(device, encoder, scene, weights, colors, &mut progress, &mut budget)
    }

    /// Encodes a part of [`encode`](Self::encode), from `progress` on, with the operations that are left in
    /// this frame's `budget`. Unless the budget is spent, that is at least 128 Gaussians of a layer. Returns
    /// the number of dispatches.
    ///
    /// All parts of one change need the same scene, weights and colors, and must be submitted in order. No
    /// other change of the same scene may come between them. Colors appear block by block: do not show the
    /// buffer before [`StyleProgress::is_done`].
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    #[expect(clippy::too_many_arguments, reason = "two of them are wgpu's own at every call")]
    pub fn encode_some(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        scene: &StyleScene,
        weights: &GpuDecoder,
        colors: &GaussianColors,
        progress: &mut StyleProgress,
        budget: &mut WorkMeter,
    ) -> Result<u64, StyleSceneError> {
        self.check(scene, weights, colors)?;
        let Some(operations) = budget.left() else { return Ok(0) };
        let steps = progress.take(&scene.steps(), operations);
        if steps.is_empty() {
            return Ok(0);
        }
        let timing = budget.grant(steps.iter().map(Step::operations).sum());
        let scratch = scene.scratch(device);
        let parameters = self.pipelines.parameters(device, &steps, weights);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("style_pass"),
            timestamp_writes: timing.and_then(|timing| budget.timestamps(timing)),
        });
        for (i, step) in steps.iter().enumerate() {
            let buffers = step_buffers(scene, &scratch, weights, colors, step);
            let bind_group = self.pipelines.bind_group(device, &parameters, &buffers);
            pass.set_pipeline(self.pipelines.of(step));
            pass.set_bind_group(0, &bind_group, &[(i * stride::<KnnLayer>()) as u32]);
            pass.dispatch_workgroups(step.workgroups[0], step.workgroups[1], 1);
        }
        drop(pass);
        if let Some(timing) = timing {
            budget.resolve(encoder, timing);
        }
        // Each part changes the colors, also if a change is not complete.
        colors.mark_changed();
        let n_dispatches = steps.len() as u64;
        self.dispatches.fetch_add(n_dispatches, Ordering::Relaxed);
        Ok(n_dispatches)
    }

    fn check(
        &self,
        scene: &StyleScene,
        weights: &GpuDecoder,
        colors: &GaussianColors,
    ) -> Result<(), StyleSceneError> {
        check(scene, weights, colors)?;
        if self.precision != scene.precision {
            let (found, expected) = (format!("{:?}", self.precision), format!("{:?}", scene.precision));
            return Err(StyleSceneError::Mismatch { what: "a precision", found, expected });
        }
        if scene.precision == Precision::Unorm8 && weights.activation != Activation::Sigmoid {
            let (found, expected) =
                (weights.activation.to_string(), "the sigmoid, to be kept as bytes".into());
            return Err(StyleSceneError::Mismatch { what: "an activation", found, expected });
        }
        Ok(())
    }
}

fn check(scene: &StyleScene, weights: &GpuDecoder, colors: &GaussianColors) -> Result<(), StyleSceneError> {
    let mismatch =
        |what, found: String, expected: String| StyleSceneError::Mismatch { what, found, expected };
    let shape = &scene.shape;
    let of_scene = (&shape.widths, shape.k, shape.residual, shape.smoothing_passes);
    let of_weights = (&weights.widths, weights.k, weights.residual != 0.0, weights.smoothing_passes);
    if of_scene != of_weights {
        let name = |(widths, k, residual, smoothing_passes): (&Vec<usize>, _, _, _)| {
            format!("widths {widths:?}, K {k}, residual {residual}, {smoothing_passes} smoothing passes")
        };
        return Err(mismatch("weights", name(of_weights), name(of_scene)));
    }
    if colors.n_gaussians() != shape.n_gaussians {
        let name = |n: usize| format!("{n} Gaussians");
        return Err(mismatch("colors", name(colors.n_gaussians()), name(shape.n_gaussians)));
    }
    Ok(())
}

/// The buffers of one dispatch, in the order of their bindings, after the parameters.
fn step_buffers<'a>(
    scene: &'a StyleScene,
    scratch: &'a Scratch,
    weights: &'a GpuDecoder,
    colors: &'a GaussianColors,
    step: &Step,
) -> [wgpu::BufferBinding<'a>; N_STORAGE] {
    let block = &scene.blocks[step.block];
    // Smoothing passes go back and forth between two buffers. Counted from the end, so that the last one writes
    // the final colors.
    let colors_before = |smoothing_passes: usize| {
        if (scene.shape.smoothing_passes - smoothing_passes).is_multiple_of(2) {
            colors.buffer()
        } else {
            &scratch.colors
        }
    };
    let n_layers = scene.shape.n_layers();
    let input = match (step.layer, step.kind) {
        (layer, StepKind::SmoothingPass) => colors_before(layer - n_layers),
        (0, _) => scene.inputs.buffer(step.input),
        (layer, _) => scratch.activations[(layer - 1) % 2].buffer(step.input),
    };
    let output = match step.kind {
        StepKind::SmoothingPass => colors_before(step.layer - n_layers + 1),
        StepKind::Color => colors_before(0),
        StepKind::KnnConv(_) => scratch.activations[step.layer % 2].buffer(step.output),
    };
    [
        block.neighbors.binding(step.parameters.first_row, step.parameters.n_rows),
        // Smoothing passes read no weights, but the binding needs some buffer.
        weights.layer(step.layer.min(n_layers - 1)).as_entire_buffer_binding(),
        input.as_entire_buffer_binding(),
        output.as_entire_buffer_binding(),
        scratch.sums.as_entire_buffer_binding(),
        scene.base_colors.as_entire_buffer_binding(),
        block.gaussians.as_entire_buffer_binding(),
    ]
}
