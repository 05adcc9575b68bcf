//! Dabs by hand, strokes, undo against a model, selections, and masks of other scenes.

use glam::{Affine3A, Quat, UVec2, Vec2, Vec3};

use super::*;
use crate::{
    camera::Camera,
    layers::{Region, Shape},
    random::Random,
    scene::Scene,
    work::{Canceled, Work},
};

fn random_means(n: usize, random: &mut Random) -> Vec<Vec3> {
    (0..n).map(|_| Vec3::from_array([(); 3].map(|()| 2.0 * random.uniform() - 1.0))).collect()
}

/// Points along x, a tenth apart.
fn line() -> Vec<Vec3> {
    (0..21).map(|i| Vec3::new(0.1 * i as f32, 0.0, 0.0)).collect()
}

#[test]
fn a_dab_by_hand() {
    let (means, mut mask) = (line(), Mask::new(21));
    let brush = Brush { radius: 0.45, softness: 0.0, strength: 1.0, channel: 2, ..Brush::default() };
    let edit = mask.paint(&means, &brush, &[Vec3::X]);
    assert_eq!((edit.len(), edit.ranges(1, 9).first()), (9, Some(&(6..15))));
    let painted: Vec<usize> = (0..21).filter(|&i| mask.weights[i] == [0, 0, 255, 0]).collect();
    assert_eq!(painted, (6..15).collect::<Vec<_>>(), "within 0.45 of x = 1");
    // A wholly soft brush fades as 1 - smoothstep from its center to its radius. A third of the way it is
    // 20/27.
    let mut mask = Mask::new(21);
    let brush = Brush { radius: 0.9, softness: 1.0, ..Brush::default() };
    mask.paint(&means, &brush, &[Vec3::X]);
    for (i, expected) in [(10, 255.0), (13, 255.0 * 20.0 / 27.0), (7, 255.0 * 20.0 / 27.0), (19, 0.0)] {
        assert!((f32::from(mask.weights[i][0]) - expected).abs() <= 1.0, "{i}: {:?}", mask.weights[i]);
    }
}

/// Many faint dabs come to what they would in exact numbers, and arrive at 255. So does an eraser, at 0.
#[test]
fn faint_dabs_add_up() {
    let n = 400;
    let (means, mut mask) = (vec![Vec3::ZERO; n], Mask::new(n));
    let mut brush = Brush { strength: 0.004, ..Brush::default() };
    for dab in 1..=5000 {
        mask.paint(&means, &brush, &[Vec3::ZERO]);
        if [1, 30, 200].contains(&dab) {
            let mean = (0..n).map(|i| mask.weight(i, 0)).sum::<f32>() / n as f32;
            let expected = 1.0 - (1.0 - brush.strength).powi(dab);
            // Each weight is rounded by up to a step, at random; 400 of them average to a twentieth of that.
            let most = 4.0 * (dab as f32).sqrt().min(8.0) * 0.5 / 255.0 / 20.0;
            assert!((mean - expected).abs() < most, "{dab} dabs: {mean}, expected {expected} within {most}");
        }
    }
    assert!(mask.weights.iter().all(|weights| *weights == [255, 0, 0, 0]));
    brush.erases = true;
    (0..5000).for_each(|_| drop(mask.paint(&means, &brush, &[Vec3::ZERO])));
    assert!(mask.weights.iter().all(|weights| *weights == [0; 4]));
}

#[test]
fn channels_give_way_if_they_are_told_to() {
    let (means, mut mask) = ([Vec3::ZERO], Mask::new(1));
    mask.weights[0] = [200, 200, 200, 200];
    let brush = Brush { strength: 0.5, channel: 1, lessens: [true, true, false, true], ..Brush::default() };
    mask.paint(&means, &brush, &[Vec3::ZERO]);
    let [a, painted, c, d] = mask.weights[0];
    assert_eq!((a, c, d), (100, 200, 100));
    assert!((227..=228).contains(&painted), "{painted}");
    // An eraser leaves the others.
    mask.paint(&means, &Brush { erases: true, strength: 1.0, ..brush }, &[Vec3::ZERO]);
    assert_eq!(mask.weights[0], [100, 0, 200, 100]);
}

