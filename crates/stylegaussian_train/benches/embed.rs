//! Held-out error against time of the embedding methods: 31,000 Gaussians, 24 views of 256x256 pixels rendered
//! from the scene's base colors over white, every sixth held out.
//!
//! `cargo bench -p stylegaussian_train --bench embed`. Needs the shared test data; says so and stops where it
//! is absent. Times are of one run on whatever else the machine does: compare rows, not runs.

use std::{
    env,
    path::{Path, PathBuf},
};

use stylegaussian::Scene;
use stylegaussian_encoder::Encoder;
use stylegaussian_files::read_scene;
use stylegaussian_train::{
    Watch,
    cameras::read_cameras,
    embed::{EmbedMethod, EmbedOptions, TrainingView, embed},
};

/// (method, steps; `None` = its default)
const ROWS: [(EmbedMethod, Option<u32>); 9] = [
    (EmbedMethod::ClosedForm, None),
    (EmbedMethod::Optimize, Some(100)),
    (EmbedMethod::Optimize, Some(300)),
    (EmbedMethod::Optimize, Some(1000)),
    (EmbedMethod::Optimize, None),
    (EmbedMethod::Optimize, Some(5000)),
    (EmbedMethod::Default, Some(50)),
    (EmbedMethod::Default, Some(100)),
    (EmbedMethod::Default, None),
];

fn main() -> anyhow::Result<()> {
    let data = env::var_os("STYLEGAUSSIAN_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    if !data.is_dir() {
        eprintln!("SKIPPED: the shared test data is not at {}", data.display());
        return Ok(());
    }
    let mut scene = read_scene(&data.join("splats/playbot_31k_sh2pad3.ply"))?.scene;
    keep_base_color(&mut scene);
    let cameras = read_cameras(&data.join("reference/playbot_views.json"))?.cameras;
    let views: Vec<TrainingView> =
        cameras.iter().map(|posed| TrainingView::rendered(posed.name.clone(), &posed.camera, 256)).collect();
    let encoder = Encoder::open(&data.join("vgg/vgg19_normalised_relu3_1.safetensors"))?;

    println!("method        steps  training  held-out  views s   fit s");
    for (method, iterations) in ROWS {
        let options = EmbedOptions { method, iterations, holdout: 6, ..EmbedOptions::default() };
        let report = embed(&mut scene, &views, &encoder, &options, Watch::default())?;
        println!(
            "{:<12} {:>6}  {:>8.4}  {:>8.4}  {:>7.2}  {:>6.2}",
            format!("{method:?}"),
            report.iterations,
            report.training_error.unwrap_or(f64::NAN),
            report.held_out_error.unwrap_or(f64::NAN),
            report.view_seconds,
            report.fit_seconds,
        );
    }
    Ok(())
}

/// Spherical harmonics of degree 0 alone.
fn keep_base_color(scene: &mut Scene) {
    if let Some(sh) = &mut scene.sh {
        let n = 3 * (usize::from(sh.degree) + 1).pow(2);
        sh.coefficients = sh.coefficients.chunks_exact(n).flat_map(|all| all[..3].to_vec()).collect();
        sh.degree = 0;
    }
}
