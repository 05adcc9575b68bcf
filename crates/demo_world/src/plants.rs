//! Trees and bushes.

use glam::{Vec2, Vec3};

use crate::{
    brush::{Canvas, Dab, mix, paint, sphere},
    random::{Random, noise3},
    terrain,
};

/// The shape and colors of a leafy tree.
struct Leafy {
    place: Vec2,
    /// Height of the crown's middle above the ground.
    middle: f32,
    /// Radii of the crown, sideways and upward.
    crown: Vec2,
    /// Number of leaf clusters.
    clusters: u32,
    /// Number of leaves.
    leaves: u32,
    /// Standard deviation of a leaf's longer axis.
    leaf: f32,
    /// Colors of leaves, from shaded to sunlit.
    colors: [u32; 4],
    bark: [u32; 2],
    trunk: f32,
    seed: u64,
}

/// One cluster of leaves.
#[derive(Clone, Copy)]
struct Cluster {
    center: Vec3,
    radius: f32,
    tint: f32,
}

fn clusters(tree: &Leafy, crown: Vec3, random: &mut Random) -> Vec<Cluster> {
    sphere(tree.clusters)
        .map(|direction| {
            let jittered = (direction + random.cube() * 0.35).normalize();
            let out = random.range(0.45, 0.78);
            let offset = jittered * out * Vec3::new(tree.crown.x, tree.crown.y, tree.crown.x);
            let radius = tree.crown.min_element() * random.range(0.32, 0.52);
            Cluster { center: crown + offset, radius, tint: random.unit() }
        })
        .collect()
}

fn trunk(canvas: &mut Canvas, tree: &Leafy, foot: Vec3, crown: Vec3, random: &mut Random) {
    let bark = tree.bark.map(paint);
    let knee = foot.lerp(crown, 0.45) + random.cube() * Vec3::new(0.06, 0.0, 0.06);
    for (ends, radii) in [
        ((foot - Vec3::Y * 0.05, knee), (tree.trunk * 1.35, tree.trunk)),
        ((knee, crown), (tree.trunk, tree.trunk * 0.55)),
    ] {
        canvas.tube(ends, radii, 0.036, |_, normal| {
            let groove = noise3(normal * 6.0 + Vec3::splat(tree.seed as f32));
            mix(bark[0], bark[1], groove * 1.3 - 0.3 + 0.5 * random.unit())
        });
    }
    for root in 0..5 {
        let angle = std::f32::consts::TAU * (root as f32 + 0.6 * random.unit()) / 5.0;
        let out = Vec3::new(libm::cosf(angle), 0.0, libm::sinf(angle));
        let ends = (foot + out * tree.trunk + Vec3::Y * 0.08, foot + out * tree.trunk * 2.6 - Vec3::Y * 0.02);
        canvas.tube(ends, (tree.trunk * 0.42, tree.trunk * 0.16), 0.04, |_, _| {
            mix(bark[0], bark[1], random.unit())
        });
    }
}

fn leafy(canvas: &mut Canvas, tree: &Leafy) {
    let mut random = Random::new(tree.seed);
    let foot = terrain::ground(tree.place);
    let crown = foot + Vec3::Y * tree.middle;
    trunk(canvas, tree, foot, crown, &mut random);
    let bark = tree.bark.map(paint);
    let clusters = clusters(tree, crown, &mut random);
    let colors = tree.colors.map(paint);
    for cluster in &clusters {
        let fork = foot.lerp(crown, 0.72);
        canvas.tube((fork, cluster.center), (tree.trunk * 0.34, tree.trunk * 0.14), 0.11, |_, _| bark[0]);
        for direction in sphere(9) {
            let at = cluster.center + direction * cluster.radius * 0.5;
            let core = Dab::ball(at, cluster.radius * 0.3, mix(colors[0], colors[1], 0.35) * 0.8, direction);
            canvas.add(core.lit_as(direction, 0.3).opacity(0.9).blocking(0.6));
        }
    }
    let total: f32 = clusters.iter().map(|cluster| cluster.radius * cluster.radius).sum();
    for (index, cluster) in clusters.iter().enumerate() {
        let share = cluster.radius * cluster.radius / total;
        for direction in sphere((1.25 * tree.leaves as f32 * share) as u32) {
            let direction = (direction + random.cube() * 0.16).normalize();
            let at = cluster.center + direction * cluster.radius * random.range(0.86, 1.08);
            let buried = clusters
                .iter()
                .enumerate()
                .any(|(other, blob)| other != index && (at - blob.center).length() < 0.8 * blob.radius);
            if buried {
                continue;
            }
            let ripple = noise3(at * 9.0);
            let light = 0.5
                + 0.32 * direction.y
                + 0.5 * (ripple - 0.5)
                + 0.25 * (cluster.tint - 0.5)
                + 0.22 * random.signed();
            let color = shade_of(&colors, light);
            let out = (at - crown).normalize();
            let normal = direction + random.cube() * 0.7;
            let leaf = tree.leaf * random.range(0.8, 1.2);
            let dab = Dab::flat(at, normal, random.direction(), (leaf, leaf * 0.68), color);
            canvas.add(
                dab.lit_as(direction + out * 0.6 + random.cube() * 0.35, 0.25).opacity(0.94).blocking(0.7),
            );
        }
    }
}

