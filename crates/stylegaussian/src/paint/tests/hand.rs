//! The artist's choices: what may be used of a painting, collections, the palette, pinned places.

use glam::Vec2;

use super::*;
use crate::{
    restyle::{RestyleError, Styles},
    strokes::{FINE_SIDE, StrokeSeed, Strokes},
};

/// Diagonal strokes of two shades of a color.
fn strokes_of(width: usize, height: usize, light: [u8; 3]) -> Paint {
    let pixel = |i: usize| {
        let (x, y) = (i % width, i / width);
        let is_light = ((x + 2 * y + x * y / 37) / 5).is_multiple_of(2);
        light.map(|value| if is_light { value } else { value / 2 })
    };
    Paint { width, height, pixels: (0..width * height).flat_map(pixel).collect(), used: None }
}

const BLUE: [u8; 3] = [60, 110, 230];
const GREEN: [u8; 3] = [60, 190, 50];

/// A wall that is blue on the left and green on the right, each a little uneven.
fn sky_and_grass() -> Scene {
    let mut scene = wall(60);
    let color = |i: usize| {
        let shade = 0.85 + 0.15 * ((i * 7919 % 101) as f32 / 101.0);
        let color = if i % 60 < 30 { [0.3, 0.5, 0.9] } else { [0.25, 0.6, 0.2] };
        color.map(|value| value * shade)
    };
    scene.set_colors(&(0..3600).map(color).collect::<Vec<_>>());
    scene
}

fn laid(scene: &Scene, surface: &Surface, paintings: &[&Canvas], hand: Hand) -> Painted {
    let paintings = paintings.iter().map(|canvas| (*canvas, 1.0)).collect();
    let styles = Styles::Painted { paintings, surface, hand };
    Recipe { looks: Vec::new(), styles, content: 0.0 }.restyle(scene, &Work::default()).unwrap()
}

fn assert_equal(a: &Painted, b: &Painted) {
    assert_eq!(a.colors, b.colors);
    assert_eq!(a.strokes, b.strokes);
}

fn collection() -> Hand<'static> {
    Hand { is_collection: true, ..Hand::default() }
}

/// The painting of each seed.
fn textures(painted: &Painted) -> Vec<u8> {
    painted.strokes.seeds.iter().map(|seed| seed.plain().texture).collect()
}

#[test]
fn a_painting_that_is_used_wholly_is_as_one_without_a_mask() {
    let scene = wall(32);
    let paint = strokes_of(200, 150, GREEN);
    let all = Paint { used: Some(vec![true; 200 * 150]), ..paint.clone() };
    let none = Paint { used: Some(vec![false; 200 * 150]), ..paint.clone() };
    let expected = painted(&scene, &paint);
    assert_equal(&painted(&scene, &all), &expected);
    assert!(!none.is_usable() && all.is_usable());
    assert_equal(&painted(&scene, &none), &expected);
}

/// Green strokes, and red ones around them that must not be used.
#[test]
fn nothing_is_taken_from_where_a_painting_must_not_be_used() {
    let side = 512;
    let (mut paint, red) = (strokes_of(side, side, GREEN), strokes_of(side, side, [250, 20, 20]));
    let is_used = |i: usize| Vec2::new((i % side) as f32 - 300.0, (i / side) as f32 - 200.0).length() < 150.0;
    let used: Vec<bool> = (0..side * side).map(is_used).collect();
    for (i, used) in used.iter().enumerate().filter(|(_, used)| !**used) {
        paint.pixels[3 * i..3 * i + 3].copy_from_slice(&red.pixels[3 * i..3 * i + 3]);
        assert!(!used);
    }
    let canvas = Canvas::new(&Paint { used: Some(used.clone()), ..paint });
    assert_eq!(canvas.size, Vec2::splat(512.0));
    let scene = sky_and_grass();
    let surface = surface(&scene);
    let found = laid(&scene, &surface, &[&canvas], Hand::default());
    assert_eq!(FINE_SIDE, side, "texels are pixels");
    for seed in &found.strokes.seeds {
        let seed = seed.plain();
        // The corner of a patch, whichever way it is turned.
        for turn in 0..16 {
            let at = seed.place
                + Vec2::from_angle(turn as f32 * std::f32::consts::FRAC_PI_8) * 16.0 * 2.0_f32.sqrt();
            assert!(used[at.y as usize * side + at.x as usize], "{}", seed.place);
        }
    }
    // Neither the palette nor the moments know of red.
    let alone = laid(&scene, &surface, &[&Canvas::new(&strokes_of(side, side, GREEN))], Hand::default());
    for (found, alone) in found.colors.iter().zip(&alone.colors) {
        assert!(Vec3::from(*found).distance(Vec3::from(*alone)) < 0.12, "{found:?} for {alone:?}");
    }
    let image = picture(&scene, &found);
    let redness = |i: usize| image.color[i][0] - image.color[i][1];
    let worst = (0..256 * 256).filter(|&i| image.alpha[i] > 0.9).map(redness).fold(f32::MIN, f32::max);
    assert!(worst < 0.2, "{worst}");
}

