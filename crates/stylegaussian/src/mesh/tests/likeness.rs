//! A mesh beside a capture of the same thing: both are drawn, and show as much brushwork.

use std::f32::consts::{PI, TAU};

use glam::{Quat, UVec2, Vec2, Vec3};

use super::*;
use crate::{
    camera::Camera,
    palette::LUMINANCE,
    splat::{Colors, render_strokes},
};

/// Sides of the pictures, in pixels.
const SIDE: usize = 256;

/// Cells of the ball's mesh around its axis and along it.
const CELLS: [usize; 2] = [48, 24];

/// Gaussians of its capture.
const N_GAUSSIANS: usize = 8_000;

/// The unit ball with texture coordinates: vertices of its seam, which faces -z, are there twice.
fn ball() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let [around, along] = CELLS;
    let at = |i: usize| {
        let (sector, ring) = (i % (around + 1) % around, i / (around + 1));
        let (turn, down) = (TAU * sector as f32 / around as f32, PI * ring as f32 / along as f32);
        Vec3::new(down.sin() * turn.sin(), down.cos(), -down.sin() * turn.cos())
    };
    let row = (around + 1) as u32;
    let cells = (0..around * along).map(|i| (i / around * (around + 1) + i % around) as u32);
    let triangles = cells.flat_map(|i| [[i, i + row, i + row + 1], [i, i + row + 1, i + 1]]).collect();
    ((0..(around + 1) * (along + 1)).map(at).collect(), triangles)
}

/// The color of a point of the ball, without detail that is finer than a stroke.
fn coarse(at: Vec3) -> Vec3 {
    let waves = Vec3::new((3.0 * at.x + 1.0).sin(), (4.0 * at.y).sin(), (3.0 * at.x + 2.0 * at.z).cos());
    Vec3::splat(0.5) + 0.25 * waves
}

/// The color of a point of the ball.
fn own(at: Vec3) -> Vec3 {
    coarse(at) + 0.04 * (50.0 * at.x).sin() * (50.0 * at.y).sin()
}

/// The ball as a capture: flat Gaussians along a spiral.
fn capture() -> Scene {
    let n = N_GAUSSIANS;
    let at = |i: usize| {
        let height = 1.0 - (2 * i + 1) as f32 / n as f32;
        let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
        Vec3::new((1.0 - height * height).sqrt() * cos, height, (1.0 - height * height).sqrt() * sin)
    };
    let means: Vec<Vec3> = (0..n).map(at).collect();
    // Half as wide as they are apart.
    let side = 0.5 * (2.0 * TAU / n as f32).sqrt();
    let mut scene = Scene {
        rotations: means.iter().map(|at| Quat::from_rotation_arc(Vec3::Z, *at)).collect(),
        scales: vec![Vec3::new(side, side, 0.05 * side); n],
        opacities: vec![0.95; n],
        order: (0..n as u32).collect(),
        n_source: n,
        up: Some(Vec3::Y),
        means,
        ..Scene::default()
    };
    let colors: Vec<[f32; 3]> = scene.means.iter().map(|at| own(*at).to_array()).collect();
    scene.set_colors(&colors);
    scene
}

/// A painting of spots of two colors, three pixels wide.
fn spotted() -> Canvas {
    let mut random = Random::new(3);
    let spots: Vec<bool> = (0..86 * 86).map(|_| random.uniform() < 0.4).collect();
    let pixel = |i: usize| {
        let (x, y) = (i % 256, i / 256);
        if spots[y / 3 * 86 + x / 3] { [235, 190, 60] } else { [30, 50, 120] }
    };
    let pixels = (0..256 * 256).flat_map(pixel).collect();
    Canvas::new(&Paint { width: 256, height: 256, pixels, used: None })
}

