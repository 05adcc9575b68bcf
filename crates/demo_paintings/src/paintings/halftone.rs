//! Pop art: a weeping eye, a bolt and a burst, in four inks. Tones are dot screens, every shape has a thick
//! black contour.

use glam::{Vec2, Vec3, vec2};

use crate::canvas::{Canvas, rgb};
use crate::noise::direction;
use crate::shapes::{curve, ellipse, points, polygon, polyline, turned};

const BLACK: u32 = 0x0b0a0c;
const WHITE: u32 = 0xfffdf4;
const RED: u32 = 0xe8182c;
const YELLOW: u32 = 0xffdc08;
const CYAN: u32 = 0x00a4e4;
const BLUE: u32 = 0x1238b0;

/// The shapes, built once.
struct Drawing {
    burst: Vec<Vec2>,
    core: Vec<Vec2>,
    face: Vec<Vec2>,
    lid: Vec<Vec2>,
    eye: Vec<Vec2>,
    brow: Vec<Vec2>,
    tear: Vec<Vec2>,
    strands: Vec<Vec<Vec2>>,
    letters: Vec<Vec<Vec2>>,
}

pub fn paint() -> Canvas {
    let drawing = Drawing::new();
    let mut canvas = Canvas::new(rgb(WHITE));
    canvas.shade(|p| drawing.color(p));
    canvas
}

impl Drawing {
    fn new() -> Self {
        let upper = curve(
            &points([(176.0, 352.0), (218.0, 300.0), (286.0, 276.0), (352.0, 296.0), (402.0, 352.0)]),
            10,
        );
        let lower = curve(
            &points([(402.0, 352.0), (344.0, 388.0), (276.0, 396.0), (218.0, 382.0), (176.0, 352.0)]),
            10,
        );
        let mut eye = upper.clone();
        eye.extend(lower);
        let hair = |k: f32| {
            points([
                (330.0 + 26.0 * k, 120.0 - 8.0 * k),
                (408.0 + 24.0 * k, 196.0),
                (452.0 + 20.0 * k, 320.0 + 8.0 * k),
                (418.0 + 24.0 * k, 540.0),
            ])
        };
        Self {
            burst: star(vec2(150.0, 132.0), 15, 96.0, 172.0),
            core: star(vec2(150.0, 132.0), 13, 66.0, 118.0),
            face: curve(
                &points([
                    (20.0, 540.0),
                    (60.0, 380.0),
                    (120.0, 268.0),
                    (220.0, 190.0),
                    (330.0, 150.0),
                    (430.0, 180.0),
                    (470.0, 320.0),
                    (440.0, 540.0),
                ]),
                8,
            ),
            lid: curve(
                &points([(180.0, 318.0), (226.0, 268.0), (290.0, 246.0), (356.0, 266.0), (404.0, 318.0)]),
                10,
            ),
            eye,
            brow: curve(&points([(168.0, 262.0), (230.0, 214.0), (310.0, 200.0), (398.0, 238.0)]), 8),
            tear: curve(
                &points([
                    (214.0, 384.0),
                    (190.0, 430.0),
                    (190.0, 462.0),
                    (212.0, 476.0),
                    (234.0, 462.0),
                    (234.0, 428.0),
                    (214.0, 384.0),
                ]),
                6,
            ),
            strands: (0..7).map(|k| curve(&hair(k as f32), 8)).collect(),
            letters: vec![
                points([(84.0, 108.0), (124.0, 100.0), (92.0, 168.0), (134.0, 160.0)]),
                points([(140.0, 162.0), (156.0, 92.0), (182.0, 150.0)]),
                points([(148.0, 134.0), (172.0, 130.0)]),
                points([(196.0, 152.0), (188.0, 86.0), (216.0, 90.0), (218.0, 112.0), (194.0, 120.0)]),
            ],
        }
    }

    fn color(&self, p: Vec2) -> Vec3 {
        let mut color = self.ground(p);
        let mut over = |d: f32, paint: u32, line: f32| {
            if d < line {
                color = rgb(if d < 0.0 { paint } else { BLACK });
            }
        };
        self.portrait(p, &mut over);
        over(polygon(p - vec2(10.0, 12.0), &self.burst), BLACK, 0.0);
        over(polygon(p, &self.burst), screen(p, 0.35, 9.0, (p.y - 20.0) / 260.0, YELLOW, RED), 6.0);
        over(polygon(p, &self.core), screen(p, 1.1, 8.0, (p.y - 90.0) / 240.0, WHITE, CYAN), 5.0);
        let word = |q: Vec2| self.letters.iter().map(|l| polyline(q, l)).fold(f32::MAX, f32::min) - 8.0;
        over(word(p - vec2(5.0, 6.0)), BLACK, 4.0);
        over(word(p), RED, 4.0);
        let inset = (p.min(Vec2::splat(512.0) - p)).min_element();
        over(inset - 9.0, WHITE, 5.0);
        color
    }