#[test]
fn a_collection_of_one_painting_is_that_painting() {
    let scene = sky_and_grass();
    let surface = surface(&scene);
    let [canvas, again] = [0, 1].map(|_| Canvas::new(&strokes_of(200, 150, GREEN)));
    let alone = laid(&scene, &surface, &[&canvas], Hand::default());
    assert_equal(&laid(&scene, &surface, &[&canvas], collection()), &alone);
    assert_equal(&laid(&scene, &surface, &[&canvas, &again, &canvas], collection()), &alone);
}

#[test]
fn each_part_of_a_scene_takes_the_painting_that_is_like_it() {
    let scene = sky_and_grass();
    let surface = surface(&scene);
    let [blue, green] = [BLUE, GREEN].map(|color| Canvas::new(&strokes_of(256, 256, color)));
    let found = laid(&scene, &surface, &[&blue, &green], collection());
    assert_eq!(found.strokes.textures.len(), 2);
    for (seed, texture) in found.strokes.seeds.iter().zip(textures(&found)) {
        if (seed.at[0] - 0.5).abs() > 0.05 {
            assert_eq!(texture == 0, seed.at[0] < 0.5, "{:?}", seed.at);
        }
    }
    // Base colors have the hue of their painting, which the mean of both has not.
    for (color, mean) in found.colors.iter().zip(&scene.means) {
        let is_blue = color[2] > color[1];
        if (mean.x - 0.5).abs() > 0.1 {
            assert_eq!(is_blue, mean.x < 0.5, "{mean}: {color:?}");
        }
    }
    // The order of the paintings is no matter.
    let turned = laid(&scene, &surface, &[&green, &blue], collection());
    assert!(textures(&found).iter().zip(textures(&turned)).all(|(a, b)| a + b == 1));
}

/// The part of a scene changes that shows the painting that changed, and no strokes show another like it.
#[test]
fn colors_follow_a_collection_under_strokes_that_stay() {
    let scene = sky_and_grass();
    let surface = surface(&scene);
    let colors = [BLUE, BLUE, GREEN];
    let [blue, again, green] = colors.map(|color| Canvas::new(&strokes_of(256, 256, color)));
    let painted = laid(&scene, &surface, &[&blue, &again, &green], collection());
    assert_eq!(painted.strokes.textures.len(), 2);
    let recolored = |blue: &Canvas| {
        let paintings = [blue, &again, &green].map(|canvas| (canvas, 1.0));
        let (hand, work) = (collection(), Work::default());
        recolored(&scene, &surface, &paintings, &hand, 0.0, &painted.strokes, &work).unwrap()
    };
    let apart = |(a, b): (&[f32; 3], &[f32; 3])| Vec3::from(*a).distance(Vec3::from(*b));
    let most = recolored(&blue).iter().zip(&painted.colors).map(apart).fold(0.0, f32::max);
    assert!(most < 0.03, "{most}");
    let other = recolored(&blue.reread(&strokes_of(200, 300, [200, 60, 230])));
    let is_violet = |color: &[f32; 3]| color[0] > color[1] + 0.1;
    for (color, mean) in other.iter().zip(&scene.means).filter(|(_, mean)| (mean.x - 0.5).abs() > 0.1) {
        assert_eq!(is_violet(color), mean.x < 0.5, "{mean}: {color:?}");
    }
}

