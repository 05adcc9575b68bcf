//! Pond, stream and waterfall.
//!
//! A Gaussian of this scene has one color for all directions, so its reflection is that of the average view.
//! Rays leave the water at a low angle all around, and the trees, banks and bridges that they meet tint it.

use glam::{Vec2, Vec3};

use crate::{
    brush::{Canvas, Dab, mix, paint, smoothstep},
    random::{Random, fractal2, noise2, noise3},
    terrain::{self, WATER_LEVEL},
};

const SPACING: f32 = 0.052;

/// The things near the water, which hide parts of the low horizon and are reflected.
struct Mirror<'a> {
    near: Vec<&'a Dab>,
}

impl<'a> Mirror<'a> {
    fn new(canvas: &'a Canvas) -> Self {
        let is_near = |dab: &&Dab| {
            let at = dab.frame.origin;
            let shore = terrain::shore_distance(Vec2::new(at.x, at.z));
            shore < 0.6 && at.y > WATER_LEVEL + 0.06 && at.y < 1.6
        };
        Self { near: canvas.dabs.iter().filter(is_near).collect() }
    }

    /// Solid angle and mean color of the things around a point, seen from the mirror image of an eye 30 degrees
    /// above the water.
    fn at(&self, p: Vec3) -> (f32, Vec3) {
        let (mut weight, mut color) = (0.0, Vec3::ZERO);
        for dab in &self.near {
            let to = dab.frame.origin - p;
            let squared = to.length_squared() + 0.02;
            let low = smoothstep(0.95, 0.3, to.y / squared.sqrt());
            let solid_angle = dab.sigma.x * dab.sigma.y * low / squared;
            weight += solid_angle;
            color += dab.color * solid_angle;
        }
        (weight, color / weight.max(1e-6))
    }
}

/// Paints pond and stream, with ripples along the flow, reflections and a bright line at the shore.
pub fn paint_water(canvas: &mut Canvas) {
    let mirror_of = canvas.clone();
    let mirror = Mirror::new(&mirror_of);
    let mut random = Random::new(81);
    let rows = (5.0 / (SPACING * 0.7)) as i32;
    let columns = (5.4 / (SPACING * 1.35)) as i32;
    for row in 0..rows {
        for column in 0..columns {
            let shift = 0.5 * (row % 2) as f32;
            let p =
                Vec2::new((column as f32 + shift) * 1.35, row as f32 * 0.7) * SPACING + Vec2::new(-0.8, 0.2);
            let depth = WATER_LEVEL - terrain::height(p);
            if depth < 0.0 || terrain::rim_share(p) > 1.0 || terrain::shore_distance(p) > 0.2 {
                continue;
            }
            let at = Vec3::new(p.x, WATER_LEVEL, p.y);
            let (covered, around) = mirror.at(at);
            let wave = noise3(Vec3::new(p.x * 3.2, 7.0, p.y * 9.0)) * 0.6
                + noise3(Vec3::new(p.x * 8.0, 3.0, p.y * 23.0)) * 0.4;
            let body = mix(paint(0x4fb0a4), paint(0x1c5f86), smoothstep(0.03, 0.26, depth));
            let reflected = mix(paint(0xa8d4ee), around, smoothstep(0.04, 0.5, covered));
            let color = mix(body, reflected, 0.18 + 0.5 * smoothstep(0.4, 0.62, wave));
            let glint = smoothstep(0.66, 0.76, wave) * smoothstep(0.05, 0.12, depth);
            let foam = smoothstep(0.035, 0.012, depth + 0.015 * random.signed()) * 0.6;
            let color = mix(color, Vec3::ONE, (0.65 * glint).max(foam));
            let tilt = Vec3::new(0.1 * (wave - 0.5), 1.0, 0.35 * (wave - 0.5));
            let opacity = 0.62 + 0.3 * smoothstep(0.03, 0.2, depth);
            let sigma = (SPACING * 0.82, SPACING * 0.44);
            let dab = Dab::flat(at, Vec3::Y, Vec3::X, sigma, color).lit_as(tilt, 0.3);
            canvas.add(dab.opacity(opacity).blocking(0.05));
        }
    }
    lilies(canvas, &mut random);
}

