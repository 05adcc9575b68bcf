//! How long a change of style takes: `cargo bench -p stylegaussian_gpu --bench style [-- N]`, N = 10,000 unless told.

#[path = "../tests/random/mod.rs"]
#[expect(dead_code, reason = "tests need more of it")]
mod random;

use std::time::Instant;

use random::Random;
use stylegaussian::{Activation, Decoder, Scene, fold};
use stylegaussian_gpu::{
    colors::GaussianColors,
    device::{DeviceError, HeadlessDevice},
    style::{FoldedLayers, GpuDecoder, StylePass, StyleScene},
};

const ROUNDS: u32 = 3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let n = std::env::args().find_map(|argument| argument.parse().ok()).unwrap_or(10_000);
    let gpu = match pollster::block_on(HeadlessDevice::request()) {
        Err(DeviceError::NoAdapter(_)) => {
            eprintln!("SKIPPED: no GPU adapter");
            return Ok(());
        }
        result => result?,
    };
    let mut random = Random(1);
    let scene = random.scene(n, 32, 0, 8);
    let decoder = random.decoder(&scene, 8, &Decoder::WIDTHS, Activation::LeakyRelu { slope: 0.2 });
    println!("{n} Gaussians, L = 32, K = 8, {:?}, on {}", Decoder::WIDTHS, gpu.info.name);
    run(&gpu, &scene, &decoder)
}

fn run(gpu: &HeadlessDevice, scene: &Scene, decoder: &Decoder) -> Result<(), Box<dyn std::error::Error>> {
    let HeadlessDevice { device, queue, .. } = gpu;
    let start = Instant::now();
    let pass = StylePass::new(device);
    report("compile", start, 1);
    let start = Instant::now();
    let style_scene = StyleScene::new(device, queue, scene, decoder)?;
    report("pack and upload", start, 1);
    let map = fold::ChannelMap::identity(decoder.n_inputs());
    let start = Instant::now();
    let mut folded = FoldedLayers::new(style_scene.content(), decoder, &map)?;
    for _ in 1..ROUNDS {
        folded = FoldedLayers::new(style_scene.content(), decoder, &map)?;
    }
    report("fold", start, ROUNDS);
    let mut weights = GpuDecoder::new(device, queue, &folded)?;
    let colors = GaussianColors::new(device, scene.len())?;
    for name in ["first changes", "later changes"] {
        let start = Instant::now();
        for _ in 0..ROUNDS {
            weights.write(queue, &folded);
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            pass.encode(device, &mut encoder, &style_scene, &weights, &colors)?;
            queue.submit([encoder.finish()]);
            device.poll(wgpu::PollType::wait_indefinitely())?;
        }
        report(name, start, ROUNDS);
    }
    Ok(())
}

fn report(what: &str, start: Instant, rounds: u32) {
    println!("{what:<16} {:9.2} ms", start.elapsed().as_secs_f64() * 1e3 / f64::from(rounds));
}
