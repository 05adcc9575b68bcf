//! Pop art: a weeping eye and a burst, in four inks. Tones are dot screens, and every shape has a thick black
//! contour.

use glam::{Vec2, Vec3, vec2};

use crate::canvas::{Canvas, rgb};
use crate::noise::direction;
use crate::shapes::{Outline, along_segment, curve, ellipse, points, segment, turned};

const BLACK: u32 = 0x0b0a0c;
const WHITE: u32 = 0xfffdf4;
const RED: u32 = 0xe8182c;
const YELLOW: u32 = 0xffdc08;
const CYAN: u32 = 0x00a4e4;
const BLUE: u32 = 0x1238b0;
const BANG: Vec2 = vec2(150.0, 132.0);

/// Paints the eye and the burst.
pub fn paint() -> Canvas {
    let drawing = Drawing::new();
    let mut canvas = Canvas::new(rgb(WHITE));
    canvas.shade(|p| drawing.color(p));
    canvas
}

/// The shapes of the drawing, built once for all pixels.
struct Drawing {
    burst: Outline,
    core: Outline,
    letters: Vec<Outline>,
    face: Outline,
    nose: Outline,
    eye: Outline,
    lid: Outline,
    brow: Outline,
    tear: Outline,
    strands: Vec<Outline>,
}

/// A smooth outline through `knots`.
fn smooth<const N: usize>(knots: [(f32, f32); N]) -> Outline {
    Outline::new(curve(&points(knots), 9))
}

impl Drawing {
    fn new() -> Self {
        let left = (176.0, 352.0);
        let right = (402.0, 346.0);
        let mut eye = curve(&points([left, (214.0, 304.0), (286.0, 278.0), (354.0, 294.0), right]), 9);
        let mut lid = eye.clone();
        eye.extend(curve(&points([right, (344.0, 388.0), (276.0, 398.0), (218.0, 384.0), left]), 9));
        lid.extend(curve(
            &points([right, (398.0, 292.0), (352.0, 244.0), (284.0, 228.0), (212.0, 262.0), left]),
            9,
        ));
        let strand = |k: f32| {
            smooth([
                (262.0 + 46.0 * k, -40.0),
                (372.0 + 30.0 * k, 96.0),
                (446.0 + 24.0 * k, 290.0),
                (418.0 + 28.0 * k, 552.0),
            ])
        };
        let letters = vec![
            points([(84.0, 108.0), (124.0, 100.0), (92.0, 168.0), (134.0, 160.0)]),
            points([(140.0, 162.0), (156.0, 92.0), (182.0, 150.0)]),
            points([(148.0, 134.0), (172.0, 130.0)]),
            points([(196.0, 152.0), (188.0, 86.0), (216.0, 90.0), (218.0, 112.0), (194.0, 120.0)]),
        ];
        Self {
            burst: star(BANG, 15, 96.0, 172.0),
            core: star(BANG, 13, 66.0, 118.0),
            letters: letters.into_iter().map(Outline::new).collect(),
            face: smooth([
                (-60.0, 560.0),
                (-40.0, 380.0),
                (60.0, 270.0),
                (190.0, 196.0),
                (330.0, 130.0),
                (440.0, 160.0),
                (490.0, 320.0),
                (460.0, 560.0),
            ]),
            nose: smooth([
                (112.0, 330.0),
                (96.0, 384.0),
                (62.0, 440.0),
                (58.0, 472.0),
                (86.0, 484.0),
                (112.0, 474.0),
            ]),
            eye: Outline::new(eye),
            lid: Outline::new(lid),
            brow: smooth([(150.0, 250.0), (214.0, 206.0), (306.0, 184.0), (420.0, 232.0)]),
            tear: smooth([
                (232.0, 388.0),
                (206.0, 436.0),
                (208.0, 472.0),
                (232.0, 486.0),
                (256.0, 472.0),
                (256.0, 434.0),
                (232.0, 388.0),
            ]),
            strands: (0..8).rev().map(|k| strand(k as f32)).collect(),
        }
    }

    fn color(&self, p: Vec2) -> Vec3 {
        let mut ink = ground(p);
        // Paints a shape with a contour `line` pixels wide around it.
        let mut over = |d: f32, paint: u32, line: f32| {
            if d < line {
                ink = if d < 0.0 { paint } else { BLACK };
            }
        };
        self.face(p, &mut over);
        self.eye(p, &mut over);
        self.hair(p, &mut over);
        self.bang(p, &mut over);
        over((p.min(Vec2::splat(512.0) - p)).min_element() - 9.0, WHITE, 5.0);
        rgb(ink)
    }

