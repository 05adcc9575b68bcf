//! Glass and gold: a peacock in tesserae.
//!
//! Lloyd's method spreads the tiles in a square metric that is turned along the drawing's contours, so that
//! rows of tiles follow it (Hausner, "Simulating Decorative Mosaics", 2001).

use glam::{Vec2, Vec3, vec2};

use crate::canvas::{Canvas, SIZE, rgb, smoothstep};
use crate::noise::{Noise, Random, direction, hash};
use crate::shapes::{curve, ellipse, points, polyline, turned};

const NOISE: Noise = Noise(55);
const GROUT: u32 = 0x3c352e;
const SPACING: f32 = 10.6;
const ROOT: Vec2 = vec2(256.0, 372.0);
const HEAD: Vec2 = vec2(254.0, 206.0);

/// One tessera: its center, and the direction of one of its sides.
#[derive(Clone, Copy)]
struct Tile {
    center: Vec2,
    axis: Vec2,
}

/// The drawing at a point.
struct Spot {
    /// Number of the region. Tiles avoid lying across two regions.
    region: u32,
    color: Vec3,
    /// A function of the plane. Rows of tiles follow its level lines.
    contour: f32,
}

/// Lays the peacock.
pub fn paint() -> Canvas {
    let mut random = Random::new(5);
    let mut tiles: Vec<Tile> = random
        .scatter(SIZE as f32, 8.0, SPACING)
        .into_iter()
        .map(|center| Tile { center, axis: axis(center) })
        .collect();
    let edges = edges();
    // Enough for the tiles to settle.
    for _ in 0..14 {
        relax(&mut tiles, &edges);
    }
    let grid = Grid::new(&tiles);
    let looks: Vec<(Vec3, Vec2)> = tiles.iter().map(|tile| look(&mut random, tile.center)).collect();
    let mut canvas = Canvas::new(rgb(GROUT));
    canvas.shade(|p| {
        let (first, second) = grid.nearest(&tiles, p);
        // Distance to the tile's edge: halfway to the second nearest, but no farther out than a square tile's
        // side.
        let inset = (0.5 * (second.1 - first.1)).min(5.6 - first.1) - 0.75;
        let (color, tilt) = looks[first.0];
        let bevel = 0.75 + 0.25 * smoothstep(0.0, 1.8, inset);
        let lit = color * bevel * (1.0 + (p - tiles[first.0].center).dot(tilt));
        let grout = rgb(GROUT) * (1.0 + 0.3 * NOISE.at(p / 3.0));
        grout.lerp(lit, smoothstep(-0.4, 0.4, inset))
    });
    canvas
}

/// Color and tilt of a tile. Glass varies a little, gold leaf a lot.
fn look(random: &mut Random, at: Vec2) -> (Vec3, Vec2) {
    let color = spot(at).color;
    let gold = color.x > 0.6 && color.y > 0.4 && color.z < 0.4;
    let vary = if gold { 0.34 } else { 0.26 };
    let tint = Vec3::new(random.bell(), random.bell(), random.bell()) * 0.07;
    (color * (1.0 + vary * random.bell()) + tint, random.offset() * 0.03)
}

/// The direction of a tile's side at a point: the slope of the contour function.
fn axis(p: Vec2) -> Vec2 {
    let slope = |d: Vec2| spot(p + d).contour - spot(p - d).contour;
    vec2(slope(vec2(1.5, 0.0)), slope(vec2(0.0, 1.5))).normalize_or(Vec2::X)
}

/// For each pixel, whether regions meet there.
fn edges() -> Vec<bool> {
    (0..SIZE * SIZE)
        .map(|i| {
            let p = vec2((i % SIZE) as f32 + 0.5, (i / SIZE) as f32 + 0.5);
            let here = spot(p).region;
            [vec2(1.5, 0.0), vec2(0.0, 1.5), vec2(-1.5, 0.0), vec2(0.0, -1.5)]
                .iter()
                .any(|&d| spot(p + d).region != here)
        })
        .collect()
}

