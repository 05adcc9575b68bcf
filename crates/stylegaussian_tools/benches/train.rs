//! Seconds that a training step takes: 20,000 Gaussians seen whole in every picture of 256x256 pixels, the losses at all
//! four layers.
//!
//! `cargo bench -p stylegaussian_tools --bench train`. Needs the shared test data; says so and stops where it is absent. The
//! difference between a long and a short training, so that loading and the first look at each picture do not count.

use std::{
    env, fs,
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::Context;
use clap::Parser;
use stylegaussian::{Features, Neighbors, Scene, file};
use stylegaussian_encoder::Encoder;
use stylegaussian_tools::cli::Cli;

const N_GAUSSIANS: usize = 20_000;
/// The numbers of steps whose times are subtracted. The paintings' 16 crops are all seen before the first.
const STEPS: [u32; 2] = [100, 150];

fn main() -> anyhow::Result<()> {
    let data = env::var_os("STYLEGAUSSIAN_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    if !data.is_dir() {
        eprintln!("SKIPPED: the shared test data is not at {}", data.display());
        return Ok(());
    }
    let folder = tempfile::tempdir()?;
    let path = |name: &str| folder.path().join(name);
    let encoder = data.join("vgg/vgg19_normalised_relu3_1.safetensors");
    let mut scene = file::read_scene(&data.join("splats/playbot_31k_sh2pad3.ply"))?.scene;
    scene = scene.subset(&(0..N_GAUSSIANS as u32).collect::<Vec<_>>());
    embed_by_chance(&mut scene, &encoder)?;
    file::write_scene(&path("scene.sgs"), &scene)?;
    fs::create_dir(path("paintings"))?;
    let painting = fs::read_dir(data.join("styles"))?.filter_map(Result::ok).map(|entry| entry.path());
    let painting = painting.filter(|path| path.extension().is_some_and(|extension| extension == "jpg")).min();
    fs::copy(painting.context("no painting")?, path("paintings").join("a.jpg"))?;

    let mut seconds = [0.0; 2];
    for (seconds, steps) in seconds.iter_mut().zip(STEPS) {
        let start = Instant::now();
        let words = [
            "stylegaussian".into(),
            "train".into(),
            path("scene.sgs").into_os_string(),
            "--styles".into(),
            path("paintings").into_os_string(),
            "--encoder".into(),
            encoder.clone().into_os_string(),
            "--relu4".into(),
            data.join("vgg/distilled16x_encoder_relu4_1.safetensors").into_os_string(),
            "-o".into(),
            path("out.decoder.safetensors").into_os_string(),
            "--iterations".into(),
            steps.to_string().into(),
        ];
        let options = ["--views", "4", "--size", "256", "--warm-iterations", "0", "--holdout-styles", "0"];
        Cli::try_parse_from(words.into_iter().chain(options.map(Into::into)))?.run()?;
        *seconds = start.elapsed().as_secs_f64();
    }
    println!("{:.3} s per step", (seconds[1] - seconds[0]) / f64::from(STEPS[1] - STEPS[0]));
    Ok(())
}

/// Features that mean nothing: a step takes as long.
fn embed_by_chance(scene: &mut Scene, encoder: &Path) -> anyhow::Result<()> {
    let encoder = Encoder::open(encoder)?;
    let numbers =
        |n: usize, step: f64| (0..n).map(|i| ((i as f64 * step) % 1.0 * 2.0 - 1.0) as f32).collect();
    let (n_channels, n_low) = (encoder.n_channels(), 32);
    scene.features = Some(Features {
        values: numbers(scene.len() * n_low, 0.754_877),
        n_low,
        basis: numbers(n_channels * n_low, 0.569_84),
        offset: numbers(n_channels, 0.618_034),
        extra: Vec::new(),
        n_extra: 0,
        encoder: Some(encoder.id().clone()),
    });
    scene.neighbors = Some(Neighbors::find(&scene.means, &scene.order, 8));
    Ok(())
}
