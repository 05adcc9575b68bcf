//! Tests of paint as a whole, on a wall of small Gaussians.

use glam::{Quat, Vec3};

use super::*;
use crate::{palette::LUMINANCE, scene::Scene};

/// A wall of `side` x `side` Gaussians in the plane z = 0, half as wide as they are apart, with a slow gradient of gray.
fn wall(side: usize) -> Scene {
    let at = |i: usize| Vec3::new((i % side) as f32, (i / side) as f32, 0.0) / side as f32;
    let n = side * side;
    let mut scene = Scene {
        means: (0..n).map(at).collect(),
        rotations: vec![Quat::IDENTITY; n],
        scales: vec![Vec3::new(0.5, 0.5, 0.05) / side as f32; n],
        opacities: vec![0.95; n],
        order: (0..n as u32).collect(),
        n_source: n,
        up: Some(Vec3::Y),
        ..Scene::default()
    };
    scene.set_colors(&(0..n).map(|i| [0.4 + 0.2 * at(i).x; 3]).collect::<Vec<_>>());
    scene
}

/// Vertical stripes of two colors, four pixels each.
fn stripes(width: usize, height: usize) -> Paint {
    let pixel = |x: usize| if (x / 4).is_multiple_of(2) { [230, 180, 30] } else { [20, 40, 120] };
    let pixels = (0..width * height).flat_map(|i| pixel(i % width)).collect();
    Paint { width, height, pixels, features: None }
}

fn moments(colors: &[[f32; 3]]) -> (Vec3, f32) {
    let mean = colors.iter().map(|color| Vec3::from(*color)).sum::<Vec3>() / colors.len() as f32;
    let square = colors.iter().map(|color| Vec3::from(*color).distance_squared(mean)).sum::<f32>();
    (mean, (square / colors.len() as f32).sqrt())
}

#[test]
fn a_gray_wall_gets_stripes_that_stand_upright() {
    let scene = wall(96);
    let surface = Surface::new(&scene, 1.0);
    let colors = repaint(&scene, &surface, &[(&stripes(128, 96), 1.0)], 0.0, Brush::default());
    let (mean, deviation) = moments(&colors);
    assert!(mean.distance(Vec3::new(125.0, 110.0, 75.0) / 255.0) < 0.12, "{mean}");
    // The painting's own deviation is 0.53. Recoloring alone would give it in one slow gradient.
    assert!(deviation > 0.25, "{deviation}");
    let step = |i: usize, j: usize| Vec3::from(colors[i]).distance(Vec3::from(colors[j]));
    let inner = || (1..95).flat_map(|y| (1..95).map(move |x| y * 96 + x));
    let across: f32 = inner().map(|i| step(i, i + 1)).sum();
    let along: f32 = inner().map(|i| step(i, i + 96)).sum();
    assert!(across.max(along) > 1.5 * across.min(along), "stripes have a direction: {across} and {along}");
}

#[test]
fn hues_are_those_of_the_painting() {
    let mut scene = wall(96);
    // A red disc in the middle. The painting is blue and yellow.
    let color = |mean: &Vec3| {
        if mean.distance(Vec3::new(0.5, 0.5, 0.0)) < 0.15 { [0.9, 0.1, 0.1] } else { [0.4 + 0.2 * mean.x; 3] }
    };
    scene.set_colors(&scene.means.iter().map(color).collect::<Vec<_>>());
    let surface = Surface::new(&scene, 1.0);
    let paint = stripes(128, 96);
    let colors = repaint(&scene, &surface, &[(&paint, 1.0)], 0.0, Brush::default());
    let rgb: Vec<f32> = paint.pixels.iter().map(|byte| f32::from(*byte) / 255.0).collect();
    let palette = crate::palette::Palette::new(&rgb, 1);
    let hue = |color: Vec3| color - color.dot(Vec3::new(0.299, 0.587, 0.114));
    let off = |color: &[f32; 3]| {
        let color = Vec3::from(*color);
        hue(color).distance(hue(palette.nearest(color)))
    };
    let mean = colors.iter().map(off).sum::<f32>() / colors.len() as f32;
    assert!(mean < 0.1, "{mean}");
}

#[test]
fn the_same_colors_for_any_number_of_threads() {
    let scene = wall(48);
    let painted = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let surface = Surface::new(&scene, 1.0);
            repaint(&scene, &surface, &[(&stripes(64, 64), 1.0)], 0.0, Brush::default())
        })
    };
    assert_eq!(painted(1), painted(4));
}

#[test]
fn gaussians_read_the_detail_that_their_sheet_shows() {
    let scene = wall(96);
    let surface = Surface::new(&scene, 1.0);
    let patches = patches::Patches::new(&stripes(128, 96)).unwrap();
    let gray = vec![Vec3::splat(0.45); scene.len()];
    let nothing = (Vec3::splat(0.45), [Vec3::ZERO; canvas::N_DETAILS]);
    let read = |share: f32| {
        let mut readings = vec![nothing; scene.len()];
        surface.sheets.read(&gray, &patches, share, &mut readings);
        readings
    };
    assert!(read(0.0).iter().all(|reading| *reading == nothing));
    let (half, whole) = (read(0.5), read(1.0));
    // Detail in luminance: two colors of stripes are 0.52 apart.
    let detail = |(_, details): &canvas::Reading| details.iter().sum::<Vec3>().dot(LUMINANCE);
    let mean = |readings: &[canvas::Reading]| {
        readings.iter().map(|reading| detail(reading).abs()).sum::<f32>() / readings.len() as f32
    };
    assert!(mean(&whole) > 0.1, "{}", mean(&whole));
    assert!((mean(&half) / mean(&whole) - 0.5).abs() < 1e-3);
    assert!(whole.iter().all(|(low, _)| *low == nothing.0), "color stays");
}

