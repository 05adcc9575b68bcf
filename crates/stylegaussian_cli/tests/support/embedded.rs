//! Made-up inputs of training and evaluation: an embedded scene and a folder of paintings.

use std::{fs, path::Path};

use glam::{Quat, Vec3};
use stylegaussian::{Features, Neighbors, Scene};
use stylegaussian_encoder::Encoder;
use stylegaussian_files::write_scene;

use crate::support::Bench;

/// A flat board of 24 x 24 opaque Gaussians of many colors, visible from all around and above.
pub fn board() -> Scene {
    const SIDE: usize = 24;
    let n = SIDE * SIDE;
    let at = |i: usize| i as f32 - (SIDE - 1) as f32 / 2.0;
    let mut scene = Scene {
        means: (0..n).map(|i| Vec3::new(0.1 * at(i % SIDE), 0.0, 0.1 * at(i / SIDE))).collect(),
        rotations: vec![Quat::IDENTITY; n],
        scales: vec![Vec3::new(0.1, 0.002, 0.1); n],
        opacities: vec![0.99; n],
        order: (0..n as u32).collect(),
        n_source: n,
        up: Some(Vec3::Y),
        ..Scene::default()
    };
    let shade = |i: usize, step: f32| 0.5 + 0.4 * (i as f32 * step).sin();
    scene.set_colors(&(0..n).map(|i| [shade(i, 0.31), shade(i, 0.17), shade(i, 0.05)]).collect::<Vec<_>>());
    scene
}

/// The board as a file. Its made-up features have the encoder's 256 channels and 3 latent features.
pub fn embedded(bench: &Bench, encoder: &Path) -> String {
    let mut scene = board();
    let n = scene.len();
    // Multiples of an irrational number, modulo 1, fill the interval evenly.
    let number = |i: usize, step: f64| ((i as f64 * step) % 1.0 * 2.0 - 1.0) as f32;
    scene.features = Some(Features {
        values: (0..n * 3).map(|i| number(i, 0.754_877)).collect(),
        n_latent: 3,
        basis: (0..256 * 3).map(|i| number(i, 0.569_84)).collect(),
        offset: (0..256).map(|i| number(i, 0.618_034)).collect(),
        extra: Vec::new(),
        n_extra: 0,
        encoder: Some(Encoder::open(encoder).unwrap().id().clone()),
    });
    scene.neighbors = Some(Neighbors::find(&scene.means, &scene.order, 8));
    let path = bench.path("embedded.sgs");
    write_scene(path.as_ref(), &scene).unwrap();
    path
}

/// Two paintings of stripes, one to train with and one to show.
pub fn paintings(bench: &Bench) -> String {
    let folder = bench.path("paintings");
    fs::create_dir(&folder).unwrap();
    for (name, step) in [("a.png", 9), ("b.png", 23)] {
        let stripe = |x: u32, y: u32| image::Rgb([((x / step) % 2 * 200) as u8, (y / 2) as u8, 90]);
        image::RgbImage::from_fn(300, 260, stripe).save(Path::new(&folder).join(name)).unwrap();
    }
    folder
}
