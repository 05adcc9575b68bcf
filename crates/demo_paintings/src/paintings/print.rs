//! A woodblock print: a breaking wave before a mountain and a red sun, in flat inks and graded bands with
//! carved outlines and the grain of the block.

use glam::{Vec2, Vec3, vec2};

use crate::canvas::{Canvas, WHOLE, around, ramp, rgb, smoothstep};
use crate::noise::{Noise, Random};
use crate::shapes::{curve, points, polygon, polyline};

const NOISE: Noise = Noise(33);
const PAPER: u32 = 0xf3e3c0;
const INDIGO: u32 = 0x14254f;
const BLUE: u32 = 0x2d5f93;
const PALE: u32 = 0x9fc0c0;
const RED: u32 = 0xd8402a;

/// Prints the wave.
pub fn paint() -> Canvas {
    let mut canvas = Canvas::new(rgb(PAPER));
    sky(&mut canvas);
    mountain(&mut canvas);
    swell(&mut canvas, 352.0, 16.0, 130.0, 0.4);
    breaker(&mut canvas);
    swell(&mut canvas, 428.0, 22.0, 210.0, 3.6);
    swell(&mut canvas, 474.0, 18.0, 160.0, 1.0);
    grain(&mut canvas);
    canvas
}

fn sky(canvas: &mut Canvas) {
    canvas.shade(|p| {
        let band = ramp(&[0xc8402c, 0xe8884a, 0xf4cf90, PAPER, PAPER], p.y / 250.0);
        band.lerp(rgb(0xf0b98a), smoothstep(300.0, 350.0, p.y) * 0.6)
    });
    let sun = vec2(392.0, 142.0);
    canvas.fill(
        around(sun, 62.0),
        |p| p.distance(sun) - 58.0,
        |p, _| ramp(&[0xc42a1e, RED, 0xe8603a], (p.y - 84.0) / 116.0),
    );
    for (y, x0, x1, half) in [
        (188.0, 290.0, 540.0, 9.0),
        (164.0, 356.0, 470.0, 7.0),
        (120.0, 424.0, 560.0, 6.0),
        (214.0, 250.0, 400.0, 7.0),
    ] {
        let (a, b) = (vec2(x0, y), vec2(x1, y));
        outlined(canvas, (a - 14.0, b + 14.0), |p| polyline(p, &[a, b]) - half, |_, _| rgb(0xf8ecd0), 1.4);
    }
}

fn mountain(canvas: &mut Canvas) {
    let slope = |p: Vec2| {
        let run = (p.x - 378.0).abs();
        let top =
            214.0 + 146.0 * (1.0 - libm::expf(-run / 105.0)) + 0.12 * run - 8.0 * libm::expf(-run / 12.0);
        (top - p.y) * 0.7
    };
    outlined(
        canvas,
        (vec2(120.0, 190.0), vec2(512.0, 400.0)),
        slope,
        |p, _| {
            let tooth = 11.0 * libm::sinf(p.x * 0.33) + 9.0 * NOISE.line(p.x / 9.0);
            if p.y < 262.0 + tooth {
                rgb(0xfaf0d8)
            } else {
                ramp(&[INDIGO, BLUE, 0x7fa6a8, PAPER], (p.y - 262.0) / 110.0)
            }
        },
        2.0,
    );
}

/// Fills a shape and draws its outline, `width` pixels wide, inside its edge.
fn outlined(
    canvas: &mut Canvas,
    bounds: (Vec2, Vec2),
    distance: impl Fn(Vec2) -> f32,
    color: impl Fn(Vec2, f32) -> Vec3,
    width: f32,
) {
    canvas.fill(bounds, &distance, color);
    let line = |p: Vec2| {
        let uneven = width * (0.8 + 0.45 * NOISE.at(p / 17.0));
        (distance(p) + 0.5 * uneven).abs() - 0.5 * uneven
    };
    canvas.fill(bounds, line, |_, _| rgb(INDIGO));
}

