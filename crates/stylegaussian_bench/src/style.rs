//! The style pass: a change of style from statistics to colors, its parts, and its memory.

use anyhow::Result;
use stylegaussian::{ChannelStatistics, Decoder, Scene};
use stylegaussian_gpu::{
    colors::GaussianColors,
    style::{
        FoldedLayers, GpuDecoder, StyleBytes, StyleInputs, StyleOptions, StylePass, StyleProgress,
        StyleScene, WorkMeter,
    },
};

use crate::{
    gpu::Gpu,
    measure::Samples,
    plan::Plan,
    report::{Report, Row, names},
    scenes::{self, N_CHANNELS, N_LOW, Random},
};

/// Measures every size.
pub fn run(gpu: &Gpu, plan: &Plan, report: &mut Report) -> Result<()> {
    let pass = StylePass::new(&gpu.device);
    for &n in plan.style_sizes() {
        let scene = scenes::embedded(n, N_LOW);
        let style = OnGpu::new(gpu, &scene, StyleOptions::default())?;
        change(gpu, &pass, &style, report)?;
        // The size of the comparison is measured in turns with the other methods.
        if n != plan.literal_size() {
            let samples = Samples::of(1, 3, || style.time(gpu, &pass))?;
            let (flops, bytes) = (Some(scenes::flops(n, N_LOW)), Some(style.bytes()));
            report.add(Row { flops, bytes, ..Row::new(names::STYLE_PASS, n, &samples) });
        }
        layers(gpu, &pass, &style, report)?;
        if !gpu.is_software() {
            budgeted(gpu, &pass, &style, report)?;
        }
    }
    if gpu.is_software() {
        report.not_run(&budgeted_name(), "an adapter that is a CPU does not tell how long its work took");
    }
    for (name, reason) in plan.left_out() {
        report.not_run(name, reason);
    }
    Ok(())
}

/// Bytes of a change of style for 300,000 Gaussians, the paper's largest scene, and for other sizes, computed
/// from real neighbor lists.
pub fn memory(plan: &Plan, report: &mut Report) -> Result<()> {
    let sizes: &[usize] = if plan.quick { &[300_000] } else { &[20_000, 100_000, 300_000] };
    for &n in sizes {
        let bytes =
            StyleBytes::of(&scenes::embedded(n, N_LOW), &scenes::decoder(), &StyleOptions::default())?;
        report.add(Row::of_memory(names::MEMORY, n, bytes.features + bytes.neighbors + bytes.activations));
    }
    Ok(())
}

/// A scene, a decoder's weights and colors on the GPU.
pub struct OnGpu {
    decoder: Decoder,
    scene: StyleScene,
    weights: GpuDecoder,
    colors: GaussianColors,
    bytes: StyleBytes,
    style: ChannelStatistics,
}

impl OnGpu {
    /// Uploads `scene` for decoding with `options`.
    pub fn new(gpu: &Gpu, scene: &Scene, options: StyleOptions) -> Result<Self> {
        let Gpu { device, queue, .. } = gpu;
        let decoder = scenes::decoder();
        let inputs = StyleInputs::with_options(scene, &decoder, options)?;
        let on_gpu = StyleScene::upload(device, queue, &inputs)?;
        let mut random = Random::new();
        let style = ChannelStatistics {
            mean: random.many(N_CHANNELS, 1.0),
            std_dev: (0..N_CHANNELS).map(|_| 0.5 + random.next()).collect(),
            covariance: None,
            encoder: None,
        };
        let weights = GpuDecoder::new(device, queue, &folded(inputs.content(), &decoder, &style)?)?;
        let colors = GaussianColors::new(device, scene.len())?;
        let bytes = StyleBytes::of(scene, &decoder, &options)?;
        Ok(Self { decoder, scene: on_gpu, weights, colors, bytes, style })
    }

    fn n(&self) -> usize {
        self.scene.n_gaussians()
    }

    /// Bytes on the GPU, without colors.
    pub fn bytes(&self) -> u64 {
        self.bytes.total()
    }

    /// Milliseconds that all layers take.
    pub fn time(&self, gpu: &Gpu, pass: &StylePass) -> Result<f64> {
        let Self { scene, weights, colors, .. } = self;
        gpu.time(|encoder| Ok(pass.encode(&gpu.device, encoder, scene, weights, colors).map(drop)?))
    }
}

