//! Seeds: spots on the scene's surfaces, a brush stroke apart, and the Gaussians that belong to each.

use std::{collections::VecDeque, num::NonZero};

use glam::{IVec3, Mat3, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::frames::{Frames, dominant, outer, thinnest};
use crate::strokes::IN_PLANE;

/// Number of seeds around a seed whose places it may continue: six touch it on a surface, and two more.
const N_AROUND: usize = 8;

/// Most seeds: four styles of as many fit into one table.
const MOST: usize = crate::strokes::MAX_SEEDS / 4;

/// The distance from all seeds of the whole, in spacings, from which on Gaussians of a part get new ones.
/// Gaussians of the whole are within 1 of a seed. Gaussians of a finer level lie around them: up to 7 pixels
/// away, which is a quarter, if the whole has a Gaussian in each square of 10 pixels.
const REACH: f32 = 1.25;

/// Width of the surroundings from which a part shares seeds, in spacings: those within reach, and the ones
/// around these, so that a border changes no choice. Disks that are packed at random fill 0.55 of a plane,
/// which makes 0.7 seeds to a squared spacing, and 9 of them have a radius of 2 spacings.
const SURROUNDINGS: f32 = REACH + 2.0;

/// Rounds in which Gaussians choose among seeds, and the seeds' colors are renewed.
const ROUNDS: usize = 2;

/// Weight of colors and of normals beside that of distance, which is 1 at a seed's spacing.
const BESIDE: f32 = 0.35;

/// Cap of a squared difference of colors, in squared contrasts.
const OTHER: f32 = 9.0;

/// Radius within which seeds are tested for a flat surface, in spacings.
const FLAT_WITHIN: f32 = 2.5;

/// Least number of seeds for that test.
const FLAT_SEEDS: usize = 5;

/// Largest ratio of the smallest to the middle variance of seeds on a flat surface.
const FLAT: f32 = 0.12;

/// Rounds in which directions flow from edges into flat ground, and the weight of a seed's own.
const FLOW_ROUNDS: usize = 4;
const OWN_DIRECTION: f32 = 0.7;

/// Added to visibilities, in pixels, so that unseen seeds have a mean as well.
const UNSEEN: f32 = 1e-3;

/// One seed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seed {
    /// Position, in scene units.
    pub at: Vec3,
    /// Unit normal of the surface.
    pub normal: Vec3,
    /// Unit direction of strokes in the tangent plane.
    pub along: Vec3,
    /// Unit direction in the tangent plane that is nearest to up; `along` on level ground.
    pub up: Vec3,
    /// How clear `along` is, 0..1.
    pub clarity: f32,
}

/// Seeds, and the Gaussians between them.
pub(super) struct Seeds {
    /// The seeds `[M]`.
    pub seeds: Vec<Seed>,
    /// Seeds around each seed `[M]`, nearest first. Fewer than [`N_AROUND`] if there are no more.
    pub around: Vec<Vec<u32>>,
    /// The seed that each Gaussian belongs to `[N]`.
    pub owners: Vec<u32>,
    /// All seeds, each after a neighbor where there is one `[M]`.
    pub order: Vec<u32>,
    /// Mean color of each seed `[M]`.
    pub colors: Vec<Vec3>,
    /// The least distance of seeds, in scene units.
    pub spacing: f32,
}

/// Seeds of a whole scene that a part of it shares.
#[derive(Default)]
pub(super) struct Shared {
    seeds: Vec<Seed>,
    colors: Vec<Vec3>,
}

/// The ground that seeds are laid on.
pub(super) struct Ground<'a> {
    pub means: &'a [Vec3],
    /// Pixels of usual views that each Gaussian fills `[N]`.
    pub visibility: &'a [f32],
    pub frames: &'a Frames,
    /// Base colors, and the same without their finest detail `[N]`.
    pub base: &'a [Vec3],
    pub soft: &'a [Vec3],
    /// Deviation of the scene's luminance.
    pub contrast: f32,
    pub up: Vec3,
}

