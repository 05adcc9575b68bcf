use std::{collections::HashMap, sync::Arc};

use glam::{Vec2, Vec3};

use super::*;
use crate::{
    Scene,
    paint::{Canvas, Company, Hand, Paint, Painted, Surface, lay, lay_beside},
    random::Random,
    recolor::ColorMoments,
    strokes::{FINE_SIDE, PlainSeed, StrokeKnobs, StrokeSeed, StrokeTexture, StrokeWord, WIDE_SIDE},
    work::{Canceled, Work},
};

mod likeness;

/// Two triangles: the square 0..1 in the plane z = 0.
fn square() -> (Vec<Vec3>, [[u32; 3]; 2]) {
    (vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y], [[0, 1, 2], [0, 2, 3]])
}

fn split(positions: Vec<Vec3>, triangles: impl IntoIterator<Item = [u32; 3]>, longest: f32) -> Split {
    Split::new(positions, triangles, longest, &Work::default()).unwrap()
}

fn area(split: &Split) -> f32 {
    let of = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|i| split.positions[i as usize]);
        0.5 * (b - a).cross(c - a).length()
    };
    split.triangles.iter().map(of).sum()
}

/// All six sides of a cube from -1 to 1, each with corners of its own.
fn cube() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let first = positions.len() as u32;
            for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                let mut at = Vec3::splat(sign);
                (at[(axis + 1) % 3], at[(axis + 2) % 3]) = (x * sign, y);
                positions.push(at);
            }
            triangles.extend([[0, 1, 2], [0, 2, 3]].map(|corners| corners.map(|i| first + i)));
        }
    }
    (positions, triangles)
}

fn stripes() -> Canvas {
    let pixel = |x: usize| if (x / 4).is_multiple_of(2) { [230, 180, 30] } else { [20, 40, 120] };
    let pixels = (0..256 * 256).flat_map(|i| pixel(i % 256)).collect();
    Canvas::new(&Paint { width: 256, height: 256, pixels, used: None })
}

#[test]
fn a_split_mesh_has_short_edges_and_no_gaps() {
    let (positions, triangles) = square();
    let split = split(positions, triangles, 0.13);
    assert!((area(&split) - 1.0).abs() < 1e-5);
    let mut uses: HashMap<[u32; 2], usize> = HashMap::new();
    for corners in &split.triangles {
        for k in 0..3 {
            let [a, b] = [corners[k], corners[(k + 1) % 3]];
            *uses.entry([a.min(b), a.max(b)]).or_default() += 1;
            assert!(split.positions[a as usize].distance(split.positions[b as usize]) <= 0.13);
        }
        // All of them still face the same way.
        let [a, b, c] = corners.map(|i| split.positions[i as usize]);
        assert!((b - a).cross(c - a).z > 0.0);
    }
    for ([a, b], n) in uses {
        let [a, b] = [a, b].map(|i| split.positions[i as usize]);
        let is_rim = (0..2).any(|k| a[k] == b[k] && (a[k] == 0.0 || a[k] == 1.0));
        assert_eq!(n, if is_rim { 1 } else { 2 }, "{a} {b}");
    }
    for (at, [a, b]) in split.positions[4..].iter().zip(&split.parents) {
        let middle = 0.5 * (split.positions[*a as usize] + split.positions[*b as usize]);
        assert_eq!(*at, middle);
    }
}

#[test]
fn bad_meshes_and_endless_splits_end() {
    let (positions, triangles) = square();
    // Nothing to split, and no way to.
    for longest in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(split(positions.clone(), triangles, longest).triangles, triangles);
    }
    let finest = split(positions.clone(), triangles, 1e-9);
    assert!((MAX_TRIANGLES / 8..=MAX_TRIANGLES).contains(&finest.triangles.len()));
    assert!((area(&finest) - 1.0).abs() < 1e-2);
    // A sliver of no area, vertices that are no numbers, and those that are not there.
    let mut odd = positions.clone();
    odd.extend([Vec3::NAN, Vec3::new(f32::INFINITY, 0.0, 0.0), Vec3::splat(1e38)]);
    let given = [[0, 1, 2], [0, 1, 1], [0, 1, 4], [0, 5, 1], [0, 1, 6], [0, 1, 99]];
    assert_eq!(split(odd.clone(), given, 10.0).triangles, [[0, 1, 2], [0, 1, 1]]);
    let work = Work::default();
    for given in [vec![], given.to_vec()] {
        for longest in [0.3, 1e30] {
            let split = split(odd.clone(), given.iter().copied(), longest);
            let colors = vec![[0.5; 3]; split.positions.len()];
            let spots = Spots::new(&split, None, &colors, longest, Vec3::Y);
            assert_eq!(spots.scene.validate(), Ok(()));
            let surface = Surface::new(&spots.scene, &work).unwrap();
            let painted =
                lay(&spots.scene, &surface, &[(&stripes(), 1.0)], &Hand::default(), 0.0, &work).unwrap();
            let paint = MeshPaint::new(&split, &spots, painted);
            assert_eq!(paint.corners.triangles.len(), split.triangles.len());
            assert!(paint.colors.iter().flatten().all(|value| value.is_finite()));
        }
    }
    work.cancel();
    assert_eq!(Split::new(positions, triangles, 0.1, &work), Err(Canceled));
}

