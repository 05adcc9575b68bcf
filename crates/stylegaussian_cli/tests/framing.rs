//! What the pictures of a scene show: things with surroundings, and worlds of any scale.

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

use std::{fs, path::Path};

use glam::{Quat, Vec3};
use stylegaussian::{Scene, scene::Sh};
use stylegaussian_files::write_scene;
use support::{Bench, stylegaussian};

/// White balls of the size `scale` at `means`.
fn balls(means: Vec<Vec3>, scale: f32) -> Scene {
    let n = means.len();
    Scene {
        rotations: vec![Quat::IDENTITY; n],
        scales: vec![Vec3::splat(scale); n],
        opacities: vec![0.95; n],
        sh: Some(Sh { degree: 0, coefficients: vec![1.7; 3 * n] }),
        order: (0..n as u32).collect(),
        n_source: n,
        means,
        ..Scene::default()
    }
}

/// The middles of 512 cells of a cube, 2 wide.
fn cube() -> Vec<Vec3> {
    let at = |i: usize| (i as f32 - 3.5) / 4.0;
    (0..512).map(|i| Vec3::new(at(i % 8), at(i / 8 % 8), at(i / 64))).collect()
}

/// The share of a picture that is covered.
fn covered(path: &Path) -> f32 {
    let picture = image::open(path).unwrap().into_rgba8();
    let n = picture.pixels().filter(|pixel| pixel.0[3] > 127).count();
    n as f32 / (picture.width() * picture.height()) as f32
}

#[test]
fn surroundings_are_left_out_and_told() {
    let bench = Bench::new();
    let scene = bench.path("a.ply");
    // 64 floaters on a spiral, 20 to 83 units away.
    let floater = |i: usize| {
        let (sin, cos) = (2.4 * i as f32).sin_cos();
        (20.0 + i as f32) * Vec3::new(cos, 0.03 * i as f32 - 1.0, sin).normalize()
    };
    let means = cube().into_iter().chain((0..64).map(floater)).collect();
    write_scene(scene.as_ref(), &balls(means, 0.15)).unwrap();
    let out = bench.path("a.png");
    let render = ["render", &scene, "--size", "64x64", "--backend", "cpu", "-o", &out];
    let run = stylegaussian(&render).expect_success();
    assert!(run.stderr.contains("a.ply: cameras leave out 64 of 576 Gaussians"), "{}", run.stderr);
    assert!(run.stderr.contains("--frame") && run.stderr.contains("--cameras"), "{}", run.stderr);
    assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
    assert!(covered(out.as_ref()) > 0.25, "{}", covered(out.as_ref()));

    let told = [&render[..], &["--frame", "-0.5,0,0,20"]].concat();
    let run = stylegaussian(&told).expect_success();
    assert_eq!(run.stderr, "");
    assert!(covered(out.as_ref()) < 0.05, "{}", covered(out.as_ref()));
    let too_large = [&render[..], &["--frame", "0,0,0,1e30"]].concat();
    stylegaussian(&too_large).expect_error("--frame 0.0,0.0,0.0,1e30: no camera in f32 can see such a ball");
}

#[test]
fn cameras_see_worlds_of_any_scale() {
    let bench = Bench::new();
    let (scene, cameras, out) = (bench.path("a.ply"), bench.path("transforms.json"), bench.path("a.png"));
    let pictures: Vec<_> = [1.0, 1e-4, 1e-2, 1e4]
        .map(|scale: f32| {
            let means = cube().into_iter().map(|mean| scale * mean).collect();
            write_scene(scene.as_ref(), &balls(means, 0.15 * scale)).unwrap();
            let pose = format!("[[1,0,0,0],[0,1,0,0],[0,0,1,{}],[0,0,0,1]]", 5.0 * scale);
            let frame = format!(r#"{{"file_path": "x.png", "transform_matrix": {pose}}}"#);
            let text = format!(r#"{{"camera_angle_x": 0.8, "w": 64, "h": 64, "frames": [{frame}]}}"#);
            fs::write(&cameras, text).unwrap();
            let render = ["render", &scene, "--cameras", &cameras, "--backend", "cpu", "-o", &out];
            stylegaussian(&render).expect_success();
            image::open(&out).unwrap().into_rgba8()
        })
        .into();
    let alphas = |i: usize| pictures[i].pixels().map(|pixel| f32::from(pixel.0[3]) / 255.0);
    assert!(alphas(0).sum::<f32>() > 500.0);
    for i in 1..pictures.len() {
        let difference = alphas(i).zip(alphas(0)).map(|(a, b)| (a - b).abs()).sum::<f32>() / 4096.0;
        assert!(difference < 0.01, "{i}: {difference}");
    }
}