fn folded(
    content: &stylegaussian_gpu::style::ContentFold,
    decoder: &Decoder,
    style: &ChannelStatistics,
) -> Result<FoldedLayers> {
    Ok(FoldedLayers::new(content, decoder, &content.transfer(&[(style, 1.0)], 0.0)?)?)
}

/// Measures a change of style from statistics to colors: fold, upload, decode.
fn change(gpu: &Gpu, pass: &StylePass, style: &OnGpu, report: &mut Report) -> Result<()> {
    let fold = Samples::wall(1, 5, || folded(style.scene.content(), &style.decoder, &style.style).map(drop))?;
    report.add(Row::new("fold", style.n(), &fold));
    let change = Samples::wall(1, 3, || {
        let folded = folded(style.scene.content(), &style.decoder, &style.style)?;
        let weights = GpuDecoder::new(&gpu.device, &gpu.queue, &folded)?;
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        pass.encode(&gpu.device, &mut encoder, &style.scene, &weights, &style.colors)?;
        gpu.queue.submit([encoder.finish()]);
        gpu.wait()
    })?;
    let flops = Some(scenes::flops(style.n(), N_LOW));
    let bytes = Some(style.bytes());
    report.add(Row { flops, bytes, ..Row::new("change of style, from statistics", style.n(), &change) });
    Ok(())
}

/// Measures each layer alone. For a scene in blocks, the sum over its blocks.
fn layers(gpu: &Gpu, pass: &StylePass, style: &OnGpu, report: &mut Report) -> Result<()> {
    const RUNS: usize = 3;
    let operations = style.scene.operations();
    let mut ms = vec![[0.0; 5]; RUNS];
    for ms in &mut ms {
        let mut progress = StyleProgress::default();
        for (i, &operations) in operations.iter().enumerate() {
            let OnGpu { scene, weights, colors, .. } = style;
            let (device, progress) = (&gpu.device, &mut progress);
            let budget = &mut WorkMeter::of_operations(operations);
            // Five layers for each block, block after block.
            ms[i % 5] += gpu.time(|encoder| {
                pass.encode_some(device, encoder, scene, weights, colors, progress, budget)?;
                Ok(())
            })?;
        }
    }
    let moved = moved_by_layers(N_LOW);
    for (i, flops) in scenes::flops_of_layers(N_LOW).into_iter().enumerate() {
        let samples = Samples { ms: ms.iter().map(|of_run| of_run[i]).collect(), cpu_ms: None };
        let of_all = |of_one: u64| Some(style.n() as u64 * of_one);
        let name = format!("style pass, layer {}", i + 1);
        report.add(Row {
            flops: of_all(flops),
            moved: of_all(moved[i]),
            ..Row::new(name, style.n(), &samples)
        });
    }
    Ok(())
}

/// Milliseconds per frame that [`budgeted`] allows: an eighth of a frame at 60 Hz.
const BUDGET_MS: f32 = 2.0;

fn budgeted_name() -> String {
    format!("style pass, a frame's part of {BUDGET_MS} ms")
}

/// Measures the frames of a change within a budget, from the first one on, at which the GPU's speed is still
/// unknown.
fn budgeted(gpu: &Gpu, pass: &StylePass, style: &OnGpu, report: &mut Report) -> Result<()> {
    let OnGpu { scene, weights, colors, .. } = style;
    let (device, mut progress) = (&gpu.device, StyleProgress::default());
    let mut budget = WorkMeter::new(BUDGET_MS).timed(device, &gpu.queue);
    let mut ms = Vec::new();
    while !progress.is_done() {
        budget.begin_frame();
        ms.push(gpu.time(|encoder| {
            pass.encode_some(device, encoder, scene, weights, colors, &mut progress, &mut budget)?;
            Ok(())
        })?);
    }
    report.add(Row::new(budgeted_name(), style.n(), &Samples { ms, cpu_ms: None }));
    Ok(())
}

/// Bytes that each layer gathers and writes for one Gaussian, in f16: K rows of inputs and of indices, and one
/// of outputs.
fn moved_by_layers(n_latent: usize) -> [u64; 5] {
    let mut d_in = n_latent;
    Decoder::WIDTHS.map(|d_out| {
        // The last layer's three colors are stored as four numbers.
        let moved = scenes::K * (2 * d_in + 4) + 2 * d_out.max(4);
        d_in = d_out;
        moved as u64
    })
}
