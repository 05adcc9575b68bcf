//! The villagers' works: bridge, jetty, boat, garden with fence, well, woodpile and bench; and the rocks they
//! sit on.

use glam::{Vec2, Vec3};

use crate::{
    brush::{Canvas, Dab, Frame, mix, paint, smoothstep, sphere},
    house::shingles,
    random::{Random, cell, noise3},
    terrain::{self, WATER_LEVEL},
};

fn grain(random: &mut Random, dark: u32, light: u32) -> Vec3 {
    mix(paint(dark), paint(light), random.unit())
}

/// Paints an arched footbridge over the stream.
pub fn paint_bridge(canvas: &mut Canvas) {
    const PLANKS: u32 = 24;
    let mut random = Random::new(91);
    let (from, to) = (Vec2::new(2.43, 0.93), Vec2::new(2.49, 2.05));
    let (along, middle) = (to - from, 0.5 * (terrain::height(from) + terrain::height(to)));
    let across = Vec3::new(-along.y, 0.0, along.x).normalize();
    let point = |t: f32, lift: f32, side: f32| {
        let p = from + along * t;
        let arch = 0.2 * (1.0 - (2.0 * t - 1.0) * (2.0 * t - 1.0));
        Vec3::new(p.x, middle + 0.02 + arch + lift, p.y) + across * side
    };
    for plank in 0..PLANKS {
        let t = (plank as f32 + 0.5) / PLANKS as f32;
        let slope = point(t + 0.02, 0.0, 0.0) - point(t - 0.02, 0.0, 0.0);
        let normal = slope.cross(across);
        let normal = if normal.y < 0.0 { -normal } else { normal };
        let tone = random.range(0.8, 1.15);
        let ends = (point(t, 0.0, -0.2), point(t, 0.0, 0.2));
        canvas.board(ends, normal, (0.040, 2), |_| grain(&mut random, 0x8a5a32, 0xc89a62) * tone);
    }
    for side in [-0.21, 0.21] {
        let out = across * side;
        for piece in 0..14 {
            let (a, b) = (piece as f32 / 14.0, (piece + 1) as f32 / 14.0);
            for (lift, width) in [(-0.03, 0.06), (0.13, 0.03), (0.25, 0.04)] {
                let ends = (point(a, lift, side), point(b, lift, side));
                canvas.board(ends, out, (width, 2), |_| grain(&mut random, 0x9c3a2a, 0xd0604a));
            }
        }
        for post in 0..6 {
            let t = post as f32 / 5.0;
            let ends = (point(t, -0.08, side), point(t, 0.29, side));
            canvas.tube(ends, (0.02, 0.02), 0.03, |_, _| grain(&mut random, 0x7c2c22, 0xc05a44));
            canvas.add(Dab::ball(point(t, 0.30, side), 0.018, paint(0xf2d9a0), Vec3::Y));
        }
    }
}

/// Paints a jetty on posts, and a rowing boat beside it.
pub fn paint_boat(canvas: &mut Canvas) {
    let mut random = Random::new(92);
    let foot = Vec2::new(0.35, 0.86);
    let out = Vec2::new(0.12, 1.0).normalize();
    let side = Vec3::new(-out.y, 0.0, out.x);
    let deck =
        |t: f32, s: f32| Vec3::new(foot.x + out.x * t, WATER_LEVEL + 0.1, foot.y + out.y * t) + side * s;
    for plank in 0..17 {
        let t = 0.045 * plank as f32;
        let tone = random.range(0.8, 1.15);
        canvas.board((deck(t, -0.13), deck(t, 0.13)), Vec3::Y, (0.037, 2), |_| {
            grain(&mut random, 0x7d5f43, 0xbd9a70) * tone
        });
    }
    for (t, s) in [(0.3, -0.13), (0.3, 0.13), (0.72, -0.13), (0.72, 0.13)] {
        let ends = (deck(t, s) - Vec3::Y * 0.3, deck(t, s) + Vec3::Y * 0.09);
        canvas.tube(ends, (0.022, 0.022), 0.03, |_, _| grain(&mut random, 0x5d432c, 0x94704c));
    }
    hull(canvas, &mut random);
}

