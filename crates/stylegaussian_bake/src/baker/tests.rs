//! Whole bakes of a small scene.

use glam::{Quat, UVec2, Vec3};
use stylegaussian::{
    Camera, Scene,
    paint::{Canvas, Surface},
    random::Random,
    restyle::Recipe,
    splat::{Colors, blend_weights, render, render_strokes},
    strokes::{StrokeKnobs, StrokeWord},
};
use stylegaussian_defaults::{ENCODER, ENCODER_NAME};
use stylegaussian_encoder::{Image, paint_of};

use super::*;
use crate::start::{LARGE_WEIGHT, protections};

/// A wall of n x n Gaussians, in gray stripes.
fn wall(n: usize) -> Scene {
    let place =
        |i: usize| Vec3::new((i % n) as f32, (i / n) as f32, 0.0) / n as f32 * 2.0 - Vec3::new(1.0, 1.0, 0.0);
    let mut scene = Scene {
        means: (0..n * n).map(place).collect(),
        rotations: vec![Quat::IDENTITY; n * n],
        scales: vec![Vec3::splat(1.2 / n as f32); n * n],
        opacities: vec![0.95; n * n],
        order: (0..(n * n) as u32).collect(),
        n_source: n * n,
        ..Default::default()
    };
    scene.set_colors(&(0..n * n).map(|i| [0.3 + 0.4 * (i / 4 % 2) as f32; 3]).collect::<Vec<_>>());
    scene
}

fn cameras() -> Vec<Camera> {
    let look = |x| Camera::look_at(Vec3::new(x, 0.0, -3.0), Vec3::ZERO, Vec3::Y, 0.7, UVec2::splat(64));
    [-0.5, 0.5].map(look).to_vec()
}

/// Diagonal dabs of blue and yellow.
fn painting(side: u32, color: impl Fn(u32, u32) -> [f32; 3]) -> Image {
    let rgb = (0..side * side).flat_map(|i| color(i % side, i / side)).collect();
    Image { width: side, height: side, rgb, alpha: None }
}

fn dabs(x: u32, y: u32) -> [f32; 3] {
    if ((x + y) / 5).is_multiple_of(2) { [0.1, 0.2, 0.7] } else { [0.9, 0.8, 0.3] }
}

const CONFIG: BakeConfig = BakeConfig { steps: 12, crop: 48, view: 64, ..BakeConfig::DEFAULT };

fn network() -> LossNetwork {
    LossNetwork::distilled(ENCODER_NAME, ENCODER).unwrap()
}

fn baker(scene: &Scene, paintings: &[(Image, f32)]) -> Baker {
    Baker::new(CONFIG, scene, &cameras(), paintings, network(), &Work::default()).unwrap()
}

fn bits(baker: &Baker) -> Vec<u32> {
    baker.colors.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn a_bake_starts_from_paint_as_far_as_it_is_strong() {
    let scene = wall(24);
    let paintings = [(painting(64, dabs), 1.0)];
    let start = |config: BakeConfig| {
        let baker = Baker::new(config, &scene, &cameras(), &paintings, network(), &Work::default()).unwrap();
        (baker.colors().to_vec(), baker.strokes().clone())
    };
    let canvas = Canvas::new(&paint_of(&paintings[0].0));
    let work = Work::default();
    let surface = Surface::new(&scene, &work).unwrap();
    let painted = Recipe::painting(&canvas, &surface).restyle(&scene, &work).unwrap();
    let (recolored, none) = start(CONFIG.with_strength(0.0));
    assert!(none.seeds.is_empty() && none.words.iter().all(|word| StrokeWord::unpacked(*word).share == 0.0));
    let apart = |a: &[[f32; 3]], b: &[[f32; 3]]| {
        let differences = a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs());
        differences.fold(0.0, f32::max)
    };
    assert!(apart(&painted.colors, &recolored) > 0.05);
    for config in [CONFIG, CONFIG.with_strength(2.0)] {
        let (colors, strokes) = start(config);
        assert!(apart(&colors, &painted.colors) < 1e-5);
        assert!(strokes == painted.strokes);
    }
    let (half, strokes) = start(CONFIG.with_strength(0.5));
    let pairs = painted.colors.iter().zip(&recolored);
    let between: Vec<[f32; 3]> = pairs.map(|(a, b)| std::array::from_fn(|i| 0.5 * (a[i] + b[i]))).collect();
    assert!(apart(&half, &between) < 1e-5);
    let shares = strokes.words.iter().map(|word| StrokeWord::unpacked(*word).share);
    assert!(shares.clone().all(|share| (share - 0.5).abs() < 0.01) && shares.len() == scene.len());
}