impl Seeds {
    /// Seeds at least `spacing` apart, the most visible places first. Those that are `shared` come before all
    /// others and stay as they are, and others are made where none of these is near.
    pub fn new(ground: &Ground, shared: &Shared, mut spacing: f32) -> Self {
        let n_shared = shared.seeds.len();
        let mut points: Vec<Vec3> = shared.seeds.iter().map(|seed| seed.at).collect();
        let mut chosen = spread(ground, &points, spacing);
        while n_shared + chosen.len() > MOST {
            spacing *= 1.5;
            chosen = spread(ground, &points, spacing);
        }
        points.extend(chosen.into_iter().map(|i| ground.means[i as usize]));
        let Some(nearest) = Nearest::new(&points) else {
            return Self {
                seeds: Vec::new(),
                around: Vec::new(),
                owners: Vec::new(),
                order: Vec::new(),
                colors: Vec::new(),
                spacing,
            };
        };
        let around = |i: usize| -> Vec<u32> {
            let others = nearest.of(points[i], N_AROUND + 1).into_iter().filter(|&j| j as usize != i);
            others.take(N_AROUND).collect()
        };
        let around: Vec<Vec<u32>> = (0..points.len()).into_par_iter().map(around).collect();
        let owners: Vec<u32> = ground.means.par_iter().map(|mean| nearest.of(*mean, 1)[0]).collect();
        let order = order(&around);
        let mut seeds = oriented(&points, &owners, ground);
        seeds[..n_shared].copy_from_slice(&shared.seeds);
        let mut seeds = Self { seeds, around, owners, order, colors: Vec::new(), spacing };
        seeds.choose_owners(ground, shared);
        seeds.flatten(ground.up, n_shared);
        seeds.flow(n_shared);
        seeds
    }

    /// The numbers of the seeds that a part within this box shares.
    pub fn near(&self, (min, max): (Vec3, Vec3)) -> Vec<u32> {
        let around = SURROUNDINGS * self.spacing;
        let is_near =
            |(_, seed): &(u32, &Seed)| (seed.at.cmpge(min - around) & seed.at.cmple(max + around)).all();
        (0..).zip(&self.seeds).filter(is_near).map(|(j, _)| j).collect()
    }

    /// The seeds of these numbers, for a part.
    pub fn to_share(&self, numbers: &[u32]) -> Shared {
        Shared {
            seeds: numbers.iter().map(|&j| self.seeds[j as usize]).collect(),
            colors: numbers.iter().map(|&j| self.colors[j as usize]).collect(),
        }
    }

    /// Gaussians belong to the seed that is near in place, color and direction, so that strokes end at edges
    /// and creases. These are superpixels on the surface (Achanta et al., "SLIC superpixels", 2012).
    fn choose_owners(&mut self, ground: &Ground, shared: &Shared) {
        let (contrast, spacing) = (ground.contrast.max(1e-6), self.spacing);
        self.renew_colors(ground, shared);
        for _ in 0..ROUNDS {
            let cost = |i: usize, j: u32| {
                let seed = &self.seeds[j as usize];
                let distance = ground.means[i].distance_squared(seed.at) / (spacing * spacing);
                let color = ground.soft[i].distance_squared(self.colors[j as usize]) / (contrast * contrast);
                let normal = 1.0 - ground.frames.normals[i].dot(seed.normal).abs();
                distance + BESIDE * (color.min(OTHER) + normal)
            };
            let owner = |i: usize| {
                let first = self.owners[i];
                let others = self.around[first as usize].iter().copied();
                let best = others.fold((cost(i, first), first), |best, j| {
                    let cost = cost(i, j);
                    if cost < best.0 { (cost, j) } else { best }
                });
                best.1
            };
            self.owners = (0..ground.means.len()).into_par_iter().map(owner).collect();
            self.renew_colors(ground, shared);
        }
    }

    /// Gives seeds the mean colors of their Gaussians. Those that are shared keep theirs.
    fn renew_colors(&mut self, ground: &Ground, shared: &Shared) {
        self.colors = self.pooled(ground.base, ground.visibility);
        self.colors[..shared.colors.len()].copy_from_slice(&shared.colors);
    }