#[test]
fn a_spot_is_a_place_and_a_side() {
    // The square as two triangles with vertices of their own, as along a seam of texture coordinates.
    let (positions, triangles) = square();
    let seam: Vec<Vec3> = triangles.iter().flatten().map(|&i| positions[i as usize]).collect();
    let apart = split(seam, [[0, 1, 2], [3, 4, 5]], 0.2);
    let shared = split(positions.clone(), triangles, 0.2);
    assert!(apart.positions.len() > shared.positions.len());
    let spots = |split: &Split| Spots::new(split, None, &vec![[0.5; 3]; split.positions.len()], 0.2, Vec3::Y);
    assert_eq!(spots(&apart).scene.len(), shared.positions.len());
    // Areas sum to the square's: spots are half as wide as they are apart.
    let areas: f32 = spots(&apart).scene.broad_sides().into_iter().map(|side| 4.0 * side * side).sum();
    assert!((areas - 1.0).abs() < 1e-4, "{areas}");
    // Both sides of a leaf, and the edges of a cube.
    let leaf = split(positions, [[0, 1, 2], [2, 1, 0]], 9.0);
    let normals = vec![Vec3::Z; 4];
    assert_eq!(spots(&leaf).scene.len(), 3, "normals of both sides sum to nothing");
    let with = Spots::new(&leaf, Some(&normals), &[[0.5; 3]; 4], 0.2, Vec3::Y);
    assert_eq!((with.scene.len(), with.of_vertex[3]), (3, Spots::NONE));
    let (positions, triangles) = cube();
    let cube = spots(&split(positions, triangles, 9.0)).scene;
    assert_eq!(cube.len(), 24);
    for (at, turn) in cube.means.iter().zip(&cube.rotations) {
        let normal = *turn * Vec3::Z;
        assert!((normal.abs().max_element() - 1.0).abs() < 1e-5 && normal.dot(*at) > 0.9, "{at} {normal}");
    }
}

#[test]
fn a_dense_mesh_has_fewer_spots_than_vertices() {
    let side = 400_u32;
    let at = |i: u32| Vec3::new((i % side) as f32, (i / side) as f32, 0.0);
    let positions: Vec<Vec3> = (0..side * side).map(at).collect();
    let cells = (0..side * (side - 1)).filter(|i| i % side + 1 < side);
    let triangles = cells.flat_map(|i| [[i, i + 1, i + side], [i + 1, i + side + 1, i + side]]);
    let dense = split(positions, triangles, 0.01);
    assert!(dense.triangles.len() > MAX_TRIANGLES, "it is not split");
    let spots = Spots::new(&dense, None, &vec![[0.2; 3]; dense.positions.len()], 0.01, Vec3::Y);
    assert!((MAX_SPOTS / 8..=MAX_SPOTS).contains(&spots.scene.len()), "{}", spots.scene.len());
    let areas: f32 = spots.scene.broad_sides().into_iter().map(|side| 4.0 * side * side).sum();
    assert!((areas / ((side - 1) * (side - 1)) as f32 - 1.0).abs() < 1e-3, "{areas}");
}

/// A texture of noise, and seeds in it.
fn noise(n_seeds: u32) -> (Vec<StrokeSeed>, Vec<Arc<StrokeTexture>>) {
    let mut random = Random::new(5);
    let mut noise = |n: usize| (0..n).map(|_| Vec3::splat(random.uniform() - 0.5)).collect();
    let texture = StrokeTexture::new(noise(FINE_SIDE * FINE_SIDE), noise(WIDE_SIDE * WIDE_SIDE));
    let seed = |i: u32| {
        PlainSeed {
            at: Vec3::new(0.3, 0.1 * i as f32, 0.0),
            right: Vec3::X,
            down: Vec3::Y,
            pitch: Vec2::new(60.0, 50.0),
            place: Vec2::new(100.0 + 77.0 * i as f32, 300.0 - 33.0 * i as f32),
            fine: 1.0,
            wide: 0.5,
            texture: 0,
        }
        .packed()
    };
    ((0..n_seeds).map(seed).collect(), vec![Arc::new(texture)])
}

fn word(seed: u32, protection: f32) -> u32 {
    StrokeWord { seed, protection, share: 1.0 }.packed()
}

