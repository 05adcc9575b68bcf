use std::sync::Arc;

use glam::{Affine3A, Mat3, Quat, UVec2, Vec2, Vec3};

use super::*;
use crate::{
    Camera, Scene,
    layers::{Region, Shape},
    random::Random,
    splat::{Colors, render, render_strokes},
};

fn seed(at: Vec3, right: Vec3, down: Vec3) -> PlainSeed {
    PlainSeed {
        at,
        right,
        down,
        pitch: Vec2::new(300.0, 450.0),
        place: Vec2::new(100.0, 700.0),
        fine: 1.0,
        wide: 0.5,
        texture: 3,
    }
}

#[test]
fn seeds_survive_packing() {
    let mut random = Random::new(1);
    for _ in 0..200 {
        let turn = Quat::from_euler(
            glam::EulerRot::XYZ,
            random.uniform() * 6.0,
            random.uniform() * 6.0,
            random.uniform() * 6.0,
        );
        let of = seed(Vec3::new(1.0, -2.0, 3.0), turn * Vec3::X, turn * Vec3::Y);
        let back = of.packed().plain();
        assert!(back.right.distance(of.right) < 2e-4 && back.down.distance(of.down) < 2e-4, "{turn}");
        assert!((back.pitch / of.pitch - 1.0).abs().max_element() < 1e-3);
        assert!((back.place - of.place).abs().max_element() <= PERIOD / 65536.0);
        assert!((back.fine - 1.0).abs() < 0.005 && (back.wide - 0.5).abs() < 0.005 && back.texture == 3);
        assert_eq!(of.packed().with_texture(200).plain(), PlainSeed { texture: 200, ..back });
    }
}

#[test]
fn words_hold_seed_protection_and_share() {
    let word = StrokeWord { seed: 200_000, protection: 0.5, share: 1.0 };
    let back = StrokeWord::unpacked(word.packed());
    assert_eq!((back.seed, back.share), (200_000, 1.0));
    assert!((back.protection - 0.5).abs() < 0.005);
    // p = q^2 / (1 + q^2): twice the q of 1 is 4 / 5, half of it 1 / 5.
    let half = StrokeWord { protection: 0.5, ..word };
    assert!((half.protection_by(2.0) - 0.8).abs() < 1e-6 && (half.protection_by(0.5) - 0.2).abs() < 1e-6);
    assert_eq!(StrokeWord { protection: 1.0, ..word }.protection_by(0.0), 0.0);
}

/// The exact point: where the ray meets the plane of a flat Gaussian.
#[test]
fn a_record_is_the_map_from_the_screen_to_the_painting_to_first_order() {
    let camera =
        Camera::look_at(Vec3::new(0.3, -0.2, -4.0), Vec3::ZERO, Vec3::NEG_Y, 0.8, UVec2::new(640, 480));
    let turn = Quat::from_rotation_y(0.6) * Quat::from_rotation_x(-0.4);
    let mean = Vec3::new(0.2, 0.1, 0.3);
    let scales = Vec3::new(0.2, 0.1, 1e-4);
    let of = seed(Vec3::new(0.25, 0.0, 0.3), Vec3::new(0.8, 0.6, 0.0), Vec3::new(-0.6, 0.8, 0.0));
    let seeds = [of.packed()];
    let word = StrokeWord { seed: 0, protection: 0.0, share: 1.0 }.packed();
    let view = camera.view_from_world.transform_point3(mean);
    let rotation: Mat3 = camera.view_from_world.matrix3.into();
    let ray = view.truncate() / view.z;
    let gradient =
        |axis: Vec3, at: f32| rotation.transpose() * (axis - at * Vec3::Z) * camera.focal.x / view.z;
    let gradients = (gradient(Vec3::X, ray.x), gradient(Vec3::Y, ray.y));
    let knobs = StrokeKnobs::default();
    let record = StrokeRecord::new(word, &seeds, (mean, turn, scales), gradients, &knobs).unwrap();

    let seed = seeds[0].plain();
    let eye = camera.position();
    let normal = turn * Vec3::Z;
    let exact = |pixel: Vec2| {
        let ray = ((pixel - camera.center) / camera.focal).extend(1.0);
        let ray = rotation.transpose() * ray;
        let point = eye + ray * (normal.dot(mean - eye) / normal.dot(ray));
        seed.place + seed.pitch * Vec2::new(seed.right.dot(point - seed.at), seed.down.dot(point - seed.at))
    };
    let center = camera.focal * ray + camera.center;
    assert!(record.texel.distance(exact(center)) < 0.01, "{} {}", record.texel, exact(center));
    for offset in [Vec2::new(6.0, 0.0), Vec2::new(-3.0, 5.0)] {
        let found = record.texel + record.step_x * offset.x + record.step_y * offset.y;
        let expected = exact(center + offset);
        // The thinnest axis counts as 3% of the longest, which turns the plane a little; the rest is the second
        // order.
        assert!(
            found.distance(expected) < 0.03 * (expected - record.texel).length() + 0.1,
            "{found} {expected}"
        );
    }
}

