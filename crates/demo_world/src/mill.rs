//! The windmill on its hill.

use glam::Vec3;

use crate::{
    brush::{Canvas, Dab, Frame, mix, paint, smoothstep},
    random::{Random, noise3},
    terrain,
};

const HEIGHT: f32 = 1.35;
const FOOT_RADIUS: f32 = 0.40;
const TOP_RADIUS: f32 = 0.27;
const SAIL: f32 = 0.98;

fn radius(share: f32) -> f32 {
    FOOT_RADIUS + (TOP_RADIUS - FOOT_RADIUS) * share
}

/// A point of the tower's wall at an angle from the front, a share of the height, and `lift` above the surface;
/// and the normal there.
fn wall(mill: &Frame, angle: f32, share: f32, lift: f32) -> (Vec3, Vec3) {
    let out = mill.vector(libm::sinf(angle), 0.0, libm::cosf(angle));
    (mill.at(0.0, share * HEIGHT, 0.0) + out * (radius(share) + lift), (out + Vec3::Y * 0.1).normalize())
}

fn tower(canvas: &mut Canvas, mill: &Frame, random: &mut Random) {
    canvas.tube(
        (mill.origin, mill.at(0.0, HEIGHT, 0.0)),
        (FOOT_RADIUS, TOP_RADIUS),
        0.052,
        |along, normal| {
            let stain = noise3(normal * 3.0 + Vec3::Y * along * 5.0) * 0.6 + 0.4 * random.unit();
            mix(paint(0xf7ecd6), paint(0xd9bf94), stain)
        },
    );
    let tones = [0xa99c8c, 0x8f867e, 0xc0b096, 0x9c8468, 0x7d766f].map(paint);
    for course in 0..22 {
        let share = (course as f32 + 0.5) / 22.0;
        let stones = (std::f32::consts::TAU * radius(share) / 0.1) as u32;
        for stone in 0..stones {
            let angle = std::f32::consts::TAU * (stone as f32 + 0.5 * (course % 2) as f32) / stones as f32;
            let (at, normal) = wall(mill, angle, share, 0.014);
            // Plaster covers the upper wall, except in patches from which it has fallen off.
            if share > 0.3 && noise3(at * 3.3) < 0.62 {
                continue;
            }
            let along = Vec3::Y.cross(normal);
            let color = random.pick(&tones) * random.range(0.85, 1.15);
            let normal = normal + random.cube() * 0.12;
            canvas.add(Dab::flat(at, normal, along, (0.038, 0.0235), color).opacity(0.98));
        }
    }
    for share in [0.32, 0.97] {
        for index in 0..60 {
            let angle = std::f32::consts::TAU * index as f32 / 60.0;
            let (at, normal) = wall(mill, angle, share, 0.025);
            let color = mix(paint(0x5d3d22), paint(0x9a6c40), random.unit());
            canvas.add(Dab::flat(at, normal, Vec3::Y.cross(normal), (0.024, 0.022), color));
        }
    }
}

fn opening(
    canvas: &mut Canvas,
    mill: &Frame,
    angle: f32,
    bottom: f32,
    size: (f32, f32),
    colors: (u32, u32),
    random: &mut Random,
) {
    let (at, normal) = wall(mill, angle, bottom / HEIGHT, 0.03);
    let frame = Frame::facing(at, normal, Vec3::Y.cross(normal));
    let face = frame.moved(-0.5 * size.0, 0.0, 0.0);
    canvas.sheet(face, size, 0.03, |x, _| {
        let plank = if (x / 0.045).rem_euclid(1.0) < 0.25 { 0.6 } else { 1.0 };
        Some(mix(paint(colors.0), paint(colors.1), random.unit()) * plank)
    });
    let (left, right) = (-0.5 * size.0, 0.5 * size.0);
    let edges = [
        ((left, 0.0), (left, size.1)),
        ((right, 0.0), (right, size.1)),
        ((left, size.1), (right, size.1)),
        ((left, 0.0), (right, 0.0)),
    ];
    for (from, to) in edges {
        let ends = (frame.at(from.0, from.1, 0.015), frame.at(to.0, to.1, 0.015));
        canvas.board(ends, frame.z, (0.035, 2), |_| mix(paint(0xe8dcc4), paint(0xfffaf0), random.unit()));
    }
}