/// One step of Lloyd's method: each tile moves to the mean of the pixels nearest to it. Pixels at region edges
/// do not count, which pushes tiles off the edges.
fn relax(tiles: &mut [Tile], edges: &[bool]) {
    let grid = Grid::new(tiles);
    let mut sums = vec![(Vec2::ZERO, 0.0f32); tiles.len()];
    for (i, _) in edges.iter().enumerate().filter(|(_, edge)| !**edge) {
        let p = vec2((i % SIZE) as f32 + 0.5, (i / SIZE) as f32 + 0.5);
        let sum = &mut sums[grid.nearest(tiles, p).0.0];
        *sum = (sum.0 + p, sum.1 + 1.0);
    }
    for (tile, (sum, count)) in tiles.iter_mut().zip(sums) {
        if count > 0.0 {
            tile.center = sum / count;
            tile.axis = axis(tile.center);
        }
    }
}

/// Tiles sorted into square cells, for finding the nearest ones.
struct Grid {
    cells: Vec<Vec<usize>>,
}

impl Grid {
    const CELL: f32 = 13.0;
    const WIDTH: i32 = 44;

    fn new(tiles: &[Tile]) -> Self {
        let mut cells = vec![Vec::new(); (Self::WIDTH * Self::WIDTH) as usize];
        for (i, tile) in tiles.iter().enumerate() {
            let (x, y) = Self::cell(tile.center);
            cells[(y * Self::WIDTH + x) as usize].push(i);
        }
        Self { cells }
    }

    fn cell(p: Vec2) -> (i32, i32) {
        let clip = |v: f32| ((v + 20.0) / Self::CELL).clamp(1.0, (Self::WIDTH - 2) as f32) as i32;
        (clip(p.x), clip(p.y))
    }

    /// The nearest and the second nearest tile, with their distances in each tile's square metric.
    fn nearest(&self, tiles: &[Tile], p: Vec2) -> ((usize, f32), (usize, f32)) {
        let (cx, cy) = Self::cell(p);
        let (mut first, mut second) = ((0, f32::MAX), (0, f32::MAX));
        for cell in (cy - 1..=cy + 1).flat_map(|y| (cx - 1..=cx + 1).map(move |x| y * Self::WIDTH + x)) {
            for &i in &self.cells[cell as usize] {
                let d = turned(p - tiles[i].center, tiles[i].axis).abs().max_element();
                if d < first.1 {
                    second = first;
                    first = (i, d);
                } else if d < second.1 {
                    second = (i, d);
                }
            }
        }
        (first, second)
    }
}

fn spot(p: Vec2) -> Spot {
    frame(p).or_else(|| bird(p)).or_else(|| fan(p)).unwrap_or_else(|| {
        if p.y > 430.0 {
            let wave = p.y + 7.0 * libm::sinf(p.x * 0.05);
            let row = (wave / 21.0).floor();
            let color = rgb([0xb02620, 0xd8482a, 0x9c1c24][(row as usize) % 3]);
            return Spot { region: 40 + row as u32, color, contour: wave };
        }
        let ray = p.distance(ROOT) + 6.0 * NOISE.at(p / 60.0);
        let color = rgb(0xe6ac2a).lerp(rgb(0xffe07a), 0.5 + 0.9 * NOISE.at(p / 50.0));
        Spot { region: 1, color, contour: ray }
    })
}

fn frame(p: Vec2) -> Option<Spot> {
    let inset = p.min(Vec2::splat(SIZE as f32) - p).min_element();
    let band = (inset / 10.6).floor();
    let color = match band as i32 {
        0 => rgb(0x9c1c24),
        1 => {
            let along = if p.x.min(SIZE as f32 - p.x) < p.y.min(SIZE as f32 - p.y) { p.y } else { p.x };
            rgb(if (along / 21.2).floor() % 2.0 == 0.0 { 0xf0e2bc } else { 0x16646a })
        }
        2 => rgb(0xd0382a),
        _ => return None,
    };
    Some(Spot { region: 60 + band as u32, color, contour: inset })
}