#[test]
fn a_picture_that_is_read_again_is_used_as_far_as_it_may_be() {
    let side = 256;
    let used = (0..side * side).map(|i| i % side < 150).collect();
    let masked = Paint { used: Some(used), ..strokes_of(side, side, GREEN) };
    let (whole, fresh) = (Canvas::new(&strokes_of(side, side, BLUE)), Canvas::new(&masked));
    let again = whole.reread(&masked);
    assert_eq!(again.size, fresh.size);
    assert!(whole.is_whole() && !again.is_whole());
    assert_eq!((&again.used, &again.colors), (&fresh.used, &fresh.colors));
    assert_eq!(again.texture(), fresh.texture());
    // Strokes that stay are known by the first picture.
    assert!(again.follows(whole.texture()) && !again.follows(again.texture()));
}

#[test]
fn neighbors_in_sixteen_paintings_prefer_the_same_one() {
    let scene = sky_and_grass();
    let surface = surface(&scene);
    let canvases: Vec<Canvas> = (0..16)
        .map(|i| Canvas::new(&strokes_of(96 + i, 96, [40 + 12 * i as u8, 120, 240 - 13 * i as u8])))
        .collect();
    let found = laid(&scene, &surface, &canvases.iter().collect::<Vec<_>>(), collection());
    let labels = textures(&found);
    assert!(found.strokes.textures.len() <= 16 && labels.iter().any(|label| *label != labels[0]));
    let pairs = surface.seeds.around.iter().enumerate();
    let pairs: Vec<(usize, u32)> = pairs.flat_map(|(i, of)| of.iter().map(move |j| (i, *j))).collect();
    let n_same = pairs.iter().filter(|(i, j)| labels[*i] == labels[*j as usize]).count();
    assert!(3 * n_same > 2 * pairs.len(), "{n_same} of {}", pairs.len());
}

#[test]
fn the_palette_pulls_as_much_as_it_is_told() {
    // Areas of any hue in the scene, and three hues in the painting.
    let mut scene = wall(48);
    let area = |i: usize| i % 48 / 8 + 6 * (i / 48 / 8);
    let colors: Vec<_> =
        (0..48 * 48).map(|i| [7, 11, 13].map(|n| (area(i) * n % 37) as f32 / 36.0)).collect();
    scene.set_colors(&colors);
    let surface = surface(&scene);
    let three = [[200, 40, 40], [40, 160, 50], [50, 60, 210]];
    let pixels = (0..256 * 256).flat_map(|i| three[i % 256 / 4 % 3]).collect();
    let canvas = Canvas::new(&Paint { width: 256, height: 256, pixels, used: None });
    let with = |palette| laid(&scene, &surface, &[&canvas], Hand { palette, ..Hand::default() });
    let chroma = |color: Vec3| color - color.dot(LUMINANCE);
    let hues = three.map(|color| chroma(Vec3::from(color.map(f32::from))).normalize());
    // How far hues are from the nearest of the painting's, as a share of the chroma.
    let off = |painted: &Painted| {
        let chromas: Vec<Vec3> = painted.colors.iter().map(|color| chroma(Vec3::from(*color))).collect();
        let near = |chroma: &Vec3| hues.map(|hue| hue.dot(*chroma)).into_iter().fold(0.0, f32::max);
        1.0 - chromas.iter().map(near).sum::<f32>()
            / chromas.iter().map(|chroma| chroma.length()).sum::<f32>()
    };
    let [none, some, usual, all] = [0.0, 0.5, Hand::PALETTE, 1.0].map(|palette| off(&with(palette)));
    assert!(none > some && some > usual && usual > all, "{none} {some} {usual} {all}");
    assert!(all < 0.8 * none, "{all} {none}");
    assert_equal(&with(Hand::PALETTE), &laid(&scene, &surface, &[&canvas], Hand::default()));
    for bad in [-0.1, 1.1, f32::NAN] {
        let hand = Hand { palette: bad, ..Hand::default() };
        let styles = Styles::Painted { paintings: vec![(&canvas, 1.0)], surface: &surface, hand };
        let recipe = Recipe { looks: Vec::new(), styles, content: 0.0 };
        let found = recipe.restyle(&scene, &Work::default());
        assert!(matches!(found, Err(RestyleError::Palette { .. })), "{bad}");
    }
}

