//! The cottage: stone base, timbered plaster walls, shingled roof, chimney.

use glam::Vec3;

use crate::{
    brush::{Canvas, Dab, Frame, mix, paint, smoothstep},
    random::{Random, noise2, noise3},
    terrain,
};

/// Half of the length along the ridge.
const HALF_LENGTH: f32 = 0.85;
/// Half of the depth.
const HALF_DEPTH: f32 = 0.6;
/// Height of the walls.
const WALL: f32 = 0.96;
/// Height of the gable above the walls.
const GABLE: f32 = 0.72;
/// Height of the stone base.
const BASE: f32 = 0.2;
/// Width of the roof beyond the walls.
const OVERHANG: f32 = 0.12;

/// An opening of a wall, by its edges in the wall's frame.
#[derive(Clone, Copy)]
struct Opening {
    left: f32,
    right: f32,
    bottom: f32,
    top: f32,
    is_door: bool,
}

const fn window(center: f32, bottom: f32) -> Opening {
    Opening { left: center - 0.11, right: center + 0.11, bottom, top: bottom + 0.32, is_door: false }
}

const fn door(center: f32) -> Opening {
    Opening { left: center - 0.13, right: center + 0.13, bottom: 0.03, top: 0.64, is_door: true }
}

impl Opening {
    fn holds(&self, x: f32, y: f32) -> bool {
        x > self.left && x < self.right && y > self.bottom && y < self.top
    }
}

/// One wall. Its frame starts at the lower left corner as seen from outside, with z outward.
struct Wall<'a> {
    frame: Frame,
    width: f32,
    gable: f32,
    openings: &'a [Opening],
}

impl Wall<'_> {
    fn top(&self, x: f32) -> f32 {
        WALL + self.gable * (1.0 - (2.0 * x / self.width - 1.0).abs())
    }
}

fn wood(random: &mut Random, dark: u32, light: u32) -> Vec3 {
    mix(paint(dark), paint(light), random.unit())
}

fn plaster(canvas: &mut Canvas, wall: &Wall, random: &mut Random) {
    let size = (wall.width, WALL + wall.gable);
    canvas.sheet(wall.frame, size, 0.05, |x, y| {
        if y > wall.top(x) || wall.openings.iter().any(|opening| opening.holds(x, y)) {
            return None;
        }
        let at = wall.frame.at(x, y, 0.0);
        let stain = noise3(at * 4.0) * 0.5 + noise3(at * 13.0) * 0.3 + 0.25 * random.unit();
        let damp = smoothstep(0.5, 0.2, y);
        Some(mix(mix(paint(0xfff4dc), paint(0xe2c79a), stain), paint(0xb99e78), 0.45 * damp))
    });
}

fn stones(canvas: &mut Canvas, wall: &Wall, random: &mut Random) {
    let tones = [0x9a9187, 0xb3a592, 0x857d78, 0xa88f74, 0xc2b59c].map(paint);
    for row in 0..4 {
        let y = BASE * (row as f32 + 0.5) / 4.0;
        let mut x = if row % 2 == 0 { 0.0 } else { -0.05 };
        while x < wall.width {
            let width = random.range(0.075, 0.13);
            let middle = x + 0.5 * width;
            x += width;
            let color = random.pick(&tones) * random.range(0.8, 1.15);
            if middle < 0.0 || middle > wall.width || wall.openings.iter().any(|o| o.holds(middle, y)) {
                continue;
            }
            let normal = (wall.frame.z + random.cube() * 0.15).normalize();
            let at = wall.frame.at(middle, y, 0.018);
            canvas.add(Dab::flat(at, normal, wall.frame.x, (width * 0.36, 0.0195), color).opacity(0.99));
        }
    }
}

fn beam(canvas: &mut Canvas, wall: &Wall, from: (f32, f32), to: (f32, f32), random: &mut Random) {
    let ends = (wall.frame.at(from.0, from.1, 0.02), wall.frame.at(to.0, to.1, 0.02));
    canvas.board(ends, wall.frame.z, (0.06, 2), |_| wood(random, 0x4a2d1a, 0x8a5a34));
}