#[test]
fn a_triangle_of_one_seed_shows_the_painting_at_the_seeds_place() {
    let (seeds, textures) = noise(1);
    let words = [word(0, 0.0); 3];
    let knobs = StrokeKnobs { stroke_scale: 2.0, amount: 1.5, ..StrokeKnobs::DEFAULT };
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    for shares in [Vec3::X, Vec3::new(0.2, 0.5, 0.3), Vec3::splat(1.0 / 3.0)] {
        let at: Vec3 = (0..3).map(|k| shares[k] * corners[k]).sum();
        // The map is affine: the place is the mean of the corners' places.
        let seed = seeds[0].plain();
        let place = |at: Vec3| seed.place + seed.pitch / 2.0 * (at - seed.at).truncate();
        let mean: Vec2 = (0..3).map(|k| shares[k] * place(corners[k])).sum();
        assert!(mean.distance(place(at)) < 1e-3);
        let expected = 1.5
            * (seed.fine * textures[0].fine(mean / FINE_SIDE as f32, 0.5)
                + seed.wide * textures[0].wide(mean / FINE_SIDE as f32, 0.5));
        let found = detail_at((words, shares), at, (&seeds, &textures), &knobs, 0.5);
        assert!(found.distance(expected) < 1e-3, "{found} {expected}");
    }
}

#[test]
fn strokes_of_two_seeds_meet_without_a_step_and_keep_their_contrast() {
    let (seeds, textures) = noise(4);
    let detail = |words: [u32; 3], shares: Vec3, at: Vec3| {
        detail_at((words, shares), at, (&seeds, &textures), &StrokeKnobs::DEFAULT, 0.0)
    };
    // Two triangles share the edge from the first corner to the second. Their third corners differ.
    let (a, b) = (word(0, 0.2), word(1, 0.6));
    for i in 0..=20 {
        let t = i as f32 / 20.0;
        let (shares, at) = (Vec3::new(1.0 - t, t, 0.0), Vec3::new(t, 0.4, 0.0));
        let (one, other) =
            (detail([a, b, word(2, 0.0)], shares, at), detail([a, b, word(3, 1.0)], shares, at));
        assert!(one.distance(other) < 1e-6);
        let reversed = detail([b, a, word(2, 0.0)], Vec3::new(t, 1.0 - t, 0.0), at);
        assert!(one.distance(reversed) < 1e-5);
    }
    // At a corner there is no other seed.
    let alone = detail([a; 3], Vec3::X, Vec3::ZERO);
    assert!(detail([a, b, b], Vec3::X, Vec3::ZERO).distance(alone) < 1e-6);
    let weights = |seeds: [u32; 3], shares: [f32; 3]| blend_weights(seeds, Vec3::from(shares));
    assert!(weights([7, 7, 7], [0.2, 0.3, 0.5]).distance(Vec3::new(0.2, 0.3, 0.5)) < 1e-6);
    for shares in [[0.5, 0.5, 0.0], [0.2, 0.3, 0.5], [1.0, 0.0, 0.0]] {
        assert!((weights([1, 2, 3], shares).length() - 1.0).abs() < 1e-6);
        let two = weights([1, 2, 2], shares);
        assert!((two.x * two.x + (two.y + two.z).powi(2) - 1.0).abs() < 1e-5);
    }
}

#[test]
fn triangles_of_one_seed_share_vertices_and_others_name_all_their_seeds() {
    let (positions, triangles) = square();
    let split = split(positions, triangles, 0.2);
    let colors = vec![[0.5; 3]; split.positions.len()];
    let spots = Spots::new(&split, None, &colors, 0.2, Vec3::Y);
    let is_left = |at: &Vec3| at.x < 0.4;
    let words: Vec<u32> =
        spots.scene.means.iter().map(|at| word(u32::from(is_left(at)), 0.3 * at.x)).collect();
    let all = Corners::new(&split, &spots, &words);
    assert_eq!(all.triangles.len(), split.triangles.len());
    for (numbers, vertices) in all.triangles.iter().zip(&split.triangles) {
        let corners = numbers.map(|i| all.corners[i as usize]);
        assert_eq!(corners.map(|corner| corner.vertex), *vertices);
        let own = vertices.map(|v| words[spots.of_vertex[v as usize] as usize]);
        for (k, corner) in corners.iter().enumerate() {
            assert_eq!(corner.words[corner.corner as usize], own[k]);
            let named = corner.words.map(|word| StrokeWord::unpacked(word).seed);
            assert_eq!(named, own.map(|word| StrokeWord::unpacked(word).seed));
        }
    }
    let one = Corners::new(&split, &spots, &vec![words[0]; spots.scene.len()]);
    assert_eq!(one.corners.len(), split.positions.len());
    assert!(all.corners.len() > split.positions.len());
}