/// Compares the detail that is added to crops with the difference of two drawn pictures. Drawing leaves out
/// fragments by alpha and not by weight, and rounds records.
#[test]
fn a_crop_has_the_strokes_that_are_drawn() {
    let scene = wall(24);
    let baker = baker(&scene, &[(painting(64, dabs), 1.0)]);
    for camera in cameras() {
        let added = strokes_over(&scene, baker.strokes(), &camera, &blend_weights(&scene, &camera));
        let colors = Colors::Rgb(baker.colors());
        let strokes = (baker.strokes(), &StrokeKnobs::DEFAULT);
        let drawn = render_strokes(&scene, colors, strokes, &camera, None);
        let plain = render(&scene, colors, &camera);
        let drawn = drawn.color.as_flattened().iter().zip(plain.color.as_flattened()).map(|(a, b)| a - b);
        let (mut square, mut apart) = (0.0, 0.0);
        for (added, drawn) in added.iter().zip(drawn) {
            square += drawn * drawn;
            apart += (added - drawn) * (added - drawn);
        }
        assert!(square > 1.0 && apart < 0.03 * square, "{apart} of {square}");
    }
}

#[test]
fn strokes_stay_as_they_are_and_colors_move_under_them() {
    let scene = wall(12);
    let mut baker =
        baker(&scene, &[(painting(64, dabs), 1.0), (painting(40, |_, y| [y as f32 / 40.0; 3]), 0.5)]);
    let (colors, strokes) = (baker.colors().to_vec(), baker.strokes().clone());
    assert_eq!(strokes.textures.len(), 2);
    while !baker.is_complete() {
        baker.step(&scene);
    }
    assert!(baker.colors() != colors && *baker.strokes() == strokes);
}

/// A part has another mean color than the whole. Alone, it takes all of the painting's colors.
#[test]
fn a_part_begins_in_the_colors_of_the_whole() {
    let mut whole = wall(24);
    // The left half is dark, the right one bright.
    let shade = |(i, color): (usize, [f32; 3])| color.map(|c| 0.5 * c + [0.0, 0.5][i % 24 / 12]);
    let colors: Vec<[f32; 3]> = whole.base_colors().into_iter().enumerate().map(shade).collect();
    whole.set_colors(&colors);
    let part = whole.subset(&(0..24 * 24).filter(|i| i % 24 < 12).collect::<Vec<_>>());
    // So is the painting, below its dabs.
    let halves = |x: u32, y: u32| dabs(x, y).map(|c| 0.5 * c + [0.0, 0.5][x as usize / 32]);
    let paintings = [(painting(64, halves), 1.0)];
    let config = BakeConfig { steps: 2, ..CONFIG };
    let brightness = |baker: &Baker| baker.colors.iter().sum::<f32>() / baker.colors.len() as f32;
    let alone = Baker::new(config, &part, &cameras(), &paintings, network(), &Work::default()).unwrap();
    let mut of_part =
        Baker::of_part(config, (&part, &whole), &cameras(), &paintings, network(), &Work::default()).unwrap();
    let (alone, beside) = (brightness(&alone), brightness(&of_part));
    assert!(beside < alone - 0.05, "{beside} as a part, {alone} alone");
    of_part.step(&part);
    assert_eq!(of_part.colors().len(), part.len());
}