/// A stroke is the same however many points the way was told in.
#[test]
fn strokes_are_even() {
    let (means, brush) = (line(), Brush { radius: 0.2, strength: 0.3, ..Brush::default() });
    let of = |points: &[f32]| {
        let (mut mask, mut stroke) = (Mask::new(21), Stroke::new(brush));
        for &x in points {
            stroke.to(&mut mask, &means, Vec3::new(x, 0.0, 0.0));
        }
        (mask, stroke.finish())
    };
    let (once, edit) = of(&[0.5, 1.513]);
    let (often, _) = of(&[0.5, 0.51, 0.53, 0.53, f32::NAN, 0.9, 1.4, 1.513]);
    // Dabs are at the same places up to the rounding of f32, and number as many.
    assert_eq!((once.n_dabs, often.n_dabs), (21, 21));
    for (a, b) in once.weights.iter().zip(&often.weights) {
        assert!(a[0].abs_diff(b[0]) <= 1, "{a:?} {b:?}");
    }
    let in_the_middle: Vec<u8> = (7..14).map(|i| once.weights[i][0]).collect();
    let (min, max) = (in_the_middle.iter().min(), in_the_middle.iter().max());
    assert!(min > Some(&100) && max.unwrap() - min.unwrap() <= 4, "{in_the_middle:?}");
    // As one edit, the stroke goes away at once.
    let (mut mask, mut edit) = (once, edit);
    edit.swap(&mut mask);
    assert!(mask.weights.iter().all(|weights| *weights == [0; 4]));
}

#[test]
fn bad_brushes_change_nothing_and_large_ones_everything() {
    let mut random = Random::new(1);
    let (means, mut mask) = (random_means(50, &mut random), Mask::new(50));
    let brush = Brush::default();
    let bad = [
        Brush { radius: 0.0, ..brush },
        Brush { radius: -1.0, ..brush },
        Brush { radius: f32::NAN, ..brush },
        Brush { strength: f32::NAN, ..brush },
        Brush { strength: -2.0, ..brush },
        Brush { channel: 4, lessens: [true; 4], ..brush },
        Brush { softness: f32::NAN, ..brush },
    ];
    for brush in bad {
        assert!(mask.paint(&means, &brush, &[Vec3::ZERO]).is_empty(), "{brush:?}");
        let mut stroke = Stroke::new(brush);
        stroke.to(&mut mask, &means, Vec3::ZERO);
        stroke.to(&mut mask, &means, Vec3::splat(1e30));
        assert!(stroke.finish().is_empty(), "{brush:?}");
    }
    for center in [Vec3::NAN, Vec3::INFINITY, Vec3::splat(f32::MAX)] {
        assert!(mask.paint(&means, &brush, &[center]).is_empty(), "{center}");
    }
    for radius in [1e9, f32::INFINITY] {
        let mut mask = mask.clone();
        assert_eq!(mask.paint(&means, &Brush { radius, ..brush }, &[Vec3::ZERO]).len(), 50);
    }
    // A segment far longer than any brush makes a bounded number of dabs.
    let mut stroke = Stroke::new(Brush { radius: 1e-6, ..brush });
    stroke.to(&mut mask, &means, Vec3::ZERO);
    stroke.to(&mut mask, &means, Vec3::splat(1e12));
    assert!(mask.n_dabs < 5000, "{}", mask.n_dabs);
}

/// A random operation of a painter.
fn random_edit(mask: &mut Mask, means: &[Vec3], random: &mut Random) -> Edit {
    let center = means[random.below(means.len())];
    let region = Region {
        shape: Shape::Cuboid { half_size: Vec3::splat(random.uniform()) },
        shape_from_scene: Affine3A::from_quat(Quat::from_rotation_y(random.uniform())),
        softness: 0.3,
    };
    match random.below(5) {
        0 => mask.invert(random.below(5)),
        1 => {
            let combine =
                [Combine::Replace, Combine::Add, Combine::Subtract, Combine::Intersect][random.below(4)];
            mask.select(means, random.below(5), &Selection::Region(region), combine)
        }
        _ => {
            let mut stroke = Stroke::new(Brush {
                radius: random.uniform(),
                strength: random.uniform(),
                channel: random.below(4),
                lessens: [(); 4].map(|()| random.below(2) == 0),
                erases: random.below(3) == 0,
                ..Brush::default()
            });
            for _ in 0..3 {
                stroke.to(mask, means, center + 0.3 * random.uniform());
            }
            stroke.finish()
        }
    }
}

/// Undo and redo lead to the states that a model keeps whole, and memory keeps to its limit.
#[test]
fn undo_and_redo_follow_a_model() {
    let mut random = Random::new(2);
    let n = 300;
    let means = random_means(n, &mut random);
    let most = 20_000;
    let (mut mask, mut history) = (Mask::new(n), History::new(most));
    let (mut states, mut at) = (vec![mask.weights.clone()], 0);
    let mut n_undone = 0;
    for step in 0..3000 {
        match random.below(4) {
            0 => {
                let undone = history.undo(&mut mask).is_some();
                at -= usize::from(undone);
                n_undone += usize::from(undone);
            }
            1 => at += usize::from(history.redo(&mut mask).is_some()),
            _ => {
                let edit = random_edit(&mut mask, &means, &mut random);
                if !edit.is_empty() {
                    states.truncate(at + 1);
                    states.push(mask.weights.clone());
                    at += 1;
                }
                history.push(edit);
            }
        }
        assert_eq!(mask.weights, states[at], "step {step}");
        assert!(history.n_bytes() <= most + 8 * n, "step {step}: {}", history.n_bytes());
        // The model remembers everything, the history as much as it has room for.
        assert!(history.len().0 <= at && history.len().1 == states.len() - 1 - at);
    }
    assert!(n_undone > 300, "{n_undone}");
}