    fn bang(&self, p: Vec2, over: &mut impl FnMut(f32, u32, f32)) {
        over(self.burst.closed(p - vec2(10.0, 12.0)), BLACK, 0.0);
        over(self.burst.closed(p), screen(p, 0.35, 11.0, (p.y - 20.0) / 260.0, YELLOW, RED), 6.0);
        over(self.core.closed(p), screen(p, 1.1, 10.0, (p.y - 90.0) / 240.0, WHITE, CYAN), 5.0);
        let word = |q: Vec2| self.letters.iter().map(|letter| letter.open(q)).fold(f32::MAX, f32::min) - 8.0;
        over(word(p - vec2(5.0, 6.0)), BLACK, 4.0);
        over(word(p), RED, 4.0);
    }

    fn face(&self, p: Vec2, over: &mut impl FnMut(f32, u32, f32)) {
        let shade = 0.30 + 0.35 * ((p.x - 330.0) / 150.0).clamp(0.0, 1.0);
        over(self.face.closed(p), screen(p, 0.5, 10.5, shade, 0xffe8d8, RED), 7.0);
        over(self.nose.open(p) - 3.4, BLACK, 0.0);
        let along = ((p.x - 150.0) / 270.0).clamp(0.0, 1.0);
        over(self.brow.open(p) - 13.0 * (1.0 - along * along) - 2.5, BLACK, 0.0);
        over(self.brow.open(p - vec2(-4.0, -3.0)) - 3.0 * (1.0 - along), YELLOW, 0.0);
    }

    fn eye(&self, p: Vec2, over: &mut impl FnMut(f32, u32, f32)) {
        over(self.lid.closed(p), screen(p, 0.9, 9.0, 0.5, YELLOW, CYAN), 4.5);
        let eye = self.eye.closed(p);
        over(eye, WHITE, 5.0);
        if eye < 0.0 {
            let iris = p.distance(vec2(288.0, 334.0));
            over(iris - 52.0, screen(p, 0.2, 7.5, iris / 64.0, CYAN, BLUE), 5.0);
            over(iris - 22.0, BLACK, 0.0);
            over(ellipse(p, vec2(306.0, 316.0), vec2(13.0, 10.0), Vec2::X), WHITE, 0.0);
        }
        let rim = eye.abs() - 4.0 - 0.13 * (350.0 - p.y);
        over(rim.max(p.y - 350.0), BLACK, 0.0);
        for k in 0..8 {
            let root = self.eye.points()[2 + 4 * k];
            let tip = root + direction(-2.45 + 0.28 * k as f32) * (40.0 + 4.0 * k as f32);
            over(segment(p, root, tip) - 7.5 * (1.0 - along_segment(p, root, tip)), BLACK, 0.0);
        }
        over(self.tear.closed(p), screen(p, 0.3, 7.0, (480.0 - p.y) / 110.0, WHITE, CYAN), 5.0);
        over(ellipse(p, vec2(220.0, 452.0), vec2(4.0, 13.0), direction(0.2)), WHITE, 0.0);
    }

    fn hair(&self, p: Vec2, over: &mut impl FnMut(f32, u32, f32)) {
        for (k, strand) in self.strands.iter().enumerate() {
            let middle = strand.open(p);
            let tone = if k % 3 == 1 { screen(p, 0.2, 9.5, 0.38, YELLOW, RED) } else { YELLOW };
            over(middle - 21.0, tone, 5.0);
            over(strand.open(p - vec2(-8.0, 3.0)) - 2.4 * libm::sinf(p.y * 0.013 + k as f32), BLACK, 0.0);
        }
    }
}

/// Speed rays on a dotted sky.
fn ground(p: Vec2) -> u32 {
    let q = p - BANG;
    let sector = libm::atan2f(q.y, q.x) * 28.0 / std::f32::consts::TAU;
    if (sector - sector.floor() - 0.5).abs() < 0.16 {
        return YELLOW;
    }
    screen(p, 0.78, 12.5, 0.95 - q.length() / 620.0, CYAN, BLUE)
}

/// A burst of spikes of unequal lengths.
fn star(center: Vec2, spikes: usize, inner: f32, outer: f32) -> Outline {
    let corner = |i: usize| {
        let uneven = 1.0 + 0.16 * libm::sinf(i as f32 * 2.7);
        let radius = if i.is_multiple_of(2) { inner } else { outer * uneven };
        center + direction(i as f32 * std::f32::consts::PI / spikes as f32 + 0.1) * radius * vec2(1.08, 0.86)
    };
    Outline::new((0..2 * spikes).map(corner).collect())
}

/// A dot screen: `paint` dots that cover the share `tone` (0..1) of the `paper`.
fn screen(p: Vec2, angle: f32, pitch: f32, tone: f32, paper: u32, paint: u32) -> u32 {
    let q = turned(p, direction(angle)) / pitch;
    let d = (q - q.floor() - 0.5).length();
    // A dot of radius r covers pi r^2 of its cell. From r = 0.5 on neighbors merge and cover less, so dark
    // tones get larger dots.
    let tone = tone.clamp(0.0, 1.0);
    let radius = libm::sqrtf(tone / std::f32::consts::PI) * (1.0 + 0.2 * tone);
    if d < radius { paint } else { paper }
}
