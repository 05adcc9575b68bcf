//! The place in the painting that each seed takes.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{
    canvas::Canvas,
    painting::{Paint, floored},
    seeds::Seed,
    surface::Surface,
};
use crate::{decoder::product::dot, noise::noise, scene::Scene, statistics};

/// Weight of colors (0..1).
const COLOR_WEIGHT: f32 = 3.0;

/// Weight of features, whose distance from their mean is 1 on average. More of it picks the painting's smooth places for
/// smooth surfaces, and with them little paint.
const FEATURE_WEIGHT: f32 = 0.5;

/// Rounds of coherence. A place spreads by one seed a round, so strokes run on over six seeds at most.
const ROUNDS: u32 = 6;

/// The share of seeds that may change in a round. If all did at once, two neighbors could trade places forever.
const AWAKE: f32 = 0.6;

/// Distance from where a neighbor would continue, in pixels of the painting, from which on places count as unrelated.
const UNRELATED: f32 = 12.0;

/// Cost of a place that continues none of the neighbors', in costs of a typical best match.
const BREAK: f32 = 1.0;

/// Least clarity at which directions of the scene and of strokes are laid upon one another. Below it, the painting
/// stands upright.
const CLEAR: f32 = 0.25;

/// A place in the painting and how it lies on the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    /// Position in the painting, in pixels.
    pub at: Vec2,
    /// The painting's x axis on the surface, a unit vector.
    pub right: Vec3,
    /// The painting's y axis on the surface, a unit vector.
    pub down: Vec3,
}

impl Placement {
    /// The position in the painting of a point at `offset` from the seed, in pixels.
    pub fn read_at(&self, offset: Vec3, pixel: f32) -> Vec2 {
        self.at + Vec2::new(offset.dot(self.right), offset.dot(self.down)) / pixel
    }

    /// Lays `place` on the surface at `seed`: strokes along the edges of the scene if both are clear, else upright.
    fn on(seed: &Seed, place: usize, canvas: &Canvas) -> Self {
        let (stroke, clarity) = canvas.strokes[place];
        let directed = clarity > CLEAR && seed.clarity > CLEAR;
        // The painting's up is -y in pixels.
        let (stroke, along) = if directed { (stroke, seed.along) } else { (Vec2::NEG_Y, seed.up) };
        let beside = seed.normal.cross(along);
        Self {
            at: canvas.center_of(place),
            right: along * stroke.x - beside * stroke.y,
            down: along * stroke.y + beside * stroke.x,
        }
    }

    /// The same paint continued from one seed to another.
    fn continued(&self, from: &Seed, to: &Seed, pixel: f32) -> Self {
        let right = self.right.reject_from_normalized(to.normal);
        let right = right.try_normalize().unwrap_or(to.along);
        let down = self.down.reject_from_normalized(to.normal).reject_from_normalized(right);
        let down = down.try_normalize().unwrap_or_else(|| to.normal.cross(right));
        Self { at: self.read_at(to.at - from.at, pixel), right, down }
    }
}

/// How well places suit seeds.
struct Matching {
    /// Descriptors `[M, W]` and `[P, W]`: features, if there are any, and weighted colors.
    seeds: Vec<f32>,
    places: Vec<f32>,
    width: usize,
    /// Mean distance of the best matches, by which distances are divided.
    typical: f32,
}

impl Matching {
    /// Descriptors of `surface`, recolored as `colors` `[M]`, and of `paint`.
    fn new(scene: &Scene, surface: &Surface, colors: &[Vec3], paint: &Paint, canvas: &Canvas) -> Self {
        let features = Features::new(scene, surface, paint);
        let width = features.width + 3;
        let rows = |features: &[f32], width: usize, colors: &[Vec3]| -> Vec<f32> {
            let row = |(i, color): (usize, &Vec3)| {
                let features = features[i * width..(i + 1) * width].iter().copied();
                features.chain((*color * COLOR_WEIGHT).to_array()).collect::<Vec<f32>>()
            };
            colors.iter().enumerate().flat_map(row).collect()
        };
        let seeds = rows(&features.seeds, features.width, colors);
        let places = rows(&features.places, features.width, &canvas.place_colors);
        Self { seeds, places, width, typical: 1.0 }
    }

    fn distance(&self, seed: usize, place: usize) -> f32 {
        let a = &self.seeds[seed * self.width..(seed + 1) * self.width];
        let b = &self.places[place * self.width..(place + 1) * self.width];
        a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>() / self.typical
    }

    /// The place of the smallest distance from each seed `[M]`. Sets the typical distance.
    fn best(&mut self) -> Vec<usize> {
        // |a - b|^2 = |a|^2 + |b|^2 - 2 a b, and |a|^2 is the same for all places.
        let squares: Vec<f32> = self.places.chunks_exact(self.width).map(|row| dot(row, row)).collect();
        let best = |seed: &[f32]| {
            let mut best = (f32::INFINITY, 0);
            for (place, (row, square)) in self.places.chunks_exact(self.width).zip(&squares).enumerate() {
                let distance = square - 2.0 * dot(seed, row);
                if distance < best.0 {
                    best = (distance, place);
                }
            }
            best.1
        };
        let places: Vec<usize> = self.seeds.par_chunks_exact(self.width).map(best).collect();
        let total: f32 = places.iter().enumerate().map(|(seed, &place)| self.distance(seed, place)).sum();
        self.typical = (total / places.len().max(1) as f32).max(1e-6);
        places
    }
}