#[test]
fn losses_fall() {
    let scene = wall(24);
    let config = BakeConfig { steps: 30, rate: 0.05, ..CONFIG };
    let mut baker =
        Baker::new(config, &scene, &cameras(), &[(painting(64, dabs), 1.0)], network(), &Work::default())
            .unwrap();
    let mut losses = Vec::new();
    while !baker.is_complete() {
        losses.push(baker.step(&scene));
    }
    let mean = |of: fn(&Losses) -> f32, part: &[Losses]| part.iter().map(of).sum::<f32>() / part.len() as f32;
    for of in [|losses: &Losses| losses.statistics, |losses: &Losses| losses.matching] {
        let (first, last) = (mean(of, &losses[..6]), mean(of, &losses[24..]));
        assert!(last < 0.9 * first, "from {first} to {last}");
    }
}

/// How far each Gaussian's color goes from the start in 30 steps `[N]`.
fn moved(scene: &Scene, protection: f32) -> Vec<f32> {
    let config = BakeConfig { steps: 30, protection, ..CONFIG };
    let mut baker =
        Baker::new(config, scene, &cameras(), &[(painting(64, dabs), 1.0)], network(), &Work::default())
            .unwrap();
    while !baker.is_complete() {
        baker.step(scene);
    }
    let pairs = baker.colors.chunks_exact(3).zip(baker.start.colors.chunks_exact(3));
    pairs.map(|(color, start)| color.iter().zip(start).map(|(a, b)| (a - b).abs()).sum()).collect()
}

#[test]
fn small_things_stay_near_the_start() {
    // Two lone bright stripes of a Gaussian each, which are small things, on a plain wall.
    const STRIPES: [usize; 2] = [30, 42];
    let mut scene = wall(48);
    let stripes = |i: usize| if STRIPES.contains(&(i % 48)) { [0.9; 3] } else { [0.5; 3] };
    scene.set_colors(&(0..48 * 48).map(stripes).collect::<Vec<_>>());
    let halves = |protection: f32| {
        let moved = moved(&scene, protection);
        // The wall away from the stripes.
        let sum = |counts: &dyn Fn(usize) -> bool| -> f32 {
            (0..48 * 48).filter(|i| counts(i % 48)).map(|i| moved[i]).sum()
        };
        [sum(&|column| (4..16).contains(&column)), sum(&|column| STRIPES.contains(&column))]
    };
    let ([plain, small], [plain_free, small_free]) = (halves(12.0), halves(0.0));
    // All is held a little.
    assert!(small / small_free < 0.7 * plain / plain_free, "{small} {small_free} {plain} {plain_free}");
}

#[test]
fn gaussians_larger_than_a_stroke_stay_near_the_start() {
    // Deviations of 12 and of 3 pixels.
    let [large, small] = [3, 12].map(|n| {
        let [held, free] = [1.0, 0.0].map(|protection| moved(&wall(n), protection).iter().sum::<f32>());
        held / free
    });
    assert!(large < 0.6 && large < 0.8 * small, "{large} {small}");
}

#[test]
fn what_carries_no_strokes_is_protected() {
    let words =
        [0.0, 1.0, 0.0, 1.0, 0.0].map(|protection| StrokeWord { protection, ..StrokeWord::NONE }.packed());
    let found = protections(&words, &[0.2, 0.2, 1.0, 1.0, 0.4], 0.05);
    let middle = found[4];
    assert_eq!(found[..4], [0.3, 1.0, LARGE_WEIGHT, LARGE_WEIGHT]);
    assert!(middle > 0.3 && middle < LARGE_WEIGHT, "{middle}");
}

#[test]
fn an_interruption_changes_no_bit() {
    let (scene, paintings) = (wall(12), [(painting(64, dabs), 1.0)]);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.checkpoint.safetensors");
    let mut whole = baker(&scene, &paintings);
    whole.save(&path).unwrap();
    // The second time among the last steps, which are averaged.
    let (stops, mut resumed) = ([3, 11], Vec::new());
    for stop in stops {
        while whole.steps() < stop {
            whole.step(&scene);
        }
        whole.save(&path).unwrap();
        let mut other = baker(&scene, &paintings);
        other.resume(&path).unwrap();
        assert_eq!(other.steps(), stop);
        resumed.push(other);
    }
    for baker in resumed.iter_mut().chain([&mut whole]) {
        while !baker.is_complete() {
            baker.step(&scene);
        }
    }
    let [mut resumed, late] = resumed.try_into().ok().unwrap();
    assert_eq!([bits(&resumed), bits(&late)], [bits(&whole), bits(&whole)]);

    let mut other = baker(&scene, &[(painting(64, |x, _| [x as f32 / 64.0; 3]), 1.0)]);
    let error = other.resume(&path).unwrap_err().to_string();
    assert!(error.contains("another scene, painting or setting"), "{error}");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    assert!(resumed.resume(&path).unwrap_err().to_string().contains("broken"));
}