fn cap(canvas: &mut Canvas, mill: &Frame, random: &mut Random) {
    let tones = [0x3f5f7a, 0x55779a, 0x6a8aa8, 0x4a5f78].map(paint);
    for row in 0..11 {
        let share = row as f32 / 11.0;
        let ring = (TOP_RADIUS + 0.09) * (1.0 - share * share * 0.35 - share * 0.6);
        let y = HEIGHT - 0.02 + 0.44 * share;
        let count = (std::f32::consts::TAU * ring / 0.05).max(5.0) as u32;
        for index in 0..count {
            let angle = std::f32::consts::TAU * (index as f32 + 0.5 * (row % 2) as f32) / count as f32;
            let out = mill.vector(libm::sinf(angle), 0.0, libm::cosf(angle));
            let (at, normal) = (mill.at(0.0, y, 0.0) + out * ring, out + Vec3::Y * (0.5 + 0.3 * share));
            let along = Vec3::Y.cross(out);
            canvas.add(Dab::flat(at - out * 0.015, normal, along, (0.034, 0.034), paint(0x2a3442)));
            let color = random.pick(&tones) * random.range(0.8, 1.15);
            canvas.add(Dab::flat(at, normal - Vec3::Y * 0.15, along, (0.022, 0.021), color).opacity(0.98));
        }
    }
    canvas.tube(
        (mill.at(0.0, HEIGHT + 0.38, 0.0), mill.at(0.0, HEIGHT + 0.56, 0.0)),
        (0.012, 0.006),
        0.02,
        |_, _| paint(0xe0b84a),
    );
    canvas.add(Dab::ball(mill.at(0.0, HEIGHT + 0.57, 0.0), 0.018, paint(0xf6d26a), Vec3::Y));
}

fn sails(canvas: &mut Canvas, mill: &Frame, random: &mut Random) {
    let hub = mill.moved(0.0, HEIGHT + 0.08, TOP_RADIUS + 0.17);
    canvas.tube((mill.at(0.0, HEIGHT + 0.08, 0.1), hub.at(0.0, 0.0, 0.03)), (0.045, 0.04), 0.03, |_, _| {
        mix(paint(0x4a3020), paint(0x86603c), random.unit())
    });
    for blade in 0..4 {
        let angle = 0.42 + std::f32::consts::FRAC_PI_2 * blade as f32;
        let out = hub.vector(libm::sinf(angle), libm::cosf(angle), 0.0);
        let side = hub.vector(libm::cosf(angle), -libm::sinf(angle), 0.12);
        let at = |r: f32, s: f32, lift: f32| hub.origin + out * r + side * s + hub.z * lift;
        let wood = |random: &mut Random| mix(paint(0x5a3a22), paint(0x94683e), random.unit());
        canvas.board((at(0.0, 0.0, 0.01), at(SAIL, 0.0, 0.01)), hub.z, (0.036, 2), |_| wood(random));
        canvas.board((at(0.2, 0.235, 0.0), at(SAIL, 0.235, 0.0)), hub.z, (0.022, 1), |_| wood(random));
        for rung in 0..9 {
            let r = 0.2 + (SAIL - 0.2) * rung as f32 / 8.0;
            canvas.board((at(r, -0.03, 0.008), at(r, 0.245, 0.008)), hub.z, (0.018, 1), |_| wood(random));
        }
        let cloth = Frame {
            origin: at(0.21, 0.015, -0.012),
            x: out,
            y: side.normalize(),
            z: out.cross(side).normalize(),
        };
        let cloth = Frame { z: if cloth.z.dot(hub.z) < 0.0 { -cloth.z } else { cloth.z }, ..cloth };
        canvas.sheet(cloth, (SAIL - 0.22, 0.215), 0.034, |x, y| {
            let fold = smoothstep(0.2, 0.8, noise3(Vec3::new(x * 9.0, y * 6.0, blade as f32 * 5.0)));
            let stripe = y > 0.14;
            let color = mix(paint(0xfff6e0), paint(0xe6d2a8), fold + 0.2 * random.signed());
            Some(if stripe { mix(paint(0xd8483a), paint(0xb03028), fold) } else { color })
        });
    }
}

/// Paints the windmill, with its sails toward the house and the pond.
pub fn paint_mill(canvas: &mut Canvas) {
    let mut random = Random::new(101);
    let foot = terrain::ground(terrain::MILL) - Vec3::Y * 0.04;
    let mill = Frame::upright(foot, Vec3::new(0.15, 0.0, 1.0));
    tower(canvas, &mill, &mut random);
    opening(canvas, &mill, 0.0, 0.05, (0.22, 0.4), (0x2f5f7a, 0x5a90ac), &mut random);
    for (angle, bottom) in [(1.7, 0.55), (-1.7, 0.55), (3.1, 0.4), (0.9, 0.95), (-2.5, 0.95)] {
        opening(canvas, &mill, angle, bottom, (0.13, 0.17), (0x24384c, 0x5a86a8), &mut random);
    }
    cap(canvas, &mill, &mut random);
    sails(canvas, &mill, &mut random);
}
