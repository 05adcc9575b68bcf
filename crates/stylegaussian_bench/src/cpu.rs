//! The decoder on the CPU, in turns with the literal one and a plain product.

use anyhow::Result;
use rayon::prelude::*;
use stylegaussian::{
    Decoder, Scene,
    decoder::product::{Matrix, product},
    fold::{ChannelMap, stylize},
};

use crate::{
    measure::{Samples, wall_ms},
    plan::Plan,
    report::{Report, Row, names},
    scenes::{self, N_CHANNELS, N_LOW, Random},
};

/// Side of the matrices of the product.
const N: usize = 2048;

/// Measures all three at the smallest size, and the folded decoder at the others too.
pub fn run(plan: &Plan, report: &mut Report) -> Result<()> {
    let decoder = scenes::decoder();
    let n = plan.cpu_sizes()[0];
    let [folded, literal] = [N_LOW, N_CHANNELS].map(|n_latent| scenes::embedded(n, n_latent));
    let mut random = Random::new();
    let (a, b, mut c) = (random.many(N * N, 1.0), random.many(N * N, 1.0), vec![0.0; N * N]);
    let samples = Samples::in_turns(
        1,
        5,
        &mut [&mut || decode(&folded, &decoder), &mut || decode(&literal, &decoder), &mut || {
            multiply(&a, &b, &mut c)
        }],
    )?;
    let rows = [(names::CPU_DECODE, N_LOW), (names::CPU_UNFOLDED, N_CHANNELS)];
    for ((name, n_latent), samples) in rows.into_iter().zip(&samples) {
        report.add(Row { flops: Some(scenes::flops(n, n_latent)), ..Row::new(name, n, samples) });
    }
    report.add(Row { flops: Some(2 * (N as u64).pow(3)), ..Row::new(names::CPU_PRODUCT, N, &samples[2]) });
    for &n in &plan.cpu_sizes()[1..] {
        let scene = scenes::embedded(n, N_LOW);
        let samples = Samples::of(1, 3, || decode(&scene, &decoder))?;
        report.add(Row { flops: Some(scenes::flops(n, N_LOW)), ..Row::new(names::CPU_DECODE, n, &samples) });
    }
    Ok(())
}

fn decode(scene: &Scene, decoder: &Decoder) -> Result<f64> {
    let map = ChannelMap::identity(N_CHANNELS);
    wall_ms(|| Ok(stylize(scene, decoder, &map).map(drop)?))
}

/// The product by the `gemm` crate, with rows split over all threads.
fn multiply(a: &[f32], b: &[f32], c: &mut [f32]) -> Result<f64> {
    // One piece for each thread: a limit that leaves threads idle is none.
    let rows = N.div_ceil(rayon::current_num_threads());
    wall_ms(|| {
        c.par_chunks_mut(rows * N).zip(a.par_chunks(rows * N)).for_each(|(c, a)| {
            product(c, false, Matrix::dense(a, a.len() / N, N), Matrix::dense(b, N, N));
        });
        Ok(())
    })
}
