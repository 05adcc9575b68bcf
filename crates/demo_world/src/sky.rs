//! Things that float around the island: clouds, a balloon, birds, smoke, and a few small rocks.

use glam::{Vec2, Vec3};

use crate::{
    brush::{Canvas, Dab, Frame, mix, paint, smoothstep, sphere},
    random::{Random, noise3},
};

/// A cumulus: balls of vapor on a flat bottom, warm above and blue below.
fn cloud(canvas: &mut Canvas, center: Vec3, size: f32, seed: u64) {
    let mut random = Random::new(seed);
    let along = Vec3::new(-center.z, 0.0, center.x).normalize();
    let puffs: Vec<(Vec3, f32)> = (0..8)
        .map(|index| {
            let t = (index as f32 + 0.5) / 4.0 - 1.0;
            let radius = size * (0.5 - 0.26 * t * t) * random.range(0.8, 1.15);
            let aside = Vec3::new(random.signed(), 0.0, random.signed()) * (0.42 * size);
            (center + along * (t * size * 1.25) + aside + Vec3::Y * radius * 0.55, radius)
        })
        .collect();
    for (index, &(middle, radius)) in puffs.iter().enumerate() {
        for direction in sphere((radius * radius * 640.0) as u32) {
            let lump = 0.82 + 0.3 * noise3(direction * 2.4 + Vec3::splat(index as f32 * 7.0));
            let mut at = middle + direction * radius * lump;
            at.y = at.y.max(center.y - 0.02 * size * random.unit());
            let hidden =
                puffs.iter().enumerate().any(|(other, p)| other != index && (at - p.0).length() < 0.75 * p.1);
            if hidden {
                continue;
            }
            let height = smoothstep(center.y - 0.1 * size, center.y + 0.8 * size, at.y);
            let color = mix(paint(0xb9c6e6), paint(0xfffaf2), 0.15 + height + 0.15 * random.signed());
            let sigma = random.range(0.05, 0.07);
            let dab = Dab::flat(at, direction, random.direction(), (sigma, sigma * 0.85), color);
            let dab = Dab { sigma: dab.sigma.with_z(0.03), ..dab };
            canvas.add(
                dab.lit_as(direction + Vec3::Y * 0.4, 0.8)
                    .opacity(random.range(0.6, 0.85))
                    .blocking(0.06)
                    .glowing(color * 0.4),
            );
        }
    }
}

/// Radius of the balloon and height over its mouth, in radii of the balloon, from the mouth (t = 0) to the
/// crown (t = 1).
fn envelope(t: f32) -> (f32, f32) {
    let angle = std::f32::consts::PI * (0.14 + 0.86 * t);
    let radius = libm::sinf(angle) * (1.0 - 0.25 * (1.0 - t) * (1.0 - t));
    (radius, 1.15 - 1.15 * libm::cosf(angle) - 0.1)
}

fn balloon(canvas: &mut Canvas, center: Vec3, size: f32) {
    const RINGS: u32 = 30;
    let mut random = Random::new(112);
    let stripes = [0xd93a34, 0xfff1d6, 0xf2a032, 0xfff1d6, 0x2f7fb8, 0xfff1d6].map(paint);
    for ring in 0..RINGS {
        let t = (ring as f32 + 0.5) / RINGS as f32;
        let (radius, lift) = envelope(t);
        let next = envelope((t + 0.5 / RINGS as f32).min(1.0));
        let slope = Vec2::new(next.0 - radius, next.1 - lift);
        let count = (std::f32::consts::TAU * radius * size / 0.047).max(5.0) as u32;
        for index in 0..count {
            let turn = (index as f32 + 0.5 * (ring % 2) as f32) / count as f32;
            let angle = std::f32::consts::TAU * turn;
            let out = Vec3::new(libm::cosf(angle), 0.0, libm::sinf(angle));
            let normal = out * slope.y - Vec3::Y * slope.x;
            let gore = (turn * 12.0).rem_euclid(12.0);
            let bulge = 0.82 + 0.18 * libm::sinf(std::f32::consts::PI * gore.fract());
            let band = (0.46..0.56).contains(&t);
            let base = if band { paint(0x233a66) } else { stripes[gore as usize % 6] };
            let color = base * (bulge * random.range(0.93, 1.05));
            let at = center + (out * radius + Vec3::Y * lift) * size;
            let along = Vec3::Y.cross(out);
            canvas.add(Dab::flat(at, normal, along, (0.027, 0.029), color).opacity(0.97).blocking(0.15));
        }
    }
    let basket = center - Vec3::Y * (0.42 * size);
    let frame = Frame::upright(basket, Vec3::new(0.4, 0.0, 1.0));
    canvas.tube((basket - Vec3::Y * 0.09, basket + Vec3::Y * 0.05), (0.07, 0.085), 0.025, |along, _| {
        mix(paint(0x6b4320), paint(0xc08a4e), random.unit()) * if along > 0.85 { 1.3 } else { 1.0 }
    });
    for (x, z) in [(-0.06, -0.06), (0.06, -0.06), (-0.06, 0.06), (0.06, 0.06)] {
        let ends = (frame.at(x, 0.05, z), center + frame.vector(x * 3.0, 0.12 * size, z * 3.0));
        canvas.board(ends, frame.z + frame.x, (0.012, 1), |_| paint(0x5a4632));
    }
}