fn timbers(canvas: &mut Canvas, wall: &Wall, random: &mut Random) {
    let width = wall.width;
    beam(canvas, wall, (0.0, BASE + 0.02), (width, BASE + 0.02), random);
    beam(canvas, wall, (0.0, WALL - 0.02), (width, WALL - 0.02), random);
    for post in [0.03, width - 0.03] {
        beam(canvas, wall, (post, BASE), (post, WALL), random);
    }
    let bays = if wall.gable > 0.0 { 3 } else { 5 };
    for bay in 1..bays {
        let x = width * bay as f32 / bays as f32;
        if !wall.openings.iter().any(|o| x > o.left - 0.05 && x < o.right + 0.05) {
            beam(canvas, wall, (x, BASE), (x, WALL), random);
        }
    }
    let brace = 0.26;
    beam(canvas, wall, (0.05, WALL - 0.05), (brace, BASE + 0.05), random);
    beam(canvas, wall, (width - 0.05, WALL - 0.05), (width - brace, BASE + 0.05), random);
    if wall.gable > 0.0 {
        let middle = 0.5 * width;
        beam(canvas, wall, (middle, WALL + 0.38), (middle, WALL + wall.gable), random);
        beam(canvas, wall, (0.25 * width, WALL + 0.37), (0.75 * width, WALL + 0.37), random);
        beam(canvas, wall, (0.2 * width, WALL), (0.36 * width, WALL + 0.36), random);
        beam(canvas, wall, (0.8 * width, WALL), (0.64 * width, WALL + 0.36), random);
    }
}

/// Panes, cross bars, frame, shutters and a box of flowers.
fn glaze(canvas: &mut Canvas, wall: &Wall, o: &Opening, random: &mut Random) {
    let (width, height) = (o.right - o.left, o.top - o.bottom);
    let pane = wall.frame.moved(o.left, o.bottom, -0.02);
    let first = canvas.dabs.len();
    canvas.sheet(pane, (width, height), 0.03, |x, y| {
        let glint = smoothstep(0.08, 0.0, (x - 0.6 * y - 0.03).abs());
        Some(mix(mix(paint(0x1f3a54), paint(0x5a8ab0), y / height), paint(0xeaf6ff), 0.45 * glint))
    });
    for dab in &mut canvas.dabs[first..] {
        let warm = smoothstep(0.05, 0.26, dab.frame.origin.y - pane.origin.y);
        dab.glow = paint(0xffb84e) * (0.42 - 0.25 * warm);
    }
    let corners = [(o.left, o.bottom), (o.right, o.bottom), (o.right, o.top), (o.left, o.top)];
    let middle = (0.5 * (o.left + o.right), 0.5 * (o.bottom + o.top));
    let bars = [
        (corners[0], corners[1]),
        (corners[1], corners[2]),
        (corners[2], corners[3]),
        (corners[3], corners[0]),
        ((middle.0, o.bottom), (middle.0, o.top)),
        ((o.left, middle.1), (o.right, middle.1)),
    ];
    for (from, to) in bars {
        let ends = (wall.frame.at(from.0, from.1, 0.03), wall.frame.at(to.0, to.1, 0.03));
        canvas.board(ends, wall.frame.z, (0.024, 1), |_| wood(random, 0xdcd3bf, 0xfffaf0));
    }
    for side in [o.left - 0.07, o.right + 0.07] {
        for slat in 0..9 {
            let y = o.bottom + height * (slat as f32 + 0.5) / 9.0;
            let color = wood(random, 0x1f6a5d, 0x4aa38a);
            canvas.add(Dab::flat(
                wall.frame.at(side, y, 0.03),
                wall.frame.z,
                wall.frame.x,
                (0.03, 0.0125),
                color,
            ));
        }
    }
    let sill = (
        wall.frame.at(o.left - 0.02, o.bottom - 0.045, 0.06),
        wall.frame.at(o.right + 0.02, o.bottom - 0.045, 0.06),
    );
    canvas.board(sill, wall.frame.z, (0.05, 2), |_| wood(random, 0x7a4a28, 0xa87444));
    for _ in 0..26 {
        let at = wall.frame.at(
            random.range(o.left, o.right),
            o.bottom + random.range(-0.02, 0.045),
            random.range(0.03, 0.09),
        );
        let petal = random.pick(&[0xff4d6d, 0xff8fab, 0xfff0f3, 0x5aa02c, 0x3f8a2a, 0xd6263f]);
        let normal = wall.frame.z + Vec3::Y * 0.6 + random.cube() * 0.5;
        canvas
            .add(Dab::flat(at, normal, random.direction(), (0.016, 0.013), paint(petal)).lit_as(normal, 0.3));
    }
}

