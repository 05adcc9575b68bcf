//! The land: its outline, heights, paths and shore, and its grass, earth and cobbles.

use glam::{Vec2, Vec3};

use crate::{
    brush::{Canvas, Dab, mix, paint, smoothstep},
    random::{Random, cell, fractal2, noise2},
};

/// Spacing of the ground's Gaussians.
const SPACING: f32 = 0.0655;
/// Height of the water's surface.
pub const WATER_LEVEL: f32 = -0.07;
/// Position of the house, and the direction of its front.
pub const HOUSE: (Vec2, Vec2) = (Vec2::new(-1.15, -0.35), Vec2::new(0.35, 0.937));
/// Position of the windmill.
pub const MILL: Vec2 = Vec2::new(1.75, -1.85);
/// The vegetable garden: center and half size, along the world's axes.
pub const GARDEN: (Vec2, Vec2) = (Vec2::new(0.62, -0.75), Vec2::new(0.55, 0.42));

const POND: (Vec2, Vec2) = (Vec2::new(0.85, 1.75), Vec2::new(1.1, 0.78));
/// The stream from the pond to the rim.
pub const STREAM: [Vec2; 4] =
    [Vec2::new(1.6, 1.8), Vec2::new(2.4, 1.5), Vec2::new(3.1, 1.72), Vec2::new(4.6, 1.95)];
const STREAM_HALF_WIDTH: f32 = 0.27;

const PATHS: [&[Vec2]; 3] = [
    &[
        Vec2::new(-0.93, 0.25),
        Vec2::new(-0.75, 0.75),
        Vec2::new(-0.95, 1.5),
        Vec2::new(-0.7, 2.3),
        Vec2::new(-0.25, 3.2),
        Vec2::new(-0.1, 4.4),
    ],
    &[
        Vec2::new(-0.78, 0.68),
        Vec2::new(0.1, 0.45),
        Vec2::new(1.1, 0.25),
        Vec2::new(2.0, 0.4),
        Vec2::new(2.42, 0.95),
        Vec2::new(2.5, 2.1),
        Vec2::new(2.25, 2.6),
        Vec2::new(1.75, 3.0),
    ],
    &[Vec2::new(1.55, 0.28), Vec2::new(1.95, -0.4), Vec2::new(1.85, -1.4)],
];
const PATH_HALF_WIDTH: f32 = 0.155;

