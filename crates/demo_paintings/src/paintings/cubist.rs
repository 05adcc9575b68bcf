//! Facets: a guitar, a bottle and a newspaper on a table, seen from several sides at once.
//!
//! A tree of random lines cuts the plane into facets. Each shows the still life shifted and turned, and is
//! shaded from one edge to another.

use glam::{Vec2, Vec3, vec2};

use crate::canvas::{Canvas, Touch, ramp, rgb, smoothstep};
use crate::noise::{Noise, Random, direction};
use crate::shapes::{ellipse, points, polygon, segment, turned};

const NOISE: Noise = Noise(44);
const INK: u32 = 0x17140f;

/// Paints the still life in facets.
pub fn paint() -> Canvas {
    let mut canvas = Canvas::new(rgb(0x8c7a58));
    let mut random = Random::new(40);
    let mut facets = Vec::new();
    cut(&points([(-4.0, -4.0), (516.0, -4.0), (516.0, 516.0), (-4.0, 516.0)]), &mut random, &mut facets);
    for facet in &facets {
        plane(&mut canvas, &mut random, facet);
    }
    hatch(&mut canvas, &mut random);
    for facet in &facets {
        edges(&mut canvas, &mut random, facet);
    }
    canvas.light(0.14, 0.0);
    canvas
}

/// Cuts a convex polygon by random lines until its pieces are small, and smaller toward the middle of the
/// picture.
fn cut(shape: &[Vec2], random: &mut Random, pieces: &mut Vec<Vec<Vec2>>) {
    let center = shape.iter().sum::<Vec2>() / shape.len() as f32;
    let limit = (1100.0 + 20.0 * center.distance(vec2(256.0, 256.0))) * random.range(0.7, 2.0);
    if area(shape) < limit {
        pieces.push(shape.to_vec());
        return;
    }
    // Few directions keep the planes related. Cuts run across the longest side, which avoids slivers.
    let long = (0..shape.len())
        .map(|i| shape[(i + 1) % shape.len()] - shape[i])
        .max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))
        .unwrap_or(Vec2::X);
    let mut normal = direction(random.pick(&[0.35, 1.05, 1.75, 2.5]) + 0.16 * random.bell());
    if normal.dot(long).abs() < 0.5 * long.length() {
        normal = normal.perp();
    }
    let through = center + random.offset() * 14.0;
    for side in [normal, -normal] {
        let half = clipped(shape, through, side);
        if half.len() > 2 {
            cut(&half, random, pieces);
        }
    }
}

fn area(shape: &[Vec2]) -> f32 {
    0.5 * (0..shape.len()).map(|i| shape[i].perp_dot(shape[(i + 1) % shape.len()])).sum::<f32>().abs()
}

/// The part of a convex polygon on the positive side of a line.
fn clipped(shape: &[Vec2], through: Vec2, normal: Vec2) -> Vec<Vec2> {
    let mut kept = Vec::new();
    for i in 0..shape.len() {
        let (a, b) = (shape[i], shape[(i + 1) % shape.len()]);
        let (da, db) = ((a - through).dot(normal), (b - through).dot(normal));
        if da >= 0.0 {
            kept.push(a);
        }
        if (da >= 0.0) != (db >= 0.0) {
            kept.push(a.lerp(b, da / (da - db)));
        }
    }
    kept
}

fn bounds(shape: &[Vec2]) -> (Vec2, Vec2) {
    let low = shape.iter().fold(Vec2::MAX, |a, &b| a.min(b));
    let high = shape.iter().fold(Vec2::MIN, |a, &b| a.max(b));
    (low - 1.0, high + 1.0)
}

/// Paints one facet: the still life in its own shift, turn and zoom, with light from one side.
fn plane(canvas: &mut Canvas, random: &mut Random, facet: &[Vec2]) {
    let (low, high) = bounds(facet);
    let center = facet.iter().sum::<Vec2>() / facet.len() as f32;
    let shift = random.offset() * 24.0;
    let axis = direction(0.34 * random.bell());
    let zoom = 1.0 + 0.3 * random.bell();
    let light = direction(random.pick(&[0.5, 1.2, 2.2, 3.9]) + 0.3 * random.bell());
    let reach = 0.5 * (high - low).length();
    let tone = 1.0 + 0.34 * random.bell();
    let strength = random.range(0.45, 1.0);
    canvas.fill(
        (low, high),
        |p| polygon(p, facet) - 0.6,
        |p, _| {
            let color = still_life(turned(p - center, axis) * zoom + center + shift);
            let across = (p - center).dot(light) / reach;
            let shaded = color * (tone - strength * across).clamp(0.22, 1.7);
            shaded.lerp(rgb(0xe6d3a4), 0.62 * smoothstep(0.1, 0.8, -across) * strength)
        },
    );
}

/// Draws some of a facet's edges. Across the others planes pass into each other.
fn edges(canvas: &mut Canvas, random: &mut Random, facet: &[Vec2]) {
    for i in 0..facet.len() {
        let (a, b) = (facet[i], facet[(i + 1) % facet.len()]);
        if a.distance(b) < 14.0 || random.chance(0.45) {
            continue;
        }
        let (color, width) =
            if random.chance(0.8) { (rgb(INK), random.range(0.9, 2.6)) } else { (rgb(0xe8e0c8), 1.6) };
        let hairs = Noise(random.bits() as u64);
        canvas.stroke(
            &[a, b],
            |t| width * (1.1 - 0.8 * t),
            |c| Touch { color, opacity: 0.95 + 0.3 * hairs.line(c.arc / 24.0) - 0.5 * c.along, height: 0.6 },
        );
    }
}

