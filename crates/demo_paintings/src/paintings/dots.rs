//! Points of pure pigment: a lake shore at noon.
//!
//! Each dot takes the pigment nearest to the scene's color after a random push. Tones mix in the eye, and shade
//! is full of complementary colors.

use glam::{Vec2, Vec3, vec2};

use crate::canvas::{Canvas, Touch, ramp, rgb, smoothstep};
use crate::noise::{Noise, Random, direction};
use crate::shapes::{ellipse, polygon, segment};

const NOISE: Noise = Noise(22);
/// Pure pigments.
const PIGMENTS: [u32; 18] = [
    0xfff3c4, 0xffe03a, 0xffb61e, 0xff8a1c, 0xf2552c, 0xd92a4a, 0xf49ac1, 0xb04fb0, 0x6a3fa8, 0x3a3fa0,
    0x2f6fd0, 0x35b0e0, 0x8fdcd8, 0x12897a, 0x3fa83a, 0x9ccb2a, 0xd8e84a, 0xfffdf0,
];

/// Paints the lake shore.
pub fn paint() -> Canvas {
    let mut canvas = Canvas::new(rgb(0xf8edc9));
    let mut random = Random::new(2);
    for (spacing, radius, push) in [(9.0, 6.0, 0.10), (7.8, 4.3, 0.28), (9.0, 3.5, 0.36)] {
        for at in random.scatter(512.0, 8.0, spacing) {
            dot(&mut canvas, &mut random, at, radius, push);
        }
    }
    canvas.light(0.16, 0.0);
    canvas
}

fn dot(canvas: &mut Canvas, random: &mut Random, at: Vec2, radius: f32, push: f32) {
    let (tone, slant) = scene(at);
    let pushed = tone + Vec3::new(random.bell(), random.bell(), random.bell()) * push;
    let dark = 1.0 - tone.dot(Vec3::new(0.3, 0.6, 0.1));
    let complement = random.chance(0.03 + 0.15 * dark);
    let wanted = if complement { (Vec3::splat(1.15) - pushed).clamp(Vec3::ZERO, Vec3::ONE) } else { pushed };
    let color = nearest(wanted);
    let radius = radius * random.range(0.8, 1.15);
    let reach = direction(slant + 0.4 * random.bell()) * radius * random.range(0.2, 0.75);
    canvas.stroke(
        &[at - reach, at + reach],
        |_| radius,
        |c| Touch {
            color: color * (1.0 - 0.06 * c.across.abs()),
            opacity: 0.95,
            height: 2.2 * (1.0 - c.across * c.across),
        },
    );
}

/// The pigment nearest to a color.
fn nearest(wanted: Vec3) -> Vec3 {
    let mut best = (f32::MAX, Vec3::ZERO);
    for pigment in PIGMENTS.map(rgb) {
        let d = pigment.distance_squared(wanted);
        if d < best.0 {
            best = (d, pigment);
        }
    }
    best.1
}

/// Color of the scene at a point, and the angle of the dots there.
fn scene(p: Vec2) -> (Vec3, f32) {
    let leaf = 10.0 * NOISE.fractal(p / 26.0, 2);
    let canopy = ellipse(p, vec2(84.0, 96.0), vec2(150.0, 86.0), vec2(1.0, 0.12)) + leaf;
    let lobe = ellipse(p, vec2(190.0, 52.0), vec2(80.0, 52.0), vec2(1.0, 0.0)) + leaf;
    let trunk = segment(p, vec2(62.0, 130.0), vec2(88.0, 400.0)) - 15.0 - 0.02 * (p.y - 300.0).max(0.0);
    if let Some(color) = figure(p) {
        return (color, 1.5);
    }
    if canopy.min(lobe) < 0.0 {
        let sun = 0.5 + 0.9 * NOISE.fractal(p / 34.0, 2) + 0.004 * (p.x - 100.0) - 0.004 * (p.y - 90.0);
        return (ramp(&[0x3a2f86, 0x14706a, 0x2f9a3a, 0x9ccb2a, 0xffe03a], sun), 0.8);
    }
    if trunk < 0.0 {
        return (ramp(&[0x4a2f86, 0x8a4a6a, 0xf2852c], (p.x - 55.0) / 42.0 - 0.2), 1.5);
    }
    ground(p)
}

