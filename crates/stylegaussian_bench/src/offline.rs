//! Steps of embedding and of training.

use std::path::Path;

use anyhow::{Context, Result};
use glam::{UVec2, Vec3};
use stylegaussian::{Camera, Scene, views::choose_views};
use stylegaussian_encoder::Encoder;
use stylegaussian_train::{
    Watch,
    decoder::{Paintings, TrainConfig, Trainer, TrainingScene},
    embed::{EmbedMethod, EmbedOptions, TrainingView, embed},
    nn::{LossNetwork, Processor},
};

use crate::{
    encode::{default_encoder, noise},
    measure::Samples,
    plan::Plan,
    report::{Report, Row},
    scenes,
};

/// Width and height of views, in pixels.
const SIDE: u32 = 256;

/// The row that needs VGG-19's weights, which the repository does not have.
const TRAINING: &str = "train, a step";

/// Measures steps of embedding, then of training with the VGG-19 weights `vgg`.
pub fn run(vgg: Option<&Path>, plan: &Plan, report: &mut Report) -> Result<()> {
    let encoder = default_encoder()?;
    let n = if plan.quick { 5_000 } else { 20_000 };
    let mut scene = scenes::structured(n);
    scene.sort_by_morton();
    embed_steps(&mut scene, &encoder, report)?;
    if let Err(error) = train_steps(&scene, &encoder, vgg, plan, report) {
        report.not_run(TRAINING, &format!("{error:#}"));
    }
    Ok(())
}

/// Steps of the descent on four views of the scene.
fn embed_steps(scene: &mut Scene, encoder: &Encoder, report: &mut Report) -> Result<()> {
    let views: Vec<TrainingView> = (0..4)
        .map(|i| {
            let angle = 0.5 + 1.57 * i as f32;
            let eye = Vec3::new(5.0 * angle.sin(), 2.6, 5.0 * angle.cos());
            let camera = Camera::look_at(eye, Vec3::new(0.0, 0.6, 0.0), Vec3::Y, 0.8, UVec2::splat(SIDE));
            TrainingView::rendered(format!("view {i}"), &camera, SIDE)
        })
        .collect();
    // The paper's method, because `fit_seconds` would include the time of a closed form.
    let options =
        EmbedOptions { method: EmbedMethod::Optimize, iterations: Some(20), ..EmbedOptions::default() };
    let fit = embed(scene, &views, encoder, &options, Watch::default())?;
    let ms = vec![1e3 * fit.fit_seconds / f64::from(fit.iterations)];
    report.add(Row::new("embed, a step", scene.len(), &Samples { ms, cpu_ms: None }));
    Ok(())
}

/// Steps with the paper's loss. The first ones also compute statistics of paintings and views, which are kept;
/// they are the warm-up.
fn train_steps(
    scene: &Scene,
    encoder: &Encoder,
    vgg: Option<&Path>,
    plan: &Plan,
    report: &mut Report,
) -> Result<()> {
    let vgg = vgg.context("the loss needs VGG-19: name its weights (safetensors) with --vgg FILE")?;
    let folder = tempfile::tempdir()?;
    let painting = folder.path().join("noise.png");
    noise(SIDE).save(&painting)?;
    let cameras = choose_views(scene, 4, UVec2::splat(SIDE));
    let loss_network = LossNetwork::open(vgg, None, Processor::Cpu)?;
    let paintings = Paintings::new(vec![painting], encoder, loss_network);
    let scenes = [TrainingScene::new("scene", scene, &cameras, &[SIDE])];
    let mut trainer = Trainer::new(TrainConfig::default(), &scenes, paintings)?;
    let [n_warm_up, n_measured] = if plan.quick { [4, 4] } else { [10, 20] };
    let samples = Samples::wall(n_warm_up, n_measured, || Ok(trainer.step().map(drop)?))?;
    report.add(Row::new(TRAINING, scene.len(), &samples));
    Ok(())
}