/// The color at `t` (0..1) of a gradient through four.
fn shade_of(colors: &[Vec3; 4], t: f32) -> Vec3 {
    let at = t.clamp(0.0, 0.999) * 3.0;
    let index = at as usize;
    mix(colors[index], colors[index + 1], at - index as f32)
}

/// A pine: tiers of drooping boughs around a straight trunk.
fn pine(canvas: &mut Canvas, place: Vec2, height: f32, seed: u64) {
    const TIERS: u32 = 7;
    let mut random = Random::new(seed);
    let foot = terrain::ground(place);
    let bark = (paint(0x4b3323), paint(0x7c593d));
    canvas.tube((foot - Vec3::Y * 0.05, foot + Vec3::Y * height * 0.35), (0.075, 0.055), 0.04, |_, _| {
        mix(bark.0, bark.1, random.unit())
    });
    let greens = [0x16352a, 0x24543a, 0x3b7a48, 0x7aa860].map(paint);
    for tier in 0..TIERS {
        let share = tier as f32 / (TIERS - 1) as f32;
        let top = foot.y + height * (0.36 + 0.64 * share.sqrt() * 0.98);
        let drop = height * (0.27 - 0.09 * share);
        let radius = height * (0.30 * (1.0 - share) + 0.055) * random.range(0.92, 1.08);
        for ring in 0..6 {
            let down = (ring as f32 + 0.5) / 6.0;
            let around = (std::f32::consts::TAU * radius * down / 0.056).max(6.0) as u32;
            for index in 0..around {
                let angle = std::f32::consts::TAU * (index as f32 + random.unit()) / around as f32;
                let out = Vec3::new(libm::cosf(angle), 0.0, libm::sinf(angle));
                let bough = 0.86 + 0.22 * libm::cosf(angle * 9.0 + tier as f32 * 2.0);
                let reach = radius * down * bough;
                let y = top - drop * down * (0.75 + 0.25 * down) - 0.03 * random.unit();
                let at = Vec3::new(foot.x, y, foot.z) + out * reach;
                let needle = out * radius - Vec3::Y * drop * 0.9 + random.cube() * 0.12;
                let light = 0.15 + 0.62 * down * down + 0.25 * random.signed() + 0.2 * (bough - 0.86);
                let normal = out * drop + Vec3::Y * radius + random.cube() * 0.12;
                let dab = Dab::flat(at, normal, needle, (0.05, 0.022), shade_of(&greens, light));
                canvas.add(dab.lit_as(normal.normalize() + random.cube() * 0.3, 0.2).blocking(0.8));
            }
        }
        let core = Vec3::new(foot.x, top - drop * 0.55, foot.z);
        canvas.add(Dab::ball(core, radius * 0.3, greens[0] * 0.6, Vec3::Y).blocking(0.5));
    }
}

/// A round bush of small leaves, some of them in bloom.
fn bush(canvas: &mut Canvas, place: Vec2, radius: f32, bloom: Option<u32>, seed: u64) {
    let mut random = Random::new(seed);
    let center = terrain::ground(place) + Vec3::Y * radius * 0.5;
    let greens = [0x23501f, 0x3f7a2c, 0x6aa53a, 0xa8cc58].map(paint);
    for direction in sphere(14) {
        let at = center + direction * radius * 0.5;
        canvas.add(Dab::ball(at, radius * 0.26, greens[0] * 0.7, direction).opacity(0.9).blocking(0.6));
    }
    for direction in sphere((radius * radius * 3400.0) as u32) {
        if direction.y < -0.5 {
            continue;
        }
        let direction = (direction + random.cube() * 0.15).normalize();
        let lump = 0.82 + 0.36 * noise3(direction * 2.7 + Vec3::splat(seed as f32));
        let at = center + direction * radius * lump * random.range(0.92, 1.05) * Vec3::new(1.0, 0.85, 1.0);
        let light = 0.42 + 0.35 * direction.y + 0.9 * (lump - 1.0) + 0.25 * random.signed();
        let flower = bloom.filter(|_| random.unit() < 0.22);
        let color = flower.map_or(shade_of(&greens, light), |rgb| paint(rgb) * random.range(0.8, 1.1));
        let dab = Dab::flat(at, direction + random.cube() * 0.6, random.direction(), (0.028, 0.02), color);
        canvas.add(dab.lit_as(direction + random.cube() * 0.3, 0.25).blocking(0.8));
    }
}

