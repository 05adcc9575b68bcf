//! Thick oil: a night river under a turning sky. Long bristled strokes follow the lines of a stream function,
//! and their relief is lit from the top left.

use glam::{Vec2, Vec3, vec2};

use crate::canvas::{Canvas, Touch, ramp, rgb, smoothstep};
use crate::noise::{Noise, Random};

const NOISE: Noise = Noise(11);
const MOON: Vec2 = vec2(376.0, 108.0);
/// Center, radius and strength of each whirl. The sign of the strength is its sense of turning.
const WHIRLS: [(Vec2, f32, f32); 5] = [
    (MOON, 62.0, 3.4),
    (vec2(190.0, 150.0), 58.0, -3.6),
    (vec2(66.0, 60.0), 40.0, 3.0),
    (vec2(282.0, 236.0), 34.0, 3.0),
    (vec2(250.0, 34.0), 28.0, -2.6),
];
/// Center of each star, and the reach of its light.
const STARS: [(Vec2, f32); 7] = [
    (vec2(66.0, 60.0), 17.0),
    (vec2(250.0, 34.0), 13.0),
    (vec2(190.0, 150.0), 10.0),
    (vec2(470.0, 44.0), 12.0),
    (vec2(484.0, 216.0), 13.0),
    (vec2(132.0, 232.0), 9.0),
    (vec2(320.0, 190.0), 9.0),
];
const SHORE: f32 = 342.0;

/// Paints the night river.
pub fn paint() -> Canvas {
    let mut canvas = Canvas::new(rgb(0x14204a));
    let mut random = Random::new(1);
    for (spacing, radius, steps, jitter) in [(15.0, 9.0, 11, 0.05), (9.0, 4.6, 9, 0.10), (11.0, 3.0, 8, 0.20)]
    {
        for start in random.scatter(512.0, 16.0, spacing) {
            stroke(&mut canvas, &mut random, start, radius, steps, jitter);
        }
    }
    canvas.light(0.34, 0.35);
    canvas
}

fn stroke(canvas: &mut Canvas, random: &mut Random, start: Vec2, radius: f32, steps: usize, jitter: f32) {
    let mut path = vec![start];
    for _ in 0..(random.range(0.6, 1.2) * steps as f32) as usize {
        let p = path[path.len() - 1];
        path.push(p + flow(p) * radius.max(4.0));
    }
    let middle = path[path.len() / 2];
    let shift = random.bell() * jitter;
    let tint = Vec3::new(random.bell(), random.bell(), random.bell()) * 0.07;
    let color = (scene(middle) + tint) * (1.0 + 2.0 * shift) + Vec3::splat(shift * 0.5);
    let bristles = Noise(random.bits() as u64);
    let radius = radius * random.range(0.75, 1.2);
    canvas.stroke(
        &path,
        |t| radius * (smoothstep(-0.12, 0.1, t) * (1.0 - 0.55 * smoothstep(0.6, 1.0, t))),
        |c| {
            let hair = bristles.at(vec2(c.across * radius * 0.75 + 40.0, c.arc * 0.03));
            let edge = c.across * c.across;
            let dry = smoothstep(0.65, 1.0, c.along) * smoothstep(0.0, 0.5, hair);
            Touch {
                color: color * (1.0 + 0.22 * hair),
                opacity: (0.97 - dry).max(0.0),
                height: 1.0 + 0.9 * hair + 0.8 * edge - 0.5 * c.along,
            }
        },
    );
}

/// The stream function. The sky's strokes follow its level lines, and its value makes bands of color.
fn stream(p: Vec2) -> f32 {
    let drift = p.y + 0.12 * p.x + 34.0 * NOISE.fractal(p / 170.0, 2);
    WHIRLS.iter().fold(drift, |sum, &(center, radius, turn)| {
        sum + turn * radius * libm::expf(-p.distance_squared(center) / (2.0 * radius * radius))
    })
}

/// Unit direction of the brush at a point.
fn flow(p: Vec2) -> Vec2 {
    let raw = if tree(p) < 0.0 {
        vec2(0.45 * libm::sinf(p.y * 0.05 + p.x * 0.06), -1.0)
    } else if p.y > SHORE {
        vec2(1.0, 0.18 * NOISE.at(p / vec2(60.0, 20.0)))
    } else if p.y > hills(p.x) {
        vec2(1.0, (hills(p.x + 6.0) - hills(p.x - 6.0)) / 12.0 + 0.5 * NOISE.at(p / 40.0))
    } else {
        let dx = stream(p + Vec2::X) - stream(p - Vec2::X);
        let dy = stream(p + Vec2::Y) - stream(p - Vec2::Y);
        vec2(dy, -dx)
    };
    raw.normalize_or(Vec2::X)
}