#[test]
fn records_survive_packing() {
    let record = StrokeRecord {
        texel: Vec2::new(1000.0, 3.25),
        step_x: Vec2::new(1.5, -0.25),
        step_y: Vec2::new(0.125, 2.0),
        fine: 1.2,
        wide: 0.0,
        texture: 7,
        level: -1.5,
    };
    let back = StrokeRecord::unpacked(record.packed());
    assert_eq!((back.step_x, back.step_y, back.texture, back.wide), (record.step_x, record.step_y, 7, 0.0));
    assert!(back.texel.distance(record.texel) < 0.03 && (back.fine - 1.2).abs() < 0.005);
    assert!((back.level + 1.5).abs() < 0.04);
}

/// Stripes of four texels across the fine texture, none in the wide one.
fn stripes() -> StrokeTexture {
    let stripe = |i: usize| if (i % FINE_SIDE / 4).is_multiple_of(2) { 0.4 } else { -0.4 };
    let fine = (0..FINE_SIDE * FINE_SIDE).map(|i| Vec3::splat(stripe(i))).collect();
    StrokeTexture::new(fine, vec![Vec3::ZERO; WIDE_SIDE * WIDE_SIDE])
}

#[test]
fn textures_are_filtered_and_mirrored() {
    let texture = stripes();
    let at = |x: f32| Vec2::new(x / FINE_SIDE as f32, 0.3);
    assert!((texture.fine(at(2.0), 0.0).x - 0.4).abs() < 0.01);
    assert!((texture.fine(at(6.0), 0.0).x + 0.4).abs() < 0.01);
    assert!(texture.fine(at(4.0), 0.0).x.abs() < 0.01);
    for x in [2.0, 6.0, 100.5] {
        assert_eq!(texture.fine(at(-x), 0.0), texture.fine(at(x), 0.0));
        assert!(texture.fine(at(PERIOD + x), 0.0).distance(texture.fine(at(x), 0.0)) < 1e-3);
    }
    // Four stripes to a texel of the fifth level.
    assert!(texture.fine(at(40.0), 5.0).x.abs() < 0.01 && texture.wide(at(2.0), 0.0) == Vec3::ZERO);
    assert_eq!((texture.fine.len(), texture.wide.len()), (10, 8));
}

