//! The style pass, in turns with the literal method and a plain product.
//!
//! The literal method in WGSL stores 256-wide features, does not fold layers and uses f32, with the same
//! kernels. Its transfer is still folded into the first layer's weights, which saves it a pass over the
//! features.

use anyhow::Result;
use stylegaussian_gpu::style::{Precision, StyleOptions, StylePass};

use crate::{
    ceilings::Product,
    gpu::Gpu,
    measure::Samples,
    plan::Plan,
    report::{LITERAL_BYTES, Report, Row, names},
    scenes::{self, N_CHANNELS, N_LOW},
    style::OnGpu,
};

/// Measures our method in f16, as it is used, and in f32, the literal method, and a product.
pub fn run(gpu: &Gpu, plan: &Plan, report: &mut Report) -> Result<()> {
    let n = plan.literal_size();
    // As a whole: blocks belong to our method and cost operations.
    let f32 = StyleOptions { precision: Precision::F32, scratch_bytes: u64::MAX };
    let [pass, pass_f32] =
        [Precision::F16, Precision::F32].map(|p| StylePass::with_precision(&gpu.device, p));
    let scene = scenes::embedded(n, N_LOW);
    let ours = OnGpu::new(gpu, &scene, StyleOptions::default())?;
    let ours_f32 = OnGpu::new(gpu, &scene, f32)?;
    let literal = OnGpu::new(gpu, &scenes::embedded(n, N_CHANNELS), f32)?;
    let product = Product::new(gpu, plan)?;
    // In turns, because ratios of these four are reported.
    let samples = Samples::in_turns(
        1,
        3,
        &mut [
            &mut || ours.time(gpu, &pass),
            &mut || ours_f32.time(gpu, &pass_f32),
            &mut || literal.time(gpu, &pass_f32),
            &mut || product.time(),
        ],
    )?;
    let folded = Some(scenes::flops(n, N_LOW));
    let unfolded = Some(scenes::flops(n, N_CHANNELS));
    let rows = [
        (names::STYLE_PASS, folded, ours.bytes()),
        ("style pass, f32", folded, ours_f32.bytes()),
        (names::LITERAL, unfolded, literal.bytes()),
    ];
    for ((name, flops, bytes), samples) in rows.into_iter().zip(&samples) {
        report.add(Row { flops, bytes: Some(bytes), ..Row::new(name, n, samples) });
    }
    report.add(Row { flops: Some(product.flops()), ..Row::new(names::PRODUCT, product.n, &samples[3]) });
    report.add(Row::of_memory("memory of the literal method, counted", n, (LITERAL_BYTES * n as f64) as u64));
    if plan.quick { Ok(()) } else { bytes_between_layers(gpu, n, report) }
}

/// Activations as bytes.
fn bytes_between_layers(gpu: &Gpu, n: usize, report: &mut Report) -> Result<()> {
    let options = StyleOptions { precision: Precision::Unorm8, ..StyleOptions::default() };
    let pass = StylePass::with_precision(&gpu.device, options.precision);
    let ours = OnGpu::new(gpu, &scenes::embedded(n, N_LOW), options)?;
    let samples = Samples::of(1, 3, || ours.time(gpu, &pass))?;
    let flops = Some(scenes::flops(n, N_LOW));
    report.add(Row { flops, bytes: Some(ours.bytes()), ..Row::new("style pass, unorm8", n, &samples) });
    Ok(())
}
