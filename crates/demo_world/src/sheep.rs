//! Sheep, on the sides of the island without buildings.

use glam::{Vec2, Vec3};

use crate::{
    brush::{Canvas, Dab, Frame, mix, paint, sphere},
    random::{Random, noise3},
    terrain,
};

fn sheep(canvas: &mut Canvas, place: Vec2, heading: Vec2, random: &mut Random) {
    let frame = Frame::upright(terrain::ground(place), Vec3::new(heading.x, 0.0, heading.y));
    for (x, z) in [(-0.035, -0.055), (0.035, -0.055), (-0.035, 0.06), (0.035, 0.06)] {
        let ends = (frame.at(x, 0.0, z), frame.at(x, 0.09, z));
        canvas.tube(ends, (0.012, 0.014), 0.035, |_, _| paint(0x3a302c));
    }
    for direction in sphere(78) {
        let curl = noise3(direction * 4.0 + frame.origin * 9.0);
        let offset = direction * Vec3::new(0.072, 0.068, 0.115) * (0.9 + 0.25 * curl);
        let at = frame.at(offset.x, 0.13 + offset.y, offset.z);
        let out = frame.vector(direction.x, direction.y, direction.z);
        let wool = mix(paint(0xd8cbb4), paint(0xfffaf0), 1.4 * curl - 0.2 + 0.2 * random.signed());
        let dab = Dab::flat(at, out, random.direction(), (0.019, 0.016), wool);
        canvas.add(Dab { sigma: dab.sigma.with_z(0.01), ..dab }.lit_as(out + random.cube() * 0.3, 0.2));
    }
    for direction in sphere(22) {
        let offset = direction * Vec3::new(0.028, 0.034, 0.042);
        let at = frame.at(offset.x, 0.165 + offset.y, 0.145 + offset.z);
        let out = frame.vector(direction.x, direction.y, direction.z);
        canvas.add(Dab::flat(at, out, frame.z, (0.012, 0.012), paint(0x3f342f)));
    }
    for side in [-1.0, 1.0] {
        let ear = frame.at(side * 0.038, 0.185, 0.13);
        canvas.add(Dab::flat(ear, frame.z + frame.y, frame.x, (0.016, 0.007), paint(0x4a3c36)));
    }
}

/// Paints the flock.
pub fn paint_sheep(canvas: &mut Canvas) {
    let mut random = Random::new(141);
    let flock = [
        (3.05, -1.25, Vec2::new(-0.6, 0.8)),
        (3.3, -1.0, Vec2::new(0.9, 0.3)),
        (2.55, -1.05, Vec2::new(-1.0, -0.2)),
        (-0.1, -3.15, Vec2::new(0.8, -0.5)),
    ];
    for (x, z, heading) in flock {
        sheep(canvas, Vec2::new(x, z), heading, &mut random);
    }
}