    /// Speed rays on a dotted sky.
    fn ground(&self, p: Vec2) -> Vec3 {
        let q = p - vec2(150.0, 132.0);
        let sector = libm::atan2f(q.y, q.x) * 28.0 / std::f32::consts::TAU;
        let ray = (sector - sector.floor() - 0.5).abs() < 0.16;
        if ray {
            return rgb(YELLOW);
        }
        rgb(screen(p, 0.78, 11.0, 0.95 - q.length() / 620.0, CYAN, BLUE))
    }

    fn portrait(&self, p: Vec2, over: &mut impl FnMut(f32, u32, f32)) {
        over(polygon(p, &self.face), screen(p, 0.5, 8.0, 0.34, 0xffe8d8, RED), 7.0);
        for (k, strand) in self.strands.iter().enumerate() {
            let t = ((p.y - 110.0) / 400.0).clamp(0.0, 1.0);
            let half = 24.0 * (0.35 + libm::sinf(2.4 * t));
            over(polyline(p, strand) - half, if k % 2 == 0 { YELLOW } else { 0xf8b400 }, 5.0);
            over(polyline(p - vec2(-7.0, 0.0), strand) - 2.2 * (1.0 - t), BLACK, 0.0);
        }
        over(polyline(p, &self.lid) - 2.5 - 2.5 * ((p.x - 180.0) / 220.0).clamp(0.0, 1.0), BLACK, 0.0);
        let along = ((p.x - 168.0) / 230.0).clamp(0.0, 1.0);
        over(polyline(p, &self.brow) - 12.0 * (1.0 - along * along) - 3.0, BLACK, 0.0);
        let eye = polygon(p, &self.eye);
        over(eye, WHITE, 5.0);
        if eye < 0.0 {
            let iris = p.distance(vec2(290.0, 334.0));
            over(iris - 50.0, screen(p, 0.2, 6.0, iris / 64.0, CYAN, BLUE), 5.0);
            over(iris - 22.0, BLACK, 0.0);
            over(ellipse(p, vec2(306.0, 316.0), vec2(13.0, 10.0), Vec2::X), WHITE, 0.0);
        }
        let upper = (352.0 - p.y).max(0.0);
        let lashes = (eye.abs() - 4.0 - 0.10 * upper).max(p.y - 352.0);
        over(lashes, BLACK, 0.0);
        for k in 0..7 {
            let root = self.eye[4 + 5 * k + 2];
            let tip = root + direction(-2.3 + 0.29 * k as f32) * (22.0 + 3.0 * k as f32);
            let t = crate::shapes::along_segment(p, root, tip);
            over(crate::shapes::segment(p, root, tip) - 5.0 * (1.0 - t), BLACK, 0.0);
        }
        over(polygon(p, &self.tear), screen(p, 0.3, 7.0, (470.0 - p.y) / 110.0, WHITE, CYAN), 5.0);
        over(ellipse(p, vec2(204.0, 446.0), vec2(4.0, 13.0), direction(0.2)), WHITE, 0.0);
    }
}

/// A burst of spikes of unequal lengths.
fn star(center: Vec2, spikes: usize, inner: f32, outer: f32) -> Vec<Vec2> {
    (0..2 * spikes)
        .map(|i| {
            let uneven = 1.0 + 0.16 * libm::sinf(i as f32 * 2.7);
            let radius = if i % 2 == 0 { inner } else { outer * uneven };
            center
                + direction(i as f32 * std::f32::consts::PI / spikes as f32 + 0.1) * radius * vec2(1.08, 0.86)
        })
        .collect()
}

/// A dot screen: `paint` dots on `paper`, covering the share `tone` (0..1) of it.
fn screen(p: Vec2, angle: f32, pitch: f32, tone: f32, paper: u32, paint: u32) -> u32 {
    let q = turned(p, direction(angle)) / pitch;
    let d = (q - q.floor() - 0.5).length();
    // A dot of radius r covers pi r^2 of its cell; from r = 0.5 on, neighbors merge.
    let radius =
        libm::sqrtf(tone.clamp(0.0, 1.0) / std::f32::consts::PI) * (1.0 + 0.2 * tone.clamp(0.0, 1.0));
    if d < radius { paint } else { paper }
}
