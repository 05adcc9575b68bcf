//! The literal method as WGSL: 256-wide features stored, layers unfolded, all f32, by the same kernels. Its transfer is
//! folded into the first layer's weights all the same, which spares it a pass over the features.

use anyhow::Result;
use stylegaussian_gpu::style::{Precision, StyleOptions, StylePass};

use crate::{
    gpu::Gpu,
    plan::Plan,
    report::{Report, Row, names},
    scenes::{self, N_CHANNELS, N_LOW},
    style::{OnGpu, add_pass},
};

/// The literal method, and ours in f32 beside it.
pub fn run(gpu: &Gpu, plan: &Plan, report: &mut Report) -> Result<()> {
    let n = plan.literal_size();
    // Whole: blocks are ours, and cost operations.
    let options = StyleOptions { precision: Precision::F32, scratch_bytes: u64::MAX };
    let pass = StylePass::with_precision(&gpu.device, options.precision);
    let folded = OnGpu::new(gpu, &scenes::embedded(n, N_LOW), options)?;
    add_pass(gpu, &pass, &folded, N_LOW, "style pass, f32", report)?;
    drop(folded);
    let literal = OnGpu::new(gpu, &scenes::embedded(n, N_CHANNELS), options)?;
    add_pass(gpu, &pass, &literal, N_CHANNELS, names::LITERAL, report)?;
    drop(literal);
    if !plan.quick {
        let options = StyleOptions { precision: Precision::Unorm8, ..StyleOptions::default() };
        let pass = StylePass::with_precision(&gpu.device, options.precision);
        let bytes = OnGpu::new(gpu, &scenes::embedded(n, N_LOW), options)?;
        add_pass(gpu, &pass, &bytes, N_LOW, "style pass, unorm8", report)?;
    }
    let counted = (crate::report::LITERAL_BYTES * n as f64) as u64;
    report.add(Row::of_memory("memory of the literal method, counted", n, counted));
    Ok(())
}