#[test]
fn a_step_that_nobody_waits_for_moves_no_color() {
    let scene = wall(12);
    let mut baker = baker(&scene, &[(painting(64, dabs), 1.0)]);
    let (colors, work) = (baker.colors().to_vec(), Work::default());
    work.cancel();
    assert_eq!(baker.step_if_wanted(&scene, &work).err(), Some(Canceled));
    assert!(baker.colors() == colors && baker.steps() == 0);
    baker.step(&scene);
    assert!(baker.colors() != colors && baker.steps() == 1);
}

#[test]
fn the_last_colors_are_averaged() {
    let scene = wall(12);
    let mut baker = baker(&scene, &[(painting(64, dabs), 1.0)]);
    let mut sum = vec![0.0_f64; scene.len() * 3];
    // Of twelve steps the last two, and the colors before them.
    while baker.steps() < 11 {
        baker.step(&scene);
        assert_eq!(baker.average.is_empty(), baker.steps() < 10);
        if baker.steps() >= 10 {
            sum.iter_mut().zip(&baker.colors).for_each(|(sum, color)| *sum += f64::from(*color));
        }
    }
    assert!(baker.average != baker.colors);
    for (average, sum) in baker.average.iter().zip(sum) {
        assert!((f64::from(*average) - sum / 2.0).abs() < 1e-6);
    }
    baker.step(&scene);
    assert_eq!(baker.average, baker.colors);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (scene, paintings) =
        (wall(12), [(painting(64, dabs), 1.0), (painting(40, |_, y| [y as f32 / 40.0; 3]), 0.5)]);
    let run = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| {
            let mut baker = baker(&scene, &paintings);
            for _ in 0..4 {
                baker.step(&scene);
            }
            bits(&baker)
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn odd_paintings_and_scenes_give_finite_colors() {
    let gray = |x: u32, y: u32| [((x * y) % 7) as f32 / 7.0; 3];
    let mut random = Random::new(1);
    let noise =
        Image { width: 300, height: 3, rgb: (0..2700).map(|_| random.uniform()).collect(), alpha: None };
    for painting in [painting(1, gray), painting(48, gray), painting(48, |_, _| [0.2, 0.5, 0.3]), noise] {
        // One Gaussian fills the pictures: a wall without a second one.
        for scene in [wall(8), wall(1)] {
            let mut baker = baker(&scene, &[(painting.clone(), 1.0)]);
            for _ in 0..2 {
                baker.step(&scene);
            }
            assert!(baker.colors.iter().all(|value| value.is_finite()), "{}", painting.width);
        }
    }
}

#[test]
fn what_cannot_be_baked_is_an_error() {
    let good = painting(16, dabs);
    let error = |scene: &Scene, paintings: &[(Image, f32)]| {
        Baker::new(CONFIG, scene, &[], paintings, network(), &Work::default()).err().unwrap().to_string()
    };
    let message = error(&Scene::default(), &[(good.clone(), 1.0)]);
    assert!(message.starts_with("the scene of 0 Gaussians"), "{message}");
    let invisible = Scene { opacities: vec![0.0; 16], ..wall(4) };
    assert!(error(&invisible, &[(good.clone(), 1.0)]).contains("no view shows anything opaque"));
    assert!(error(&wall(4), &[]).contains("expected at least one"));
    assert!(error(&wall(4), &[(good.clone(), 0.0)]).contains("expected at least one"));
    let broken = Image { width: 4, height: 4, rgb: vec![f32::NAN; 48], alpha: None };
    assert!(error(&wall(4), &[(broken, 1.0)]).contains("NaN"));
    assert!(
        error(&wall(4), &[(Image { width: 0, height: 4, rgb: Vec::new(), alpha: None }, 1.0)])
            .contains("0x4")
    );
}
