//! Parts of a painted scene and its levels of detail, which share its strokes.

use std::sync::Arc;

use glam::Vec2;

use super::*;
use crate::strokes::{PlainSeed, Strokes};

/// Gaussians along a side of the walls at their finest level.
const SIDE: usize = 96;

/// A wall that is painted, of which others are parts.
struct Whole {
    canvases: Vec<Canvas>,
    hand: Hand<'static>,
    surface: Surface,
    painted: Painted,
    company: Company,
}

impl Whole {
    fn new(scene: &Scene, paints: &[Paint], hand: Hand<'static>) -> Self {
        let canvases: Vec<Canvas> = paints.iter().map(Canvas::new).collect();
        let (surface, paintings, work) = (surface(scene), evenly(&canvases), Work::default());
        let painted = lay(scene, &surface, &paintings, &hand, 0.0, &work).unwrap();
        let company = Company::new(&surface, &paintings, &hand, &painted.strokes, &work).unwrap().unwrap();
        Self { canvases, hand, surface, painted, company }
    }

    /// A scene on the surface of a part.
    fn part(&self, scene: &Scene) -> (Surface, Painted) {
        let surface = Surface::part_of(scene, &self.surface, &Work::default()).unwrap();
        let painted = self.laid(scene, &surface);
        (surface, painted)
    }

    /// A scene that has its own seeds.
    fn beside(&self, scene: &Scene) -> Painted {
        self.laid(scene, &Surface::beside(scene, &self.surface, 1.0, &Work::default()).unwrap())
    }

    fn laid(&self, scene: &Scene, surface: &Surface) -> Painted {
        let how = (&self.hand, 0.0, &self.company);
        lay_beside(scene, surface, &evenly(&self.canvases), how, &Work::default()).unwrap()
    }
}

fn evenly(canvases: &[Canvas]) -> Vec<(&Canvas, f64)> {
    canvases.iter().map(|canvas| (canvas, 1.0)).collect()
}

/// Uneven strokes that nowhere repeat.
fn dabs(light: [u8; 3]) -> Paint {
    let pixel = |i: usize| {
        let (x, y) = (i % 512, i / 512);
        let shade = ((x + 2 * y + x * y / 37) / 5 * 7919 % 97) as f32 / 96.0;
        light.map(|value| (f32::from(value) * (0.4 + 0.6 * shade)) as u8)
    };
    Paint { width: 512, height: 512, pixels: (0..512 * 512).flat_map(pixel).collect(), used: None }
}

/// The Gaussians of a wall in these columns and rows.
fn of_wall(is_in: impl Fn(usize, usize) -> bool) -> Vec<u32> {
    (0..SIDE * SIDE).filter(|i| is_in(i % SIDE, i / SIDE)).map(|i| i as u32).collect()
}

/// The next level of a wall: a quarter of the Gaussians, four times as large.
fn coarser(fine: &Scene) -> Scene {
    let mut coarse = fine.subset(&of_wall(|x, y| x % 2 == 0 && y % 2 == 0));
    coarse.scales.iter_mut().for_each(|scale| *scale *= Vec3::new(2.0, 2.0, 1.0));
    coarse
}

fn seed_of(strokes: &Strokes, i: usize) -> PlainSeed {
    strokes.seeds[StrokeWord::unpacked(strokes.words[i]).seed as usize].plain()
}

/// The spot of the painting, in texels, that the strokes of Gaussian `i` show at `at`.
fn texel(strokes: &Strokes, i: usize, at: Vec3) -> Vec2 {
    let seed = seed_of(strokes, i);
    let local = at - seed.at;
    seed.place + seed.pitch * Vec2::new(seed.right.dot(local), seed.down.dot(local))
}

/// Share of pairs of spots that are the same to two texels.
fn alike(pairs: impl Iterator<Item = [Vec2; 2]>) -> f32 {
    let pairs: Vec<_> = pairs.collect();
    let n = pairs.iter().filter(|[a, b]| a.distance(*b) < 2.0).count();
    n as f32 / pairs.len() as f32
}

