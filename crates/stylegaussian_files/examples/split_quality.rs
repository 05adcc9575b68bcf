//! How much splitting changes the picture of an unstyled scene, in views that had no say in it.
//!
//! `cargo run --release -p stylegaussian_files --example split_quality -- SCENE [FACTOR]`

use std::{path::Path, time::Instant};

use glam::UVec2;
use stylegaussian::{
    split::{SplitOptions, picture_change, split},
    views::{choose_views, orbit},
};
use stylegaussian_files::read_scene;

const SIZE: UVec2 = UVec2::splat(512);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: split_quality SCENE [FACTOR]")?;
    let factor = arguments.next().map_or(Ok(SplitOptions::default().factor), |text| text.parse())?;
    let scene = read_scene(Path::new(&path))?.scene;
    let mut parts = scene.clone();
    let start = Instant::now();
    let n_added = split(&mut parts, SplitOptions { factor, ..SplitOptions::default() });
    println!("{path}: {} Gaussians, {n_added} added in {:.1} s", scene.len(), start.elapsed().as_secs_f64());
    // Views are chosen one after another, so those after the first 24 are not among the views of the split.
    let chosen = choose_views(&scene, 32, SIZE).split_off(24);
    for (name, views) in [("further views", chosen), ("orbit", orbit(&scene, 8, SIZE))] {
        let errors: Vec<f64> = views.iter().map(|camera| picture_change(&scene, &parts, camera)).collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let worst = errors.iter().copied().fold(0.0, f64::max);
        println!("  {name}: {:.2} dB, the worst of {} {:.2} dB", decibel(mean), errors.len(), decibel(worst));
    }
    Ok(())
}

/// PSNR of a mean square error of colors in 0..1.
fn decibel(mean_square: f64) -> f64 {
    -10.0 * mean_square.log10()
}
