//! Watercolor: poppies and leaves on white paper. Each wash absorbs light from the layers below it. Its dried
//! rim is darker, blooms form inside, and pigment settles in the paper's hollows.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3, vec2};

use crate::canvas::{Canvas, WHOLE, around, rgb, smoothstep};
use crate::noise::{Noise, Random, direction};
use crate::shapes::{curve, ellipse, polyline, turned};

const PAPER: Noise = Noise(77);

const ROSE: u32 = 0xf07c9c;
const CORAL: u32 = 0xf79a7e;
const LILAC: u32 = 0xb49ad8;
const LEAF: u32 = 0x86bf8c;
const SEA: u32 = 0x7fc4c0;
const SUN: u32 = 0xf7d27a;

/// Center, size and color of each flower.
const FLOWERS: [(Vec2, f32, u32); 5] = [
    (vec2(176.0, 180.0), 92.0, ROSE),
    (vec2(352.0, 132.0), 70.0, CORAL),
    (vec2(330.0, 296.0), 84.0, LILAC),
    (vec2(118.0, 338.0), 58.0, CORAL),
    (vec2(438.0, 250.0), 44.0, ROSE),
];

/// Distance to the inner 80% of the nearest flower. Stems and leaves stop there, since flowers stand before
/// them.
fn beside_flowers(p: Vec2) -> f32 {
    FLOWERS.iter().map(|&(center, size, _)| p.distance(center) - 0.8 * size).fold(f32::MAX, f32::min)
}

/// Paints the poppies.
pub fn paint() -> Canvas {
    let mut canvas = Canvas::new(rgb(0xfcfaf5));
    let mut random = Random::new(7);
    for (x, y, radius, color) in [
        (130.0, 120.0, 150.0, 0xf9e2c4),
        (390.0, 150.0, 160.0, 0xcfe8ea),
        (250.0, 400.0, 170.0, 0xe4eccd),
        (440.0, 430.0, 110.0, 0xf6d5de),
    ] {
        let at = vec2(x, y);
        wash(&mut canvas, random.bits(), around(at, radius * 2.0), rgb(color), 0.9, 60.0, |p| {
            p.distance(at) - radius
        });
    }
    foliage(&mut canvas, &mut random);
    for (center, size, color) in FLOWERS {
        flower(&mut canvas, &mut random, center, size, rgb(color));
    }
    splatter(&mut canvas, &mut random);
    paper(&mut canvas);
    canvas
}

/// Lays one wash. `distance` is the shape's signed distance, which is bent at the rim by up to `rough` pixels,
/// and `load` the amount of pigment.
fn wash(
    canvas: &mut Canvas,
    seed: u32,
    bounds: (Vec2, Vec2),
    color: Vec3,
    load: f32,
    rough: f32,
    distance: impl Fn(Vec2) -> f32,
) {
    let noise = Noise(seed as u64);
    canvas.change(bounds, |p, below| {
        let bend =
            noise.warp(p / (rough * 2.5 + 12.0), 3) * rough + noise.warp(p / 7.0, 2) * (0.3 * rough).min(1.2);
        let d = distance(p + bend);
        if d > 1.0 {
            return below;
        }
        let inside = smoothstep(1.0, -0.8, d);
        let rim = 0.75 * libm::expf(d.min(0.0) / 1.7) + 0.3 * libm::expf(d.min(0.0) / 9.0);
        let pool = noise.fractal(p / 46.0 + 7.0, 3);
        let bloom = 0.5 * smoothstep(0.06, 0.0, (pool - 0.12).abs()) + 0.75 * pool;
        let grain = 0.42 * PAPER.fractal(p / 2.7, 2) * (0.5 + 0.5 * load);
        let density = load * inside * (0.72 + rim + bloom + grain).max(0.08);
        absorb(below, color, density)
    });
}

/// The light that remains after a layer of pigment. At `density` 1 the layer has the given `color` on white
/// paper, and thicker layers absorb exponentially more (Beer and Lambert).
fn absorb(below: Vec3, color: Vec3, density: f32) -> Vec3 {
    let through = |c: f32| libm::powf(c.max(0.02), density);
    below * Vec3::new(through(color.x), through(color.y), through(color.z))
}