/// Short parallel dabs over everything: the touch of the brush.
fn hatch(canvas: &mut Canvas, random: &mut Random) {
    for at in random.scatter(512.0, 4.0, 8.5) {
        let lean = 0.9 * NOISE.at(at / 130.0) + if NOISE.at(at / 70.0 + 9.0) > 0.0 { 0.35 } else { 1.9 };
        let reach = direction(lean) * random.range(4.0, 9.0);
        let shift = 0.12 * random.bell();
        let hairs = Noise(random.bits() as u64);
        canvas.stroke(
            &[at - reach, at + reach],
            |_| 3.1,
            |c| Touch {
                color: c.ground * (1.0 + shift + 0.10 * hairs.line(c.across * 3.0 + 9.0)),
                opacity: 1.0,
                height: 0.8 + 0.8 * hairs.line(c.across * 3.0 + 9.0),
            },
        );
    }
}

/// The still life before it is cut, painted back to front.
fn still_life(p: Vec2) -> Vec3 {
    let mut color = ramp(&[0x77848c, 0xb4b09c, 0xcdb98c, 0xa08a60], p.y / 420.0 + 0.3 * NOISE.at(p / 90.0));
    let mut over = |d: f32, paint: Vec3, line: f32| {
        color = color.lerp(paint, smoothstep(1.0, -1.0, d));
        color = color.lerp(rgb(INK), line * smoothstep(2.6, 1.0, d.abs()));
    };
    over(
        400.0 - p.y + 0.12 * p.x - 40.0,
        ramp(&[0x5a3a1c, 0x8a5a28, 0xb98a48], 0.5 + 0.8 * NOISE.at(p / vec2(70.0, 7.0))),
        0.9,
    );
    let sheet = polygon(p, &points([(40.0, 300.0), (210.0, 268.0), (246.0, 404.0), (66.0, 440.0)]));
    over(sheet, newsprint(p), 0.8);
    over(
        polygon(p, &points([(360.0, 40.0), (500.0, 70.0), (480.0, 300.0), (350.0, 280.0)])),
        ramp(&[0x49606e, 0x27343f], (p.y - 40.0) / 260.0),
        0.6,
    );
    let bottle = segment(p, vec2(120.0, 200.0), vec2(120.0, 330.0)) - 40.0;
    let neck = segment(p, vec2(120.0, 84.0), vec2(120.0, 180.0)) - 14.0;
    over(bottle.min(neck), ramp(&[0x1f3a34, 0x5f8478, 0x26443c, 0x15241f], (p.x - 80.0) / 80.0), 1.0);
    over(segment(p, vec2(98.0, 262.0), vec2(142.0, 262.0)) - 24.0, rgb(0xcdbf98), 0.7);
    guitar(p, &mut over);
    let glass = polygon(p, &points([(384.0, 330.0), (452.0, 330.0), (436.0, 440.0), (400.0, 440.0)]));
    over(glass, ramp(&[0xd8dcd4, 0x7f949c, 0xc4ccc6], (p.x - 384.0) / 66.0), 1.0);
    over(ellipse(p, vec2(418.0, 330.0), vec2(34.0, 9.0), Vec2::X), rgb(0x8c2f1c), 1.0);
    color
}

fn guitar(p: Vec2, over: &mut impl FnMut(f32, Vec3, f32)) {
    let axis = direction(-0.95);
    let q = turned(p - vec2(262.0, 330.0), axis);
    let blend = |a: f32, b: f32| {
        let h = (0.5 + 0.5 * (b - a) / 26.0).clamp(0.0, 1.0);
        b + (a - b) * h - 26.0 * h * (1.0 - h)
    };
    let body = blend(q.distance(vec2(-26.0, 0.0)) - 88.0, q.distance(vec2(92.0, 0.0)) - 62.0);
    let wood = ramp(
        &[0x7a3d12, 0xb4681e, 0xd9973a, 0xe8b860],
        0.55 - q.y / 170.0 + 0.3 * NOISE.at(vec2(q.x / 90.0, q.y / 7.0)),
    );
    over(body, wood, 1.0);
    over((body + 9.0).abs() - 1.6, rgb(0x3a1c0c), 0.0);
    over(q.distance(vec2(48.0, 0.0)) - 31.0, rgb(0xd8c8a0), 0.8);
    over(q.distance(vec2(48.0, 0.0)) - 25.0, rgb(0x120d0a), 0.0);
    over(segment(q, vec2(80.0, 0.0), vec2(290.0, 0.0)) - 13.0, rgb(0x33201a), 0.9);
    over(segment(q, vec2(292.0, 0.0), vec2(332.0, 0.0)) - 20.0, rgb(0x6a3d1c), 0.9);
    over(segment(q, vec2(-56.0, -26.0), vec2(-56.0, 26.0)) - 6.0, rgb(0x23130c), 0.5);
    for k in -2..=2 {
        let y = k as f32 * 4.6;
        over(segment(q, vec2(-56.0, y), vec2(320.0, y)) - 0.7, rgb(0xf0e4c4), 0.0);
    }
}

/// Columns of illegible type.
fn newsprint(p: Vec2) -> Vec3 {
    let q = turned(p, direction(-0.185));
    let row = (q.y / 8.0).floor();
    let word = NOISE.line(q.x / 5.0 + row * 17.3) > -0.25 && (q.x / 60.0 - (q.x / 60.0).floor()) > 0.1;
    let inked = q.y / 8.0 - row < 0.5 && word;
    if inked { rgb(0x3a372f) } else { rgb(0xdcd3b8) }
}
