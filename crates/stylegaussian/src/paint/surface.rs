//! All that paint needs of a scene, whatever the style.

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::{
    frames::{Frames, outer},
    patch::{PATCH, STEP, offset_in_patch},
    proofs::Proofs,
    seeds::{Ground, Nearest, Seed, Seeds, Shared},
    sight::{Sight, usual_views},
    smooth::Grid,
};
use crate::{
    camera::Camera,
    morton,
    neighbors::Neighbors,
    palette::LUMINANCE,
    recolor::ColorMoments,
    scene::Scene,
    work::{Canceled, Work},
};

/// Distance between seeds, in pixels of the painting: about the length of a stroke in a painting of 512 pixels.
/// At twice as much, whole motifs fit on a spot.
const SPACING: f32 = 28.0;

/// Standard deviations of the scene's smoothed colors, in pixels of the painting: without grain, without detail
/// smaller than a stroke, and shapes alone.
const SMOOTH: [f32; 3] = [2.0, 4.0, 8.0];

/// Standard deviation over which contrast is measured, in pixels of the painting.
const AROUND_EDGES: f32 = 2.5;

/// Standard deviation over which contrast counts as usual there, in pixels of the painting.
const AROUND_TEXTURE: f32 = 24.0;

/// Shares of the time that the choice of views takes, and looking through them of what is left.
const VIEWS: f32 = 0.3;
const SIGHT: f32 = 0.5;

/// Neighbors that normals and directions are averaged over.
const N_NEIGHBORS: usize = 8;

/// Least visibility of a Gaussian in a patch, in pixels of usual views.
const SEEN: f32 = 0.02;

/// Distance from a patch's point, in steps, beyond which a Gaussian does not belong to it.
const BESIDE: f32 = 2.5;

/// The surfaces of a scene: their directions, seeds and colors. Computed once per scene, for every style.
pub struct Surface {
    pub(super) seeds: Seeds,
    /// The numbers that its first seeds have in the scene that it is a part of. None if it is no part.
    pub(super) shared: Vec<u32>,
    /// Whether the scene stands beside a painted one, or is a part of it.
    pub(super) is_beside: bool,
    /// Size of a pixel of the painting, in scene units.
    pub(super) pixel: f32,
    /// The direction that is up, a unit vector.
    up: Vec3,
    /// Pixels of usual views that each Gaussian fills `[N]`.
    pub(super) visibility: Vec<f32>,
    /// Base colors, with and without detail smaller than a stroke `[N]`.
    pub(super) base: Vec<Vec3>,
    pub(super) low: Vec<Vec3>,
    /// Contrast around each Gaussian: the mean of d d^T, where d is the color's detail between grain and shapes
    /// `[N]`.
    pub(super) edges: Vec<Square>,
    /// This contrast over the usual one there, in luminance `[N]`: about 1 in texture, 7 at a lone edge.
    pub(super) lone: Vec<f32>,
    /// Pictures by which paint is measured.
    pub(super) proofs: Proofs,
    /// Gaussians under a patch around each seed, upright and along its direction `[M]` each.
    pub(super) patches: [Vec<[u32; PATCH]>; 2],
    /// Moments of the base colors, as pictures show them.
    pub(super) moments: ColorMoments,
}

/// A symmetric matrix: its diagonal, and xy, yz, zx.
#[derive(Clone, Copy, Debug)]
pub(super) struct Square {
    pub diagonal: Vec3,
    pub beside: Vec3,
}