fn hang_door(canvas: &mut Canvas, wall: &Wall, o: &Opening, random: &mut Random) {
    for plank in 0..6 {
        let x = o.left + (o.right - o.left) * (plank as f32 + 0.5) / 6.0;
        let tone = random.range(0.8, 1.15);
        let ends = (wall.frame.at(x, o.bottom, -0.01), wall.frame.at(x, o.top, -0.01));
        canvas.board(ends, wall.frame.z, (0.042, 2), |_| wood(random, 0x7d2f22, 0xb8523a) * tone);
    }
    for (from, to) in [
        ((o.left, o.bottom), (o.left, o.top)),
        ((o.right, o.bottom), (o.right, o.top)),
        ((o.left, o.top), (o.right, o.top)),
    ] {
        let ends = (wall.frame.at(from.0, from.1, 0.03), wall.frame.at(to.0, to.1, 0.03));
        canvas.board(ends, wall.frame.z, (0.05, 2), |_| wood(random, 0x3b2415, 0x6a4326));
    }
    for (x, y) in [(o.left + 0.1, o.bottom + 0.12), (o.left + 0.1, o.top - 0.1)] {
        let at = wall.frame.at(x, y, 0.012);
        canvas.add(Dab::flat(at, wall.frame.z, wall.frame.x, (0.06, 0.009), paint(0x2b2b30)));
    }
    let knob = wall.frame.at(o.right - 0.05, 0.5 * (o.bottom + o.top), 0.03);
    canvas.add(Dab::ball(knob, 0.012, paint(0xf0c659), wall.frame.z));
    for step in 0..3 {
        let (depth, drop) = (0.05 + 0.075 * step as f32, -0.01 - 0.03 * step as f32);
        for index in 0..7 {
            let x = o.left + (o.right - o.left) * (index as f32 + 0.5) / 7.0;
            let color = paint(0xb9ad9c) * random.range(0.8, 1.1);
            canvas.add(Dab::flat(
                wall.frame.at(x, o.bottom + drop, depth),
                Vec3::Y,
                wall.frame.x,
                (0.022, 0.026),
                color,
            ));
        }
    }
}

/// A shingled slope. The frame's x runs along the eaves, y up the slope, and z outward. `color` takes a
/// shingle's column and row.
pub fn shingles(
    canvas: &mut Canvas,
    slope: Frame,
    size: (f32, f32),
    shingle: (f32, f32),
    mut color: impl FnMut(f32, f32) -> Vec3,
) {
    canvas.sheet(slope, size, 0.08, |_, _| Some(paint(0x4d261f)));
    let rows = (size.1 / shingle.1).round().max(1.0);
    let columns = (size.0 / shingle.0).round().max(1.0);
    let (width, height) = (size.0 / columns, size.1 / rows);
    let tilted = Frame::facing(Vec3::ZERO, slope.z - slope.y * 0.22, slope.x);
    for row in 0..rows as u32 {
        let shift = if row % 2 == 0 { 0.25 } else { 0.75 };
        for column in 0..columns as u32 {
            let (x, y) = (width * (column as f32 + shift), height * (row as f32 + 0.5));
            let tone = color(x / size.0, y / size.1);
            let upper = slope.at(x, y + 0.1 * height, 0.016);
            canvas
                .add(Dab::flat(upper, tilted.z, tilted.x, (width * 0.43, height * 0.48), tone).opacity(0.98));
            let lip = slope.at(x, y - 0.32 * height, 0.026);
            canvas.add(
                Dab::flat(lip, tilted.z, tilted.x, (width * 0.38, height * 0.14), tone * 1.3).opacity(0.85),
            );
        }
    }
}

