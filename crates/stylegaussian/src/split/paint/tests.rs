//! Painted discs, split and drawn without strokes.

use glam::{Quat, Vec3};

use super::*;
use crate::{
    paint::{Canvas, Paint, Surface},
    palette::LUMINANCE,
    restyle::Recipe,
    splat::render,
};

/// Side of the pictures, in pixels.
const SIDE: usize = 256;

/// Pixels around one whose mean is no fine detail: a square of 2 R + 1 on a side.
const R: usize = 4;

/// A disc of flat Gaussians in the plane z = 0, with a slow gradient of gray, and one beyond all pictures. A
/// deviation is three quarters of the distance between neighbors, so that the disc is opaque.
fn disc(side: usize) -> Scene {
    // No two at one depth, where their order in the scene would decide which is in front.
    let z = |i: usize| 0.1 * (i * 617 % 1009) as f32 / 1009.0;
    let at = |i: usize| Vec3::new((i % side) as f32 + 0.5, (i / side) as f32 + 0.5, z(i)) / side as f32;
    let middle = Vec3::new(0.5, 0.5, 0.0);
    let inside = (0..side * side).map(at).filter(|mean| mean.distance(middle) < 0.5);
    let means: Vec<Vec3> = inside.chain([Vec3::new(9.0, 0.0, 0.0)]).collect();
    let n = means.len();
    let mut scene = Scene {
        rotations: vec![Quat::IDENTITY; n],
        scales: vec![Vec3::new(0.75, 0.75, 0.02) / side as f32; n],
        opacities: vec![0.95; n],
        order: (0..n as u32).collect(),
        n_source: n,
        cameras: vec![camera(Vec3::new(0.5, 0.5, -2.0), 512)],
        up: Some(Vec3::Y),
        ..Scene::default()
    };
    let gray: Vec<[f32; 3]> = means.iter().map(|mean| [0.3 + 0.4 * mean.x; 3]).collect();
    scene.means = means;
    scene.set_colors(&gray);
    scene
}

/// A camera at `eye` that sees all of the disc.
fn camera(eye: Vec3, side: usize) -> Camera {
    Camera::look_at(eye, Vec3::new(0.5, 0.5, 0.0), Vec3::NEG_Y, 0.5, UVec2::splat(side as u32))
}

/// Dabs of two colors, eight pixels wide.
fn dabs() -> Paint {
    let pixel = |x: usize, y: usize| {
        let is_light = ((x + y / 3) / 8 + y / 13).is_multiple_of(2);
        if is_light { [230, 180, 30] } else { [20, 40, 120] }
    };
    let pixels = (0..256 * 256).flat_map(|i| pixel(i % 256, i / 256)).collect();
    Paint { width: 256, height: 256, pixels, used: None }
}

fn painted(scene: &Scene) -> Painted {
    let surface = Surface::new(scene, &Work::default()).unwrap();
    Recipe::painting(&Canvas::new(&dabs()), &surface).restyle(scene, &Work::default()).unwrap()
}

/// Luminance without its mean around each pixel that the disc covers.
fn fine(image: &RenderedImage) -> Vec<f32> {
    let of = |i: usize| Vec3::from(image.color[i]).dot(LUMINANCE);
    let luminance: Vec<f32> = (0..image.color.len()).map(of).collect();
    let inside = |i: &usize| {
        let beside = (i % SIDE).abs_diff(SIDE / 2).pow(2) + (i / SIDE).abs_diff(SIDE / 2).pow(2);
        beside < (SIDE * 3 / 10).pow(2)
    };
    let around = |i: usize| {
        let rows = (0..=2 * R).map(|row| &luminance[i + row * SIDE - R * SIDE - R..][..=2 * R]);
        rows.flatten().sum::<f32>() / ((2 * R + 1) * (2 * R + 1)) as f32
    };
    (0..luminance.len()).filter(inside).map(|i| luminance[i] - around(i)).collect()
}

/// Correlation of the fine detail of `found` with that of `wanted`, and its energy over that.
fn likeness(found: &RenderedImage, wanted: &RenderedImage) -> [f32; 2] {
    let (found, wanted) = (fine(found), fine(wanted));
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    let energies = [dot(&found, &found), dot(&wanted, &wanted)];
    [dot(&found, &wanted) / (energies[0] * energies[1]).sqrt(), energies[0] / energies[1]]
}