/// A wall of Gaussians: gray with a gradient, and red in a part of it.
fn wall() -> Scene {
    let (side, n) = (60_usize, 3600);
    let at = |i: usize| Vec3::new((i % side) as f32, (i / side) as f32, 0.0) / side as f32;
    let mut scene = Scene {
        means: (0..n).map(at).collect(),
        rotations: vec![glam::Quat::IDENTITY; n],
        scales: vec![Vec3::new(0.5, 0.5, 0.02) / side as f32; n],
        opacities: vec![0.95; n],
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    };
    let color = |at: &Vec3| if at.x < 0.3 { RED } else { [0.1 + 0.8 * at.y; 3] };
    scene.set_colors(&scene.means.iter().map(color).collect::<Vec<_>>());
    scene
}

const RED: [f32; 3] = [0.7, 0.2, 0.1];

#[test]
fn what_is_alike_is_painted_alike_beside_a_scene() {
    let (wall, canvas, work) = (wall(), stripes(), Work::default());
    let paintings = [(&canvas, 1.0)];
    let hand = Hand::default();
    let surface = Surface::new(&wall, &work).unwrap();
    let painted = lay(&wall, &surface, &paintings, &hand, 0.0, &work).unwrap();
    let company = Company::new(&surface, &paintings, &hand, &painted.strokes, &work).unwrap().unwrap();
    // A red square as large as the wall, whose unit is half of the wall's.
    let scale = 2.0;
    let spacing = SPACING * surface.pixel() * scale;
    let (positions, triangles) = square();
    let split = split(positions.into_iter().map(|at| scale * at).collect(), triangles, spacing);
    let spots = Spots::new(&split, None, &vec![RED; split.positions.len()], spacing, Vec3::Y);
    let beside = Surface::beside(&spots.scene, &surface, scale, &work).unwrap();
    assert_eq!(beside.pixel(), scale * surface.pixel());
    let seeds = beside.n_seeds() as f32 / surface.n_seeds() as f32;
    assert!((0.6..1.6).contains(&seeds), "strokes are as large: {seeds}");
    let on_mesh = lay_beside(&spots.scene, &beside, &paintings, (&hand, 0.0, &company), &work).unwrap();
    let mean = |colors: &mut dyn Iterator<Item = [f32; 3]>| {
        let (sum, n) = colors.fold((Vec3::ZERO, 0.0), |(sum, n), c| (sum + Vec3::from(c), n + 1.0));
        sum / n
    };
    let reds = (0..wall.len()).filter(|&i| wall.means[i].x < 0.25);
    let expected = mean(&mut reds.map(|i| painted.colors[i]));
    let found = mean(&mut on_mesh.colors.iter().copied());
    assert!(found.distance(expected) < 0.08, "{found} for {expected}");
    // Alone, red would be the mean of the painting.
    let own = Surface::new(&spots.scene, &work).unwrap();
    let alone = lay(&spots.scene, &own, &paintings, &hand, 0.0, &work).unwrap();
    let apart = mean(&mut alone.colors.iter().copied()).distance(expected);
    assert!(apart > 1.5 * found.distance(expected), "{apart}: the test would not see it");

    // Strokes on the mesh are as strong as in the painting.
    let paint = MeshPaint::new(&split, &spots, on_mesh);
    let mut random = Random::new(9);
    let detail = |_| {
        let numbers = paint.corners.triangles[random.below(paint.corners.triangles.len())];
        let corners = numbers.map(|i| paint.corners.corners[i as usize]);
        let words = corners.map(|corner| corner.words[corner.corner as usize]);
        let shares = Vec3::from_array(std::array::from_fn(|_| random.uniform()));
        let shares = shares / shares.element_sum();
        let at = (0..3).map(|k| shares[k] * split.positions[corners[k].vertex as usize]).sum();
        let strokes = (&*paint.strokes.seeds, &*paint.strokes.textures);
        detail_at((words, shares), at, strokes, &StrokeKnobs::DEFAULT, 0.0)
    };
    let on_mesh = ColorMoments::of_weighted((0..4000).map(detail).map(|detail| (detail, 1.0)));
    let texels = canvas.texture().fine[0]
        .iter()
        .map(|[r, g, b, _]| (Vec3::new(f32::from(*r), f32::from(*g), f32::from(*b)) / 127.0, 1.0));
    let in_painting = ColorMoments::of_weighted(texels);
    let along = crate::palette::LUMINANCE;
    let ratio = on_mesh.deviation_along(along) / in_painting.deviation_along(along);
    assert!((0.7..1.3).contains(&ratio), "{ratio}");
    // Strokes of other paintings are no company.
    let none = Painted::default().strokes;
    assert!(Company::new(&surface, &paintings, &hand, &none, &work).unwrap().is_none());
}