fn roof(canvas: &mut Canvas, house: Frame, random: &mut Random) {
    let rise = Vec3::new(0.0, GABLE, HALF_DEPTH);
    let slope_length = rise.length() * (1.0 + OVERHANG / HALF_DEPTH);
    for side in [1.0, -1.0] {
        let out = house.z * side;
        let up_slope = (house.y * GABLE - out * HALF_DEPTH).normalize();
        let along = house.x * side;
        let eaves = house.at(0.0, WALL + 0.03, 0.0) + out * (HALF_DEPTH + OVERHANG)
            - house.y * (GABLE / HALF_DEPTH * OVERHANG);
        let frame = Frame {
            origin: eaves - along * (HALF_LENGTH + OVERHANG),
            x: along,
            y: up_slope,
            z: along.cross(up_slope),
        };
        let length = 2.0 * (HALF_LENGTH + OVERHANG);
        let tones = [0xb5482f, 0xc95f3c, 0x9c3a2a, 0xd97a4e, 0xa8503f, 0x8a3a34].map(paint);
        shingles(canvas, frame, (length, slope_length), (0.068, 0.074), |x, y| {
            let at = frame.at(x * length, y * slope_length, 0.0);
            let moss = smoothstep(0.62, 0.8, noise3(at * 2.6)) * (1.0 - y);
            mix(random.pick(&tones) * random.range(0.85, 1.12), paint(0x76833f), 0.7 * moss)
        });
        for x in [0.0, length] {
            let ends = (frame.at(x, 0.0, -0.01), frame.at(x, slope_length, -0.01));
            let outward = frame.x * (if x > 0.0 { 1.0 } else { -1.0 });
            canvas.board(ends, outward, (0.075, 2), |_| wood(random, 0x6b4526, 0x9a6c40));
        }
        canvas.board(
            (frame.at(0.0, 0.0, -0.01), frame.at(length, 0.0, -0.01)),
            out - Vec3::Y * 0.3,
            (0.05, 2),
            |_| wood(random, 0x5a3a20, 0x86592f),
        );
        let underside = Frame { origin: frame.at(length, 0.0, -0.03), x: -frame.x, y: frame.y, z: -frame.z };
        canvas
            .sheet(underside, (length, OVERHANG * 1.7), 0.06, |_, _| Some(wood(random, 0x5a3a20, 0x86592f)));
    }
    let ridge = (
        house.at(-HALF_LENGTH - OVERHANG, WALL + GABLE + 0.05, 0.0),
        house.at(HALF_LENGTH + OVERHANG, WALL + GABLE + 0.05, 0.0),
    );
    canvas.tube(ridge, (0.035, 0.035), 0.04, |_, _| wood(random, 0x8a3a2a, 0xc46a45));
}

/// A square shaft of bricks that stands on the frame's origin.
fn chimney(canvas: &mut Canvas, foot: Frame, random: &mut Random) {
    let (half, height) = (0.11, 0.62);
    for side in 0..4 {
        let (out, along) = match side {
            0 => (foot.z, foot.x),
            1 => (foot.x, -foot.z),
            2 => (-foot.z, -foot.x),
            _ => (-foot.x, foot.z),
        };
        let face = Frame { origin: foot.origin + out * half - along * half, x: along, y: foot.y, z: out };
        canvas.sheet(face, (2.0 * half, height), 0.05, |_, _| Some(paint(0xb8a791)));
        for row in 0..15 {
            let y = height * (row as f32 + 0.5) / 15.0;
            for brick in 0..3 {
                let x = 2.0 * half * (brick as f32 + if row % 2 == 0 { 0.25 } else { 0.7 }) / 3.0;
                let color = random.pick(&[0x9f4a35, 0xb65f45, 0x83392c, 0xa9705a].map(paint));
                canvas.add(Dab::flat(face.at(x, y, 0.012), out, along, (0.027, 0.0135), color));
            }
        }
        let cap = (face.at(-0.03, height, 0.025), face.at(2.0 * half + 0.03, height, 0.025));
        canvas.board(cap, out, (0.06, 2), |_| wood(random, 0x8d8378, 0xb5aa9b));
    }
    let top = Frame { origin: foot.at(-half, height + 0.03, half), x: foot.x, y: -foot.z, z: foot.y };
    canvas.sheet(top, (2.0 * half, 2.0 * half), 0.05, |x, y| {
        let middle = (x - half).abs().max((y - half).abs());
        Some(if middle < 0.06 { paint(0x1d1a1a) } else { paint(0x9d9286) })
    });
}