    /// Gives seeds on flat surfaces the normal of the plane through the seeds around them. Normals of single
    /// large Gaussians would stretch strokes. The first ones, which are shared, stay.
    fn flatten(&mut self, up: Vec3, n_shared: usize) {
        let spacing = self.spacing;
        let normal = |i: usize| {
            let near = |point: &Vec3| point.distance(self.seeds[i].at) < FLAT_WITHIN * spacing;
            let around = self.around[i].iter().map(|&j| self.seeds[j as usize].at);
            let points: Vec<Vec3> = around.chain([self.seeds[i].at]).filter(near).collect();
            if points.len() < FLAT_SEEDS {
                return None;
            }
            let mean = points.iter().sum::<Vec3>() / points.len() as f32;
            let spread = points.iter().fold(Mat3::ZERO, |sum, p| sum + outer(*p - mean, *p - mean));
            let normal = thinnest(&spread);
            let most = dominant(spread);
            let (least, largest) = (normal.dot(spread * normal), most.dot(spread * most));
            let middle = spread.x_axis.x + spread.y_axis.y + spread.z_axis.z - least - largest;
            (least < FLAT * middle).then_some(normal)
        };
        let normals: Vec<Option<Vec3>> = (0..self.seeds.len()).into_par_iter().map(normal).collect();
        for (seed, normal) in self.seeds.iter_mut().zip(normals).skip(n_shared) {
            let Some(normal) = normal else { continue };
            *seed = Seed { at: seed.at, clarity: seed.clarity, ..lying(normal, seed.along, up) };
        }
    }

    /// Diffuses directions from edges into flat areas, so that strokes follow paths and banks. The first seeds,
    /// which are shared, stay.
    fn flow(&mut self, n_shared: usize) {
        let tensor = |seed: &Seed| outer(seed.along, seed.along) * seed.clarity * seed.clarity;
        let own: Vec<Mat3> = self.seeds.iter().map(tensor).collect();
        let mut tensors = own.clone();
        for _ in 0..FLOW_ROUNDS {
            let flowed = |i: usize| {
                let around = &self.around[i];
                let sum = around.iter().fold(Mat3::ZERO, |sum, &j| {
                    let alike = self.seeds[j as usize].normal.dot(self.seeds[i].normal).abs();
                    sum + tensors[j as usize] * alike
                });
                own[i] * OWN_DIRECTION + sum * (1.0 / around.len().max(1) as f32)
            };
            tensors = (0..own.len()).map(flowed).collect();
        }
        for (seed, tensor) in self.seeds.iter_mut().zip(&tensors).skip(n_shared) {
            let direction = dominant(*tensor);
            let in_plane = direction.reject_from_normalized(seed.normal);
            let trace = tensor.x_axis.x + tensor.y_axis.y + tensor.z_axis.z;
            if in_plane.length() > IN_PLANE && trace > 0.0 {
                let clarity = (2.0 * direction.dot(*tensor * direction) / trace - 1.0).clamp(0.0, 1.0);
                seed.along = in_plane.normalize();
                seed.clarity = seed.clarity.max(clarity);
            }
        }
    }

    /// Means of colors `[N]` over the Gaussians of each seed `[M]`, weighted.
    fn pooled(&self, colors: &[Vec3], weights: &[f32]) -> Vec<Vec3> {
        let mut sums = vec![(Vec3::ZERO, 0.0_f32); self.seeds.len()];
        for ((color, owner), weight) in colors.iter().zip(&self.owners).zip(weights) {
            let (sum, total) = &mut sums[*owner as usize];
            *sum += *color * (weight + UNSEEN);
            *total += weight + UNSEEN;
        }
        sums.into_iter()
            .zip(&self.seeds)
            .map(|((sum, total), _)| if total > 0.0 { sum / total } else { sum })
            .collect()
    }
}

/// The nearest of some points.
pub(super) struct Nearest(ImmutableKdTree<f64, 3>);

impl Nearest {
    /// `None` if there is no point.
    pub fn new(points: &[Vec3]) -> Option<Self> {
        let rows: Vec<[f64; 3]> = points.iter().map(|point| point.to_array().map(f64::from)).collect();
        (!rows.is_empty()).then(|| ImmutableKdTree::new_from_slice(&rows).ok().map(Self)).flatten()
    }

    /// The `n` nearest points, or all of them if there are less, by distance and then by index.
    pub fn of(&self, point: Vec3, n: usize) -> Vec<u32> {
        let n = NonZero::new(n).unwrap_or(NonZero::<usize>::MIN);
        let query = point.to_array().map(f64::from);
        let found = self.0.query(&query).nearest_n::<SquaredEuclidean<f64>>(n).execute();
        let mut found: Vec<(f64, u32)> = found.into_iter().map(|item| (item.distance, item.item)).collect();
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.into_iter().map(|(_, i)| i).collect()
    }

