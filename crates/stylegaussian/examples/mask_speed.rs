//! Measures dabs of several sizes, a lasso, and the way to files and back, for 300,000 Gaussians on one core.

use std::{hint::black_box, time::Instant};

use glam::{Affine3A, Quat, UVec2, Vec2, Vec3};
use stylegaussian::{
    Camera, Mask, Scene, StoredMask,
    mask::{Brush, Combine, Lasso, Selection, Stroke},
    morton,
    random::Random,
};

const N: usize = 300_000;

fn main() -> Result<(), rayon::ThreadPoolBuildError> {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    let mut random = Random::new(1);
    let means: Vec<Vec3> =
        (0..N).map(|_| Vec3::from_array([(); 3].map(|()| 2.0 * random.uniform() - 1.0))).collect();
    let means: Vec<Vec3> = morton::order(&means).into_iter().map(|i| means[i as usize]).collect();
    for radius in [0.05, 0.2, 0.5, 4.0] {
        let brush = Brush { radius, strength: 0.2, ..Brush::default() };
        let mut mask = Mask::new(N);
        let (mut times, mut edit) = (Vec::new(), None);
        for _ in 0..21 {
            let start = Instant::now();
            edit = Some(black_box(mask.paint(&means, &brush, &[Vec3::splat(0.1)])));
            times.push(start.elapsed());
        }
        times.sort();
        let ranges = edit.map(|edit| (edit.len(), edit.ranges(256, 64))).unwrap_or_default();
        let bytes: usize = ranges.1.iter().map(|range| 4 * range.len()).sum();
        println!(
            "dab of radius {radius}: {:?}, {} Gaussians, {bytes} bytes in {} ranges to upload",
            times[10],
            ranges.0,
            ranges.1.len()
        );
    }
    let brush = Brush { radius: 0.05, strength: 0.2, ..Brush::default() };
    let (mut mask, mut stroke) = (Mask::new(N), Stroke::new(brush));
    stroke.to(&mut mask, &means, Vec3::ZERO);
    let start = Instant::now();
    let edit = stroke.to(&mut mask, &means, Vec3::new(0.25, 0.0, 0.0));
    println!("20 dabs of a stroke of radius 0.05: {:?}, {} Gaussians", start.elapsed(), edit.len());
    let camera = Camera {
        view_from_world: Affine3A::from_translation(Vec3::new(0.0, 0.0, 3.0)),
        focal: Vec2::splat(1000.0),
        center: Vec2::splat(500.0),
        size: UVec2::splat(1000),
        near: Camera::NEAR,
    };
    let corner = |i: usize| 500.0 + 250.0 * Vec2::from_angle(std::f32::consts::TAU * i as f32 / 200.0);
    let lasso = Selection::Lasso(Lasso::new(camera, &(0..200).map(corner).collect::<Vec<_>>()));
    let start = Instant::now();
    let edit = mask.select(&means, 1, &lasso, Combine::Replace);
    println!("lasso of 200 points: {:?}, {} Gaussians", start.elapsed(), edit.len());
    let scene = Scene {
        rotations: vec![Quat::IDENTITY; N],
        scales: vec![Vec3::ONE; N],
        opacities: vec![1.0; N],
        order: random.permutation(N).into_iter().map(|i| i as u32).collect(),
        n_source: N,
        means,
        ..Scene::default()
    };
    let start = Instant::now();
    let stored = StoredMask::new(&scene, &mask);
    println!("to the order of a file: {:?}", start.elapsed());
    let start = Instant::now();
    black_box(stored.mask_for(&scene)).ok();
    println!("from the order of a file: {:?}", start.elapsed());
    Ok(())
}