/// The great wave. Its back rises from the left, and its lip curls over to the right.
fn breaker(canvas: &mut Canvas) {
    let back = curve(
        &points([(-30.0, 190.0), (40.0, 150.0), (110.0, 92.0), (190.0, 66.0), (262.0, 96.0), (296.0, 160.0)]),
        10,
    );
    let face = curve(
        &points([
            (296.0, 160.0),
            (262.0, 150.0),
            (222.0, 160.0),
            (192.0, 200.0),
            (186.0, 262.0),
            (214.0, 326.0),
            (278.0, 372.0),
            (372.0, 392.0),
            (540.0, 372.0),
        ]),
        10,
    );
    let mut body = back.clone();
    body.extend(&face);
    body.extend(points([(540.0, 540.0), (-30.0, 540.0)]));
    let lip = curve(
        &points([
            (-40.0, 215.0),
            (40.0, 186.0),
            (104.0, 140.0),
            (176.0, 112.0),
            (232.0, 124.0),
            (262.0, 150.0),
        ]),
        8,
    );
    outlined(
        canvas,
        WHOLE,
        |p| polygon(p, &body),
        |p, _| {
            let depth = polyline(p, &face);
            let taper = 0.5 + 0.5 * smoothstep(120.0, 380.0, p.y);
            let stripe = libm::sinf(depth * 0.2 / taper + 1.5 * NOISE.at(p / 90.0));
            if stripe > 0.25 {
                ramp(&[PALE, 0x7fa6b8, BLUE], depth / 170.0)
            } else {
                ramp(&[BLUE, 0x24477c, INDIGO], depth / 190.0)
            }
        },
        3.0,
    );
    foam(canvas, &back, &lip);
}

/// Foam: clustered scallops along the wave's lip, larger toward its tip, with fingers and spray before it.
fn foam(canvas: &mut Canvas, back: &[Vec2], lip: &[Vec2]) {
    let mut random = Random::new(3);
    let mut blobs = Vec::new();
    for (i, &outer) in back.iter().enumerate() {
        let inner = lip[i * (lip.len() - 1) / (back.len() - 1)];
        let tip = i as f32 / back.len() as f32;
        for k in 0..3 {
            let at = outer.lerp(inner, (k as f32 + random.unit()) / 3.0 * (0.4 + 0.6 * tip));
            blobs.push((at + random.offset() * 4.0, random.range(5.0, 9.0) + 6.0 * tip));
        }
    }
    for i in 0..26 {
        let t = i as f32 / 25.0;
        let finger = vec2(300.0 - 96.0 * t, 168.0 + 6.0 * libm::sinf(i as f32 * 2.4) + 40.0 * t * t);
        blobs.push((finger + random.offset() * 7.0, random.range(4.0, 10.0) * (1.1 - 0.5 * t)));
    }
    for &(at, radius) in &blobs {
        outlined(
            canvas,
            around(at, radius + 2.0),
            |p| p.distance(at) - radius,
            |p, _| {
                if (p - at).dot(vec2(0.5, 0.85)) > radius * 0.45 { rgb(0xc4d8d0) } else { rgb(0xfbf2dc) }
            },
            1.8,
        );
    }
    for _ in 0..70 {
        let at = vec2(random.range(210.0, 400.0), random.range(90.0, 300.0)) + random.offset() * 10.0;
        let radius = random.range(1.2, 3.6);
        let keep = at.distance(vec2(290.0, 180.0)) < random.range(30.0, 120.0);
        if keep {
            outlined(canvas, around(at, 6.0), |p| p.distance(at) - radius, |_, _| rgb(0xfbf2dc), 0.9);
        }
    }
}

/// A row of rolling waves, combed by lines parallel to their crests.
fn swell(canvas: &mut Canvas, level: f32, height: f32, length: f32, phase: f32) {
    let crest = |x: f32| {
        let t = ((x / length + phase) - (x / length + phase).floor()) * 2.0 - 1.0;
        level - height * (1.0 - t.abs() * (1.6 - 0.6 * t.abs())) - 4.0 * libm::sinf(x * 0.02 + phase)
    };
    let bounds = (vec2(0.0, level - height - 16.0), vec2(512.0, 512.0));
    outlined(
        canvas,
        bounds,
        |p| (crest(p.x) - p.y) * 0.85,
        |p, _| {
            let depth = p.y - crest(p.x);
            if depth < 9.0 + 3.0 * libm::sinf(p.x * 0.35) {
                return rgb(0xfbf2dc);
            }
            let comb = libm::sinf(depth * 0.42 + libm::sinf(p.x * 0.03) * 1.2);
            if comb > 0.45 { rgb(PALE) } else { ramp(&[BLUE, INDIGO], depth / 70.0) }
        },
        2.4,
    );
}

/// Uneven ink: streaks along the grain, speckle, and a paper margin's warmth.
fn grain(canvas: &mut Canvas) {
    canvas.change(WHOLE, |p, color| {
        let rings = libm::sinf(p.y * 0.55 + 9.0 * NOISE.at(p / vec2(260.0, 60.0)));
        let streak = 0.020 * rings + 0.035 * Noise(34).at(p / vec2(60.0, 1.6));
        let speckle = smoothstep(0.55, 0.95, Noise(35).fractal(p / 3.2, 2)) * 0.16;
        color.lerp(rgb(PAPER), speckle) * (1.0 + streak)
    });
}