#[test]
fn split_gaussians_show_strokes_by_themselves() {
    let scene = disc(80);
    let painted = painted(&scene);
    let mut split = scene.clone();
    let n_added = split_paint(&mut split, &painted, 4.0, &Work::default()).unwrap();
    split.validate().unwrap();
    assert_eq!(split.len(), scene.len() + n_added);
    assert!(split.len() > 3 * scene.len() && split.len() <= 4 * scene.len(), "{n_added} of {}", scene.len());
    // What no view shows is not split.
    assert_eq!(split.order.iter().filter(|order| **order as usize == scene.len() - 1).count(), 1);
    let flat = painted.flattened(&scene);
    // The view to which colors were fitted, and one from beside and nearer, where other parts are in front.
    for (eye, least, gain) in [(Vec3::new(0.5, 0.5, -2.0), 0.7, 0.2), (Vec3::new(1.0, 0.2, -1.8), 0.5, 0.05)]
    {
        let camera = camera(eye, SIDE);
        let strokes = (&painted.strokes, &StrokeKnobs::DEFAULT);
        let wanted = render_strokes(&scene, Colors::Rgb(&painted.colors), strokes, &camera, None);
        let drawn = render(&split, Colors::Captured, &camera);
        let [like, energy] = likeness(&drawn, &wanted);
        let [flat, of_flat] = likeness(&render(&scene, Colors::Rgb(&flat), &camera), &wanted);
        assert!(like > least && like > flat + gain, "{like}, flat {flat}");
        assert!((0.3..1.3).contains(&energy) && energy > 2.0 * of_flat, "{energy}, flat {of_flat}");
        let apart = |(a, b): (&f32, &f32)| (a - b).abs();
        let apart: Vec<f32> = drawn.alpha.iter().zip(&wanted.alpha).map(apart).collect();
        let mean = apart.iter().sum::<f32>() / apart.len() as f32;
        let most = apart.iter().copied().fold(0.0, f32::max);
        // Narrow parts draw a sharper edge.
        assert!(mean < 0.02 && most < 0.3, "alpha differs by {mean}, at most {most}");
    }
}

#[test]
fn without_strokes_only_colors_change() {
    let scene = disc(12);
    let colors: Vec<[f32; 3]> = (0..scene.len()).map(|i| [0.01 * i as f32, 0.5, -0.2]).collect();
    let painted = Painted { colors, ..Painted::default() };
    let mut split = scene.clone();
    assert_eq!(split_paint(&mut split, &painted, 4.0, &Work::default()), Ok(0));
    assert_eq!((&split.means, &split.scales), (&scene.means, &scene.scales));
    assert_eq!((&split.opacities, &split.order), (&scene.opacities, &scene.order));
    for (found, wanted) in split.base_colors().as_flattened().iter().zip(painted.colors.as_flattened()) {
        assert!((found - wanted).abs() < 1e-6);
    }
}

#[test]
fn odd_scenes_and_factors_are_fine() {
    let mut one = disc(30).subset(&[400]);
    one.cameras.clear();
    for (scene, factor) in
        [(Scene::default(), 4.0), (one, f64::INFINITY), (disc(12), 1.0), (disc(12), f64::NAN)]
    {
        let painted = painted(&scene);
        let mut split = scene.clone();
        let n_added = split_paint(&mut split, &painted, factor, &Work::default()).unwrap();
        split.validate().unwrap();
        assert_eq!(split.len(), scene.len() + n_added);
        assert!(n_added == 0 || factor > 1.0, "{n_added} at {factor}");
        assert!(split.base_colors().as_flattened().iter().all(|value| (-1e-6..1.31).contains(value)));
    }
}

#[test]
fn a_canceled_split_leaves_the_scene_as_it_was() {
    let scene = disc(12);
    let painted = painted(&scene);
    let (mut split, work) = (scene.clone(), Work::default());
    work.cancel();
    assert_eq!(split_paint(&mut split, &painted, 4.0, &work), Err(Canceled));
    assert_eq!((&split.means, split.base_colors()), (&scene.means, scene.base_colors()));
}

#[test]
fn detail_is_hidden_by_what_is_larger() {
    let energies = [4.0, 3.0, 1.0];
    for (level, hidden) in [(0.0, 0.0), (0.5, 0.5), (1.5, 2.0), (2.0, 3.0), (9.5, 3.0)] {
        assert_eq!(finer_than(&energies, level), hidden, "level {level}");
    }
    // (1 + 1 + 1 + 0) / 2.
    assert!((energy(&[[127, -127, 127, 0], [0; 4]]) - 1.5).abs() < 1e-6);
}