fn polyline_distance(line: &[Vec2], p: Vec2) -> f32 {
    let segment = |ends: &[Vec2]| {
        let along = ends[1] - ends[0];
        let t = ((p - ends[0]).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        (p - ends[0] - along * t).length()
    };
    line.windows(2).map(segment).fold(f32::MAX, f32::min)
}

/// Distance to the water's edge, negative on the water.
pub fn shore_distance(p: Vec2) -> f32 {
    let wobble = 0.16 * (noise2(p * 2.1) - 0.5);
    let scaled = (p - POND.0) / POND.1;
    let pond = (scaled.length() - 1.0) * POND.1.y;
    pond.min(polyline_distance(&STREAM, p) - STREAM_HALF_WIDTH) + wobble
}

/// Distance to the edge of the nearest path, negative on it.
pub fn path_distance(p: Vec2) -> f32 {
    let wobble = 0.07 * (noise2(p * 4.3) - 0.5);
    PATHS.iter().map(|path| polyline_distance(path, p)).fold(f32::MAX, f32::min) - PATH_HALF_WIDTH + wobble
}

/// Distance from the island's axis to its rim, in a horizontal unit direction. Harmonics of the angle come from
/// the angle-sum formulas, without trigonometry.
pub fn rim(direction: Vec2) -> f32 {
    let (c, s) = (direction.x, direction.y);
    let (c2, s2) = (c * c - s * s, 2.0 * c * s);
    let (c3, s3) = (c * c2 - s * s2, s * c2 + c * s2);
    let wave = 0.035 * (c2 + 0.6 * s2) + 0.035 * (0.6 * c3 - s3);
    3.95 * (1.0 + wave + 0.05 * (noise2(direction * 5.0) - 0.5) + 0.03 * (noise2(direction * 13.0) - 0.5))
}

/// Position of a point between the axis (0) and the rim (1).
pub fn rim_share(p: Vec2) -> f32 {
    let length = p.length();
    if length < 1e-3 { 0.0 } else { length / rim(p / length) }
}

fn bump(p: Vec2, center: Vec2, radius: f32) -> f32 {
    let t = (1.0 - (p - center).length_squared() / (radius * radius)).max(0.0);
    t * t
}

/// Height of the ground, or of the bed if it is under water.
pub fn height(p: Vec2) -> f32 {
    let rolling = 0.05 + 0.22 * (fractal2(p * 0.9) - 0.4);
    let hills = 0.62 * bump(p, MILL, 1.7)
        + 0.45 * bump(p, Vec2::new(-2.5, -2.1), 1.8)
        + 0.2 * bump(p, Vec2::new(-2.7, 1.1), 1.3);
    let rim = 0.25 * smoothstep(0.86, 1.02, rim_share(p));
    let wild = rolling + hills - rim;
    // House, mill and garden stand on level ground, paths are trodden in, and the shore leads down to the bed.
    let house = smoothstep(1.5, 1.0, (p - HOUSE.0).length());
    let mill = smoothstep(0.75, 0.45, (p - MILL).length());
    let settled = wild + (0.12 - wild) * house;
    let settled = settled + (0.62 - settled) * mill;
    let bed = smoothstep(0.25, 0.0, ((p - GARDEN.0).abs() - GARDEN.1).max_element());
    let settled = settled + (0.14 - settled) * bed;
    let trodden = settled - 0.025 * smoothstep(0.05, -0.06, path_distance(p));
    let dry = smoothstep(-0.22, 0.26, shore_distance(p));
    -0.34 + (trodden + 0.34) * dry
}

/// The point of the ground above or below a place of the plan.
pub fn ground(p: Vec2) -> Vec3 {
    Vec3::new(p.x, height(p), p.y)
}

/// Normal of the ground, by central differences.
pub fn normal(p: Vec2) -> Vec3 {
    const STEP: f32 = 0.04;
    let slope = |axis: Vec2| (height(p + axis * STEP) - height(p - axis * STEP)) / (2.0 * STEP);
    Vec3::new(-slope(Vec2::X), 1.0, -slope(Vec2::Y)).normalize()
}

/// Whether grass and flowers may grow at a place.
pub fn is_meadow(p: Vec2) -> bool {
    let from_house = (p - HOUSE.0).length();
    let from_garden = ((p - GARDEN.0).abs() - GARDEN.1).max_element();
    rim_share(p) < 0.985
        && shore_distance(p) > 0.1
        && path_distance(p) > 0.02
        && from_house > 0.75
        && from_garden > 0.04
        && (p - MILL).length() > 0.5
}

/// Color of the grass at a place, with patches, mown stripes of light, and dry tufts.
pub fn grass(p: Vec2) -> Vec3 {
    let lush = mix(paint(0x4f8f2b), paint(0x86b83c), fractal2(p * 1.3 + Vec2::new(9.0, 3.0)) * 1.7 - 0.4);
    let dry = smoothstep(0.55, 0.78, fractal2(p * 0.8 + Vec2::new(40.0, 7.0)));
    let mossy = smoothstep(0.5, 0.75, noise2(p * 2.2 + Vec2::new(3.0, 77.0)));
    mix(mix(lush, paint(0xb9bc52), 0.65 * dry), paint(0x37762f), 0.5 * mossy)
}

fn earth(p: Vec2, random: &mut Random) -> Vec3 {
    mix(paint(0x7a5c3c), paint(0xb08c5c), 0.7 * noise2(p * 5.0) + 0.4 * random.unit())
}

fn ground_color(p: Vec2, random: &mut Random) -> Vec3 {
    let shore = shore_distance(p);
    if shore < -0.02 {
        let depth = smoothstep(0.0, -0.4, shore);
        let pebble = random.pick(&[0x8f8a70, 0xa79d80, 0x75805f, 0x6b6a5c]);
        return mix(paint(pebble), paint(0x2f6b62), 0.7 * depth);
    }
    let from_garden = ((p - GARDEN.0).abs() - GARDEN.1).max_element();
    if from_garden < 0.0 {
        let row = ((p.y - GARDEN.0.y) * 5.2).rem_euclid(1.0);
        return mix(
            paint(0x4a2f1e),
            paint(0x7d5636),
            smoothstep(0.2, 0.5, (row - 0.5).abs()) + 0.3 * random.unit(),
        );
    }
    let speckle = random.unit();
    let green = grass(p) * (0.5 + 0.8 * speckle * speckle);
    let sand = mix(paint(0xd8c08a), paint(0xa88f62), random.unit());
    let beach = smoothstep(0.16, 0.03, shore + 0.08 * random.signed());
    let worn = smoothstep(0.06, -0.03, path_distance(p) + 0.04 * random.signed());
    mix(mix(green, sand, beach), earth(p, random), worn)
}

/// Paints the ground: a hexagonal grid over the plan, of which every dab is a short stroke on its slope.
pub fn paint_ground(canvas: &mut Canvas) {
    let mut random = Random::new(11);
    let rows = (9.6 / (SPACING * 0.866)) as i32;
    let columns = (9.6 / SPACING) as i32;
    for row in 0..rows {
        for column in 0..columns {
            let shift = 0.5 * (row % 2) as f32;
            let p = Vec2::new(column as f32 + shift, row as f32 * 0.866) * SPACING - Vec2::splat(4.8);
            let p = p + Vec2::new(random.signed(), random.signed()) * (0.22 * SPACING);
            if rim_share(p) > 1.0 || (p - HOUSE.0).length() < 0.5 {
                continue;
            }
            let along = random.direction();
            let sigma = SPACING * random.range(0.54, 0.66);
            let color = ground_color(p, &mut random);
            let dab = Dab::flat(ground(p), normal(p), along, (sigma * 1.5, sigma * 0.68), color);
            canvas.add(Dab { sigma: dab.sigma.with_z(0.008), ..dab });
        }
    }
}

/// Paints cobbles on the paths, one rounded stone per cell of a cellular noise.
pub fn paint_cobbles(canvas: &mut Canvas) {
    const SIZE: f32 = 0.115;
    let mut random = Random::new(12);
    let stones = [0xb5aa98, 0x958c80, 0xc9bda4, 0x857d74, 0xa89680].map(paint);
    let count = (9.6 / SIZE) as i32;
    for index in 0..count * count {
        let corner = Vec2::new((index % count) as f32, (index / count) as f32) * SIZE - Vec2::splat(4.8);
        let p = corner + Vec2::new(random.range(0.25, 0.75), random.range(0.25, 0.75)) * SIZE;
        let (along, size) = (random.direction(), random.range(0.30, 0.40) * SIZE);
        let color = random.pick(&stones) * random.range(0.75, 1.1);
        if path_distance(p) > -0.015 || rim_share(p) > 0.985 || shore_distance(p) < 0.12 {
            continue;
        }
        let normal = (normal(p) + random.cube() * 0.12).normalize();
        canvas.add(Dab::flat(ground(p) + Vec3::Y * 0.012, normal, along, (size * 1.15, size * 0.85), color));
        let highlight = mix(color, Vec3::ONE, 0.25);
        let top = ground(p) + Vec3::new(random.signed() * 0.012, 0.02, random.signed() * 0.012);
        canvas.add(Dab::flat(top, normal, along, (size * 0.5, size * 0.4), highlight).opacity(0.7));
    }
}

/// The rock's surface before it is broken into chunks, at a share of the way from the rim (0) to the axis (1).
fn underside(share: f32, direction: Vec2) -> Vec3 {
    let radius = rim(direction);
    let lumps = fractal2(direction * 3.1 + Vec2::splat(20.0));
    let steep = 1.0 - (1.0 - share) * (1.0 - share);
    let depth = (2.75 + 1.5 * (lumps - 0.45)) * (0.5 * steep + 0.5 * share * share.sqrt());
    let inward = 0.03 * smoothstep(0.0, 0.1, share) + 0.97 * share * (0.32 + 0.68 * share);
    let edge = direction * radius;
    let top = height(edge);
    let reach = radius * (1.0 - inward);
    Vec3::new(direction.x * reach, top - depth, direction.y * reach)
}

/// The rock's surface at a share of the way from the rim to the axis, broken into chunks by cellular noise.
fn rock(share: f32, angle: f32) -> Vec3 {
    let direction = Vec2::new(libm::cosf(angle), libm::sinf(angle));
    let smooth = underside(share, direction);
    let chunk = cell(smooth * Vec3::new(1.9, 2.7, 1.9));
    let fine = cell(smooth * 5.5);
    let out = Vec3::new(direction.x, -0.25, direction.y);
    let fade = smoothstep(0.0, 0.05, share);
    smooth
        + out
            * (fade * (0.34 * (chunk.id - 0.4) * smoothstep(0.0, 0.25, chunk.seam) + 0.06 * (fine.id - 0.5)))
}

fn rock_color(at: Vec3, share: f32, random: &mut Random) -> Vec3 {
    let chunk = cell(at * Vec3::new(1.9, 2.7, 1.9));
    let fine = cell(at * 5.5);
    let band = fractal2(Vec2::new(at.y * 5.0, 0.35 * at.x + 0.2 * at.z));
    let tones = [0xa0917f, 0xbca387, 0x8e838a, 0xcbb08b, 0xa98f70].map(paint);
    let base = tones[(chunk.id * 4.99) as usize];
    let layered = mix(base, paint(0xc4ab86), smoothstep(0.45, 0.7, band));
    let layered = mix(layered, paint(0x5d5560), smoothstep(0.42, 0.25, band));
    let crack = 0.38 + 0.62 * smoothstep(0.0, 0.13, chunk.seam).min(smoothstep(-0.12, 0.14, fine.seam));
    let soil = smoothstep(0.07, 0.03, share + 0.02 * random.signed());
    let stone = layered * (crack * random.range(0.82, 1.15));
    let moss = smoothstep(0.62, 0.75, fractal2(Vec2::new(at.x + at.y, at.z - at.y) * 1.7)) * (1.0 - share);
    mix(mix(stone, paint(0x5f7d35), 0.75 * moss), paint(0x6a4528) * random.range(0.7, 1.2), soil)
}

/// Paints the cliffs around and below, in rings from the rim to the tip.
pub fn paint_cliffs(canvas: &mut Canvas) {
    const CLIFF_SPACING: f32 = 0.094;
    const RINGS: u32 = 40;
    let mut random = Random::new(13);
    for ring in 0..RINGS {
        let share = (ring as f32 + 0.5) / RINGS as f32;
        let around = (std::f32::consts::TAU * 4.0 * (1.0 - share * (0.32 + 0.68 * share)) / CLIFF_SPACING)
            .max(6.0) as u32;
        let (down, side) = (0.5 / RINGS as f32, std::f32::consts::PI / around as f32);
        for index in 0..around {
            let angle = 2.0 * side * (index as f32 + 0.5 * (ring % 2) as f32);
            let at = rock(share, angle);
            let below = rock((share + down).min(1.0), angle) - rock(share - down, angle);
            let beside = rock(share, angle + side) - rock(share, angle - side);
            let normal = below.cross(beside).try_normalize().unwrap_or(Vec3::NEG_Y);
            let out = Vec3::new(at.x, -1.0, at.z);
            let normal = if normal.dot(out) < 0.0 { -normal } else { normal };
            let facet = cell(at * 5.5);
            let shade = normal + facet.offset * 1.2 + Vec3::Y * (0.5 * facet.id - 0.1);
            let sigma = (beside.length().min(0.2) * 0.54, below.length().min(0.25) * 0.54);
            let color = rock_color(at, share, &mut random);
            let dab = Dab::flat(at, normal, beside, sigma, color).opacity(0.98);
            canvas.add(Dab { sigma: dab.sigma.with_z(0.01), ..dab.lit_as(shade, 0.1) });
        }
    }
}

/// Paints grass that hangs over the rim and covers the seam between meadow and rock.
pub fn paint_rim(canvas: &mut Canvas) {
    const TUFTS: u32 = 1100;
    let mut random = Random::new(14);
    for tuft in 0..TUFTS {
        let angle = std::f32::consts::TAU * (tuft as f32 + random.unit()) / TUFTS as f32;
        let direction = Vec2::new(libm::cosf(angle), libm::sinf(angle));
        let edge = direction * (rim(direction) * random.range(0.985, 1.006));
        if shore_distance(edge) < 0.03 {
            continue;
        }
        let length = random.range(0.03, 0.075) * (0.6 + 0.8 * noise2(direction * 9.0));
        let out = Vec3::new(direction.x, 0.0, direction.y);
        let hang = (out * 0.45 - Vec3::Y + random.cube() * 0.4).normalize();
        let at = ground(edge) + Vec3::Y * 0.01 + hang * length * 0.8;
        let color = grass(edge) * random.range(0.55, 1.25);
        let dab = Dab::flat(at, out + Vec3::Y * 0.3, hang, (length, 0.018), color);
        canvas.add(dab.lit_as(out + Vec3::Y, 0.3).blocking(0.5));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pond_holds_water_and_the_house_stands_dry() {
        assert!(height(POND.0) < WATER_LEVEL - 0.15);
        assert!((height(HOUSE.0) - 0.12).abs() < 1e-4);
        assert!(height(MILL) > 0.55);
        assert!(!is_meadow(POND.0) && !is_meadow(MILL) && is_meadow(Vec2::new(-2.2, 1.6)));
    }

    #[test]
    fn distance_to_a_polyline() {
        let line = [Vec2::ZERO, Vec2::new(2.0, 0.0), Vec2::new(2.0, 2.0)];
        assert_eq!(polyline_distance(&line, Vec2::new(1.0, 1.0)), 1.0);
        assert_eq!(polyline_distance(&line, Vec2::new(-3.0, 4.0)), 5.0);
    }
}
