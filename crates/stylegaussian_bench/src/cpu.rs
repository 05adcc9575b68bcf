//! The decoder on the CPU, beside the unfolded one and a plain product.

use anyhow::Result;
use rayon::prelude::*;
use stylegaussian::{
    decoder::product::{Matrix, product},
    fold::{ChannelMap, stylize},
};

use crate::{
    measure::Samples,
    plan::Plan,
    report::{Report, Row, names},
    scenes::{self, N_CHANNELS, N_LOW, Random},
};

/// A product of two large square matrices by the `gemm` crate, rows split over all threads.
pub fn ceiling(_plan: &Plan, report: &mut Report) -> Result<()> {
    const N: usize = 2048;
    let mut random = Random::new();
    let (a, b) = (random.many(N * N, 1.0), random.many(N * N, 1.0));
    let mut c = vec![0.0; N * N];
    let rows = N.div_ceil(rayon::current_num_threads());
    let samples = Samples::wall(1, 5, || {
        c.par_chunks_mut(rows * N).zip(a.par_chunks(rows * N)).for_each(|(c, a)| {
            product(c, false, Matrix::dense(a, a.len() / N, N), Matrix::dense(&b, N, N));
        });
        Ok(())
    })?;
    let flops = Some(2 * (N as u64).pow(3));
    report.add(Row { flops, bytes: Some(12 * (N * N) as u64), ..Row::new(names::CPU_PRODUCT, N, &samples) });
    Ok(())
}

/// Folded at every size, and unfolded at the smallest.
pub fn run(plan: &Plan, report: &mut Report) -> Result<()> {
    let (decoder, map) = (scenes::decoder(), ChannelMap::identity(N_CHANNELS));
    let decode = |name: &str, n: usize, n_low: usize, report: &mut Report| {
        let scene = scenes::embedded(n, n_low);
        let samples = Samples::wall(1, 3, || Ok(stylize(&scene, &decoder, &map).map(drop)?))?;
        report.add(Row { flops: Some(scenes::flops(n, n_low)), ..Row::new(name, n, &samples) });
        anyhow::Ok(())
    };
    for &n in plan.cpu_sizes() {
        decode(names::CPU_DECODE, n, N_LOW, report)?;
    }
    decode(names::CPU_UNFOLDED, plan.cpu_sizes()[0], N_CHANNELS, report)
}