fn hull(canvas: &mut Canvas, random: &mut Random) {
    let boat = Frame::upright(Vec3::new(0.92, WATER_LEVEL, 1.62), Vec3::new(0.45, 0.0, 0.9));
    let (half_length, half_width) = (0.36, 0.15);
    for strake in 0..6 {
        let rise = strake as f32 / 5.0;
        for index in 0..44 {
            for side in [-1.0, 1.0] {
                let u = 2.0 * (index as f32 + 0.5) / 44.0 - 1.0;
                let sheer = 0.05 * u * u;
                let width = half_width
                    * (1.0 - u * u * u * u).max(0.0).sqrt()
                    * (1.0 - u * u * 0.35)
                    * (0.72 + 0.28 * rise);
                let at = boat.at(
                    side * width,
                    -0.01 + (0.12 + sheer) * rise,
                    u * half_length * (0.94 + 0.06 * rise),
                );
                let normal = boat.vector(side, 0.25, 0.7 * u * u * u);
                let stripe = if strake == 4 { (0xf6efe0, 0xffffff) } else { (0x1f5f94, 0x3f8fc4) };
                let color = if strake == 5 {
                    grain(random, 0x7a4a26, 0xb07c48)
                } else {
                    grain(random, stripe.0, stripe.1)
                };
                canvas.add(Dab::flat(at, normal, boat.z, (0.012, 0.0155), color));
            }
        }
    }
    let floor = boat.moved(-0.09, 0.02, -0.26);
    let floor = Frame { y: floor.z, z: floor.y, ..floor };
    canvas.sheet(floor, (0.18, 0.52), 0.035, |_, _| Some(grain(random, 0x6b4526, 0xa87848)));
    for z in [-0.18, 0.0, 0.18] {
        let ends = (boat.at(-0.13, 0.09, z), boat.at(0.13, 0.09, z));
        canvas.board(ends, Vec3::Y, (0.06, 3), |_| grain(random, 0x9c6c3c, 0xd0a068));
    }
    for side in [-1.0, 1.0] {
        let ends = (boat.at(side * 0.08, 0.13, 0.05), boat.at(side * 0.34, 0.0, -0.22));
        canvas.tube(ends, (0.01, 0.012), 0.03, |_, _| grain(random, 0xb88a54, 0xe0c08c));
    }
}

fn pickets(canvas: &mut Canvas, from: Vec2, to: Vec2, random: &mut Random) {
    let length = (to - from).length();
    let out = Vec3::new(to.y - from.y, 0.0, from.x - to.x);
    let count = (length / 0.068) as u32;
    let first = canvas.dabs.len();
    let point = |t: f32, lift: f32| terrain::ground(from + (to - from) * t) + Vec3::Y * lift;
    for picket in 0..=count {
        let t = picket as f32 / count as f32;
        let top = random.range(0.20, 0.225);
        canvas.board((point(t, 0.0), point(t, top)), out, (0.036, 2), |_| grain(random, 0xd9d0bc, 0xfffaf0));
        canvas.add(Dab::ball(point(t, top + 0.008), 0.010, paint(0xfffaf0), Vec3::Y));
    }
    for lift in [0.07, 0.16] {
        for piece in 0..count {
            let (a, b) = (piece as f32 / count as f32, (piece + 1) as f32 / count as f32);
            let back = out.normalize() * 0.012;
            canvas.board((point(a, lift) - back, point(b, lift) - back), out, (0.022, 1), |_| {
                grain(random, 0xc9bfa8, 0xf0e8d8)
            });
        }
    }
    // Thin boards are seen from both sides, so both get the light from above.
    for dab in &mut canvas.dabs[first..] {
        *dab = dab.lit_as(Vec3::Y, 0.5);
    }
}

/// Paints the vegetable garden inside its picket fence.
pub fn paint_garden(canvas: &mut Canvas) {
    let mut random = Random::new(93);
    let (center, half) = terrain::GARDEN;
    let half = half + Vec2::splat(0.05);
    let corner = |x: f32, y: f32| center + half * Vec2::new(x, y);
    pickets(canvas, corner(-1.0, -1.0), corner(1.0, -1.0), &mut random);
    pickets(canvas, corner(1.0, -1.0), corner(1.0, 1.0), &mut random);
    pickets(canvas, corner(-1.0, 1.0), corner(-1.0, -1.0), &mut random);
    pickets(canvas, corner(-1.0, 1.0), corner(-0.25, 1.0), &mut random);
    pickets(canvas, corner(0.3, 1.0), corner(1.0, 1.0), &mut random);
    for row in 0..4 {
        let z = center.y + (row as f32 + 0.5 - 2.0) / 5.2;
        for plant in 0..8 {
            let x = center.x + 0.125 * (plant as f32 - 3.5);
            let foot = terrain::ground(Vec2::new(x, z)) + Vec3::Y * 0.02;
            crop(canvas, row, foot, &mut random);
        }
    }
}