/// Fallen leaves or petals around a tree.
fn litter(canvas: &mut Canvas, place: Vec2, radius: f32, colors: [u32; 3], count: u32, seed: u64) {
    let mut random = Random::new(seed);
    for _ in 0..count {
        let p = place
            + Vec2::new(random.signed() + random.signed(), random.signed() + random.signed())
                * (0.6 * radius);
        if terrain::rim_share(p) > 0.97 {
            continue;
        }
        let height = terrain::height(p).max(terrain::WATER_LEVEL) + random.range(0.012, 0.03);
        let color = paint(random.pick(&colors)) * random.range(0.8, 1.1);
        let normal = Vec3::Y + random.cube() * 0.4;
        canvas.add(Dab::flat(Vec3::new(p.x, height, p.y), normal, random.direction(), (0.02, 0.013), color));
    }
}

/// Paints every tree and bush of the island.
pub fn paint_trees(canvas: &mut Canvas) {
    let brown = [0x4a3424, 0x8a6a4c];
    let white = [0x3b3836, 0xf1ece0];
    let oak = [0x1f4a1c, 0x3c7a26, 0x6fa833, 0xb7d35a];
    let maple = [0x7a1f12, 0xc2401a, 0xec7a23, 0xffc24a];
    let cherry = [0xa84a6e, 0xe07ba0, 0xf7aecb, 0xffe6ef];
    let gold = [0x8a6a12, 0xc9a01c, 0xeccb3c, 0xfff08a];
    let apple = [0x2c5a22, 0x4f8a2c, 0x82b53c, 0xc2d964];
    let trees = [
        Leafy {
            place: Vec2::new(-2.75, 0.95),
            middle: 1.5,
            crown: Vec2::new(0.92, 0.82),
            clusters: 26,
            leaves: 2500,
            leaf: 0.036,
            colors: oak,
            bark: brown,
            trunk: 0.12,
            seed: 31,
        },
        Leafy {
            place: Vec2::new(0.2, -2.35),
            middle: 1.25,
            crown: Vec2::new(0.68, 0.66),
            clusters: 20,
            leaves: 1800,
            leaf: 0.034,
            colors: maple,
            bark: brown,
            trunk: 0.085,
            seed: 32,
        },
        Leafy {
            place: Vec2::new(-1.95, 2.45),
            middle: 1.1,
            crown: Vec2::new(0.66, 0.52),
            clusters: 20,
            leaves: 1600,
            leaf: 0.033,
            colors: cherry,
            bark: [0x3c2a2c, 0x705054],
            trunk: 0.075,
            seed: 33,
        },
        Leafy {
            place: Vec2::new(3.2, 0.35),
            middle: 1.2,
            crown: Vec2::new(0.36, 0.66),
            clusters: 14,
            leaves: 1100,
            leaf: 0.031,
            colors: gold,
            bark: white,
            trunk: 0.05,
            seed: 34,
        },
        Leafy {
            place: Vec2::new(2.95, -0.5),
            middle: 1.05,
            crown: Vec2::new(0.33, 0.58),
            clusters: 14,
            leaves: 950,
            leaf: 0.031,
            colors: gold,
            bark: white,
            trunk: 0.046,
            seed: 35,
        },
        Leafy {
            place: Vec2::new(-0.75, -2.0),
            middle: 0.85,
            crown: Vec2::new(0.5, 0.46),
            clusters: 10,
            leaves: 1200,
            leaf: 0.032,
            colors: apple,
            bark: brown,
            trunk: 0.06,
            seed: 36,
        },
    ];
    for tree in &trees {
        leafy(canvas, tree);
    }
    let pines = [(-3.3, -0.55, 1.75), (-3.1, -1.25, 1.3), (-1.6, -2.95, 1.9), (-2.25, -2.65, 1.4)];
    for (index, (x, z, height)) in pines.into_iter().enumerate() {
        pine(canvas, Vec2::new(x, z), height, 41 + index as u64);
    }
    let bushes = [
        (-0.15, 0.0, 0.19, Some(0xff7fa8)),
        (-2.25, -0.05, 0.21, None),
        (-1.85, 0.5, 0.17, Some(0xb58cff)),
        (-0.35, -1.2, 0.2, None),
        (3.4, 1.15, 0.2, Some(0xffffff)),
        (1.0, -3.0, 0.22, None),
        (0.4, 3.25, 0.2, Some(0xffd24a)),
        (-3.25, 1.9, 0.2, None),
    ];
    for (index, (x, z, radius, bloom)) in bushes.into_iter().enumerate() {
        bush(canvas, Vec2::new(x, z), radius, bloom, 51 + index as u64);
    }
    litter(canvas, Vec2::new(0.2, -2.35), 0.75, [0xe0622a, 0xf0a030, 0xb83a20], 260, 61);
    litter(canvas, Vec2::new(-1.95, 2.45), 0.75, [0xf7aecb, 0xffe0ea, 0xe88aae], 260, 62);
    litter(canvas, Vec2::new(3.1, 0.0), 0.55, [0xeccb3c, 0xd8a820, 0xfff08a], 140, 63);
}