#[test]
fn the_number_of_threads_does_not_count() {
    let run = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| {
            let mut random = Random::new(3);
            let means = random_means(30_000, &mut random);
            let mut mask = Mask::new(means.len());
            let edits: Vec<usize> =
                (0..20).map(|_| random_edit(&mut mask, &means, &mut random).len()).collect();
            (mask.weights, edits)
        })
    };
    assert!(run(1) == run(4));
}

#[test]
fn ranges_join_across_gaps() {
    let mut mask = Mask::new(30);
    let is_chosen = |i: usize| [2, 3, 4, 7, 20, 29].contains(&i);
    let edit = mask.edit(|i, weights| if is_chosen(i) { [9; 4] } else { weights });
    assert_eq!(edit.ranges(1, 9), [2..5, 7..8, 20..21, 29..30]);
    assert_eq!(edit.ranges(3, 9), [2..8, 20..21, 29..30]);
    let all = edit.ranges(1, 3);
    assert_eq!((all.len(), all[0].clone()), (1, 2..30));
    assert!(Edit::default().ranges(1, 0).is_empty());
}

#[test]
fn selections_combine() {
    let means = line();
    let half = |point: f32| {
        let shape_from_scene = Affine3A::from_rotation_translation(
            Quat::from_rotation_z(std::f32::consts::FRAC_PI_2),
            Vec3::new(0.0, -point, 0.0),
        );
        // y below 0 is x below `point` in the scene.
        Selection::Region(Region { shape: Shape::HalfSpace, shape_from_scene, softness: 0.0 })
    };
    let mut mask = Mask::new(21);
    let mut after = |point: f32, combine: Combine| {
        mask.select(&means, 1, &half(point), combine);
        (0..21).filter(|&i| mask.weights[i] == [0, 255, 0, 0]).count()
    };
    assert_eq!(after(0.95, Combine::Replace), 10);
    assert_eq!(after(0.55, Combine::Subtract), 4);
    assert_eq!(after(0.75, Combine::Intersect), 2);
    assert_eq!(after(0.35, Combine::Add), 6);
    // What is selected in one channel can be taken for another.
    mask.select(&means, 0, &Selection::Region(Region::EVERYWHERE), Combine::Replace);
    mask.select(&means, 0, &Selection::Channel(1), Combine::Subtract);
    assert!(mask.weights.iter().all(|weights| weights[0] == 255 - weights[1]));
    mask.invert(0);
    assert!(mask.weights.iter().all(|weights| weights[0] == weights[1]));
    assert!(mask.select(&means, 9, &half(1.0), Combine::Add).is_empty() && mask.invert(4).is_empty());
}

/// A camera at the origin that looks along z, 100 pixels per unit at distance 1.
fn camera() -> Camera {
    Camera {
        view_from_world: Affine3A::IDENTITY,
        focal: Vec2::splat(100.0),
        center: Vec2::splat(50.0),
        size: UVec2::splat(100),
        near: Camera::NEAR,
    }
}

#[test]
fn a_lasso_selects_behind_its_line() {
    // An L: a square of 40 pixels without its upper right quarter.
    let corners = [(30.0, 30.0), (50.0, 30.0), (50.0, 50.0), (70.0, 50.0), (70.0, 70.0), (30.0, 70.0)];
    let polygon = corners.map(|(x, y)| Vec2::new(x, y));
    let lasso = Lasso::new(camera(), &polygon);
    let at = |x: f32, y: f32, z: f32| Vec3::new((x - 50.0) * z / 100.0, (y - 50.0) * z / 100.0, z);
    for z in [0.5, 1.0, 30.0] {
        for (x, y, within) in [
            (40.0, 40.0, true),
            (60.0, 60.0, true),
            (40.0, 60.0, true),
            (60.0, 40.0, false),
            (20.0, 60.0, false),
            (80.0, 60.0, false),
            (60.0, 80.0, false),
        ] {
            assert_eq!(lasso.contains(at(x, y, z)), within, "{x} {y} {z}");
        }
    }
    assert!(!lasso.contains(-at(40.0, 40.0, 1.0)), "behind the camera");
    assert!(!lasso.contains(Vec3::NAN) && !lasso.contains(Vec3::ZERO));
    let limited = lasso.with_depths(1.0..=2.0);
    assert_eq!([0.9, 1.5, 2.1].map(|z| limited.contains(at(40.0, 40.0, z))), [false, true, false]);
    // A star of five points drawn in one line has an empty middle.
    let tip = |i: usize| 50.0 + 40.0 * Vec2::from_angle(std::f32::consts::TAU * 0.4 * i as f32);
    let star = Lasso::new(camera(), &[0, 1, 2, 3, 4].map(tip));
    assert!(!star.contains(at(50.0, 50.0, 1.0)) && star.contains(at(85.0, 50.0, 1.0)));
    for nothing in [&[][..], &[Vec2::ZERO], &polygon[..2], &[Vec2::NAN; 5]] {
        assert!(!Lasso::new(camera(), nothing).contains(at(40.0, 40.0, 1.0)));
    }
}