#[test]
fn what_is_fine_does_not_depend_on_the_contrast_of_the_scene() {
    // Quarters of the wall: checks, which are smaller than a stroke, beside smooth gray.
    let fine = |contrast: f32| {
        let mut scene = wall(96);
        let color = |i: usize| {
            let (x, y) = (i % 96, i / 96);
            let check = if x < 48 && y < 48 { ((x + y) % 2) as f32 - 0.5 } else { (y / 48) as f32 * 0.1 };
            [0.5 + contrast * check; 3]
        };
        scene.set_colors(&(0..96 * 96).map(color).collect::<Vec<_>>());
        Surface::new(&scene, 1.0).fine
    };
    let (strong, weak) = (fine(0.8), fine(0.2));
    let inner = |fine: &[f32], x: usize, y: usize| fine[y * 96 + x];
    assert!(inner(&strong, 20, 20) > 0.5 && inner(&strong, 80, 80) < 0.05, "{}", inner(&strong, 20, 20));
    for (strong, weak) in strong.iter().zip(&weak) {
        assert!((strong - weak).abs() < 0.02, "{strong} and {weak}");
    }
}

#[test]
fn on_rough_ground_only_what_stands_out_is_fine() {
    // Checks all over, four times as strong in a quarter of the wall.
    let mut scene = wall(96);
    let color = |i: usize| {
        let (x, y) = (i % 96, i / 96);
        let strength = if x < 48 && y < 48 { 0.4 } else { 0.1 };
        [0.5 + strength * (((x + y) % 2) as f32 - 0.5); 3]
    };
    scene.set_colors(&(0..96 * 96).map(color).collect::<Vec<_>>());
    let surface = Surface::new(&scene, 1.0);
    let (strong, weak) = (surface.fine[20 * 96 + 20], surface.fine[80 * 96 + 80]);
    assert!(strong > 0.9 && weak < 0.45, "{strong} and {weak}");
}

#[test]
fn content_and_weights_blend() {
    let scene = wall(32);
    let surface = Surface::new(&scene, 1.0);
    let (a, b) = (stripes(64, 64), Paint { pixels: vec![200; 3 * 64], width: 8, height: 8, features: None });
    let paint =
        |paints: &[(&Paint, f64)], content| repaint(&scene, &surface, paints, content, Brush::default());
    assert_eq!(paint(&[(&a, 1.0)], 1.0), scene.base_colors());
    assert_eq!(paint(&[], 0.0), scene.base_colors());
    assert_eq!(paint(&[(&a, 2.0)], 0.0), paint(&[(&a, 1.0), (&b, 0.0)], 0.0));
    let half = paint(&[(&a, 1.0), (&b, 3.0)], 0.5);
    let (in_a, in_b) = (paint(&[(&a, 1.0)], 0.0), paint(&[(&b, 1.0)], 0.0));
    for (((found, own), a), b) in half.iter().zip(scene.base_colors()).zip(in_a).zip(in_b) {
        let expected = Vec3::from(own) * 0.5 + Vec3::from(a) * 0.125 + Vec3::from(b) * 0.375;
        assert!(Vec3::from(*found).distance(expected) < 1e-5);
    }
}

#[test]
fn odd_scenes_and_paintings_give_finite_colors() {
    let one_pixel = Paint { width: 1, height: 1, pixels: vec![255, 0, 0], features: None };
    let gray = Paint { width: 40, height: 3, pixels: vec![128; 360], features: None };
    let mut pile = wall(4);
    pile.means = vec![Vec3::ONE; 16];
    for scene in [Scene::default(), wall(1), pile, wall(3)] {
        let surface = Surface::new(&scene, f32::NAN);
        assert_eq!(surface.is_empty(), scene.is_empty());
        for paint in [&one_pixel, &gray] {
            let colors = repaint(&scene, &surface, &[(paint, 1.0)], 0.0, Brush::default());
            assert_eq!(colors.len(), scene.len());
            let expected = if paint.width == 1 { Vec3::X } else { Vec3::splat(128.0 / 255.0) };
            let colors: Vec<Vec3> = colors.into_iter().map(Vec3::from).collect();
            let within = |color: &Vec3| color.min_element() >= -1.0 && color.max_element() <= 2.0;
            assert!(colors.iter().all(|color| color.is_finite() && within(color)));
            // Pictures are corrected: of the Gaussians on one spot, those behind the first have no say.
            let shown = surface.proofs.pixels(&colors);
            assert_eq!(shown.is_empty(), scene.is_empty());
            assert!(shown.iter().all(|color| color.distance(expected) < 0.06), "{shown:?}");
        }
    }
}