#[test]
fn a_finer_level_shows_the_strokes_of_the_coarser_one() {
    let fine = wall(SIDE);
    let whole = Whole::new(&coarser(&fine), &[dabs([230, 180, 90])], Hand::default());
    // Without the rim, so that seeds of its own would not begin where those of the whole do.
    let rows = of_wall(|x, y| (5..91).contains(&x) && (5..91).contains(&y));
    let part = fine.subset(&rows);
    // At the Gaussians that both levels have.
    let share = |painted: &Painted| {
        let both = rows.iter().enumerate().filter_map(|(i, row)| {
            let (x, y) = (*row as usize % SIDE, *row as usize / SIDE);
            (x % 2 == 0 && y % 2 == 0).then_some((i, y / 2 * (SIDE / 2) + x / 2))
        });
        alike(both.map(|(i, of_coarse)| {
            let at = part.means[i];
            [texel(&whole.painted.strokes, of_coarse, at), texel(&painted.strokes, i, at)]
        }))
    };
    let (shared, own) = (share(&whole.part(&part).1), share(&whole.beside(&part)));
    assert!(shared > 0.9 && own < 0.5, "{shared} on its seeds, {own} on others");
}

#[test]
fn a_mix_shows_the_same_painting_at_a_spot_at_each_level() {
    let fine = wall(SIDE);
    let whole = Whole::new(&coarser(&fine), &[dabs([230, 180, 90]), dabs([60, 110, 230])], Hand::default());
    let (_, part) = whole.part(&fine);
    let texture = |strokes: &Strokes, i: usize| seed_of(strokes, i).texture;
    let both: Vec<[u8; 2]> = of_wall(|x, y| x % 2 == 0 && y % 2 == 0)
        .iter()
        .enumerate()
        .map(|(i, row)| [texture(&whole.painted.strokes, i), texture(&part.strokes, *row as usize)])
        .collect();
    let share = |n: usize| n as f32 / both.len() as f32;
    let second = share(both.iter().filter(|[of_coarse, _]| *of_coarse == 1).count());
    let alike = share(both.iter().filter(|[of_coarse, of_fine]| of_coarse == of_fine).count());
    assert!((0.2..0.8).contains(&second) && alike > 0.9, "{alike} of {second}");
}

#[test]
fn strokes_go_on_over_the_border_of_parts() {
    let fine = wall(SIDE);
    let whole = Whole::new(&coarser(&fine), &[dabs([230, 180, 90])], Hand::default());
    let halves = [0, SIDE / 2].map(|first| {
        let columns = first..first + SIDE / 2;
        fine.subset(&of_wall(|x, _| columns.contains(&x)))
    });
    // Halfway between the last column of one half and the first one of the other.
    let share = |[left, right]: &[Painted; 2]| {
        let half = SIDE / 2;
        alike((0..SIDE).map(|y| {
            let [last, first] = [y * half + half - 1, y * half];
            let at = 0.5 * (halves[0].means[last] + halves[1].means[first]);
            [texel(&left.strokes, last, at), texel(&right.strokes, first, at)]
        }))
    };
    let shared = share(&halves.each_ref().map(|half| whole.part(half).1));
    let own = share(&halves.each_ref().map(|half| whole.beside(half)));
    assert!(shared > 0.7 && own < 0.3, "{shared} on shared seeds, {own} on others");
}

#[test]
fn what_the_whole_does_not_have_gets_seeds_of_its_own() {
    let mut fine = wall(SIDE);
    let whole = Whole::new(&coarser(&fine), &[dabs([230, 180, 90])], Hand::default());
    // The last rows are far away.
    let is_apart = |i: usize| i / SIDE >= 80;
    for (_, mean) in fine.means.iter_mut().enumerate().filter(|(i, _)| is_apart(*i)) {
        mean.x += 5.0;
    }
    let (surface, painted) = whole.part(&fine);
    let n_shared = surface.shared.len();
    assert!(n_shared > 0 && n_shared < surface.n_seeds());
    for (i, word) in painted.strokes.words.iter().enumerate() {
        let is_new = StrokeWord::unpacked(*word).seed as usize >= n_shared;
        if is_apart(i) {
            assert!(is_new, "Gaussian {i}");
            // The nearest one is within a stroke, and colors and normals hardly differ.
            let apart = seed_of(&painted.strokes, i).at.distance(fine.means[i]);
            assert!(apart < 2.0 * 28.0 * surface.pixel(), "Gaussian {i}: {apart}");
        } else {
            assert!(!is_new, "Gaussian {i}");
        }
    }
}