fn hills(x: f32) -> f32 {
    300.0 + 22.0 * libm::sinf(x * 0.012 + 0.6) + 10.0 * libm::sinf(x * 0.031)
}

/// Signed distance to the two poplars.
fn tree(p: Vec2) -> f32 {
    let flame = |foot: Vec2, top: f32, width: f32| {
        let t = ((foot.y - p.y) / (foot.y - top)).clamp(0.0, 1.0);
        let beyond = (top - p.y).max(p.y - foot.y).max(0.0);
        let wobble = 7.0 * libm::sinf(p.y * 0.045 + foot.x) + 5.0 * NOISE.at(p / 18.0);
        let half = width * libm::sqrtf(t.max(0.0)) * (1.0 - t) * 2.2;
        (p.x - foot.x - wobble * t).abs() - half + beyond
    };
    flame(vec2(70.0, 470.0), 116.0, 30.0).min(flame(vec2(112.0, 462.0), 214.0, 20.0))
}

fn scene(p: Vec2) -> Vec3 {
    if tree(p) < 0.0 {
        return ramp(&[0x05090f, 0x0d2420, 0x1f3d2a, 0x5a4a1e], 0.5 + 0.75 * NOISE.at(p / vec2(9.0, 34.0)));
    }
    let bank = 448.0 + 26.0 * libm::sinf(p.x * 0.011 + 2.4) + 4.0 * NOISE.at(p / 20.0);
    if p.y > bank {
        return ramp(&[0x080d1c, 0x14251f, 0x2f4a2a, 0x8a6a22], 0.42 + 0.7 * NOISE.at(p / vec2(40.0, 10.0)));
    }
    if p.y > SHORE {
        return river(p);
    }
    if p.y > hills(p.x) {
        let lamp = (libm::sinf(p.x * 0.21) * libm::sinf(p.x * 0.047 + 1.0)).max(0.0);
        let near = smoothstep(16.0, 2.0, SHORE - p.y);
        let hill = ramp(&[0x0a1030, 0x152a5c, 0x2b5a86], 0.4 + 0.7 * NOISE.at(p / vec2(50.0, 12.0)));
        return hill.lerp(rgb(0xf6b93b), smoothstep(0.5, 0.75, lamp) * near);
    }
    sky(p)
}

fn sky(p: Vec2) -> Vec3 {
    let band = 0.5 + 0.5 * libm::sinf(stream(p) * 0.16 + 1.5 * NOISE.at(p / 60.0));
    let depth = band * 0.72 + 0.22 * p.y / SHORE + 0.15 * NOISE.at(p / 25.0);
    let mut color = ramp(&[0x0a1440, 0x14307c, 0x2a5fb4, 0x5f9ed0, 0xb9d9d6], depth);
    let mut glow = |center: Vec2, reach: f32, core: u32| {
        let d = p.distance(center);
        let ring = 0.75 + 0.25 * libm::cosf(d * 0.42);
        color = color.lerp(rgb(0xee9a10), (2.4 * libm::expf(-d / reach) * ring).min(1.0));
        color = color.lerp(rgb(core), smoothstep(reach * 0.95, reach * 0.55, d));
    };
    STARS.iter().for_each(|&(center, reach)| glow(center, 1.25 * reach, 0xffdf70));
    glow(MOON, 42.0, 0xffd54a);
    color
}

fn river(p: Vec2) -> Vec3 {
    let ripple = NOISE.fractal(p / vec2(46.0, 8.0), 2);
    let mut color = ramp(&[0x081238, 0x12306e, 0x1f5a96, 0x4f9db8], 0.45 + 0.6 * ripple);
    let column = |x: f32, width: f32| libm::expf(-(p.x - x).abs() / width) * smoothstep(-0.25, 0.25, ripple);
    let lamps = (libm::sinf(p.x * 0.21) * libm::sinf(p.x * 0.047 + 1.0)).max(0.0);
    let fade = smoothstep(460.0, SHORE, p.y);
    color = color.lerp(rgb(0xf0a52a), (1.5 * column(MOON.x, 30.0)).min(1.0));
    color.lerp(rgb(0xffc95a), smoothstep(0.5, 0.8, lamps) * fade * smoothstep(-0.2, 0.2, ripple))
}