/// A wall of overlapping Gaussians in the plane z = 0, in strokes of one seed, and a camera before it to which
/// a pixel is a texel.
fn wall(texture: StrokeTexture) -> (Scene, Strokes, Camera) {
    let side = 12;
    let at = |i: usize| Vec3::new((i % side) as f32 - 5.5, (i / side) as f32 - 5.5, 0.0) / 6.0;
    let n = side * side;
    let mut scene = Scene {
        means: (0..n).map(at).collect(),
        rotations: vec![Quat::IDENTITY; n],
        scales: vec![Vec3::new(0.12, 0.12, 0.001); n],
        opacities: vec![0.9; n],
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    };
    scene.set_colors(&vec![[0.5; 3]; n]);
    let camera = Camera::look_at(Vec3::new(0.0, 0.0, -4.0), Vec3::ZERO, Vec3::NEG_Y, 0.4, UVec2::splat(128));
    let flat = PlainSeed {
        pitch: Vec2::splat(camera.focal.x / 4.0),
        place: Vec2::new(64.0, 64.0),
        texture: 0,
        wide: 0.0,
        ..seed(Vec3::ZERO, Vec3::X, Vec3::Y)
    };
    let word = StrokeWord { seed: 0, protection: 0.0, share: 1.0 }.packed();
    let strokes =
        Strokes { seeds: vec![flat.packed()], words: vec![word; n], textures: vec![Arc::new(texture)] };
    (scene, strokes, camera)
}

/// A wall of overlapping Gaussians, seen from the front, shows the stripes as sharp as the screen.
#[test]
fn a_wall_shows_the_painting_by_the_pixel() {
    let (scene, strokes, camera) = wall(stripes());
    let painted =
        render_strokes(&scene, Colors::Captured, (&strokes, &StrokeKnobs::default()), &camera, None);
    let plain = render(&scene, Colors::Captured, &camera);
    assert_eq!(painted.alpha, plain.alpha);
    let row = |x: usize| {
        (painted.color[64 * 128 + x][0] - plain.color[64 * 128 + x][0]) / painted.alpha[64 * 128 + x]
    };
    let (light, dark): (Vec<f32>, Vec<f32>) =
        ((41..=88).step_by(8).map(row).collect(), (45..=88).step_by(8).map(row).collect());
    assert!(light.iter().all(|v| *v > 0.25) && dark.iter().all(|v| *v < -0.25), "{light:?} {dark:?}");
    // Twice the amount, none of it, and strokes of twice the size.
    let with = |knobs| render_strokes(&scene, Colors::Captured, (&strokes, &knobs), &camera, None);
    let none = with(StrokeKnobs { amount: 0.0, ..StrokeKnobs::default() });
    assert_eq!(none.color, plain.color);
    let large = with(StrokeKnobs { stroke_scale: 2.0, near: 0.0, ..StrokeKnobs::default() });
    let same = (40..80).filter(|x| large.color[64 * 128 + x][0] > plain.color[64 * 128 + x][0]).count();
    assert!((16..=24).contains(&same), "{same}");
}