fn ground(p: Vec2) -> (Vec3, f32) {
    let shore = 318.0 + 24.0 * libm::sinf(p.x * 0.011 + 0.4);
    let far =
        168.0 - 34.0 * libm::expf(-(p.x - 420.0) * (p.x - 420.0) / 9000.0) - 6.0 * NOISE.line(p.x / 20.0);
    if p.y > shore {
        let shade =
            ellipse(p, vec2(150.0, 420.0), vec2(170.0, 34.0), vec2(1.0, 0.06)) + 14.0 * NOISE.at(p / 30.0);
        let parasol = ellipse(p, vec2(466.0, 494.0), vec2(90.0, 16.0), vec2(1.0, 0.1));
        if shade.min(parasol) < 0.0 {
            return (ramp(&[0x3f3a9a, 0x1f7f7a, 0x4a9a5a], 0.5 + 0.6 * NOISE.at(p / 22.0)), 0.1);
        }
        let t = (p.y - shore) / 190.0 + 0.35 * NOISE.at(p / vec2(60.0, 22.0));
        return (ramp(&[0xfff0a0, 0xffe03a, 0xc8dc3a, 0x8ccb3a, 0xffb61e], t), 0.1);
    }
    if let Some(color) = boats(p) {
        return (color, 1.4);
    }
    if p.y > 196.0 {
        let glint = NOISE.fractal(p / vec2(40.0, 7.0), 2) + 0.3 * smoothstep(330.0, 200.0, p.y);
        return (ramp(&[0x2f5fc0, 0x35a0e0, 0x8fdcd8, 0xffe8b0], 0.42 + 0.5 * glint), 0.0);
    }
    if p.y > far {
        return (ramp(&[0x4a3fa0, 0x6a5fc0, 0x3a8fa0], 0.5 + 0.7 * NOISE.at(p / 18.0)), 0.1);
    }
    let cloud = NOISE.fractal(p / vec2(110.0, 46.0), 3);
    let sky = ramp(&[0x2f8fe0, 0x55bde8, 0x8fd8e4, 0xffd9b0, 0xff9a8a], p.y / 185.0);
    (sky.lerp(rgb(0xfff6e8), smoothstep(0.12, 0.5, cloud) * smoothstep(170.0, 110.0, p.y)), 0.2)
}

fn boats(p: Vec2) -> Option<Vec3> {
    for (x, y, s) in [(268.0, 272.0, 1.25), (446.0, 232.0, 0.75), (206.0, 222.0, 0.5)] {
        let q = (p - vec2(x, y)) / s;
        let main = polygon(q, &[vec2(2.0, -104.0), vec2(48.0, -8.0), vec2(2.0, -8.0)]);
        let jib = polygon(q, &[vec2(-3.0, -92.0), vec2(-3.0, -8.0), vec2(-34.0, -8.0)]);
        let hull = polygon(q, &[vec2(-42.0, -4.0), vec2(54.0, -4.0), vec2(40.0, 12.0), vec2(-28.0, 12.0)]);
        if hull < 0.0 {
            return Some(rgb(0xd92a4a));
        }
        if main < 0.0 {
            return Some(ramp(&[0xfffdf0, 0xffe9b0, 0xffb05c], q.x / 44.0));
        }
        if jib < 0.0 {
            return Some(rgb(0xff9a5c));
        }
        if q.x > -30.0 && q.x < 40.0 && q.y > 12.0 && q.y < 62.0 && NOISE.at(p / vec2(20.0, 5.0)) > -0.05 {
            return Some(rgb(0xffd9a0));
        }
    }
    None
}

fn figure(p: Vec2) -> Option<Vec3> {
    let q = (p - vec2(404.0, 384.0)) / 1.35;
    let shade = ellipse(q, vec2(6.0, -48.0), vec2(48.0, 46.0), direction(0.12));
    if shade < 0.0 && q.y < -48.0 + 0.12 * q.x {
        let gore = libm::sinf(q.x * 0.16);
        return Some(if gore > 0.0 { rgb(0xf2452c) } else { rgb(0xff9a3c) });
    }
    let body = polygon(
        q,
        &[
            vec2(-8.0, -18.0),
            vec2(10.0, -18.0),
            vec2(8.0, 16.0),
            vec2(36.0, 82.0),
            vec2(-26.0, 82.0),
            vec2(-7.0, 16.0),
        ],
    );
    if body < 0.0 {
        return Some(ramp(&[0x6a3fa8, 0xb04fb0, 0xf8b8d8], (q.x + 14.0) / 30.0));
    }
    if q.distance(vec2(1.0, -30.0)) < 11.0 {
        return Some(rgb(if q.y < -32.0 { 0x3a3fa0 } else { 0xffb08a }));
    }
    (segment(q, vec2(12.0, -2.0), vec2(4.0, -84.0)) < 2.5).then(|| rgb(0x6a3fa8))
}
