//! Paint on small scenes.

use std::sync::{Arc, OnceLock};

use glam::{Quat, UVec2, Vec3};

use super::*;
use crate::{
    Camera,
    palette::LUMINANCE,
    restyle::Recipe,
    scene::Scene,
    splat::{Colors, RenderedImage, render, render_strokes},
    strokes::{StrokeKnobs, StrokeWord},
    work::{Canceled, Work},
};

mod hand;
mod parts;

/// A wall of `side` x `side` Gaussians in the plane z = 0, half as wide as they are apart, with a slow gradient
/// of gray.
fn wall(side: usize) -> Scene {
    let at = |i: usize| Vec3::new((i % side) as f32, (i / side) as f32, 0.0) / side as f32;
    let n = side * side;
    let mut scene = Scene {
        means: (0..n).map(at).collect(),
        rotations: vec![Quat::IDENTITY; n],
        scales: vec![Vec3::new(0.5, 0.5, 0.02) / side as f32; n],
        opacities: vec![0.95; n],
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    };
    let gray: Vec<[f32; 3]> = (0..n).map(|i| [0.3 + 0.4 * (i % side) as f32 / side as f32; 3]).collect();
    scene.set_colors(&gray);
    scene
}

/// Vertical stripes of two colors, four pixels each.
fn stripes(width: usize, height: usize) -> Paint {
    let pixel = |x: usize| if (x / 4).is_multiple_of(2) { [230, 180, 30] } else { [20, 40, 120] };
    let pixels = (0..width * height).flat_map(|i| pixel(i % width)).collect();
    Paint { width, height, pixels, used: None }
}

fn surface(scene: &Scene) -> Surface {
    Surface::new(scene, &Work::default()).unwrap()
}

fn painted(scene: &Scene, paint: &Paint) -> Painted {
    Recipe::painting(&Canvas::new(paint), &surface(scene)).restyle(scene, &Work::default()).unwrap()
}

/// The wall from the front, filling the picture.
fn front() -> Camera {
    Camera::look_at(Vec3::new(0.5, 0.5, -2.0), Vec3::new(0.5, 0.5, 0.0), Vec3::NEG_Y, 0.45, UVec2::splat(256))
}

fn picture(scene: &Scene, painted: &Painted) -> RenderedImage {
    let strokes = (&painted.strokes, &StrokeKnobs::default());
    render_strokes(scene, Colors::Rgb(&painted.colors), strokes, &front(), None)
}

fn luminance(image: &RenderedImage, x: usize, y: usize) -> f32 {
    Vec3::from(image.color[y * 256 + x]).dot(LUMINANCE)
}

#[test]
fn a_gray_wall_gets_stripes_finer_than_its_gaussians() {
    // A Gaussian is as wide as six stripes.
    let scene = wall(12);
    let painted = painted(&scene, &stripes(512, 512));
    let with = picture(&scene, &painted);
    let plain = render(&scene, Colors::Rgb(&painted.colors), &front());
    let steps = |image: &RenderedImage, dx: usize, dy: usize| -> f32 {
        let pixels = (40..216).flat_map(|y| (40..216).map(move |x| (x, y)));
        pixels.map(|(x, y)| (luminance(image, x + dx, y + dy) - luminance(image, x, y)).abs()).sum()
    };
    assert!(
        steps(&with, 1, 0) > 10.0 * steps(&plain, 1, 0),
        "{} {}",
        steps(&with, 1, 0),
        steps(&plain, 1, 0)
    );
    // Stripes stand upright, as in the painting.
    assert!(steps(&with, 1, 0) > 2.0 * steps(&with, 0, 1), "{} {}", steps(&with, 1, 0), steps(&with, 0, 1));
}

#[test]
fn hues_are_those_of_the_painting() {
    let mut scene = wall(48);
    // A red disc in the middle. The painting is blue and yellow.
    let color = |mean: &Vec3| {
        if mean.distance(Vec3::new(0.5, 0.5, 0.0)) < 0.2 { [0.8, 0.1, 0.1] } else { [0.5, 0.5, 0.5] }
    };
    let colors: Vec<_> = scene.means.iter().map(color).collect();
    scene.set_colors(&colors);
    let painted = painted(&scene, &stripes(512, 512));
    let image = picture(&scene, &painted);
    // Of the painting's two colors red is between green and the mean of both or above it, and never far above
    // green and blue.
    let red = |i: usize| {
        let [r, g, b] = image.color[i];
        r - g.max(b)
    };
    let worst = (0..256 * 256).filter(|&i| image.alpha[i] > 0.9).map(red).fold(f32::MIN, f32::max);
    assert!(worst < 0.35, "{worst}");
}

