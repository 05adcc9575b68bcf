//! Ink on paper: bamboo before mountains in mist. Washes stain the paper wet in wet, a loaded brush that runs
//! dry draws the bamboo, and a red seal signs it.

use glam::{Vec2, Vec3, vec2};

use crate::canvas::{Canvas, Touch, WHOLE, around, rgb, smoothstep};
use crate::noise::{Noise, Random, direction};
use crate::shapes::{curve, points, segment};

const NOISE: Noise = Noise(66);

/// Paints the bamboo.
pub fn paint() -> Canvas {
    let mut canvas = Canvas::new(rgb(0xece8de));
    let mut random = Random::new(6);
    canvas.change(WHOLE, |p, paper| {
        let fiber = 0.025 * NOISE.fractal(p / vec2(22.0, 3.0), 3)
            + 0.02 * NOISE.fractal(p / vec2(3.0, 15.0) + 50.0, 2);
        paper * (1.0 + fiber - 0.05 * NOISE.fractal(p / 150.0, 2).max(0.0))
    });
    moon(&mut canvas);
    for (seed, base, height, ink, fade) in
        [(1, 250.0, 90.0, 0.34, 110.0), (2, 300.0, 130.0, 0.55, 120.0), (3, 392.0, 120.0, 0.86, 110.0)]
    {
        mountain(&mut canvas, &mut random, seed, base, height, ink, fade);
    }
    reflections(&mut canvas, &mut random);
    for (foot, top, width, ink) in
        [(402.0, 470.0, 7.0, 0.32), (455.0, 398.0, 15.0, 0.88), (352.0, 372.0, 10.0, 0.62)]
    {
        stalk(&mut canvas, &mut random, vec2(foot, 540.0), vec2(top, -20.0), width, ink);
    }
    seal(&mut canvas);
    canvas
}

/// A color stained by ink. `density` 1 leaves almost black, slightly warm.
fn stain(color: Vec3, density: f32) -> Vec3 {
    let absorb = Vec3::new(2.9, 2.85, 2.65) * density.max(0.0);
    color * Vec3::new(libm::expf(-absorb.x), libm::expf(-absorb.y), libm::expf(-absorb.z))
}

fn moon(canvas: &mut Canvas) {
    let center = vec2(150.0, 104.0);
    canvas.change(around(center, 190.0), |p, color| {
        let d = p.distance(center) + 2.0 * NOISE.at(p / 24.0);
        let halo = smoothstep(46.0, 49.0, d) * smoothstep(170.0, 60.0, d);
        stain(color, 0.20 * halo * (1.0 + 0.6 * NOISE.fractal(p / 60.0, 3)))
    });
}

/// A mountain ridge. Its ink fades into mist below, and texture strokes run down its slopes.
fn mountain(
    canvas: &mut Canvas,
    random: &mut Random,
    seed: u64,
    base: f32,
    height: f32,
    ink: f32,
    fade: f32,
) {
    let noise = Noise(600 + seed * 7);
    let ridge = |x: f32| {
        let shape = noise.line(x / 120.0) * 0.6
            + noise.line(x / 47.0 + 40.0) * 0.42
            + noise.line(x / 17.0 + 9.0) * 0.14
            + noise.line(x / 6.0) * 0.04;
        base - height * shape - 0.25 * height * smoothstep(330.0, 40.0, x)
    };
    canvas.change(WHOLE, |p, color| {
        let bleed = 5.0 * NOISE.fractal(p / 9.0, 2);
        let depth = p.y - ridge(p.x);
        let edge = smoothstep(-1.5, 1.0 + bleed.abs() * 0.6, depth);
        let mist = libm::expf(-depth.max(0.0) / fade * (1.6 + NOISE.at(p / 70.0)));
        let pool = 0.35 * smoothstep(12.0, 1.0, depth);
        let mottled = 1.0 + 0.55 * noise.fractal(p / vec2(26.0, 40.0), 4);
        stain(color, ink * edge * (mist * mottled + pool * 0.7) * 0.75)
    });
    for _ in 0..(240.0 * ink) as usize {
        let x = random.range(-10.0, 520.0);
        let slope = ridge(x + 7.0) - ridge(x - 7.0);
        let start = vec2(x, ridge(x) + random.range(2.0, fade * 0.75) * random.unit());
        let lean = if slope > 0.0 { 0.9 } else { 2.3 };
        let end = start + direction(lean + 0.35 * random.bell()) * random.range(10.0, 34.0);
        let middle = start.lerp(end, 0.5) + random.offset() * 4.0;
        let fainter = libm::expf(-(start.y - ridge(x)) / fade * 1.2);
        brush(canvas, random.bits(), &curve(&[start, middle, end], 4), (0.5, 2.6), ink * 0.8 * fainter, 0.75);
    }
}

/// A brush stroke of two widths, at its ends and in its middle. `ink` is its density, and `dry` the dryness of
/// the brush (0..1).
fn brush(canvas: &mut Canvas, seed: u32, path: &[Vec2], (ends, middle): (f32, f32), ink: f32, dry: f32) {
    let hairs = Noise(seed as u64);
    let radius = |t: f32| ends + (middle - ends) * libm::sinf(3.1 * t.max(0.02)).max(0.0);
    canvas.stroke(path, radius, |c| {
        let hair = hairs.at(vec2(c.across * middle * 0.8 + 20.0, c.arc * 0.035)) + 0.5 * NOISE.at(c.at / 2.2);
        let skip = smoothstep(0.25, -0.35, hair + 0.9 - 1.25 * dry * (0.35 + c.along));
        let rim = 0.25 * c.across * c.across;
        Touch { color: stain(c.ground, ink * (0.85 + 0.3 * hair + rim)), opacity: 1.0 - skip, height: 0.0 }
    });
}