/// The body with its raised neck, and the head with its crown.
fn bird(p: Vec2) -> Option<Spot> {
    let neck =
        curve(&points([(256.0, 372.0), (236.0, 330.0), (240.0, 286.0), (262.0, 254.0), (256.0, 222.0)]), 5);
    let head = p.distance(vec2(254.0, 210.0)) - 23.0;
    let t = ((p.y - 210.0) / 160.0).clamp(0.0, 1.0);
    let body =
        ellipse(p, vec2(256.0, 394.0), vec2(50.0, 62.0), Vec2::X).min(polyline(p, &neck) - 14.0 - 18.0 * t);
    let beak = ellipse(p, vec2(228.0, 216.0), vec2(15.0, 6.0), direction(-0.35));
    if p.distance(vec2(248.0, 207.0)) < 5.5 {
        return Some(Spot { region: 20, color: rgb(0x14100e), contour: p.x });
    }
    if beak < 0.0 && head > -4.0 {
        return Some(Spot { region: 21, color: rgb(0xf0b030), contour: beak });
    }
    if head.min(body) < 0.0 {
        let cheek = p.distance(vec2(250.0, 208.0)) < 12.0;
        let glint = NOISE.at(p / 26.0) + 0.012 * (250.0 - p.x);
        let blue = rgb(0x123a8c).lerp(rgb(0x2f7fd0), smoothstep(-0.4, 0.6, glint));
        return Some(Spot {
            region: 22 + cheek as u32,
            color: if cheek { rgb(0xf4ead0) } else { blue },
            contour: head.min(body),
        });
    }
    for k in -2..=2 {
        let plume = vec2(256.0, 196.0) + direction(-1.57 + 0.42 * k as f32) * 24.0;
        if p.distance(plume) < 5.5 {
            return Some(Spot { region: 25, color: rgb(0x2f7fd0), contour: p.distance(plume) });
        }
    }
    None
}

/// The tail: rows of eyes on rays from the root.
fn fan(p: Vec2) -> Option<Spot> {
    let nimbus = p.distance(HEAD);
    if nimbus < 52.0 {
        let color = rgb(if nimbus > 42.0 { 0xd03a24 } else { 0xffd75e });
        return Some(Spot { region: 30 + (nimbus > 42.0) as u32, color, contour: nimbus });
    }
    let q = p - ROOT;
    let reach = q.length();
    let angle = libm::atan2f(q.x, -q.y);
    if reach > 300.0 || angle.abs() > 1.75 {
        return None;
    }
    let mut nearest = (f32::MAX, 0, 0);
    for row in 0..4 {
        let step = 3.1 / (5 + 2 * row) as f32;
        let shift = if row % 2 == 0 { 0.5 } else { 0.0 };
        let k = (angle / step + shift).round() as i32;
        let bearing = (k as f32 - shift) * step;
        let at = ROOT + vec2(libm::sinf(bearing), -libm::cosf(bearing)) * (104.0 + 58.0 * row as f32);
        let scale = 0.82 + 0.12 * row as f32;
        let d = turned(p - at, (at - ROOT).normalize_or(Vec2::Y)) * vec2(0.8, 1.0);
        if d.length() / scale < nearest.0 {
            nearest = (d.length() / scale, row, k);
        }
    }
    let (d, row, k) = nearest;
    if reach > 268.0 && d > 27.0 {
        return None;
    }
    let ring = [7.0, 13.0, 20.0, 26.0].iter().position(|&r| d < r);
    let color = match ring {
        Some(0) => rgb(0x101c50),
        Some(1) => rgb(0x1fa0a8),
        Some(2) => rgb(0xe8b440),
        Some(3) => rgb(0xb03020),
        _ => rgb(0x0c5f66).lerp(rgb(0x3fb49c), hash(5, (angle * 9.0 + 50.0) as i32, row)),
    };
    let region = ring.map_or(2, |r| 100 + r as u32 * 1000 + (row * 40 + k + 20) as u32);
    Some(Spot { region, color, contour: if ring.is_some() { d } else { reach } })
}