/// Strokes are where they are, whatever the order of Gaussians in the file.
#[test]
fn the_same_for_any_order() {
    let mut scene = wall(40);
    scene.sort_by_morton();
    // More Gaussians than neighbors of one cell, and an order without any locality.
    let shuffled: Vec<u32> = (0..1600).map(|i| i * 777 % 1600).collect();
    let [sorted, other] = [&scene, &scene.subset(&shuffled)].map(|scene| painted(scene, &stripes(128, 96)));
    assert_eq!(other.strokes.seeds, sorted.strokes.seeds);
    for (i, &row) in shuffled.iter().enumerate() {
        let apart = Vec3::from(other.colors[i]).distance(sorted.colors[row as usize].into());
        assert!(apart < 1e-4, "{i}: {apart}");
        let [words, expected] = [other.strokes.words[i], sorted.strokes.words[row as usize]];
        assert_eq!(StrokeWord::unpacked(words).seed, StrokeWord::unpacked(expected).seed);
    }
}

#[test]
fn the_same_for_any_number_of_threads() {
    let scene = wall(40);
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| painted(&scene, &stripes(128, 96)))
    };
    let (one, four) = (of(1), of(4));
    assert_eq!(one.colors, four.colors);
    assert_eq!((one.strokes.seeds, one.strokes.words), (four.strokes.seeds, four.strokes.words));
}

#[test]
fn what_stands_out_is_protected() {
    // Dark and bright checks, smaller than a stroke: a few on a smooth wall, and a field of them.
    let mut scene = wall(96);
    let color = |i: usize| {
        let (x, y) = (i % 96, i / 96);
        let is_rough = (18..24).contains(&x) && (45..51).contains(&y) || x >= 56;
        if is_rough { [0.1 + 0.8 * ((x / 2 + y / 2) % 2) as f32; 3] } else { [0.5 + 0.001 * x as f32; 3] }
    };
    let colors: Vec<_> = (0..96 * 96).map(color).collect();
    scene.set_colors(&colors);
    let words = painted(&scene, &stripes(512, 512)).strokes.words;
    let mean = |from: [usize; 2], size: usize| -> f32 {
        let rows = (from[1]..from[1] + size).flat_map(|y| (from[0]..from[0] + size).map(move |x| y * 96 + x));
        rows.map(|i| StrokeWord::unpacked(words[i]).protection).sum::<f32>() / (size * size) as f32
    };
    let [few, field, smooth] = [mean([19, 46], 4), mean([70, 40], 16), mean([5, 5], 8)];
    assert!(few > 0.6 && field < 0.3 && smooth < 0.1, "few {few}, a field {field}, none {smooth}");
}

#[test]
fn content_and_weights_blend() {
    let scene = wall(32);
    let surface = surface(&scene);
    let laid = |paintings: &[(&Canvas, f64)], content| {
        lay(&scene, &surface, paintings, &Hand::default(), content, &Work::default()).unwrap()
    };
    let (a, b) = (
        Canvas::new(&stripes(64, 64)),
        Canvas::new(&Paint { pixels: vec![200; 192], width: 8, height: 8, used: None }),
    );
    let base = scene.base_colors();
    let kept = laid(&[(&a, 1.0)], 1.0);
    assert_eq!(kept.colors, base);
    assert!(kept.strokes.words.iter().all(|word| StrokeWord::unpacked(*word).share == 0.0));
    assert_eq!(laid(&[], 0.0).colors, base);
    assert_eq!(laid(&[(&a, 0.0)], 0.0).colors, base);
    let only = laid(&[(&a, 2.0), (&b, 0.0)], 0.0);
    assert_eq!(only.colors, laid(&[(&a, 1.0)], 0.0).colors);
    let half = laid(&[(&a, 1.0)], 0.5);
    for ((half, all), base) in half.colors.iter().zip(&only.colors).zip(&base) {
        assert!((0..3).all(|c| (half[c] - 0.5 * (all[c] + base[c])).abs() < 1e-5));
    }
    // Seeds of both, and words of either.
    let both = laid(&[(&a, 1.0), (&b, 1.0)], 0.0).strokes;
    let n = surface.n_seeds() as u32;
    assert_eq!((both.seeds.len(), both.textures.len()), (2 * n as usize, 2));
    let of_second = both.words.iter().filter(|word| StrokeWord::unpacked(**word).seed >= n).count();
    assert!(of_second > 0 && of_second < both.words.len(), "{of_second}");
}

#[test]
fn a_painting_is_read_at_its_own_scale() {
    // Stripes of 4 pixels are fine, stripes of 80 are not.
    assert_eq!(Canvas::new(&stripes(512, 512)).size.x, 512.0);
    let broad = |x: usize| if (x / 80).is_multiple_of(2) { 40 } else { 220 };
    let pixels = (0..512 * 512).flat_map(|i| [broad(i % 512); 3]).collect();
    assert_eq!(Canvas::new(&Paint { width: 512, height: 512, pixels, used: None }).size.x, 256.0);
    // A small painting is enlarged: its strokes have the size that they have in a large one.
    assert_eq!(Canvas::new(&stripes(256, 256)).size.x, 512.0);
}