fn lilies(canvas: &mut Canvas, random: &mut Random) {
    let mut count = 0;
    while count < 46 {
        let p = Vec2::new(random.range(-0.2, 2.0), random.range(1.0, 2.6));
        let patch = noise2(p * 1.9 + Vec2::new(5.0, 1.0));
        if !(-0.6..-0.12).contains(&terrain::shore_distance(p)) || patch < 0.5 {
            continue;
        }
        count += 1;
        let at = Vec3::new(p.x, WATER_LEVEL + 0.012, p.y);
        let size = random.range(0.026, 0.045);
        let leaf = mix(paint(0x2f7a3a), paint(0x86bf56), random.unit());
        canvas.add(Dab::flat(at, Vec3::Y, random.direction(), (size, size * 0.9), leaf));
        let glance = at + Vec3::new(-0.3, 0.08, 0.25) * size;
        canvas.add(Dab::flat(glance, Vec3::Y, Vec3::X, (size * 0.5, size * 0.35), leaf * 1.35).opacity(0.7));
        if count % 4 == 0 {
            for petal in 0..6 {
                let angle = std::f32::consts::TAU * petal as f32 / 6.0;
                let out = Vec3::new(libm::cosf(angle), 0.5, libm::sinf(angle));
                let normal = Vec3::Y - out * 0.5;
                let color = paint(if petal % 2 == 0 { 0xffd7ea } else { 0xf58fc0 });
                canvas.add(Dab::flat(at + out * 0.02 + Vec3::Y * 0.01, normal, out, (0.015, 0.009), color));
            }
            canvas.add(Dab::ball(at + Vec3::Y * 0.028, 0.008, paint(0xffd23f), Vec3::Y));
        }
    }
}

/// The point at which the stream leaves the island, and its direction there.
fn lip() -> (Vec2, Vec2) {
    let (from, to) = (terrain::STREAM[2], terrain::STREAM[3]);
    let along = (to - from).normalize();
    let mut p = from;
    while terrain::rim_share(p) < 0.97 {
        p += along * 0.01;
    }
    (p, along)
}

/// Paints the fall: strands of water leave the lip level, bend down and break into spray.
pub fn paint_waterfall(canvas: &mut Canvas) {
    let mut random = Random::new(82);
    let (start, along) = lip();
    let across = Vec2::new(-along.y, along.x);
    let point = |side: f32, t: f32| {
        let out = 0.34 * t.sqrt() * (1.0 + 0.15 * side * side);
        let drop = 1.95 * t * t + 0.15 * t;
        let ragged = noise2(Vec2::new(t * 5.0, 3.0 * side.signum())) - 0.5;
        let spread = side * (0.19 + 0.10 * t + 0.09 * ragged * t.sqrt());
        let p = start + along * out + across * spread;
        Vec3::new(p.x, WATER_LEVEL - drop, p.y)
    };
    const STRANDS: u32 = 17;
    const DROPS: u32 = 44;
    for strand in 0..STRANDS {
        let side = 2.0 * (strand as f32 + 0.5) / STRANDS as f32 - 1.0;
        let (phase, length) = (random.unit(), random.range(0.82, 1.08));
        for drop in 0..DROPS {
            let t = length * (drop as f32 + phase) / DROPS as f32;
            let (at, next) = (point(side, t), point(side, t + 0.5 / DROPS as f32));
            let streak = fractal2(Vec2::new(side * 15.0, t * 4.0)) * 2.0 - 0.6 + 0.25 * random.signed();
            let blue = mix(paint(0x2b82ad), paint(0xa9dcf0), streak * 1.4);
            let color = mix(blue, Vec3::splat(0.98), smoothstep(0.55, 1.0, streak) * 0.8 + 0.5 * t * t);
            let normal =
                Vec3::new(along.x, 0.35, along.y) + Vec3::new(across.x, 0.0, across.y) * (0.5 * side);
            let edge = smoothstep(0.75, 1.0, side.abs());
            let opacity = 0.94 - 0.4 * edge - 0.5 * smoothstep(0.7, 1.0, t / length);
            let sigma = ((next - at).length() * 1.15 + 0.012, 0.0135 + 0.008 * t);
            let dab = Dab::flat(at, normal, next - at, sigma, color).lit_as(normal + Vec3::Y * 0.6, 0.5);
            canvas.add(Dab { sigma: dab.sigma.with_z(0.012), ..dab.opacity(opacity).blocking(0.3) });
        }
    }
    for _ in 0..150 {
        let at = point(random.signed() * 1.3, random.range(0.8, 1.02))
            + random.cube() * Vec3::new(0.12, 0.14, 0.12);
        let mist = Dab::ball(at, random.range(0.02, 0.055), Vec3::splat(0.92), Vec3::Y).lit_as(Vec3::Y, 1.0);
        canvas.add(mist.opacity(random.range(0.12, 0.4)).blocking(0.1));
    }
}
