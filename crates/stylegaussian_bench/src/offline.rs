//! Steps of embedding and of training.

use std::{fs, path::Path, sync::atomic::AtomicBool, time::Instant};

use anyhow::Result;
use clap::Parser;
use glam::{UVec2, Vec3};
use stylegaussian::{Camera, Scene, file};
use stylegaussian_encoder::Encoder;
use stylegaussian_tools::{
    cli::Cli,
    embed::{EmbedMethod, EmbedOptions, TrainingView, Watch, embed},
    encoder::open_encoder,
};

use crate::{
    encode::noise,
    measure::Samples,
    plan::Plan,
    report::{Report, Row},
    scenes,
};

/// Width and height of views, in pixels.
const SIDE: u32 = 256;

/// The row that needs more than the repository has.
const TRAINING: &str = "train, a step";

/// Steps of embedding, then of training, whose loss looks through the weights `vgg`.
pub fn run(vgg: Option<&Path>, plan: &Plan, report: &mut Report) -> Result<()> {
    let encoder = open_encoder(None)?;
    let n = if plan.quick { 5_000 } else { 20_000 };
    let mut scene = scenes::structured(n);
    scene.sort_by_morton();
    embed_steps(&mut scene, &encoder, report)?;
    if let Err(error) = train_steps(&scene, vgg, plan, report) {
        report.not_run(TRAINING, &format!("{error:#}"));
    }
    Ok(())
}

/// Descent on four views of the scene.
fn embed_steps(scene: &mut Scene, encoder: &Encoder, report: &mut Report) -> Result<()> {
    let views: Vec<TrainingView> = (0..4)
        .map(|i| {
            let angle = 0.5 + 1.57 * i as f32;
            let eye = Vec3::new(5.0 * angle.sin(), 2.6, 5.0 * angle.cos());
            let camera = Camera::look_at(eye, Vec3::new(0.0, 0.6, 0.0), Vec3::Y, 0.8, UVec2::splat(SIDE));
            TrainingView::rendered(format!("view {i}"), &camera, SIDE)
        })
        .collect();
    let options =
        EmbedOptions { method: EmbedMethod::Optimize, iterations: Some(20), ..EmbedOptions::default() };
    let watch = Watch { progress: &|_| (), interrupted: &AtomicBool::new(false) };
    let fit = embed(scene, &views, encoder, &options, watch)?;
    let ms = vec![1e3 * fit.fit_seconds / f64::from(fit.iterations)];
    report.add(Row::new("embed, a step", scene.len(), &Samples { ms, cpu_ms: None }));
    Ok(())
}

/// The difference between a long and a short training, so that loading does not count.
fn train_steps(scene: &Scene, vgg: Option<&Path>, plan: &Plan, report: &mut Report) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let path = |name: &str| folder.path().join(name);
    file::write_scene(&path("scene.sgs"), scene)?;
    fs::create_dir(path("paintings"))?;
    noise(SIDE).save(path("paintings").join("noise.png"))?;
    let steps: [u32; 2] = if plan.quick { [4, 8] } else { [10, 30] };
    let mut seconds = [0.0; 2];
    for (seconds, steps) in seconds.iter_mut().zip(steps) {
        let start = Instant::now();
        train(folder.path(), vgg, steps)?;
        *seconds = start.elapsed().as_secs_f64();
    }
    let ms = vec![1e3 * (seconds[1] - seconds[0]) / f64::from(steps[1] - steps[0])];
    report.add(Row::new(TRAINING, scene.len(), &Samples { ms, cpu_ms: None }));
    Ok(())
}

fn train(folder: &Path, vgg: Option<&Path>, steps: u32) -> Result<()> {
    let paths = [folder.join("scene.sgs"), folder.join("paintings"), folder.join("out.decoder.safetensors")];
    let [scene, paintings, out] = paths.map(|path| path.into_os_string());
    let words =
        ["stylegaussian".into(), "train".into(), scene, "--styles".into(), paintings, "-o".into(), out];
    let options = ["--views", "4", "--size", "256", "--warm-iterations", "0", "--holdout-styles", "0"];
    let iterations = ["--iterations".into(), steps.to_string().into()];
    let vgg = vgg.into_iter().flat_map(|file| ["--vgg".into(), file.as_os_str().to_owned()]);
    let words = words.into_iter().chain(options.map(Into::into)).chain(iterations).chain(vgg);
    Cli::try_parse_from(words)?.run()
}