/// Paints grass blades, flowers and reeds.
pub fn paint_meadow(canvas: &mut Canvas) {
    let mut random = Random::new(71);
    let mut blades = 0;
    while blades < 3900 {
        let p = Vec2::new(random.signed(), random.signed()) * 4.4;
        let (tall, lean, shade) = (random.range(0.6, 1.4), random.cube() * 0.45, random.unit());
        let thick = noise3(Vec3::new(p.x * 2.6, 0.3, p.y * 2.6));
        if !terrain::is_meadow(p) || thick < 0.3 + 0.35 * random.unit() {
            continue;
        }
        blades += 1;
        let up = (Vec3::Y + lean).normalize();
        let length = 0.034 * tall * (0.6 + thick);
        let color = mix(terrain::grass(p) * 0.75, paint(0xc6da6a), 0.15 + 0.6 * shade * shade);
        let at = terrain::ground(p) + up * length * 1.1;
        let dab = Dab::flat(at, random.direction().with_y(0.0) + Vec3::Z * 0.01, up, (length, 0.0075), color);
        canvas.add(dab.lit_as(terrain::normal(p), 0.4).opacity(0.9).blocking(0.35));
    }
    flowers(canvas, &mut random);
    reeds(canvas, &mut random);
}

fn flowers(canvas: &mut Canvas, random: &mut Random) {
    let kinds = [0xff5a5a, 0xffd23f, 0xffffff, 0xb07cff, 0xff8ac2, 0x6aa8ff];
    let mut planted = 0;
    while planted < 620 {
        let p = Vec2::new(random.signed(), random.signed()) * 4.3;
        let patch = noise3(Vec3::new(p.x * 1.4, 9.0, p.y * 1.4));
        let kind = noise3(Vec3::new(p.x * 0.9, 21.0, p.y * 0.9)) * 1.3 - 0.15;
        if !terrain::is_meadow(p) || patch < 0.52 + 0.2 * random.unit() {
            continue;
        }
        planted += 1;
        let mixed = (kind + 0.12 * random.signed()).clamp(0.0, 0.999);
        let color = paint(kinds[(mixed * kinds.len() as f32) as usize]) * random.range(0.85, 1.05);
        let at = terrain::ground(p) + Vec3::Y * random.range(0.05, 0.09);
        let normal = Vec3::Y + random.cube() * 0.4;
        canvas.add(Dab::flat(at, normal, random.direction(), (0.021, 0.018), color).lit_as(Vec3::Y, 0.4));
        canvas.add(Dab::ball(at + Vec3::Y * 0.01, 0.007, paint(0xffdd55), Vec3::Y));
    }
}

fn reeds(canvas: &mut Canvas, random: &mut Random) {
    let mut planted = 0;
    while planted < 290 {
        let p = Vec2::new(0.9, 1.8) + Vec2::new(random.signed() * 1.5, random.signed() * 1.2);
        let shore = terrain::shore_distance(p);
        let clump = noise3(Vec3::new(p.x * 2.2, 4.0, p.y * 2.2));
        if !(-0.1..0.1).contains(&shore) || clump < 0.52 || terrain::path_distance(p) < 0.1 {
            continue;
        }
        planted += 1;
        let up = (Vec3::Y + random.cube() * 0.22).normalize();
        let length = random.range(0.05, 0.1);
        let color = mix(paint(0x3f7a2c), paint(0xa9bf55), random.unit());
        let foot = Vec3::new(p.x, terrain::height(p).max(terrain::WATER_LEVEL), p.y);
        let facing = random.direction().with_y(0.0) + Vec3::X * 0.01;
        let blade = Dab::flat(foot + up * length * 1.2, facing, up, (length, 0.008), color);
        canvas.add(blade.lit_as(Vec3::Y + facing * 0.3, 0.4).blocking(0.4));
        if planted % 5 == 0 {
            let head = Dab::flat(foot + up * length * 2.6, facing, up, (0.028, 0.012), paint(0x6b4022));
            canvas.add(Dab { sigma: head.sigma.with_z(0.012), ..head });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_run_from_the_first_to_the_last() {
        let scale = [0x000000, 0x404040, 0x808080, 0xffffff].map(paint);
        assert_eq!(shade_of(&scale, -1.0), scale[0]);
        assert!((shade_of(&scale, 1.0) - scale[3]).length() < 0.01);
        assert!((shade_of(&scale, 1.0 / 3.0) - scale[1]).length() < 1e-4);
    }
}