fn crop(canvas: &mut Canvas, row: u32, foot: Vec3, random: &mut Random) {
    let (low, high, fruit) = match row {
        0 => (0x4c8f3a, 0xb6dc7a, None),
        1 => (0x2f6f2a, 0x77ad4a, Some(0xe23b2a)),
        2 => (0x6a3f7a, 0xb48ac8, None),
        _ => (0x3a7a2c, 0x9cc84e, Some(0xff9a2a)),
    };
    for leaf in 0..11 {
        let direction = (random.direction() + Vec3::Y * 0.9).normalize();
        let at = foot + direction * random.range(0.02, 0.045);
        let color = mix(paint(low), paint(high), 0.4 * direction.y + 0.5 * random.unit());
        canvas.add(
            Dab::flat(at, direction + random.cube() * 0.4, random.direction(), (0.021, 0.014), color)
                .lit_as(direction, 0.3),
        );
        if let (Some(fruit), true) = (fruit, leaf % 4 == 0) {
            let at = foot + direction * 0.05;
            canvas.add(Dab::ball(at, 0.013, paint(fruit), direction));
        }
    }
}

fn boulder(canvas: &mut Canvas, place: Vec2, radius: f32, random: &mut Random) {
    let base = terrain::height(place).max(WATER_LEVEL - 0.05);
    let center = Vec3::new(place.x, base + radius * 0.25, place.y);
    let stretch = Vec3::new(random.range(0.85, 1.3), random.range(0.7, 0.95), random.range(0.85, 1.3));
    let seed = random.cube() * 40.0;
    let tone = mix(paint(0x8c8680), paint(0xb8a890), random.unit());
    let count = (radius * radius * 12.6 / 0.0027) as u32;
    let form = |direction: Vec3| {
        let facet = cell(direction * 1.6 + seed);
        direction * stretch * (radius * (0.84 + 0.3 * facet.id * smoothstep(0.0, 0.3, facet.seam)))
    };
    let spacing = (12.6 * radius * radius / count as f32).sqrt();
    for direction in sphere(count.max(24)) {
        if direction.y < -0.45 {
            continue;
        }
        let tangent = crate::brush::any_tangent(direction);
        let other = direction.cross(tangent);
        let step = 0.12;
        let normal = (form((direction + tangent * step).normalize())
            - form((direction - tangent * step).normalize()))
        .cross(form((direction + other * step).normalize()) - form((direction - other * step).normalize()))
        .normalize();
        let at = center + form(direction);
        let facet = cell(direction * 1.6 + seed);
        let crack = 0.6 + 0.4 * smoothstep(0.0, 0.14, facet.seam);
        let lichen = smoothstep(0.6, 0.72, noise3(at * 11.0));
        let moss = smoothstep(0.25, 0.9, normal.y) * smoothstep(0.45, 0.65, noise3(at * 6.0 + seed));
        let stone = tone * (crack * random.range(0.82, 1.15));
        let color = mix(mix(stone, paint(0xd9cf9c), 0.5 * lichen), paint(0x6d8f3c), 0.75 * moss);
        canvas.add(
            Dab::flat(at, normal, random.direction(), (spacing * 0.62, spacing * 0.55), color).opacity(0.98),
        );
    }
}

/// Paints a roofed well behind the house.
pub fn paint_well(canvas: &mut Canvas) {
    let mut random = Random::new(96);
    let well = Frame::upright(terrain::ground(Vec2::new(-2.0, -1.35)), Vec3::new(-0.6, 0.0, -0.8));
    for course in 0..6 {
        for stone in 0..15 {
            let angle = std::f32::consts::TAU * (stone as f32 + 0.5 * (course % 2) as f32) / 15.0;
            let out = well.vector(libm::cosf(angle), 0.0, libm::sinf(angle));
            let at = well.at(0.0, 0.02 + 0.043 * course as f32, 0.0) + out * 0.17;
            let color = grain(&mut random, 0x7f7870, 0xc2b59c);
            canvas.add(Dab::flat(at, out + random.cube() * 0.15, Vec3::Y.cross(out), (0.029, 0.0185), color));
        }
    }
    for direction in sphere(60) {
        let at = well.at(0.0, 0.15, 0.0) + direction.with_y(0.0) * 0.15;
        canvas.add(Dab::flat(at, Vec3::Y, Vec3::X, (0.04, 0.04), paint(0x1c2a30)));
    }
    for side in [-0.17, 0.17] {
        let ends = (well.at(side, 0.0, 0.0), well.at(side, 0.56, 0.0));
        canvas.tube(ends, (0.018, 0.018), 0.03, |_, _| grain(&mut random, 0x5a3a22, 0x94683e));
    }
    let axle = (well.at(-0.2, 0.4, 0.0), well.at(0.2, 0.4, 0.0));
    canvas.tube(axle, (0.016, 0.016), 0.03, |_, _| grain(&mut random, 0x7a5230, 0xb4844e));
    for side in [1.0, -1.0] {
        let (along, up) = (well.x * side, (Vec3::Y * 0.7 - well.z * side).normalize());
        let origin = well.at(0.0, 0.5, 0.21 * side) - along * 0.26;
        let slope = Frame { origin, x: along, y: up, z: along.cross(up) };
        shingles(canvas, slope, (0.52, 0.27), (0.06, 0.065), |_, _| grain(&mut random, 0x6b4a32, 0xa8794c));
    }
}

