//! The place in the painting that each seed takes.

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::{
    canvas::{CLEAR, Canvas},
    direction::Direction,
    patch::PATCH,
    seeds::Seed,
    surface::Surface,
};
use crate::{
    decoder::product::{Matrix, dot, product},
    strokes::IN_PLANE,
};

/// Numbers of a descriptor: a patch without its mean, and a mean color.
const WIDTH: usize = 3 * PATCH + 3;

/// Weight of colors (0..1), both of means and of patches.
const COLOR_WEIGHT: f32 = 3.0;

/// Width of the rim that seeds avoid, in pixels: it holds frames, and mirroring repeats it.
const RIM: f32 = 18.0;

/// Cost of a place in the rim, relative to that of a usual best match.
const IN_RIM: f32 = 6.0;

/// Energy over the mean above which a place counts as a motif, and not as strokes.
const MOTIF: f32 = 1.5;

/// Cost of a place that was taken three times as often as usual.
const CROWDED: f32 = 0.2;

/// Side of the blocks in which uses of places are counted, in places.
const BLOCK: usize = 4;

/// Distance from a neighbor's continuation, in pixels, beyond which places count as unrelated.
const UNRELATED: f32 = 12.0;

/// Descriptors of seeds or of places. Their squared difference is the dissimilarity of two.
pub(super) struct Descriptors {
    /// `[n, WIDTH]`.
    rows: Vec<f32>,
    /// The square of each `[n]`.
    squares: Vec<f32>,
}

impl Descriptors {
    /// Descriptors of the colors of patches, and of mean colors.
    pub fn new(patches: impl Iterator<Item = ([Vec3; PATCH], Vec3)>) -> Self {
        let weight = COLOR_WEIGHT / (PATCH as f32).sqrt();
        let mut rows = Vec::new();
        for (colors, mean) in patches {
            let middle = colors.iter().sum::<Vec3>() / PATCH as f32;
            rows.extend(colors.iter().flat_map(|color| ((*color - middle) * weight).to_array()));
            rows.extend((mean * COLOR_WEIGHT).to_array());
        }
        let squares = rows.chunks_exact(WIDTH).map(|row| dot(row, row)).collect();
        Self { rows, squares }
    }

    /// Those of these numbers.
    pub fn some(&self, numbers: &[u32]) -> Self {
        let row = |&i: &u32| &self.rows[i as usize * WIDTH..][..WIDTH];
        Self {
            rows: numbers.iter().flat_map(row).copied().collect(),
            squares: numbers.iter().map(|&i| self.squares[i as usize]).collect(),
        }
    }

    /// Squared distances from each to each of `others` `[n, m]`.
    pub fn distances(&self, others: &Self) -> Vec<f32> {
        let (n, m) = (self.squares.len(), others.squares.len());
        let mut distances = vec![0.0; n * m];
        let (own, other) = (Matrix::dense(&self.rows, n, WIDTH), Matrix::dense(&others.rows, m, WIDTH));
        product(&mut distances, false, own, other.transposed());
        for (row, square) in distances.chunks_exact_mut(m.max(1)).zip(&self.squares) {
            for (distance, other) in row.iter_mut().zip(&others.squares) {
                *distance = (square + other - 2.0 * *distance).max(0.0);
            }
        }
        distances
    }
}

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

/// A seed whose place is given.
pub(super) struct Placed {
    pub seed: u32,
    pub painting: usize,
    pub placement: Placement,
}

impl Placement {
    /// Lays `place` on the surface at `seed`: strokes along a given direction, or else along the edges of the
    /// scene, if both are clear, else upright.
    pub fn on(seed: &Seed, place: usize, canvas: &Canvas, direction: Option<Direction>) -> Self {
        let (stroke, clarity) = canvas.strokes[place];
        let along = match direction {
            Some(direction) => {
                let in_plane = direction.at(seed.at).reject_from_normalized(seed.normal);
                in_plane.try_normalize().filter(|_| in_plane.length() > IN_PLANE)
            }
            None => Some(seed.along).filter(|_| seed.clarity > CLEAR),
        };
        // The painting's up is -y in pixels.
        let upright = (Vec2::NEG_Y, seed.up);
        let (stroke, along) = along.filter(|_| clarity > CLEAR).map_or(upright, |along| (stroke, along));
        let beside = seed.normal.cross(along);
        Self {
            at: canvas.center_of(place),
            right: along * stroke.x - beside * stroke.y,
            down: along * stroke.y + beside * stroke.x,
        }
    }

    /// The same paint continued from one seed to another.
    pub fn continued(&self, from: &Seed, to: &Seed, pixel: f32) -> Self {
        let right = self.right.reject_from_normalized(to.normal);
        let right = right.try_normalize().unwrap_or(to.along);
        let down = self.down.reject_from_normalized(to.normal).reject_from_normalized(right);
        let down = down.try_normalize().unwrap_or_else(|| to.normal.cross(right));
        let offset = to.at - from.at;
        let at = self.at + Vec2::new(offset.dot(self.right), offset.dot(self.down)) / pixel;
        Self { at, right, down }
    }
}