/// A flower: petals in two rounds, one wash each, then the heart.
fn flower(canvas: &mut Canvas, random: &mut Random, center: Vec2, size: f32, color: Vec3) {
    let turn = random.range(0.0, TAU);
    for (count, reach, load) in [(5, 1.0, 0.62), (4, 0.66, 0.5)] {
        for k in 0..count {
            let toward = direction(turn + (k as f32 + 0.2 * random.bell()) * TAU / count as f32 + reach);
            let middle = center + toward * size * reach * 0.52;
            let radii = vec2(size * reach * 0.52, size * reach * random.range(0.36, 0.5));
            let tint = (color + Vec3::new(random.bell(), random.bell(), random.bell()) * 0.07)
                .clamp(Vec3::ZERO, Vec3::ONE);
            wash(
                canvas,
                random.bits(),
                around(middle, size),
                tint,
                load * random.range(0.7, 1.2),
                5.0,
                |p| {
                    let notch = 0.07 * size * libm::sinf(libm::atan2f((p - center).y, (p - center).x) * 9.0);
                    ellipse(p, middle, radii, toward) + notch
                },
            );
        }
    }
    wash(canvas, random.bits(), around(center, size * 0.3), rgb(SUN), 1.3, 4.0, |p| {
        p.distance(center) - size * 0.15
    });
    for _ in 0..(size * 0.34) as usize {
        let at = center + direction(random.range(0.0, TAU)) * size * random.range(0.13, 0.30);
        let radius = random.range(1.1, 2.6);
        wash(canvas, random.bits(), around(at, 6.0), rgb(0x6a4a78), 1.0, 0.8, |p| p.distance(at) - radius);
    }
}

fn foliage(canvas: &mut Canvas, random: &mut Random) {
    let stems = [
        [vec2(268.0, 530.0), vec2(248.0, 420.0), vec2(216.0, 300.0), vec2(176.0, 190.0)],
        [vec2(276.0, 530.0), vec2(296.0, 420.0), vec2(340.0, 280.0), vec2(352.0, 140.0)],
        [vec2(272.0, 530.0), vec2(290.0, 450.0), vec2(318.0, 370.0), vec2(330.0, 300.0)],
        [vec2(264.0, 530.0), vec2(226.0, 450.0), vec2(160.0, 400.0), vec2(118.0, 340.0)],
        [vec2(280.0, 530.0), vec2(340.0, 440.0), vec2(410.0, 360.0), vec2(438.0, 254.0)],
    ];
    for knots in stems {
        let stem = curve(&knots, 8);
        wash(canvas, random.bits(), WHOLE, rgb(LEAF), 1.5, 1.5, |p| {
            (polyline(p, &stem) - 2.4).max(-beside_flowers(p))
        });
        for k in 0..5 {
            let i = 3 + k * 4;
            let (root, along) = (stem[i], (stem[i + 1] - stem[i]).normalize_or(Vec2::NEG_Y));
            let side = if k % 2 == 0 { 1.0 } else { -1.0 };
            let toward = (along + along.perp() * side * random.range(0.7, 1.5)).normalize_or(Vec2::X);
            let color = random.pick(&[LEAF, SEA, 0xa9cf7c, 0x6fae9a]);
            let length = random.range(56.0, 104.0);
            leaf(canvas, random, root, toward, length, rgb(color));
        }
    }
}

/// A leaf in two halves, with a white vein between them.
fn leaf(canvas: &mut Canvas, random: &mut Random, root: Vec2, toward: Vec2, length: f32, color: Vec3) {
    let bow = random.range(-0.22, 0.22);
    for side in [-1.0, 1.0] {
        let load = random.range(0.5, 1.05);
        wash(
            canvas,
            random.bits(),
            around(root + toward * length * 0.5, length * 0.75),
            color,
            load,
            2.2,
            |p| {
                let q = turned(p - root, toward);
                let t = (q.x / length).clamp(0.0, 1.0);
                let vein = bow * length * t * (1.0 - t);
                let half = 0.62 * length * libm::sqrtf(t) * (1.0 - t) * 0.72;
                let across = (q.y - vein) * side;
                (across - half).max(1.1 - across).max(q.x - length).max(-q.x).max(-beside_flowers(p))
            },
        );
    }
}

fn splatter(canvas: &mut Canvas, random: &mut Random) {
    for _ in 0..60 {
        let at = vec2(random.range(10.0, 500.0), random.range(10.0, 500.0));
        let radius = 1.0 + 5.0 * random.unit() * random.unit() * random.unit();
        let color = rgb(random.pick(&[ROSE, CORAL, LILAC, LEAF, SEA, SUN]));
        wash(canvas, random.bits(), around(at, 12.0), color, 0.9, 1.5, |p| p.distance(at) - radius);
    }
}

/// The cold-pressed tooth of the paper.
fn paper(canvas: &mut Canvas) {
    canvas.change(WHOLE, |p, color| color * (1.0 + 0.022 * PAPER.fractal(p / 2.7, 2)));
}