/// Paints firewood, stacked against the back of the house.
pub fn paint_woodpile(canvas: &mut Canvas) {
    let mut random = Random::new(97);
    let (house, front) = terrain::HOUSE;
    let back = Frame::upright(terrain::ground(house - front * 0.74), Vec3::new(-front.x, 0.0, -front.y));
    for row in 0..4 {
        for log in 0..9 - row {
            let x = -0.62 + 0.066 * (log as f32 + 0.5 * row as f32);
            let end = back.at(x, 0.03 + 0.056 * row as f32, 0.09 + 0.02 * random.signed());
            canvas.tube((end - back.z * 0.16, end), (0.031, 0.031), 0.045, |_, _| {
                grain(&mut random, 0x4a3424, 0x7c5c40)
            });
            canvas.add(Dab::flat(
                end,
                back.z,
                back.x,
                (0.021, 0.021),
                grain(&mut random, 0xc0935a, 0xe6c08a),
            ));
            canvas.add(Dab::flat(end + back.z * 0.006, back.z, back.x, (0.007, 0.007), paint(0x9a6a3c)));
        }
    }
}

/// Paints a bench and a lamp post at the end of the path.
pub fn paint_bench(canvas: &mut Canvas) {
    let mut random = Random::new(95);
    let seat = Frame::upright(terrain::ground(Vec2::new(1.55, 3.1)), Vec3::new(-0.35, 0.0, -1.0));
    for slat in 0..3 {
        let z = 0.05 * slat as f32 - 0.05;
        let ends = (seat.at(-0.2, 0.12, z), seat.at(0.2, 0.12, z));
        canvas.board(ends, Vec3::Y, (0.042, 2), |_| grain(&mut random, 0x8a5a32, 0xc89a62));
        let ends =
            (seat.at(-0.2, 0.17 + 0.05 * slat as f32, -0.1), seat.at(0.2, 0.17 + 0.05 * slat as f32, -0.1));
        canvas.board(ends, seat.z + Vec3::Y * 0.4, (0.04, 2), |_| grain(&mut random, 0x8a5a32, 0xc89a62));
    }
    for (x, z) in [(-0.17, -0.09), (0.17, -0.09), (-0.17, 0.06), (0.17, 0.06)] {
        let top = if z < 0.0 { 0.3 } else { 0.12 };
        canvas.tube((seat.at(x, 0.0, z), seat.at(x, top, z)), (0.014, 0.014), 0.03, |_, _| paint(0x3a3a40));
    }
    let post = seat.moved(0.36, 0.0, 0.0);
    canvas.tube((post.origin, post.at(0.0, 0.5, 0.0)), (0.018, 0.012), 0.025, |_, _| paint(0x2f3a3c));
    for direction in sphere(40) {
        let at = post.at(0.0, 0.56, 0.0) + direction * Vec3::new(0.045, 0.06, 0.045);
        let glass = Dab::flat(at, direction, Vec3::Y, (0.02, 0.018), paint(0xffe2a0));
        canvas.add(glass.glowing(paint(0xffc860) * 0.45));
    }
    canvas
        .tube((post.at(0.0, 0.6, 0.0), post.at(0.0, 0.66, 0.0)), (0.07, 0.01), 0.022, |_, _| paint(0x2f3a3c));
}

/// Paints boulders on the banks, by the paths and along the rim.
pub fn paint_rocks(canvas: &mut Canvas) {
    let mut random = Random::new(94);
    let boulders = [
        (2.05, 2.1, 0.15),
        (1.9, 2.32, 0.1),
        (-0.28, 1.75, 0.16),
        (-0.42, 1.98, 0.1),
        (0.3, 2.62, 0.14),
        (3.25, 1.3, 0.13),
        (3.55, 2.2, 0.17),
        (3.35, 2.42, 0.1),
        (-1.1, 3.25, 0.17),
        (-1.35, 3.4, 0.11),
        (-3.55, 0.2, 0.2),
        (-3.45, 0.5, 0.11),
        (1.25, -2.95, 0.19),
        (2.75, -2.0, 0.22),
        (2.95, -1.7, 0.13),
        (-0.5, -3.35, 0.15),
        (2.95, 1.98, 0.08),
        (1.35, 0.85, 0.09),
        (-1.9, -1.5, 0.14),
    ];
    for (x, z, radius) in boulders {
        boulder(canvas, Vec2::new(x, z), radius, &mut random);
    }
}