#[test]
fn another_palette_gives_the_hues_and_keeps_the_strokes() {
    let scene = sky_and_grass();
    let surface = surface(&scene);
    let canvas = Canvas::new(&stripes(256, 256));
    let own = laid(&scene, &surface, &[&canvas], Hand::default());
    let reds = Tints::of_colors(&[[0.3, 0.05, 0.05], [0.6, 0.15, 0.1], [0.95, 0.6, 0.55]]).unwrap();
    for tints in [&reds, Canvas::new(&strokes_of(96, 96, [240, 90, 60])).tints()] {
        let found = laid(&scene, &surface, &[&canvas], Hand { tints: Some(tints), ..Hand::default() });
        let red = found.colors.iter().filter(|color| color[0] > color[1] && color[0] > color[2]).count();
        assert!(20 * red > 19 * scene.len(), "{red} of {}", scene.len());
        for (a, b) in own.strokes.seeds.iter().zip(&found.strokes.seeds) {
            assert_eq!(a.place, b.place, "places are those of the strokes' painting");
        }
        let texels = |painted: &Painted| painted.strokes.textures[0].fine[0].clone();
        let apart = |(a, b): (&[i8; 4], &[i8; 4])| {
            let of = |texel: &[i8; 4]| Vec3::new(texel[0].into(), texel[1].into(), texel[2].into());
            (of(a).dot(LUMINANCE) - of(b).dot(LUMINANCE)).abs()
        };
        let worst = texels(&own).iter().zip(&texels(&found)).map(apart).fold(0.0, f32::max);
        // Each byte is rounded; some saturate.
        assert!(worst < 12.0, "{worst}");
    }
}

/// Upright stripes have a direction, which is laid along the one that is told.
#[test]
fn strokes_follow_a_direction() {
    let scene = sky_and_grass();
    let surface = surface(&scene);
    let canvas = Canvas::new(&stripes(512, 512));
    for direction in [Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::new(-3.0, 9.0, 0.5)] {
        let hand = Hand { direction: Some(Direction::Along(direction)), ..Hand::default() };
        let found = laid(&scene, &surface, &[&canvas], hand);
        let along = direction.reject_from_normalized(Vec3::Z).normalize();
        for seed in &found.strokes.seeds {
            let down = seed.plain().down;
            assert!(down.dot(along).abs() > 0.98, "{down} along {along}");
        }
    }
    for bad in [Vec3::ZERO, Vec3::new(0.0, f32::NAN, 1.0)] {
        let hand = Hand { direction: Some(Direction::Along(bad)), ..Hand::default() };
        let styles = Styles::Painted { paintings: vec![(&canvas, 1.0)], surface: &surface, hand };
        let recipe = Recipe { looks: Vec::new(), styles, content: 0.0 };
        let found = recipe.restyle(&scene, &Work::default());
        assert!(matches!(found, Err(RestyleError::Direction { .. })), "{bad}");
    }
}

/// Around a circle, every spot's strokes follow it, those of spots that continue their neighbors too.
#[test]
fn strokes_follow_a_curve() {
    let scene = sky_and_grass();
    let surface = surface(&scene);
    let canvas = Canvas::new(&stripes(512, 512));
    let center = Vec3::new(0.5, 0.5, 0.0);
    let point = |i: usize| {
        let (sin, cos) = (i as f32 * std::f32::consts::TAU / 48.0).sin_cos();
        center + 0.3 * Vec3::new(cos, sin, 0.0)
    };
    let mut circle: Vec<Vec3> = (0..48).map(point).collect();
    circle.push(circle[0]);
    let hand = Hand { direction: Some(Direction::Curve(&circle)), ..Hand::default() };
    let found = laid(&scene, &surface, &[&canvas], hand);
    let mut n_seen = 0;
    for seed in &found.strokes.seeds {
        let from = Vec3::from(seed.at) - center;
        if from.length() > 0.1 {
            let around = Vec3::Z.cross(from).normalize();
            let down = seed.plain().down;
            assert!(down.dot(around).abs() > 0.95, "{down} around {around}");
            n_seen += 1;
        }
    }
    assert!(n_seen > 20, "{n_seen}");
    let hand = Hand { direction: Some(Direction::Curve(&circle[..1])), ..Hand::default() };
    let styles = Styles::Painted { paintings: vec![(&canvas, 1.0)], surface: &surface, hand };
    let found = Recipe { looks: Vec::new(), styles, content: 0.0 }.restyle(&scene, &Work::default());
    let message = found.map(|_| ()).unwrap_err().to_string();
    assert_eq!(message, "the strokes' curve has 1 points that differ, expected at least 2");
}