/// Features of seeds and places in the same few dimensions, as AdaIN compares them.
struct Features {
    seeds: Vec<f32>,
    places: Vec<f32>,
    width: usize,
}

impl Features {
    /// Nothing, if scene and painting have no features of the same encoder's width.
    fn new(scene: &Scene, surface: &Surface, paint: &Paint) -> Self {
        let same = |(a, b): &(&crate::Features, &super::PaintFeatures)| a.n_channels() == b.n_channels;
        let both = scene.features.as_ref().zip(paint.features.as_ref()).filter(same);
        let Some((features, painting)) = both else {
            return Self { seeds: Vec::new(), places: Vec::new(), width: 0 };
        };
        let content = statistics::ContentStatistics::of(features);
        let mut deviations: Vec<f32> = content.std_dev.iter().map(|value| *value as f32).collect();
        floored(&mut deviations);
        let n_latent = features.n_latent;
        let width = painting.axes.len() / painting.n_channels;
        // Axes in the scene's latent space [C, L]: V^T diag(1 / std) A.
        let mut axes = vec![0.0; width * n_latent];
        for (axis, out) in
            painting.axes.chunks_exact(painting.n_channels).zip(axes.chunks_exact_mut(n_latent))
        {
            for ((weight, deviation), row) in
                axis.iter().zip(&deviations).zip(features.basis.chunks_exact(n_latent))
            {
                out.iter_mut().zip(row).for_each(|(sum, a)| *sum += weight / deviation * a);
            }
        }
        let mean: Vec<f32> = statistics::mean_latent(features).iter().map(|value| *value as f32).collect();
        let n_places = painting.places.len() / width.max(1);
        let square: f32 = painting.places.iter().map(|value| value * value).sum();
        // Places are on average at distance 1 from their mean. A painting of one color has none.
        let scale = FEATURE_WEIGHT / (square / n_places.max(1) as f32).sqrt().max(1e-3);
        let seed = |row: &[f32]| -> Vec<f32> {
            let centered: Vec<f32> = row.iter().zip(&mean).map(|(value, mean)| value - mean).collect();
            axes.chunks_exact(n_latent).map(|axis| scale * dot(axis, &centered)).collect()
        };
        Self {
            seeds: surface.seed_features.chunks_exact(n_latent).flat_map(seed).collect(),
            places: painting.places.iter().map(|value| scale * value).collect(),
            width,
        }
    }
}

/// The placement of each seed `[M]`, if the scene is recolored as `colors` `[M]`.
pub(super) fn place(
    scene: &Scene,
    surface: &Surface,
    colors: &[Vec3],
    paint: &Paint,
    canvas: &Canvas,
) -> Vec<Placement> {
    let mut matching = Matching::new(scene, surface, colors, paint, canvas);
    let seeds = &surface.seeds;
    let mut placements: Vec<Placement> = matching
        .best()
        .iter()
        .zip(&seeds.seeds)
        .map(|(&place, seed)| Placement::on(seed, place, canvas))
        .collect();
    for round in 0..ROUNDS {
        let chosen = |i: usize| {
            // Uniform, since noise is uniform between -sqrt(3) and sqrt(3). In the last round all seeds are awake.
            let awake = noise(i as u32, round) < (2.0 * AWAKE - 1.0) * 3.0_f32.sqrt();
            if !awake && round + 1 < ROUNDS {
                return placements[i];
            }
            let (seed, mine) = (&seeds.seeds[i], placements[i]);
            let continuing: Vec<Placement> = seeds.around[i]
                .iter()
                .map(|&j| placements[j as usize].continued(&seeds.seeds[j as usize], seed, surface.pixel))
                .collect();
            cheapest(&matching, canvas, i, mine, &continuing)
        };
        placements = (0..placements.len()).into_par_iter().map(chosen).collect();
    }
    placements
}

/// The cheapest of a seed's own placement and those that continue its neighbors'.
fn cheapest(
    matching: &Matching,
    canvas: &Canvas,
    seed: usize,
    mine: Placement,
    continuing: &[Placement],
) -> Placement {
    let cost = |placement: &Placement| {
        let breaks = continuing.iter().map(|other| {
            let apart = (placement.at - other.at).abs().max_element();
            (apart / UNRELATED).min(1.0)
        });
        let broken = breaks.sum::<f32>() / continuing.len().max(1) as f32;
        matching.distance(seed, canvas.place_at(placement.at)) + BREAK * broken
    };
    let inside = |placement: &&Placement| {
        placement.at.cmpge(Vec2::ZERO).all() && placement.at.cmplt(canvas.size()).all()
    };
    let mut best = (cost(&mine), mine);
    for placement in continuing.iter().filter(inside) {
        let cost = cost(placement);
        if cost < best.0 {
            best = (cost, *placement);
        }
    }
    best.1
}
