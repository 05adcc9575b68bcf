//! Records of changed strokes, against seeds that the CPU has changed.

use stylegaussian::strokes::{StrokeCurve, StrokeFactors, StrokeRelief, StrokeSeed};

use super::*;

/// The number that the lower change adds. The upper one adds twice as much.
const FIRST: usize = 512;

/// A seed under changes of which each but its motion is taken over one below.
fn changed(seed: &StrokeSeed, factors: &[StrokeFactors], seconds: f64) -> StrokeSeed {
    let motion = factors.iter().rev().find_map(|factors| factors.motion).unwrap_or_default();
    // A motion is of the seed as it was.
    let moved = seed.plain_at(&motion.at(seconds)).packed().with_direction(seed.direction());
    factors.iter().fold(moved, |seed, factors| factors.seed(&seed).packed().with_direction(seed.direction()))
}

#[test]
fn changed_records_match() {
    let Some(gpu) = gpu() else { return };
    let mut random = randoms(57);
    let scene = random_scene(900, &mut random);
    let mut painting = random_strokes(&scene, &mut random);
    for seed in &mut painting.seeds {
        // Of gains that are doubled, none is beyond the largest.
        let plain = seed.plain();
        let halved = PlainSeed { fine: 0.4 * plain.fine, wide: 0.4 * plain.wide, ..plain };
        *seed = halved.packed().with_direction(seed.direction());
    }
    let (camera, place) = (before_scene(), Affine3A::IDENTITY);
    let boil = Motion::Boil { rate: 8.0, amount: 0.7 };
    let direction = Some(Vec3::new(1.0, -2.0, 0.5).normalize());
    let none = StrokeFactors::NONE;
    let scaled = StrokeFactors { amount: 1.4, stroke_scale: 2.0, relief: 0.5, ..none };
    // Through the middle of the scene, around a corner, and back.
    let curve = StrokeCurve::new(&[-Vec3::X, Vec3::new(0.5, 0.2, 0.0), Vec3::Y, Vec3::new(-1.0, 1.0, 0.5)]);
    assert!(curve.is_some());
    let pairs = [
        [scaled, StrokeFactors { direction, relief: 3.0, ..none }],
        [StrokeFactors { motion: Some(boil), ..none }, scaled],
        [StrokeFactors { motion: Some(boil), ..none }, StrokeFactors { motion: Some(Motion::Still), ..none }],
        [StrokeFactors { added_relief: 0.5, ..none }, StrokeFactors { curve, relief: 3.0, ..none }],
    ];
    let changed_word = |i: usize| {
        let of = StrokeWord::unpacked(painting.words[i]);
        StrokeWord { seed: of.seed + (FIRST * (i % 4)) as u32, ..of }.packed()
    };
    let words = (0..scene.len()).map(changed_word).collect();
    let painting = Strokes { words, ..painting.clone() };
    for (case, [lower, upper]) in pairs.into_iter().enumerate() {
        let seconds = 1.71;
        // In the last case, the change alone gives paint a thickness.
        let relief = if case < 3 { 1.0 } else { 0.0 };
        let knobs = StrokeKnobs { relief, light: Vec3::X, ..StrokeKnobs::DEFAULT };
        let set = |strokes: &mut GaussianStrokes| {
            strokes.set_changes(vec![(2 * FIRST as u32, upper), (FIRST as u32, lower)]);
        };
        let (records, visible, relief) =
            set_on_gpu(&gpu, &scene, &painting, set, (knobs, seconds), &camera, place);
        let mut n_shown = [0; 4];
        for i in (0..scene.len()).filter(|&i| visible[i]) {
            let factors = [vec![], vec![lower], vec![upper], vec![lower, upper]][i % 4].clone();
            let word = StrokeWord::unpacked(painting.words[i]);
            let number = word.seed as usize - FIRST * (i % 4);
            let seed = [changed(&painting.seeds[number], &factors, seconds)];
            let word = StrokeWord { seed: 0, ..word }.packed();
            let gaussian = (scene.means[i], scene.rotations[i].normalize(), scene.scales[i]);
            let across = gradients(&camera, &place, scene.means[i].as_dvec3());
            let expected = StrokeRecord::new(word, &seed, gaussian, across, &knobs);
            n_shown[i % 4] += usize::from(expected.is_some());
            check(&format!("case {case}, {i}"), records[i], expected);
            let strength = factors.iter().fold(knobs.relief, |below, factors| factors.thickness(below));
            assert_eq!(StrokeRelief::unpacked(relief[i]).strength, strength, "case {case}, {i}");
        }
        assert!(n_shown.iter().all(|n| *n > 30), "{n_shown:?}");
    }
}

/// Changes that nothing is of leave each byte as it was.
#[test]
fn records_without_changes_are_the_same_bytes() {
    let Some(gpu) = gpu() else { return };
    let mut random = randoms(58);
    let scene = random_scene(300, &mut random);
    let painting = random_strokes(&scene, &mut random);
    let (camera, place, knobs) = (before_scene(), Affine3A::IDENTITY, StrokeKnobs::DEFAULT);
    let plain = on_gpu(&gpu, &scene, &painting, knobs, &camera, place).0;
    let set = |strokes: &mut GaussianStrokes| {
        strokes.set_changes(vec![(512, StrokeFactors { stroke_scale: 3.0, ..StrokeFactors::NONE })]);
    };
    let (records, ..) = set_on_gpu(&gpu, &scene, &painting, set, (knobs, 0.0), &camera, place);
    assert!(records == plain && plain.iter().any(|record| *record != [0; 4]));
}