/// Ivy that climbs a wall from its lower right corner.
fn ivy(canvas: &mut Canvas, wall: &Wall, random: &mut Random) {
    for _ in 0..420 {
        let (x, y) = (wall.width * random.unit(), 1.1 * random.unit());
        let reach = 0.62 * noise2(glam::Vec2::new(y * 5.0, 3.0)) + 0.35 - 0.35 * y;
        if wall.width - x > reach || y > wall.top(x) || wall.openings.iter().any(|o| o.holds(x, y)) {
            continue;
        }
        let normal = wall.frame.z + random.cube() * 0.5;
        let color = wood(random, 0x2c6b2a, 0x86b548);
        let at = wall.frame.at(x, y, random.range(0.03, 0.06));
        canvas.add(
            Dab::flat(at, normal, random.direction(), (0.024, 0.017), color)
                .lit_as(wall.frame.z + Vec3::Y * 0.3, 0.3),
        );
    }
}

/// The cottage's frame: x along the ridge, z out of the front door.
fn cottage() -> Frame {
    let (place, front) = terrain::HOUSE;
    Frame::upright(terrain::ground(place) - Vec3::Y * 0.02, Vec3::new(front.x, 0.0, front.y))
}

/// The whole cottage.
pub fn paint_house(canvas: &mut Canvas) {
    let mut random = Random::new(21);
    let house = cottage();
    let front_openings = [door(0.85), window(0.42, 0.33), window(1.28, 0.33)];
    let back_openings = [window(0.42, 0.33), window(0.85, 0.33), window(1.28, 0.33)];
    let gable_openings = [window(0.6, 0.33), window(0.6, 0.98)];
    let sides = [
        (house.z, house.x, HALF_LENGTH, HALF_DEPTH, 0.0, &front_openings[..]),
        (-house.z, -house.x, HALF_LENGTH, HALF_DEPTH, 0.0, &back_openings[..]),
        (house.x, -house.z, HALF_DEPTH, HALF_LENGTH, GABLE, &gable_openings[..]),
        (-house.x, house.z, HALF_DEPTH, HALF_LENGTH, GABLE, &gable_openings[..]),
    ];
    for (index, (out, along, half_width, distance, gable, openings)) in sides.into_iter().enumerate() {
        let frame = Frame {
            origin: house.origin + out * distance - along * half_width,
            x: along,
            y: Vec3::Y,
            z: out,
        };
        let wall = Wall { frame, width: 2.0 * half_width, gable, openings };
        plaster(canvas, &wall, &mut random);
        stones(canvas, &wall, &mut random);
        timbers(canvas, &wall, &mut random);
        for opening in openings {
            if opening.is_door {
                hang_door(canvas, &wall, opening, &mut random);
            } else {
                glaze(canvas, &wall, opening, &mut random);
            }
        }
        if index == 1 || index == 2 {
            ivy(canvas, &wall, &mut random);
        }
    }
    roof(canvas, house, &mut random);
    chimney(canvas, house.moved(0.45, WALL + 0.42, -0.2), &mut random);
}

/// The top of the chimney, from which smoke rises.
pub fn chimney_top() -> Vec3 {
    cottage().at(0.45, WALL + 0.42 + 0.66, -0.2)
}