/// The *grain* of `eval`: the deviation of the Laplacian of luminance over that of luminance, where `counts`.
fn grain(color: &[Vec3], counts: &dyn Fn(usize, usize) -> bool) -> f32 {
    let at = |x: usize, y: usize| color[y * SIDE + x].dot(LUMINANCE);
    let inner =
        || (1..SIDE - 1).flat_map(|y| (1..SIDE - 1).map(move |x| (x, y))).filter(|&(x, y)| counts(x, y));
    let deviation = |of: &dyn Fn(usize, usize) -> f32| {
        let n = inner().count() as f32;
        let mean = inner().map(|(x, y)| of(x, y)).sum::<f32>() / n;
        (inner().map(|(x, y)| (of(x, y) - mean).powi(2)).sum::<f32>() / n).sqrt()
    };
    let laplacian =
        |x: usize, y: usize| 4.0 * at(x, y) - at(x - 1, y) - at(x + 1, y) - at(x, y - 1) - at(x, y + 1);
    deviation(&laplacian) / deviation(&at)
}

#[test]
fn a_ball_shows_the_brushwork_of_its_capture_and_no_seam() {
    let (capture, canvas, work) = (capture(), spotted(), Work::default());
    let (paintings, hand) = ([(&canvas, 1.0)], Hand::default());
    let surface = Surface::new(&capture, &work).unwrap();
    let painted = lay(&capture, &surface, &paintings, &hand, 0.0, &work).unwrap();
    let company = Company::new(&surface, &paintings, &hand, &painted.strokes, &work).unwrap().unwrap();
    let spacing = SPACING * surface.pixel();
    let (positions, triangles) = ball();
    let split = split(positions, triangles, spacing);
    let own_of: Vec<[f32; 3]> = split.positions.iter().map(|at| coarse(*at).to_array()).collect();
    let spots = Spots::new(&split, Some(&split.positions), &own_of, spacing, Vec3::Y);
    let beside = Surface::beside(&spots.scene, &surface, 1.0, &work).unwrap();
    let how = (&hand, 0.0, &company);
    let paint =
        MeshPaint::new(&split, &spots, lay_beside(&spots.scene, &beside, &paintings, how, &work).unwrap());

    let eye = -4.0 * Vec3::Z;
    let camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Y, 0.52, UVec2::splat(SIDE as u32));
    let mesh = draw((&split, &spots), &paint, (&own_of[..], own), &camera);
    let is_covered = |i: usize| mesh.alpha[i] == 1.0;
    let mesh: Vec<Vec3> = mesh.color.iter().map(|color| Vec3::from(*color)).collect();
    let strokes = (&painted.strokes, &StrokeKnobs::DEFAULT);
    let splats = render_strokes(&capture, Colors::Rgb(&painted.colors), strokes, &camera, None);
    let splats: Vec<Vec3> = splats.color.iter().map(|color| Vec3::from(*color)).collect();
    // The middle of the ball, on both.
    let is_inner = |x: usize, y: usize| {
        let from_middle = Vec2::new(x as f32, y as f32) - 0.5 * SIDE as f32;
        from_middle.length() < 0.38 * SIDE as f32
    };
    let all = || (0..SIDE * SIDE).filter(|i| is_inner(i % SIDE, i / SIDE));
    assert!(all().all(is_covered));
    let grains = [grain(&mesh, &is_inner), grain(&splats, &is_inner)];
    let ratio = grains[0] / grains[1];
    let mean = |color: &[Vec3]| all().map(|i| color[i]).sum::<Vec3>() / all().count() as f32;
    let apart = mean(&mesh).distance(mean(&splats));

    // Mean steps of luminance from a column to the next, around the seam in the middle.
    let step = |x: usize| {
        let rows = SIDE / 5..SIDE - SIDE / 5;
        let at = |x: usize, y: usize| mesh[y * SIDE + x].dot(LUMINANCE);
        rows.clone().map(|y| (at(x + 1, y) - at(x, y)).abs()).sum::<f32>() / rows.len() as f32
    };
    let around = (1..30).flat_map(|k| [SIDE / 2 - 1 - k, SIDE / 2 - 1 + k]).map(step).sum::<f32>() / 58.0;
    let at_seam = step(SIDE / 2 - 1) / around;
    assert!((0.8..1.25).contains(&ratio), "{grains:?}");
    assert!(apart < 0.06, "{apart}");
    assert!(at_seam < 1.3, "{at_seam}");
}