fn reflections(canvas: &mut Canvas, random: &mut Random) {
    for _ in 0..26 {
        let at = vec2(random.range(-20.0, 330.0), random.range(448.0, 505.0));
        let end = at + vec2(random.range(30.0, 120.0), random.range(-2.0, 2.0));
        brush(canvas, random.bits(), &[at, end], (0.6, 2.2), random.range(0.15, 0.5), 0.95);
    }
    let hull = curve(&points([(120.0, 462.0), (136.0, 472.0), (168.0, 473.0), (188.0, 460.0)]), 5);
    brush(canvas, random.bits(), &hull, (1.0, 4.2), 1.1, 0.2);
    brush(canvas, random.bits(), &[vec2(150.0, 466.0), vec2(153.0, 444.0)], (2.0, 3.4), 1.0, 0.2);
    brush(canvas, random.bits(), &[vec2(142.0, 446.0), vec2(163.0, 444.0)], (0.8, 2.6), 1.1, 0.2);
    brush(canvas, random.bits(), &[vec2(160.0, 436.0), vec2(128.0, 486.0)], (0.7, 0.9), 1.0, 0.2);
}

/// A bamboo stalk: segments with dark joints, and their twigs and leaves.
fn stalk(canvas: &mut Canvas, random: &mut Random, foot: Vec2, top: Vec2, width: f32, ink: f32) {
    let mut from = foot;
    while from.y > top.y {
        let t = (foot.y - from.y) / (foot.y - top.y);
        let next = foot.lerp(top, (t + random.range(0.13, 0.19)).min(1.02)) + vec2(2.5 * random.bell(), 0.0);
        let half = width * (1.0 - 0.25 * t);
        let hairs = Noise(random.bits() as u64);
        let up = (next - from).normalize_or(Vec2::NEG_Y);
        canvas.stroke(
            &[from + up * (half + 1.5), next - up * (half * 0.6)],
            |a| half * (0.94 + 0.12 * (2.0 * a - 1.0) * (2.0 * a - 1.0)),
            |c| {
                let hair = hairs.at(vec2(c.across * half * 0.55 + 30.0, c.arc * 0.012))
                    + 0.35 * NOISE.at(c.at / 2.5);
                let round = 0.30 + 0.70 * smoothstep(-0.7, 0.95, c.across * c.across.abs() + 0.5 * hair);
                let joint = 0.5 * smoothstep(0.12, 0.0, c.along.min(1.0 - c.along));
                let skip = smoothstep(0.30, 0.62, hair * (0.4 + c.along));
                Touch {
                    color: stain(c.ground, ink * (round + joint)),
                    opacity: 1.0 - 0.9 * skip,
                    height: 0.0,
                }
            },
        );
        let ring = [next + vec2(-half - 2.0, 2.0), next + vec2(0.0, -2.5), next + vec2(half + 2.0, 2.5)];
        brush(canvas, random.bits(), &curve(&ring, 4), (1.0, 2.2), ink * 1.3, 0.1);
        if t < 0.9 {
            twig(canvas, random, next, half, ink);
        }
        from = next;
    }
}

fn twig(canvas: &mut Canvas, random: &mut Random, from: Vec2, half: f32, ink: f32) {
    let side = if random.chance(0.62) { -1.0 } else { 1.0 };
    let reach = random.range(50.0, 120.0);
    let tip = from + vec2(side * reach, -random.range(10.0, 46.0));
    let path = curve(&[from + vec2(side * half, 0.0), from.lerp(tip, 0.5) + vec2(0.0, -8.0), tip], 6);
    brush(canvas, random.bits(), &path, (1.3, 0.9), ink, 0.3);
    for k in 0..3 {
        let bud = path[(path.len() - 1) * (k + 1) / 3];
        let fall = if side < 0.0 { 2.35 } else { 0.8 };
        for _ in 0..2 + random.bits() as usize % 3 {
            let toward = direction(fall + 0.75 * random.bell());
            let long = random.range(34.0, 74.0);
            let bend = toward.perp() * random.range(-7.0, 7.0);
            let leaf = curve(&[bud, bud + toward * long * 0.5 + bend, bud + toward * long], 5);
            let dark = ink * random.range(0.6, 1.45);
            brush(canvas, random.bits(), &leaf, (0.4, random.range(3.6, 6.4)), dark, random.range(0.2, 0.75));
        }
    }
}

/// The painter's seal, cut in stone.
fn seal(canvas: &mut Canvas) {
    let corner = vec2(30.0, 446.0);
    canvas.change((corner - 4.0, corner + 50.0), |p, color| {
        let q = p - corner - 22.0;
        let worn = 1.6 * NOISE.fractal(p / 5.0, 2);
        let inside = smoothstep(1.0, -0.5, q.abs().max_element() - 20.0 + worn);
        let marks: [[(f32, f32); 2]; 8] = [
            [(-13.0, -12.0), (-2.0, -12.0)],
            [(-8.0, -15.0), (-8.0, 13.0)],
            [(-13.0, -2.0), (-2.0, -2.0)],
            [(-13.0, 13.0), (-2.0, 13.0)],
            [(4.0, -14.0), (13.0, -14.0)],
            [(4.0, -14.0), (4.0, 0.0)],
            [(4.0, 0.0), (13.0, 0.0)],
            [(13.0, 0.0), (7.0, 14.0)],
        ];
        let cut =
            marks.iter().map(|m| segment(q, Vec2::from(m[0]), Vec2::from(m[1]))).fold(f32::MAX, f32::min);
        let carved = smoothstep(0.9, 2.0, cut + 0.4 * worn);
        color.lerp(rgb(0xc22a1c), inside * carved * (0.92 - 0.3 * NOISE.at(p / 3.0).max(0.0)))
    });
}
