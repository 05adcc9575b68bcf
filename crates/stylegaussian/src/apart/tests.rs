//! Calls and answers.

use glam::Quat;

use super::*;
use crate::{
    paint::{Canvas, Company, Hand, Painted, Surface, Tints, lay_beside, pin},
    restyle::{Recipe, Styles},
    work::Work,
};

fn scene() -> Scene {
    let n = 400;
    let mut scene = Scene {
        // In no order of any kind.
        means: (0..n).map(|i| Vec3::new((i * 7 % 20) as f32, (i * 7 / 20 % 20) as f32, 0.0)).collect(),
        rotations: vec![Quat::IDENTITY; n],
        scales: vec![Vec3::new(0.5, 0.5, 0.01); n],
        opacities: vec![0.9; n],
        order: (0..n as u32).collect(),
        n_source: n,
        up: Some(Vec3::Y),
        frame: Some(Frame { center: Vec3::new(10.0, 10.0, 0.0), radius: 12.0 }),
        filter: ScreenFilter::Antialiased,
        ..Scene::default()
    };
    let colors: Vec<[f32; 3]> = (0..n).map(|i| [0.001 * i as f32, 0.3, 0.6]).collect();
    scene.set_colors(&colors);
    scene.neighbors = Some(Neighbors::find(&scene.means, &scene.order, 8));
    scene
}

fn paint(stripe: usize) -> Paint {
    let pixel = |i: usize| if (i % 48 / stripe).is_multiple_of(2) { [220, 170, 40] } else { [20, 40, 130] };
    let used = (0..48 * 40).map(|i| i % 48 > 2).collect();
    Paint { width: 48, height: 40, pixels: (0..48 * 40).flat_map(pixel).collect(), used: Some(used) }
}

fn answer(apart: &mut Apart, call: &Call) -> Result<Vec<u8>, ApartError> {
    apart.answer(&call.pieces().concat(), &Work::default())
}

#[test]
fn what_is_laid_on_apart_is_what_is_laid_on_here() {
    let (scene, paints, work) = (scene(), [paint(4), paint(9)], Work::default());
    let mut apart = Apart::default();
    answer(&mut apart, &Call::Surface(7, &scene, None)).unwrap();
    for (number, paint) in (1..).zip(&paints) {
        answer(&mut apart, &Call::Canvas(number, paint)).unwrap();
    }
    let surface = Surface::new(&scene, &work).unwrap();
    let canvases = paints.each_ref().map(Canvas::new);
    let colors = [[0.9, 0.2, 0.1], [0.1, 0.2, 0.8]];
    let pins = [Pin { at: Vec3::new(5.0, 5.0, 0.0), place: Vec2::new(0.5, 0.5), painting: 1 }];
    let direction = Some(Direction::Along(Vec3::new(1.0, 1.0, 0.0)));
    let curve = [Vec3::ZERO, Vec3::X, Vec3::new(2.0, 1.0, 0.0)];
    let of_colors = Tints::of_colors(&colors).unwrap();
    let plain =
        Choices { is_collection: false, tints: None, palette: Hand::PALETTE, direction: None, pins: &[] };
    let tinted = Choices { tints: Some(TintsOf::Canvas(2)), direction, ..plain };
    let given = Choices {
        tints: Some(TintsOf::Colors(&colors)),
        palette: 0.3,
        direction: Some(Direction::Curve(&curve)),
        ..plain
    };
    let collected = Choices { is_collection: true, pins: &pins, ..plain };
    let tints = [None, Some(canvases[1].tints()), Some(&of_colors), None];
    let mut laid = Vec::new();
    for (choices, tints) in [plain, tinted, given, collected].into_iter().zip(tints) {
        let Choices { is_collection, palette, direction, pins, .. } = choices;
        let hand = Hand { is_collection, tints, palette, direction, pins };
        let paintings = canvases.iter().zip([1.0, 0.5]).collect();
        let styles = Styles::Painted { paintings, surface: &surface, hand };
        let recipe = Recipe { looks: Vec::new(), styles, content: 0.25 };
        let here = recipe.restyle(&scene, &work).unwrap();
        let paintings = &[(1, 1.0), (2, 0.5)];
        let laying = Laying { surface: 7, whole: None, paintings, hand: choices, content: 0.25 };
        let bytes = answer(&mut apart, &Call::Lay(laying)).unwrap();
        let there = Painted::from_bytes(&bytes).unwrap();
        assert_eq!((&there.colors, &there.strokes), (&here.colors, &here.strokes));
        laid.push((here, laying));
    }
    // Pins move strokes that are there.
    let (mut here, mut laying) = laid.swap_remove(0);
    laying.hand.pins = &pins;
    let before = here.strokes.seeds.clone();
    let paintings: Vec<_> = canvases.iter().zip([1.0, 0.5]).collect();
    pin(&mut here.strokes, &surface, &paintings, &Hand { pins: &pins, ..Hand::default() }).unwrap();
    let bytes = answer(&mut apart, &Call::Pin(laying, &before)).unwrap();
    assert_eq!(pinned_seeds(&bytes, before.len()).unwrap(), here.strokes.seeds);
    assert_ne!(here.strokes.seeds, before);
    assert_eq!(pinned_seeds(&bytes, before.len() + 1), Err(ApartError::Part));
    assert!(matches!(pinned_seeds(&bytes, before.len() - 1), Err(ApartError::More(_))));
    // What cannot be had is told, and what is forgotten is not there.
    laying.content = 2.0;
    assert!(matches!(answer(&mut apart, &Call::Lay(laying)), Err(ApartError::Style(_))));
    answer(&mut apart, &Call::ForgetCanvas(2)).unwrap();
    let error = answer(&mut apart, &Call::Lay(laying)).unwrap_err();
    assert_eq!(error, ApartError::Unknown { what: "canvas" });
    answer(&mut apart, &Call::ForgetSurface(7)).unwrap();
    let error = answer(&mut apart, &Call::Lay(laying)).unwrap_err();
    assert_eq!(error, ApartError::Unknown { what: "surface" });
}