/// Slopes that face the light are brighter, those that face away darker, and flat paint is as it was, to the
/// bit.
#[test]
fn light_falls_on_slopes_alone() {
    // Hills of sixteen texels.
    let hill = |i: usize| 0.3 * (std::f32::consts::TAU * (i % FINE_SIDE) as f32 / 16.0).sin();
    let fine = (0..FINE_SIDE * FINE_SIDE).map(|i| Vec3::splat(hill(i))).collect();
    let hills = StrokeTexture::new(fine, vec![Vec3::ZERO; WIDE_SIDE * WIDE_SIDE]);
    let (scene, strokes, camera) = wall(hills);
    let draw = |strokes: &Strokes, relief: f32, light: Vec3| {
        let knobs = StrokeKnobs { relief, light, ..StrokeKnobs::DEFAULT };
        render_strokes(&scene, Colors::Captured, (strokes, &knobs), &camera, None).color
    };
    // The camera looks along z, and its picture's x is the scene's.
    let right = Vec3::new(1.0, 0.0, -1.0);
    let plain = draw(&strokes, 0.0, right);
    let [from_right, from_left] = [right, Vec3::new(-1.0, 0.0, -1.0)].map(|light| draw(&strokes, 1.0, light));
    // The texel at the middle of the picture is 64, the start of a hill: it rises there.
    let added = |picture: &[[f32; 3]], x: usize| picture[64 * 128 + x][0] - plain[64 * 128 + x][0];
    for (rising, falling) in [(64, 56), (48, 72), (80, 88)] {
        assert!(added(&from_right, falling) > 0.03 && added(&from_right, rising) < -0.03);
        assert!(added(&from_left, rising) > 0.03 && added(&from_left, falling) < -0.03);
    }
    // Nothing without an amount or a direction, in the shade behind the wall, and on flat paint.
    for (relief, light) in [
        (0.0, right),
        (-1.0, right),
        (f32::NAN, right),
        (f32::INFINITY, right),
        (1.0, Vec3::ZERO),
        (1.0, Vec3::NAN),
        (1.0, Vec3::Z),
    ] {
        assert!(draw(&strokes, relief, light) == plain, "{relief} {light}");
    }
    let zeros = |side: usize| vec![Vec3::ZERO; side * side];
    let flat = StrokeTexture::new(zeros(FINE_SIDE), zeros(WIDE_SIDE));
    let flat = Strokes { textures: vec![Arc::new(flat)], ..strokes.clone() };
    assert!(draw(&flat, 1.0, right) == draw(&flat, 0.0, right));
    // From far, slopes are averaged, and fade.
    let far = |relief: f32| {
        let seed = PlainSeed { pitch: 16.0 * strokes.seeds[0].plain().pitch, ..strokes.seeds[0].plain() };
        draw(&Strokes { seeds: vec![seed.packed()], ..strokes.clone() }, relief, right)
    };
    let apart = far(1.0).iter().zip(far(0.0)).map(|(a, b)| (a[0] - b[0]).abs()).fold(0.0, f32::max);
    assert!(apart < 0.02, "{apart}");
}

#[test]
fn the_light_on_a_splat_survives_packing() {
    let seed = seed(Vec3::ZERO, Vec3::X, Vec3::Y);
    let knobs = StrokeKnobs { relief: 1.5, light: Vec3::new(3.0, 0.0, -4.0), ..StrokeKnobs::DEFAULT };
    let relief = StrokeRelief::new(&seed, Vec3::NEG_Z, &knobs).unwrap();
    // The eye sees the other side of the axes: z is toward it.
    assert!(relief.light.distance(Vec3::new(0.6, 0.0, 0.8)) < 1e-6);
    assert!(relief.half.distance(Vec3::new(0.6, 0.0, 1.8).normalize()) < 1e-6);
    let back = StrokeRelief::unpacked(relief.packed());
    assert!(back.light.distance(relief.light) < 1e-4 && back.half.distance(relief.half) < 1e-4);
    assert_eq!((back.strength, back.aspect), (1.5, 1.5));
}

#[test]
fn mixed_strokes_change_spot_by_spot() {
    let of = |seed: u32| StrokeWord { seed, protection: 0.0, share: 1.0 };
    let n = 4000;
    let at = |share: f32| (0..n).map(|i| mixed(of(i), of(n + i), share)).collect::<Vec<_>>();
    let of_above =
        |words: &[StrokeWord]| words.iter().filter(|word| word.seed >= n).count() as f32 / n as f32;
    assert_eq!(at(0.0), (0..n).map(of).collect::<Vec<_>>());
    assert_eq!(at(1.0), (n..2 * n).map(of).collect::<Vec<_>>());
    assert!((of_above(&at(0.5)) - 0.5).abs() < 0.02);
    assert!((of_above(&at(0.3)) - 0.25).abs() < 0.02);
    // No spot jumps: between two frames a share changes by the step over the edge's width at most.
    let (before, after) = (at(0.5), at(0.51));
    for (before, after) in before.iter().zip(&after) {
        let change = if before.seed == after.seed {
            (after.share - before.share).abs()
        } else {
            before.share + after.share
        };
        assert!(change < 0.01 / 0.1 + 1e-4, "{before:?} {after:?}");
    }
    // Beside nothing they fade.
    assert_eq!(mixed(StrokeWord::NONE, of(3), 0.25), StrokeWord { share: 0.25, ..of(3) });
    assert_eq!(mixed(of(3), StrokeWord::NONE, 0.25), StrokeWord { share: 0.75, ..of(3) });
    assert_eq!(mixed(of(3), of(3), 0.25), of(3));
}