    /// The nearest point and the square of its distance.
    pub fn one(&self, point: Vec3) -> (u32, f32) {
        let query = point.to_array().map(f64::from);
        let found = self.0.query(&query).nearest_one::<SquaredEuclidean<f64>>().execute();
        (found.item, found.distance as f32)
    }
}

/// Gaussians at least `spacing` apart, and out of reach of the seeds that are `there`, chosen by falling
/// visibility.
fn spread(ground: &Ground, there: &[Vec3], spacing: f32) -> Vec<u32> {
    let (means, visibility) = (ground.means, ground.visibility);
    let there = Nearest::new(there);
    let is_bare = |i: &u32| {
        let reach = REACH * spacing;
        there.as_ref().is_none_or(|there| there.one(means[*i as usize]).1 >= reach * reach)
    };
    let mut order: Vec<u32> = (0..means.len() as u32).into_par_iter().filter(is_bare).collect();
    order.par_sort_unstable_by(|&a, &b| {
        visibility[b as usize].total_cmp(&visibility[a as usize]).then(a.cmp(&b))
    });
    let mut cells: FxHashMap<IVec3, Vec<u32>> = FxHashMap::default();
    let cell_of = |point: Vec3| (point / spacing).floor().as_ivec3();
    let mut chosen = Vec::new();
    for i in order {
        let (point, cell) = (means[i as usize], cell_of(means[i as usize]));
        let is_free = neighborhood(cell).all(|near| {
            let there = cells.get(&near);
            there.is_none_or(|there| {
                there.iter().all(|&j| means[j as usize].distance_squared(point) >= spacing * spacing)
            })
        });
        if is_free {
            cells.entry(cell).or_default().push(i);
            chosen.push(i);
        }
    }
    chosen
}

/// A cell and the 26 around it. Coordinates far outside saturate, where cells are shared and only get slower.
fn neighborhood(cell: IVec3) -> impl Iterator<Item = IVec3> {
    (0..27).map(move |i| cell.saturating_add(IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1)))
}

/// All seeds, breadth first over neighbors.
fn order(around: &[Vec<u32>]) -> Vec<u32> {
    let (mut order, mut is_listed) = (Vec::new(), vec![false; around.len()]);
    for start in 0..around.len() {
        let mut queue = VecDeque::new();
        if !std::mem::replace(&mut is_listed[start], true) {
            queue.push_back(start as u32);
        }
        while let Some(i) = queue.pop_front() {
            order.push(i);
            for &j in &around[i as usize] {
                if !std::mem::replace(&mut is_listed[j as usize], true) {
                    queue.push_back(j);
                }
            }
        }
    }
    order
}

/// A seed with this normal, whose strokes run along a direction. Its position is 0 and its clarity 1.
fn lying(normal: Vec3, along: Vec3, up: Vec3) -> Seed {
    let in_plane = |v: Vec3| v.reject_from_normalized(normal);
    let along = in_plane(along).try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector());
    let up = Some(in_plane(up)).filter(|up| up.length() > IN_PLANE).map_or(along, Vec3::normalize);
    Seed { at: Vec3::ZERO, normal, along, up, clarity: 1.0 }
}

/// Seeds at `points` with the mean normal and direction of their Gaussians.
fn oriented(points: &[Vec3], owners: &[u32], ground: &Ground) -> Vec<Seed> {
    let mut sums = vec![(Mat3::ZERO, Mat3::ZERO, 0.0_f32); points.len()];
    for (i, owner) in owners.iter().enumerate() {
        let weight = ground.visibility[i] + UNSEEN;
        let (normals, directions, total) = &mut sums[*owner as usize];
        *total += weight;
        // Products, because neither has a sign.
        *normals += outer(ground.frames.normals[i], ground.frames.normals[i]) * weight;
        let direction = ground.frames.directions[i];
        *directions += outer(direction, direction) * (weight * ground.frames.clarity[i]);
    }
    let seed = |(at, (normals, directions, total)): (&Vec3, &(Mat3, Mat3, f32))| {
        let along = dominant(*directions);
        let clarity = along.dot(*directions * along) / total.max(f32::MIN_POSITIVE);
        Seed { at: *at, clarity, ..lying(dominant(*normals), along, ground.up) }
    };
    points.iter().zip(&sums).map(seed).collect()
}