impl Surface {
    /// The surfaces of `scene`, whatever the order of its Gaussians. Takes about a second for 70,000 Gaussians
    /// on two cores.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn new(scene: &Scene, work: &Work) -> Result<Self, Canceled> {
        Self::in_order(scene, |sorted| {
            let cameras = usual_views(sorted, work)?;
            work.at(VIEWS)?;
            Self::of(sorted, &cameras, &work.part(VIEWS, 1.0))
        })
    }

    /// The surfaces of `scene` as `cameras` show them: a few of its capture's, or chosen ones if those are not
    /// known ([`choose_overviews`](crate::views::choose_overviews)), the most useful first. The first eight
    /// count.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn seen_from(scene: &Scene, cameras: &[Camera], work: &Work) -> Result<Self, Canceled> {
        Self::in_order(scene, |sorted| Self::of(sorted, cameras, work))
    }

    /// The result of `compute` on the Gaussians in Morton order, for the order of `scene`. Of equal seeds and
    /// candidates the first wins, so another order would give other places.
    fn in_order(
        scene: &Scene,
        compute: impl FnOnce(&Scene) -> Result<Self, Canceled>,
    ) -> Result<Self, Canceled> {
        let order = morton::order(&scene.means);
        if order.is_sorted() {
            return compute(scene);
        }
        let mut surface = compute(&surfaces_of(scene, &order))?;
        let mut rows = vec![0; order.len()];
        for (row, &i) in (0..).zip(&order) {
            rows[i as usize] = row;
        }
        surface.visibility = in_rows(&surface.visibility, &rows);
        surface.base = in_rows(&surface.base, &rows);
        surface.low = in_rows(&surface.low, &rows);
        surface.edges = in_rows(&surface.edges, &rows);
        surface.lone = in_rows(&surface.lone, &rows);
        surface.seeds.owners = in_rows(&surface.seeds.owners, &rows);
        for i in surface.patches.iter_mut().flatten().flatten() {
            *i = order[*i as usize];
        }
        surface.proofs.renumber(&order);
        Ok(surface)
    }

    /// The surfaces of `scene`, which stands beside the one that `painted` is of: strokes are as large as
    /// there, and colors change as there. `scale` is the size of the other's unit in units of this scene, above
    /// 0. All of it counts as seen, from the front, and nothing is rendered. Up is as there, unless the scene
    /// tells it.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn beside(scene: &Scene, painted: &Self, scale: f32, work: &Work) -> Result<Self, Canceled> {
        Self::in_order(scene, |sorted| {
            let sight = Sight::from_the_front(sorted, painted.pixel * scale, painted.up, work)?;
            let spacing = SPACING * sight.pixel;
            Self::seen(sorted, (sight, spacing), Some((painted, Vec::new())), work)
        })
    }

    /// The surfaces of a part of the scene that `whole` is of, at any level of detail, in the same space:
    /// [beside](Self::beside) the whole, and on its seeds. New ones are made only where none of them is near.
    /// So levels of a part have the same strokes, and parts that touch have them in common at their border.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn part_of(scene: &Scene, whole: &Self, work: &Work) -> Result<Self, Canceled> {
        Self::in_order(scene, |sorted| {
            let sight = Sight::from_the_front(sorted, whole.pixel, whole.up, work)?;
            let shared = sorted.bounds().map_or_else(Vec::new, |bounds| whole.seeds.near(bounds));
            Self::seen(sorted, (sight, whole.seeds.spacing), Some((whole, shared)), work)
        })
    }

    /// Size of a pixel of the painting, in scene units. Seeds are 28 pixels apart.
    pub fn pixel(&self) -> f32 {
        self.pixel
    }

    /// The surfaces of a scene in Morton order.
    fn of(scene: &Scene, cameras: &[Camera], work: &Work) -> Result<Self, Canceled> {
        let sight = Sight::of(scene, cameras, &work.part(0.0, SIGHT))?;
        work.at(SIGHT)?;
        let spacing = SPACING * sight.pixel;
        Self::seen(scene, (sight, spacing), None, work)
    }

    /// The surfaces of a scene in Morton order, as it is seen, with seeds this far apart. Moments are those of
    /// its pictures, or those of the surface beside it, whose seeds of these numbers it shares.
    fn seen(
        scene: &Scene,
        (sight, spacing): (Sight, f32),
        beside: Option<(&Self, Vec<u32>)>,
        work: &Work,
    ) -> Result<Self, Canceled> {
        let pixel = sight.pixel;
        let found;
        let neighbors = match &scene.neighbors {
            Some(neighbors) if neighbors.k >= N_NEIGHBORS => neighbors,
            _ => {
                found = Neighbors::find_if_wanted(&scene.means, &scene.order, N_NEIGHBORS, work)?;
                &found
            }
        };
        let base: Vec<Vec3> = scene.base_colors().into_iter().map(Vec3::from).collect();
        let grid = |size: f32| Grid::new(&scene.means, size * pixel);
        let level = |size: &f32| work.check().map(|()| grid(*size).smooth(&base, &sight.visibility));
        let levels: Vec<Vec<Vec3>> = SMOOTH.par_iter().map(level).collect::<Result<_, _>>()?;
        work.at(0.8)?;
        let [soft, low, shapes] = levels.try_into().unwrap_or_default();
        work.check()?;
        let (frames, edges) = rayon::join(
            || Frames::new(scene, neighbors, &base),
            || edges(&soft, &shapes, &grid(AROUND_EDGES), &sight.visibility),
        );
        work.at(0.9)?;
        let lone = lone(&edges, &grid(AROUND_TEXTURE), &sight.visibility);
        let is_beside = beside.is_some();
        let (moments, of_other, shared) = match beside {
            Some((other, shared)) => (other.moments, other.seeds.to_share(&shared), shared),
            None => {
                let moments = moments(&sight.proofs.pixels(&base), &sight.visibility, &base);
                (moments, Shared::default(), Vec::new())
            }
        };
        let ground = Ground {
            means: &scene.means,
            visibility: &sight.visibility,
            frames: &frames,
            base: &base,
            soft: &soft,
            contrast: moments.deviation_along(LUMINANCE),
            up: sight.up,
        };
        let seeds = Seeds::new(&ground, &of_other, spacing);
        work.check()?;
        let patches = patches(&scene.means, &sight.visibility, &seeds.seeds, STEP * pixel);
        Ok(Self {
            seeds,
            shared,
            is_beside,
            pixel,
            up: sight.up,
            base,
            low,
            edges,
            lone,
            proofs: sight.proofs,
            visibility: sight.visibility,
            patches,
            moments,
        })
    }

    /// N, the number of Gaussians.
    pub fn len(&self) -> usize {
        self.base.len()
    }

    /// Whether the scene has no Gaussian.
    pub fn is_empty(&self) -> bool {
        self.base.is_empty()
    }

    /// M, the number of seeds.
    pub fn n_seeds(&self) -> usize {
        self.seeds.seeds.len()
    }
}