/// Colors of a Gaussian and of a seed as a painting has them, by the numbers of the painting and of either.
pub(super) struct Hues<'a> {
    pub gaussian: &'a (dyn Fn(usize, usize) -> Vec3 + Sync),
    pub seed: &'a (dyn Fn(usize, usize) -> Vec3 + Sync),
}

/// The placement of each seed `[M]` in its painting, whose numbers are `labels` `[M]`. Strokes follow
/// `direction` if there is one. Seeds that are `placed` have their place, which their neighbors may continue.
///
/// Each other seed in turn, neighbors one after another, takes the cheapest of its best place and those that
/// continue the places of neighbors in the same painting: a place costs more the less it resembles the seed,
/// the less strokes it has, the more it is a motif, the more often it was taken, and the more neighbors it
/// breaks with.
pub(super) fn place(
    surface: &Surface,
    paintings: &[&Canvas],
    labels: &[u8],
    hues: &Hues,
    direction: Option<Direction>,
    placed: &[Placed],
) -> Vec<Placement> {
    let seeds = &surface.seeds.seeds;
    let mut placements: Vec<Option<Placement>> = vec![None; seeds.len()];
    for Placed { seed, placement, .. } in placed {
        placements[*seed as usize] = Some(*placement);
    }
    // Most small parts of a scene have no seeds of their own.
    if placements.iter().all(Option::is_some) {
        return placements.into_iter().flatten().collect();
    }
    let mut searches: Vec<Search> = (0..paintings.len())
        .map(|painting| {
            let own = |j: &u32| usize::from(labels[*j as usize]) == painting;
            let of_painting: Vec<u32> = (0..seeds.len() as u32).filter(own).collect();
            Search::new(surface, paintings[painting], (painting, of_painting), &placements, hues, direction)
        })
        .collect();
    for &j in &surface.seeds.order {
        let j = j as usize;
        if placements[j].is_some() {
            continue;
        }
        let search = &mut searches[usize::from(labels[j])];
        let continuing: Vec<Placement> = surface.seeds.around[j]
            .iter()
            .filter(|i| labels[**i as usize] == labels[j])
            .filter_map(|&i| {
                Some(placements[i as usize]?.continued(&seeds[i as usize], &seeds[j], surface.pixel))
            })
            .collect();
        placements[j] = Some(search.best(j, &seeds[j], &continuing));
    }
    // The order has every seed.
    placements.into_iter().flatten().collect()
}

/// The search for places in one painting.
struct Search<'a> {
    canvas: &'a Canvas,
    /// Dissimilarity of each place and each of the painting's seeds without a place `[m, P]`: 1 for a usual
    /// best match.
    costs: Vec<f32>,
    /// The row of each seed among them.
    rows: FxHashMap<u32, usize>,
    quality: Vec<f32>,
    blocks: Blocks,
    /// Direction of strokes, if one is given.
    direction: Option<Direction<'a>>,
}

impl<'a> Search<'a> {
    /// The search for places of a painting of this number for these seeds, some of which may have their
    /// `placements` already.
    fn new(
        surface: &Surface,
        canvas: &'a Canvas,
        (painting, seeds): (usize, Vec<u32>),
        placements: &[Option<Placement>],
        hues: &Hues,
        direction: Option<Direction<'a>>,
    ) -> Self {
        let n_places = canvas.n_places.0 * canvas.n_places.1;
        let mut blocks = Blocks::new(canvas.n_places, seeds.len());
        for there in seeds.iter().filter_map(|j| placements[*j as usize]) {
            blocks.take(canvas.place_at(there.at));
        }
        let sought: Vec<u32> = seeds.into_iter().filter(|j| placements[*j as usize].is_none()).collect();
        Self {
            costs: costs(surface, canvas, (painting, &sought), hues, direction),
            quality: (0..n_places).map(|place| quality(canvas, place)).collect(),
            blocks,
            rows: sought.into_iter().zip(0..).collect(),
            canvas,
            direction,
        }
    }

    /// The placement of seed `j`, beside those that continue its neighbors. It counts as taken.
    fn best(&mut self, j: usize, seed: &Seed, continuing: &[Placement]) -> Placement {
        let n_places = self.quality.len();
        let row = &self.costs[self.rows[&(j as u32)] * n_places..][..n_places];
        let cost = |place: usize| row[place] + self.quality[place] + self.blocks.cost(place);
        let broken = |at: Vec2| {
            let apart = |other: &Placement| ((at - other.at).abs().max_element() / UNRELATED).min(1.0);
            continuing.iter().map(apart).sum::<f32>() / continuing.len().max(1) as f32
        };
        let best = (0..n_places).fold((f32::INFINITY, 0), |best, place| {
            let cost = cost(place);
            if cost < best.0 { (cost, place) } else { best }
        });
        let own = Placement::on(seed, best.1, self.canvas, self.direction);
        let mut chosen = (best.0 + broken(own.at), own);
        for other in continuing.iter().filter(|other| inside(self.canvas, other.at)) {
            let cost = cost(self.canvas.place_at(other.at)) + broken(other.at);
            if cost < chosen.0 {
                chosen = (cost, self.along(seed, *other));
            }
        }
        self.blocks.take(self.canvas.place_at(chosen.1.at));
        chosen.1
    }