#[test]
fn layers_of_strokes_have_regions_and_tables() {
    let means = [Vec3::ZERO, Vec3::new(5.0, 0.0, 0.0)];
    let word = StrokeWord { seed: 1, protection: 0.25, share: 1.0 }.packed();
    let words = [word, word];
    let everywhere = StrokeLayer {
        words: Some(&words),
        first_seed: 0,
        region: Region::EVERYWHERE,
        strength: 1.0,
        mask: None,
        factors: None,
    };
    let ball = Region {
        shape: Shape::Ellipsoid { radii: Vec3::ONE },
        shape_from_scene: Affine3A::IDENTITY,
        softness: 0.1,
    };
    let above = StrokeLayer { first_seed: 10, region: ball, ..everywhere };
    let found = mix_strokes(&means, &[everywhere, above]).into_iter().map(StrokeWord::unpacked);
    assert_eq!(found.map(|word| word.seed).collect::<Vec<_>>(), [11, 1]);
    let bare = StrokeLayer { words: None, strength: 0.5, ..everywhere };
    let found = StrokeWord::unpacked(mix_strokes(&means, &[everywhere, bare])[0]);
    assert!((found.share - 0.5).abs() < 0.005);
}

#[test]
fn strokes_of_two_paintings_share_a_table() {
    let texture = |value: f32| {
        let texels = |side: usize| vec![Vec3::splat(value); side * side];
        std::sync::Arc::new(StrokeTexture::new(texels(FINE_SIDE), texels(WIDE_SIDE)))
    };
    let of = |value: f32, n: usize| Strokes {
        seeds: vec![StrokeSeed::default(); n],
        words: (0..60)
            .map(|i| StrokeWord { seed: i % n as u32, protection: 0.5, share: 1.0 }.packed())
            .collect(),
        textures: vec![texture(value)],
    };
    let mut mix = Strokes::default();
    mix.mix(&of(0.1, 20), 1.0);
    assert_eq!(mix.words, of(0.1, 20).words);
    mix.mix(&of(0.2, 30), 0.5);
    assert_eq!((mix.seeds.len(), mix.textures.len()), (50, 2));
    assert!(mix.seeds[..20].iter().all(|seed| seed.plain().texture == 0));
    assert!(mix.seeds[20..].iter().all(|seed| seed.plain().texture == 1));
    let words: Vec<StrokeWord> = mix.words.iter().map(|word| StrokeWord::unpacked(*word)).collect();
    let n_above = words.iter().enumerate().filter(|(i, word)| word.seed as usize == 20 + i % 30).count();
    let n_below = words.iter().enumerate().filter(|(i, word)| word.seed as usize == i % 20).count();
    // About half of the spots show either.
    assert!(n_above + n_below == 60 && (20..=40).contains(&n_above), "{n_above} and {n_below}");

    let shares = |strokes: &Strokes| -> f32 {
        strokes.words.iter().map(|word| StrokeWord::unpacked(*word).share).sum()
    };
    let before = shares(&mix);
    // A look without strokes above, and a factor: to 7 bits.
    mix.mix(&Strokes::default(), 0.5);
    assert!((shares(&mix) - 0.5 * before).abs() < 60.0 / 127.0);
    mix.fade(0.5);
    assert!((shares(&mix) - 0.25 * before).abs() < 60.0 / 127.0);
    // A table without room keeps what it has.
    let mut full = of(0.1, 20);
    full.textures = vec![texture(0.1); MAX_TEXTURES];
    full.mix(&of(0.2, 30), 0.25);
    assert_eq!((full.seeds.len(), full.textures.len()), (20, MAX_TEXTURES));
    assert!((shares(&full) - 45.0).abs() < 60.0 / 127.0);
}