/// The input of a surface: the Gaussians of `scene` at `order`, without harmonics and features.
fn surfaces_of(scene: &Scene, order: &[u32]) -> Scene {
    let mut sorted = Scene {
        means: in_rows(&scene.means, order),
        rotations: in_rows(&scene.rotations, order),
        scales: in_rows(&scene.scales, order),
        opacities: in_rows(&scene.opacities, order),
        order: in_rows(&scene.order, order),
        n_source: scene.n_source,
        cameras: scene.cameras.clone(),
        frame: scene.frame,
        up: scene.up,
        filter: scene.filter,
        ..Scene::default()
    };
    sorted.set_colors(&in_rows(&scene.base_colors(), order));
    sorted
}

/// The values at `rows`.
fn in_rows<T: Copy>(values: &[T], rows: &[u32]) -> Vec<T> {
    rows.iter().map(|&row| values[row as usize]).collect()
}

impl Square {
    /// The scalar product with a symmetric matrix: the mean of d^T Q d.
    pub fn dot(&self, matrix: &Mat3) -> f32 {
        let diagonal = Vec3::new(matrix.x_axis.x, matrix.y_axis.y, matrix.z_axis.z);
        let beside = Vec3::new(matrix.x_axis.y, matrix.y_axis.z, matrix.z_axis.x);
        self.diagonal.dot(diagonal) + 2.0 * self.beside.dot(beside)
    }
}

/// Weighted means of the squared differences between `soft` and `shapes`.
fn edges(soft: &[Vec3], shapes: &[Vec3], grid: &Grid, weights: &[f32]) -> Vec<Square> {
    let mean = |product: fn(Vec3) -> Vec3| {
        let products: Vec<Vec3> = soft.iter().zip(shapes).map(|(a, b)| product(*a - *b)).collect();
        grid.smooth(&products, weights)
    };
    let (diagonal, beside) = rayon::join(|| mean(|d| d * d), || mean(|d| d * Vec3::new(d.y, d.z, d.x)));
    diagonal.into_iter().zip(beside).map(|(diagonal, beside)| Square { diagonal, beside }).collect()
}

/// Contrast over the weighted mean around it.
fn lone(edges: &[Square], grid: &Grid, weights: &[f32]) -> Vec<f32> {
    let luminance = outer(LUMINANCE, LUMINANCE);
    let own: Vec<Vec3> = edges.iter().map(|edges| Vec3::splat(edges.dot(&luminance).max(0.0))).collect();
    let around = grid.smooth(&own, weights);
    own.iter().zip(&around).map(|(own, around)| own.x / around.x.max(1e-9)).collect()
}

/// Gaussians under the patches of seeds: the nearest visible ones.
fn patches(means: &[Vec3], visibility: &[f32], seeds: &[Seed], step: f32) -> [Vec<[u32; PATCH]>; 2] {
    let is_seen = |i: &u32| visibility[*i as usize] > SEEN;
    let mut seen: Vec<u32> = (0..means.len() as u32).filter(is_seen).collect();
    if seen.is_empty() {
        seen = (0..means.len() as u32).collect();
    }
    let points: Vec<Vec3> = seen.iter().map(|&i| means[i as usize]).collect();
    let Some(nearest) = Nearest::new(&points) else { return [Vec::new(), Vec::new()] };
    let patch = |seed: &Seed, along: Vec3| {
        let beside = seed.normal.cross(along);
        let own = nearest.one(seed.at).0;
        std::array::from_fn(|k| {
            let (a, b) = offset_in_patch(k);
            let (found, squared) = nearest.one(seed.at + (along * a + beside * b) * step);
            seen[if squared < (BESIDE * step).powi(2) { found } else { own } as usize]
        })
    };
    [
        seeds.par_iter().map(|seed| patch(seed, seed.up)).collect(),
        seeds.par_iter().map(|seed| patch(seed, seed.along)).collect(),
    ]
}

/// Moments of the pixels `shown` in pictures of these `colors` `[N]`, or of the Gaussians by visibility if
/// there are none.
pub(super) fn moments(shown: &[Vec3], visibility: &[f32], colors: &[Vec3]) -> ColorMoments {
    match shown.is_empty() {
        true => ColorMoments::of_weighted(colors.iter().copied().zip(visibility.iter().copied())),
        false => ColorMoments::of_weighted(shown.iter().map(|color| (*color, 1.0))),
    }
}