#[test]
fn new_strokes_of_a_part_stand_as_the_whole_does() {
    let mut fine = wall(SIDE);
    // Captures have y down. Chunks of a world do not tell it.
    let coarse = Scene { up: Some(Vec3::NEG_Y), ..coarser(&fine) };
    let whole = Whole::new(&coarse, &[dabs([230, 180, 90])], Hand::default());
    for mean in &mut fine.means[80 * SIDE..] {
        mean.x += 5.0;
    }
    let of_new = |scene: &Scene| {
        let (surface, _) = whole.part(scene);
        surface.seeds.seeds[surface.shared.len()..].to_vec()
    };
    let new = of_new(&fine);
    assert!(!new.is_empty() && new.iter().all(|seed| seed.up.y < -0.5), "{new:?}");
    // What a scene tells goes first.
    fine.up = Some(Vec3::Y);
    let new = of_new(&fine);
    assert!(!new.is_empty() && new.iter().all(|seed| seed.up.y > 0.5), "{new:?}");
}

#[test]
fn seeds_that_are_shared_keep_their_paintings_and_places() {
    let fine = wall(SIDE);
    let hand = Hand { is_collection: true, ..Hand::default() };
    let paints = [dabs([60, 110, 230]), stripes(512, 512)];
    let whole = Whole::new(&coarser(&fine), &paints, hand);
    let (surface, painted) = whole.part(&fine.subset(&of_wall(|x, y| x < 40 && y < 40)));
    assert!(!surface.shared.is_empty() && surface.shared.len() < whole.surface.n_seeds());
    let [of_part, of_whole] = [&painted.strokes, &whole.painted.strokes];
    for (seed, number) in of_part.seeds.iter().zip(&surface.shared) {
        let (seed, given) = (seed.plain(), of_whole.seeds[*number as usize].plain());
        assert_eq!(seed.at, given.at);
        assert!(seed.place.distance(given.place) < 0.1, "{} for {}", seed.place, given.place);
        assert!(seed.right.dot(given.right) > 0.9999 && seed.down.dot(given.down) > 0.9999);
        let [own, other] = [(of_part, seed), (of_whole, given)]
            .map(|(strokes, seed)| &strokes.textures[usize::from(seed.texture)]);
        assert!(Arc::ptr_eq(own, other));
    }
}

#[test]
fn parts_in_the_colors_of_a_palette_share_its_textures() {
    let fine = wall(SIDE);
    let paints = [dabs([60, 110, 230]), stripes(512, 512)];
    let tints = Canvas::new(&dabs([230, 180, 90])).tints().clone();
    let hand = Hand { is_collection: true, tints: Some(&tints), ..Hand::default() };
    let canvases: Vec<Canvas> = paints.iter().map(Canvas::new).collect();
    let (coarse, work) = (coarser(&fine), Work::default());
    let (whole, paintings) = (surface(&coarse), evenly(&canvases));
    let painted = lay(&coarse, &whole, &paintings, &hand, 0.0, &work).unwrap();
    let company = Company::new(&whole, &paintings, &hand, &painted.strokes, &work).unwrap().unwrap();
    for columns in [0..20, 40..96] {
        let part = fine.subset(&of_wall(|x, _| columns.contains(&x)));
        let surface = Surface::part_of(&part, &whole, &work).unwrap();
        let laid = lay_beside(&part, &surface, &paintings, (&hand, 0.0, &company), &work).unwrap();
        let is_known = |own: &Arc<_>| painted.strokes.textures.iter().any(|known| Arc::ptr_eq(known, own));
        assert!(!laid.strokes.textures.is_empty() && laid.strokes.textures.iter().all(is_known));
    }
}

#[test]
fn a_part_far_from_the_whole_is_as_one_beside_it() {
    let scene = wall(40);
    let mut far = scene.clone();
    far.means.iter_mut().for_each(|mean| mean.y += 1000.0);
    let whole = Whole::new(&far, &[stripes(128, 96)], Hand::default());
    let ((surface, part), beside) = (whole.part(&scene), whole.beside(&scene));
    assert!(surface.shared.is_empty());
    assert_eq!((part.colors, part.strokes), (beside.colors, beside.strokes));
    // What has no Gaussian shares no seed.
    let nothing = Surface::part_of(&Scene::default(), &whole.surface, &Work::default()).unwrap();
    assert_eq!((nothing.shared.len(), nothing.n_seeds()), (0, 0));
}

#[test]
fn a_part_is_the_same_for_any_number_of_threads() {
    let scene = wall(40);
    let whole = Whole::new(&scene, &[stripes(128, 96)], Hand::default());
    let part = scene.subset(&(0..800).collect::<Vec<_>>());
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| whole.part(&part).1)
    };
    let (one, four) = (of(1), of(4));
    assert_eq!((one.colors, one.strokes), (four.colors, four.strokes));
}
