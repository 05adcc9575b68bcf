//! Speed of the folded decoder, compared with the unfolded one and with a plain matrix product.
//!
//! Prints medians and two ratios: `folded_over_unfolded_cpu` (time of the unfolded decoder / time of the folded
//! one) and `cpu_decode_over_product` (rate of the decoder / rate of a large product). Run it on a machine
//! without other load:
//!
//! ```sh
//! cargo run --release -p stylegaussian --example decode_speed -- 100000
//! ```

use std::{hint::black_box, time::Instant};

use glam::{Quat, Vec3};
use stylegaussian::{
    Decoder, Features, Layer, Neighbors, Scene,
    fold::{ChannelMap, stylize},
};

const N_CHANNELS: usize = 256;
const N_LATENT: usize = 32;
const K: usize = 8;
const RUNS: usize = 5;

fn numbers(n: usize, deviation: f32) -> Vec<f32> {
    // A low-discrepancy sequence. Any numbers do, if none is denormal or zero: those would change the speed of
    // arithmetic.
    (0..n).map(|i| deviation * ((i as f64 * 0.754_877_666) % 1.0 - 0.5) as f32 * 3.46).collect()
}

fn scene(n: usize, n_latent: usize) -> Scene {
    let position = |i: usize| {
        Vec3::from(
            [0.754_877_666, 0.569_840_291, 0.438_579_2].map(|step: f64| (i as f64 * step % 1.0) as f32),
        )
    };
    let mut scene = Scene {
        means: (0..n).map(position).collect(),
        rotations: vec![Quat::IDENTITY; n],
        scales: vec![Vec3::splat(0.01); n],
        opacities: vec![0.5; n],
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    };
    scene.sort_by_morton();
    scene.features = Some(Features {
        values: numbers(n * n_latent, 1.0),
        n_latent,
        basis: numbers(N_CHANNELS * n_latent, 0.1),
        offset: numbers(N_CHANNELS, 1.0),
        extra: Vec::new(),
        n_extra: 0,
        encoder: None,
    });
    scene.neighbors = Some(Neighbors::find(&scene.means, &scene.order, K));
    scene
}

fn decoder() -> Decoder {
    let mut d_in = N_CHANNELS;
    let layer = |d_out| {
        let weight = numbers(d_out * K * d_in, 1.0 / ((K * d_in) as f32).sqrt());
        let layer = Layer { weight, bias: numbers(d_out, 0.1), d_in, d_out };
        d_in = d_out;
        layer
    };
    Decoder { layers: Decoder::WIDTHS.map(layer).into(), k: K, ..Decoder::default() }
}

/// Median time of [`RUNS`] runs after a warm-up, in seconds.
fn median(mut run: impl FnMut()) -> f64 {
    run();
    let mut seconds: Vec<f64> = (0..RUNS)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    seconds[RUNS / 2]
}

/// Time of a matrix product with the folded decoder's number of multiply-adds over `n` Gaussians, in seconds.
fn product_seconds(n: usize) -> f64 {
    // The shape of the second layer, the largest: K times 256 inputs, 128 outputs.
    let (rows, inner, columns) = (n, 2048, 128);
    let (lhs, rhs) = (numbers(rows * inner, 1.0), numbers(inner * columns, 1.0));
    let mut target = vec![0.0_f32; rows * columns];
    let seconds = median(|| {
        let threads = gemm::Parallelism::Rayon(0);
        // SAFETY: the three slices were made above with rows * inner, inner * columns and rows * columns
        // values, the extents that these dimensions and strides address, and the target overlaps no operand.
        #[expect(unsafe_code, reason = "gemm takes pointers; the slices have the stated shapes")]
        unsafe {
            gemm::gemm(
                rows,
                columns,
                inner,
                target.as_mut_ptr(),
                1,
                columns as isize,
                false,
                lhs.as_ptr(),
                1,
                inner as isize,
                rhs.as_ptr(),
                1,
                columns as isize,
                0.0,
                1.0,
                false,
                false,
                false,
                threads,
            );
        }
        black_box(&target);
    });
    seconds * multiply_adds(n, N_LATENT) / (rows * inner * columns) as f64
}

fn multiply_adds(n: usize, n_inputs: usize) -> f64 {
    let widths = [n_inputs, 256, 128, 64, 32, 3];
    (n * widths.windows(2).map(|pair| K * pair[0] * pair[1]).sum::<usize>()) as f64
}

fn main() {
    let n = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(100_000);
    let decoder = decoder();
    let time = |n_latent: usize| {
        let scene = scene(n, n_latent);
        median(|| {
            black_box(stylize(&scene, &decoder, &ChannelMap::identity(N_CHANNELS)).unwrap());
        })
    };
    let (folded, unfolded, product) = (time(N_LATENT), time(N_CHANNELS), product_seconds(n));
    let rate = |seconds: f64, n_inputs: usize| multiply_adds(n, n_inputs) * 2e-9 / seconds;
    println!("N = {n}, {} threads", rayon::current_num_threads());
    println!("folded   (L = {N_LATENT})  {folded:.3} s  {:.1} GFLOP/s", rate(folded, N_LATENT));
    println!("unfolded (D = {N_CHANNELS}) {unfolded:.3} s  {:.1} GFLOP/s", rate(unfolded, N_CHANNELS));
    println!("product            {product:.3} s  {:.1} GFLOP/s", rate(product, N_LATENT));
    println!("folded_over_unfolded_cpu {:.2}", unfolded / folded);
    println!("cpu_decode_over_product {:.2}", product / folded);
}