/// The whole was painted before, or was not.
#[test]
fn a_part_of_a_painted_scene_is_painted_apart_as_here() {
    let (scene, paints, work) = (scene(), [paint(4), paint(9)], Work::default());
    let part = scene.subset(&Vec::from_iter(0..150));
    let canvases = paints.each_ref().map(Canvas::new);
    let paintings: Vec<_> = canvases.iter().zip([1.0, 0.5]).collect();
    let surface = Surface::new(&scene, &work).unwrap();
    let styles = Styles::Painted { paintings: paintings.clone(), surface: &surface, hand: Hand::default() };
    let whole = Recipe { looks: Vec::new(), styles, content: 0.25 }.restyle(&scene, &work).unwrap();
    let hand = Hand::default();
    let company = Company::new(&surface, &paintings, &hand, &whole.strokes, &work).unwrap().unwrap();
    let of_part = Surface::part_of(&part, &surface, &work).unwrap();
    let here = lay_beside(&part, &of_part, &paintings, (&hand, 0.25, &company), &work).unwrap();
    let Hand { is_collection, palette, .. } = hand;
    let choices = Choices { is_collection, tints: None, palette, direction: None, pins: &[] };
    let numbers = &[(1, 1.0), (2, 0.5)];
    let of_whole = Laying { surface: 7, whole: None, paintings: numbers, hand: choices, content: 0.25 };
    let laying = Laying { surface: 8, whole: Some(7), ..of_whole };
    for before in [Some(0.25), Some(0.5), None] {
        let mut apart = Apart::default();
        let error = answer(&mut apart, &Call::Surface(8, &part, Some(7))).unwrap_err();
        assert_eq!(error, ApartError::Unknown { what: "surface" });
        answer(&mut apart, &Call::Surface(7, &scene, None)).unwrap();
        answer(&mut apart, &Call::Surface(8, &part, Some(7))).unwrap();
        for (number, paint) in (1..).zip(&paints) {
            answer(&mut apart, &Call::Canvas(number, paint)).unwrap();
        }
        if let Some(content) = before {
            answer(&mut apart, &Call::Lay(Laying { content, ..of_whole })).unwrap();
        }
        // The second one finds the facts of the first.
        for _ in 0..2 {
            let there = answer(&mut apart, &Call::Lay(laying)).unwrap();
            let there = Painted::from_bytes(&there).unwrap();
            assert_eq!((&there.colors, &there.strokes), (&here.colors, &here.strokes), "{before:?}");
        }
        answer(&mut apart, &Call::ForgetSurface(7)).unwrap();
        let error = answer(&mut apart, &Call::Lay(laying)).unwrap_err();
        assert_eq!(error, ApartError::Unknown { what: "surface" });
    }
}

#[test]
fn parts_of_calls_and_numbers_of_nothing_are_refused() {
    let mut scene = scene();
    let mut apart = Apart::default();
    let work = Work::default();
    let paint = paint(4);
    for call in [Call::Surface(0, &scene, None), Call::Canvas(0, &paint)] {
        let bytes = call.pieces().concat();
        // Every beginning would take long.
        for end in (0..bytes.len().min(200)).chain([bytes.len() / 2, bytes.len() - 1]) {
            assert_eq!(apart.answer(&bytes[..end], &work), Err(ApartError::Part), "{end}");
        }
        let longer = [&bytes[..], &[0]].concat();
        assert_eq!(apart.answer(&longer, &work), Err(ApartError::More(1)));
    }
    // Numbers that no bytes follow.
    for kind in [SURFACE, CANVAS] {
        let huge = [kind, u32::MAX, u32::MAX, u32::MAX, u32::MAX].map(u32::to_ne_bytes).concat();
        assert_eq!(apart.answer(&huge, &work), Err(ApartError::Part));
    }
    assert_eq!(apart.answer(&[9; 8], &work), Err(ApartError::Unknown { what: "call" }));
    let neighbors = Neighbors { k: 8, indices: vec![400; 8 * 400] };
    scene.neighbors = Some(neighbors);
    let error = answer(&mut apart, &Call::Surface(0, &scene, None)).unwrap_err();
    assert_eq!(error, ApartError::Unknown { what: "neighbor" });
    assert!(apart.surfaces.is_empty() && apart.canvases.is_empty());
}

#[test]
fn cameras_arrive_as_they_were() {
    let mut scene = scene();
    let to = Vec3::new(10.0, 10.0, 0.0);
    scene.cameras = vec![Camera::look_at(Vec3::new(3.0, 4.0, 30.0), to, Vec3::Y, 0.7, UVec2::new(64, 48))];
    let bytes = pieces_of(&scene).concat();
    let read = super::scene(Reader(&bytes)).unwrap();
    assert_eq!(read.cameras, scene.cameras);
    assert_eq!((read.up, read.frame, read.filter), (scene.up, scene.frame, scene.filter));
    assert_eq!((read.base_colors(), read.order), (scene.base_colors(), scene.order));
}