    /// A continued placement, with strokes along the curve if there is one: it turns from seed to seed.
    fn along(&self, seed: &Seed, continued: Placement) -> Placement {
        match self.direction {
            Some(Direction::Curve(_)) => {
                let place = self.canvas.place_at(continued.at);
                Placement { at: continued.at, ..Placement::on(seed, place, self.canvas, self.direction) }
            }
            _ => continued,
        }
    }
}

/// Whether a position in pixels is inside of the painting's rim.
fn inside(canvas: &Canvas, at: Vec2) -> bool {
    at.cmpge(Vec2::splat(RIM)).all() && at.cmplt(canvas.size - RIM).all()
}

/// Descriptors of these seeds in the colors of a painting, upright (0) or along their direction (1).
pub(super) fn of_seeds(
    surface: &Surface,
    painting: usize,
    seeds: &[u32],
    aligned: usize,
    hues: &Hues,
) -> Descriptors {
    let patch = |&j: &u32| {
        let colors = surface.patches[aligned][j as usize].map(|i| (hues.gaussian)(painting, i as usize));
        (colors, (hues.seed)(painting, j as usize))
    };
    Descriptors::new(seeds.par_iter().map(patch).collect::<Vec<_>>().into_iter())
}

/// Dissimilarity of each place and each of these seeds `[m, P]`: 1 for a usual best match.
fn costs(
    surface: &Surface,
    canvas: &Canvas,
    (painting, seeds): (usize, &[u32]),
    hues: &Hues,
    direction: Option<Direction>,
) -> Vec<f32> {
    let n_places = canvas.n_places.0 * canvas.n_places.1;
    let of =
        |aligned: usize| of_seeds(surface, painting, seeds, aligned, hues).distances(&canvas.places[aligned]);
    let (mut upright, aligned) = rayon::join(|| of(0), || of(1));
    let mut typical = 0.0;
    for (row, &j) in seeds.iter().enumerate() {
        let first = row * n_places;
        let row = &mut upright[first..first + n_places];
        // Along a given direction, no patch was looked at.
        if direction.is_none() && surface.seeds.seeds[j as usize].clarity > CLEAR {
            for (place, cost) in row.iter_mut().enumerate() {
                if canvas.strokes[place].1 > CLEAR {
                    *cost = aligned[first + place];
                }
            }
        }
        typical += (row.iter().copied().enumerate())
            .filter(|(place, _)| canvas.is_used(*place))
            .map(|(_, cost)| cost)
            .fold(f32::INFINITY, f32::min);
    }
    let typical = (typical / seeds.len().max(1) as f32).max(1e-6);
    upright.iter_mut().for_each(|cost| *cost /= typical);
    upright
}

/// The cost of a place, whichever seed takes it: infinite if it may not be used.
pub(super) fn quality(canvas: &Canvas, place: usize) -> f32 {
    if !canvas.is_used(place) {
        return f32::INFINITY;
    }
    let at = canvas.center_of(place);
    let energy = (canvas.detail.energy_at(at) / canvas.detail.typical).sqrt();
    let rim = if inside(canvas, at) { 0.0 } else { IN_RIM };
    rim + (1.0 - energy).max(0.0).powi(2) + (energy - MOTIF).max(0.0)
}

/// How often places were taken, block by block.
struct Blocks {
    columns: usize,
    /// Columns of places.
    n_x: usize,
    taken: Vec<f32>,
    usual: f32,
}

impl Blocks {
    fn new((n_x, n_y): (usize, usize), n_seeds: usize) -> Self {
        let (columns, rows) = (n_x.div_ceil(BLOCK), n_y.div_ceil(BLOCK));
        let n = columns * rows;
        Self { columns, n_x, taken: vec![0.0; n], usual: (n_seeds as f32 / n as f32).max(1.0) }
    }

    fn block(&self, place: usize) -> usize {
        place / self.n_x / BLOCK * self.columns + place % self.n_x / BLOCK
    }

    fn cost(&self, place: usize) -> f32 {
        CROWDED * (self.taken[self.block(place)] / (3.0 * self.usual)).powi(2)
    }

    fn take(&mut self, place: usize) {
        let block = self.block(place);
        self.taken[block] += 1.0;
    }
}