/// The point of the painting, 0..1, that a seed lays on a point of the scene.
fn place_of(painted: &Painted, seed: usize, at: Vec3) -> Vec2 {
    let seed = painted.strokes.seeds[seed].plain();
    let offset = at - seed.at;
    (seed.place + seed.pitch * Vec2::new(seed.right.dot(offset), seed.down.dot(offset))) / FINE_SIDE as f32
}

#[test]
fn pinned_places_are_honored_and_their_neighbors_continue_them() {
    let scene = sky_and_grass();
    let surface = surface(&scene);
    let [blue, green] = [BLUE, GREEN].map(|color| Canvas::new(&strokes_of(256, 256, color)));
    let pins = [
        Pin { at: Vec3::new(0.31, 0.52, 0.0), place: Vec2::new(0.4, 0.6), painting: 0 },
        Pin { at: Vec3::new(0.7, 0.3, 0.0), place: Vec2::new(0.7, 0.3), painting: 0 },
    ];
    let hand = Hand { pins: &pins, ..Hand::default() };
    let found = laid(&scene, &surface, &[&blue], hand);
    let plain = laid(&scene, &surface, &[&blue], Hand::default());
    for pin in &pins {
        let near =
            |(_, seed): &(usize, &StrokeSeed)| Vec3::from(seed.at).distance(pin.at) < 40.0 * surface.pixel;
        let seeds: Vec<usize> = found.strokes.seeds.iter().enumerate().filter(near).map(|(j, _)| j).collect();
        assert!(seeds.len() > 3);
        for seed in seeds {
            let place = place_of(&found, seed, pin.at);
            assert!(place.distance(pin.place) < 0.01, "seed {seed}: {place}");
        }
    }
    // Nothing else changes, and strokes that are there already are moved alike.
    assert_eq!((&found.colors, &found.strokes.words), (&plain.colors, &plain.strokes.words));
    let moved = found.strokes.seeds.iter().zip(&plain.strokes.seeds).filter(|(a, b)| a != b).count();
    assert!(moved < found.strokes.seeds.len() / 2, "{moved}");
    let mut strokes = plain.strokes.clone();
    pin(&mut strokes, &surface, &[(&blue, 1.0)], &hand).unwrap();
    assert_eq!(strokes, found.strokes);
    // In a mix, the second painting's seeds follow the first's.
    let pins = pins.map(|pin| Pin { painting: 1, ..pin });
    let mixed = |pins| laid(&scene, &surface, &[&blue, &green], Hand { pins, ..Hand::default() });
    let mut strokes = mixed(&[]).strokes;
    let hand = Hand { pins: &pins, ..Hand::default() };
    pin(&mut strokes, &surface, &[(&blue, 1.0), (&green, 1.0)], &hand).unwrap();
    assert_eq!(strokes, mixed(&pins).strokes);
}

#[test]
fn a_pin_in_a_collection_chooses_the_painting() {
    let scene = sky_and_grass();
    let surface = surface(&scene);
    let [blue, green] = [BLUE, GREEN].map(|color| Canvas::new(&strokes_of(256, 256, color)));
    let pins = [Pin { at: Vec3::new(0.2, 0.5, 0.0), place: Vec2::splat(0.5), painting: 1 }];
    let found = laid(&scene, &surface, &[&blue, &green], Hand { pins: &pins, ..collection() });
    let apart = |j: &usize| Vec3::from(found.strokes.seeds[*j].at).distance(pins[0].at);
    let nearest = (0..surface.n_seeds()).min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap();
    assert_eq!(textures(&found)[nearest], 1);
    assert!(place_of(&found, nearest, pins[0].at).distance(pins[0].place) < 0.01);
    let (color, _) = found
        .colors
        .iter()
        .zip(&scene.means)
        .min_by(|a, b| a.1.distance(pins[0].at).total_cmp(&b.1.distance(pins[0].at)))
        .unwrap();
    assert!(color[1] > color[2], "{color:?}");
}