#[test]
fn a_painting_that_nobody_waits_for_is_read_no_further() {
    let paint = stripes(64, 48);
    let canvas = Canvas::new(&paint);
    // Stopped at every share.
    for stop in [0.0, 0.1, 0.4, 0.5, 0.7, 0.8, 0.87] {
        let work = Arc::new(OnceLock::<Work>::new());
        let canceling = Arc::clone(&work);
        let telling = Work::telling(move |share| {
            if share > stop
                && let Some(work) = canceling.get()
            {
                work.cancel();
            }
        });
        let work = work.get_or_init(|| telling);
        assert_eq!(Canvas::new_if_wanted(&paint, work).err(), Some(Canceled), "{stop}");
        assert!(work.done() < 1.0, "it went on to {}", work.done());
        assert_eq!(canvas.reread_if_wanted(&paint, work).err(), Some(Canceled), "{stop}");
    }
    let wanted = Canvas::new_if_wanted(&paint, &Work::default()).unwrap();
    assert_eq!(*wanted.texture(), *canvas.texture());
}

#[test]
fn flattened_colors_have_the_detail_of_their_size() {
    let fine = wall(300);
    let painted = painted(&fine, &stripes(512, 512));
    let flat = painted.flattened(&fine);
    let steps = |colors: &[[f32; 3]]| -> f32 {
        let row = &colors[150 * 300..151 * 300];
        row.windows(2).map(|pair| (pair[1][0] - pair[0][0]).abs()).sum()
    };
    assert!(steps(&flat) > 3.0 * steps(&painted.colors), "{} {}", steps(&flat), steps(&painted.colors));
}

#[test]
fn odd_scenes_and_paintings_give_finite_colors() {
    let one_pixel = Paint { width: 1, height: 1, pixels: vec![255, 0, 0], used: None };
    let gray = Paint { width: 40, height: 3, pixels: vec![128; 360], used: None };
    let line = Paint { width: 4000, height: 50, pixels: (0..600_000).map(|i| i as u8).collect(), used: None };
    let mut pile = wall(4);
    pile.means.fill(Vec3::ZERO);
    let mut far = wall(4);
    far.means.iter_mut().for_each(|mean| *mean += Vec3::splat(1e6));
    for scene in [wall(1), wall(2), Scene::default(), pile, far] {
        for paint in [&one_pixel, &gray, &line, &stripes(64, 64)] {
            let painted = painted(&scene, paint);
            assert_eq!(painted.strokes.words.len(), scene.len());
            assert!(painted.colors.iter().flatten().all(|value| value.is_finite()));
            assert!(painted.flattened(&scene).iter().flatten().all(|value| value.is_finite()));
        }
    }
}

#[test]
fn colors_follow_a_painting_under_strokes_that_stay() {
    let scene = wall(24);
    let surface = surface(&scene);
    let work = Work::default();
    let [canvas, second] = [stripes(256, 256), stripes(128, 200)].map(|paint| Canvas::new(&paint));
    // One painting has no weight.
    fn mix<'a>(canvas: &'a Canvas, second: &'a Canvas) -> [(&'a Canvas, f64); 3] {
        [(second, 0.0), (canvas, 3.0), (second, 1.0)]
    }
    let paintings = mix(&canvas, &second);
    // With a share of the scene's own colors.
    let hand = Hand::default();
    let painted = lay(&scene, &surface, &paintings, &hand, 0.25, &work).unwrap();
    let recolored = |canvas: &Canvas| {
        recolored(&scene, &surface, &mix(canvas, &second), &hand, 0.25, &painted.strokes, &work).unwrap()
    };
    let difference = |colors: &[[f32; 3]]| {
        let pairs = colors.as_flattened().iter().zip(painted.colors.as_flattened());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    // The same painting gives the same colors, to the 7 bits of a protection and the 8 bits of a gain, of which
    // each Gaussian has that of one painting.
    assert!(difference(&recolored(&canvas)) < 0.03, "{}", difference(&recolored(&canvas)));
    let red = Paint { pixels: [200, 30, 20].repeat(64 * 64), width: 64, height: 64, used: None };
    let colors = recolored(&canvas.reread(&red));
    assert!(difference(&colors) > 0.1);
    let mean = |colors: &[[f32; 3]], c: usize| colors.iter().map(|color| color[c]).sum::<f32>() / 576.0;
    assert!(mean(&colors, 0) > mean(&painted.colors, 0), "{} red", mean(&colors, 0));
    assert!(mean(&colors, 2) < mean(&painted.colors, 2), "{} blue", mean(&colors, 2));
    work.cancel();
    let canceled = super::recolored(&scene, &surface, &paintings, &hand, 0.0, &painted.strokes, &work);
    assert!(canceled.is_err());
}