/// A point is within a polygon if its angles to the corners sum to a whole turn, which counts otherwise.
#[test]
fn a_lasso_follows_winding_numbers() {
    let mut random = Random::new(5);
    for _ in 0..50 {
        // Around its middle, so that it does not cross itself.
        let n = 3 + random.below(20);
        let corner = |i: usize, radius: f32| {
            50.0 + radius * Vec2::from_angle(std::f32::consts::TAU * i as f32 / n as f32)
        };
        let polygon: Vec<Vec2> = (0..n).map(|i| corner(i, 5.0 + 40.0 * random.uniform())).collect();
        let lasso = Lasso::new(camera(), &polygon);
        for _ in 0..100 {
            let pixel = 100.0 * Vec2::new(random.uniform(), random.uniform());
            let turn: f32 = (0..n).map(|i| (polygon[i] - pixel).angle_to(polygon[(i + 1) % n] - pixel)).sum();
            let expected = turn.abs() > std::f32::consts::PI;
            let point = ((pixel - 50.0) / 100.0).extend(1.0);
            assert_eq!(lasso.contains(point), expected, "{pixel} in {polygon:?}");
        }
    }
}

#[test]
fn hidden_and_cropped_shares() {
    let weights = [[0, 51, 0, 255]];
    let share = |channel, is| Visibility { weights: &weights, channel, is }.share(0);
    assert_eq!([0, 1, 3, 7].map(|channel| share(channel, MaskUse::Hide)), [1.0, 0.8, 0.0, 1.0]);
    assert_eq!([0, 1, 3, 7].map(|channel| share(channel, MaskUse::Crop)), [0.0, 0.2, 1.0, 0.0]);
}

#[test]
fn a_mask_follows_its_scene() {
    let mut random = Random::new(6);
    let scene = Scene {
        means: random_means(9, &mut random),
        rotations: vec![Quat::IDENTITY; 9],
        scales: vec![Vec3::ONE; 9],
        opacities: vec![0.5; 9],
        order: (0..9).collect(),
        n_source: 9,
        ..Scene::default()
    };
    let mut mask = Mask::new(9);
    mask.names[1] = "ink".into();
    (0..9).for_each(|i| mask.weights[i][1] = i as u8);
    let stored = StoredMask::new(&scene, &mask);
    let moved = scene.subset(&[3, 1, 8, 0, 2, 7, 6, 5, 4]);
    let found = stored.mask_for(&moved).unwrap();
    assert_eq!(found.names, mask.names);
    for (weights, i) in found.weights.iter().zip(&moved.order) {
        assert_eq!(*weights, [0, *i as u8, 0, 0]);
    }
    assert_eq!(StoredMask::new(&moved, &found), stored);
    assert_eq!(stored.n_painted(), [0, 8, 0, 0]);
    let error = stored.mask_for(&scene.subset(&[0, 1])).unwrap_err();
    assert_eq!((error.found.n_gaussians, error.expected.n_gaussians), (9, 2));
    // Canceled before it begins, and at each share.
    for stop in [-1.0, 0.4, 0.6] {
        let own = std::sync::Arc::new(std::sync::OnceLock::<Work>::new());
        let known = own.clone();
        let telling = Work::telling(move |share| {
            if share > stop {
                known.get().unwrap().cancel();
            }
        });
        let work = own.get_or_init(|| telling);
        if stop < 0.0 {
            work.cancel();
        }
        assert_eq!(stored.mask_for_if_wanted(&moved, work).err(), Some(Canceled), "{stop}");
        assert!(work.done() < 0.8);
    }
    let lie = StoredMask { weights: Vec::new(), ..stored };
    assert_eq!(lie.mask_for(&scene).unwrap_err().found.n_gaussians, 0);
}