fn bird(canvas: &mut Canvas, at: Vec3, heading: Vec3) {
    let frame = Frame::upright(at, heading);
    for side in [-1.0, 1.0] {
        let color = paint(0x55617a);
        let inner = frame.vector(side, 0.55, 0.0);
        canvas.add(Dab::flat(
            frame.at(side * 0.045, 0.022, 0.0),
            frame.y - inner * 0.3,
            inner,
            (0.034, 0.014),
            color,
        ));
        let outer = frame.vector(side, -0.15, -0.25);
        canvas.add(Dab::flat(
            frame.at(side * 0.115, 0.036, -0.008),
            frame.y,
            outer,
            (0.034, 0.010),
            color * 0.8,
        ));
    }
    canvas.add(Dab::flat(at, frame.y, frame.z, (0.036, 0.014), paint(0x3f4a60)));
}

fn smoke(canvas: &mut Canvas, from: Vec3) {
    let mut random = Random::new(113);
    for puff in 0..46 {
        let t = puff as f32 / 46.0;
        let drift = Vec3::new(-0.34 * t * t, 0.75 * t, -0.12 * t) + random.cube() * (0.03 + 0.07 * t);
        let tone = mix(paint(0xd9d6d4), paint(0xffffff), t + 0.3 * random.signed());
        let dab =
            Dab::ball(from + drift, 0.025 + 0.045 * t, tone, Vec3::Y).lit_as(Vec3::Y + random.cube(), 0.8);
        canvas.add(dab.opacity(0.5 * (1.0 - t) + 0.06).blocking(0.1));
    }
}

/// A small rock adrift beside the island, grassy on top.
fn islet(canvas: &mut Canvas, center: Vec3, radius: f32, seed: u64) {
    let mut random = Random::new(seed);
    for direction in sphere((radius * radius * 3300.0) as u32) {
        let lump = 0.78 + 0.44 * noise3(direction * 2.2 + Vec3::splat(seed as f32));
        let stretch = Vec3::new(1.0, if direction.y > 0.0 { 0.32 } else { 1.15 }, 1.0);
        let at = center + direction * stretch * radius * lump;
        let stone = mix(paint(0x7a7078), paint(0xb59c7c), noise3(at * 6.0) + 0.3 * random.signed());
        let green = mix(paint(0x3c7424), paint(0xa8d04c), random.unit() * random.unit() * 1.3);
        let color = mix(stone, green, smoothstep(-0.1, 0.1, direction.y + 0.15 * random.signed()));
        let spacing = radius * (12.6 / (radius * radius * 3300.0)).sqrt();
        let dab =
            Dab::flat(at, direction / stretch, random.direction(), (spacing * 0.7, spacing * 0.6), color);
        canvas.add(Dab { sigma: dab.sigma.with_z(0.012), ..dab });
    }
}

/// Paints everything in the air. Clouds are low or high, so that none hides the village from a camera.
pub fn paint_sky(canvas: &mut Canvas, chimney: Vec3) {
    let clouds = [
        (Vec3::new(2.5, -1.75, 3.3), 0.5),
        (Vec3::new(-3.9, -1.25, 1.3), 0.6),
        (Vec3::new(-2.6, -1.5, -3.3), 0.55),
        (Vec3::new(2.9, -1.35, -3.2), 0.6),
        (Vec3::new(-1.7, -1.95, 3.3), 0.45),
        (Vec3::new(-0.75, 3.0, -0.9), 0.36),
    ];
    for (index, (center, size)) in clouds.into_iter().enumerate() {
        cloud(canvas, center, size, 121 + index as u64);
    }
    balloon(canvas, Vec3::new(0.95, 2.75, 0.3), 0.4);
    smoke(canvas, chimney);
    islet(canvas, Vec3::new(-4.35, 0.25, -1.9), 0.3, 131);
    islet(canvas, Vec3::new(4.2, -0.75, -1.5), 0.36, 132);
    islet(canvas, Vec3::new(-4.0, -0.85, 2.75), 0.24, 133);
    for (x, y, z) in
        [(-0.9, 2.7, 1.5), (-0.6, 2.9, 1.2), (-1.3, 2.85, 1.1), (2.6, 2.2, -0.4), (2.9, 2.4, -0.7)]
    {
        bird(canvas, Vec3::new(x, y, z), Vec3::new(0.8, 0.0, 0.5));
    }
}