#[test]
fn pins_that_cannot_be_honored_are_errors() {
    let scene = wall(16);
    let surface = surface(&scene);
    let side = 128;
    let used = (0..side * side).map(|i| i % side < side / 2).collect();
    let canvas = Canvas::new(&Paint { used: Some(used), ..strokes_of(side, side, GREEN) });
    let good = Pin { at: Vec3::splat(0.5), place: Vec2::new(0.2, 0.5), painting: 0 };
    let restyled = |pin: Pin| {
        let hand = Hand { pins: &[good, pin], ..Hand::default() };
        let styles = Styles::Painted { paintings: vec![(&canvas, 1.0)], surface: &surface, hand };
        let recipe = Recipe { looks: Vec::new(), styles, content: 0.0 };
        recipe.restyle(&scene, &Work::default()).map(|_| ())
    };
    restyled(good).unwrap();
    let far = Pin { at: Vec3::new(1e3, 0.5, 0.0), ..good };
    for bad in [
        Pin { at: Vec3::new(0.0, f32::NAN, 0.0), ..good },
        far,
        Pin { at: Vec3::splat(-1e30), ..good },
        Pin { place: Vec2::new(1.2, 0.5), ..good },
        Pin { place: Vec2::new(0.2, f32::NAN), ..good },
        Pin { place: Vec2::new(0.9, 0.5), ..good },
        Pin { painting: 1, ..good },
    ] {
        let error = restyled(bad).unwrap_err();
        let text = error.to_string();
        assert!(matches!(error, RestyleError::Pin(_)) && text.starts_with("pin 2: found"), "{text}");
    }
    // Pins of a whole scene are far from most of its parts, which leave them alone.
    let part = Surface::part_of(&scene, &surface, &Work::default()).unwrap();
    let before = Strokes { seeds: vec![StrokeSeed::default(); part.n_seeds()], ..Strokes::default() };
    let mut strokes = before.clone();
    let hand = Hand { pins: &[far], ..Hand::default() };
    pin(&mut strokes, &part, &[(&canvas, 1.0)], &hand).unwrap();
    assert_eq!(strokes, before);
    let hand = Hand { pins: &[far, good], ..Hand::default() };
    pin(&mut strokes, &part, &[(&canvas, 1.0)], &hand).unwrap();
    assert_ne!(strokes, before);
    let other = StoredPins::new(&scene, vec![good]);
    assert_eq!(other.pins_for(&scene).unwrap(), [good]);
    assert!(other.pins_for(&wall(17)).unwrap_err().to_string().contains("another scene"));
}

/// Times on this machine: run with `--ignored --nocapture`, with optimizations.
#[test]
#[ignore = "times depend on the machine"]
fn times_of_collections_and_pins() {
    let scene = wall(260);
    let surface = surface(&scene);
    let canvases: Vec<Canvas> = (0..16)
        .map(|i| Canvas::new(&strokes_of(500 + i, 500, [40 + 12 * i as u8, 120, 240 - 13 * i as u8])))
        .collect();
    let all: Vec<&Canvas> = canvases.iter().collect();
    for n in [1, 4, 16] {
        let begun = std::time::Instant::now();
        laid(&scene, &surface, &all[..n], collection());
        eprintln!("{n} paintings, {} seeds: {:?}", surface.n_seeds(), begun.elapsed());
    }
    let mut strokes = laid(&scene, &surface, &all[..1], Hand::default()).strokes;
    let pins = [Pin { at: Vec3::new(0.3, 0.5, 0.0), place: Vec2::splat(0.5), painting: 0 }];
    let begun = std::time::Instant::now();
    let hand = Hand { pins: &pins, ..Hand::default() };
    pin(&mut strokes, &surface, &[(all[0], 1.0)], &hand).unwrap();
    let elapsed = begun.elapsed();
    eprintln!("a pin: {elapsed:?}");
    assert!(elapsed.as_secs_f64() < 0.1);
}
