//! Size, middle and direction of a scene, measured so that stray Gaussians do not matter.

use crate::{
    Scene,
    bulk::{LARGER, bulk_of, is_within, quantiles, region, without_backdrop},
    frame::Frame,
    morton,
    splat::MIN_ALPHA,
    work::{Canceled, Work},
};
use glam::Vec3;

use super::{
    eye::{Eye, eye},
    up::up,
};

/// Number of Gaussians of the simplified scene: enough to distinguish surfaces from gaps at the size of test
/// views.
pub(super) const N_STAND_IN: usize = 30_000;

/// The share of the mass on either side of the box, along each axis.
const OUTSIDE_BOX: f64 = 0.02;

/// The share of the mass within the radius.
const WITHIN_RADIUS: f32 = 0.97;

/// Distance from the middle within which surfaces tell up, in radii of what is framed.
const TELLS_UP: f32 = 4.0;

/// Size, middle and direction of a scene, and a simplified scene that renders quickly.
pub(super) struct Survey {
    /// A regular selection of the scene's Gaussians, enlarged to fill the gaps.
    pub stand_in: Scene,
    /// Mass of each Gaussian `[n]`, for quantiles: opacity times visible area, with a limit on the area of huge
    /// Gaussians. 0 for those that are not framed.
    pub masses: Vec<f32>,
    /// The middle of the box that holds nearly all mass.
    pub center: Vec3,
    /// Half the box's size, along the world's axes, in scene units.
    pub half_size: Vec3,
    /// Radius of the ball about the middle that holds nearly all mass, in scene units; above 0.
    pub radius: f32,
    /// The up direction, a unit vector.
    pub up: Vec3,
    /// What is framed of the scene.
    pub framed: Framed,
    /// The spot from which the capture was made, if that was within the scene.
    pub eye: Option<Eye>,
}

/// What is framed of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Framed {
    /// All of it, but for a backdrop.
    All,
    /// The part in this box, without its surroundings.
    Dense([Vec3; 2]),
    /// The ball that the scene tells.
    Told,
}

impl Survey {
    /// Surveys a scene by at most `n_stand_in` of its Gaussians, or returns `None` if nothing of it is visible.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn new(scene: &Scene, n_stand_in: usize, work: &Work) -> Result<Option<Self>, Canceled> {
        let stand_in = stand_in(scene, n_stand_in, &work.part(0.0, 0.5))?;
        work.at(0.5)?;
        let masses = masses(&stand_in);
        let is_drawn = |opacity: &f32| *opacity >= MIN_ALPHA;
        if !scene.opacities.iter().any(is_drawn) || masses.iter().all(|&mass| mass <= 0.0) {
            return Ok(None);
        }
        let region = if scene.frame.is_none() { region(scene) } else { None };
        work.at(0.7)?;
        let Some((extent, framed_masses, framed, eye)) = framed(scene.frame, region, &stand_in, &masses)
        else {
            return Ok(None);
        };
        work.at(0.9)?;
        let Extent { center, half_size, radius } = extent;
        // Above 0 even if Gaussians of no size lie in one point, and enough for digits of f32 to be left.
        let radius = radius.max(1e-6 * center.abs().max_element()).max(1e-12);
        let tells_up = |mean: &Vec3| mean.distance(center) < TELLS_UP * radius;
        let near: Vec<f32> = (stand_in.means.iter().zip(&masses))
            .map(|(mean, &mass)| if framed == Framed::All || tells_up(mean) { mass } else { 0.0 })
            .collect();
        let up = up(&stand_in, &near, half_size);
        let eye = eye.map(|eye| eye.above_floor(&stand_in, up));
        Ok(Some(Self { radius, stand_in, masses: framed_masses, center, half_size, up, framed, eye }))
    }
}

/// Where the mass of a scene is.
pub(super) struct Extent {
    pub center: Vec3,
    pub half_size: Vec3,
    pub radius: f32,
}

impl Extent {
    fn of(stand_in: &Scene, masses: &[f32]) -> Option<Self> {
        let [low, high] = bulk_of(&stand_in.means, masses, OUTSIDE_BOX)?;
        let (center, half_size) = ((low + high) / 2.0, (high - low) / 2.0);
        let distances = stand_in
            .means
            .iter()
            .zip(&stand_in.scales)
            .map(|(mean, scales)| (mean - center).length() + scales.max_element());
        let [radius] = quantiles(distances, masses, [WITHIN_RADIUS]);
        Some(Self { center, half_size, radius })
    }
}

/// The part of a scene to frame, which may tell a `frame` or have a dense `region`: its extent, and the masses
/// of the scene's Gaussians `[n]`, which are 0 beyond. If the scene was captured from within, all is framed,
/// and the spot is told.
fn framed(
    frame: Option<Frame>,
    region: Option<[Vec3; 2]>,
    stand_in: &Scene,
    masses: &[f32],
) -> Option<(Extent, Vec<f32>, Framed, Option<Eye>)> {
    let only = |is_framed: &dyn Fn(Vec3) -> bool| -> Option<Vec<f32>> {
        let framed = stand_in.means.iter().zip(masses);
        let framed: Vec<f32> =
            framed.map(|(&mean, &mass)| if is_framed(mean) { mass } else { 0.0 }).collect();
        framed.iter().any(|&mass| mass > 0.0).then_some(framed)
    };
    if let Some(Frame { center, radius }) = frame {
        let extent = Extent { center, half_size: Vec3::splat(radius / 3.0_f32.sqrt()), radius };
        // A ball around nothing is framed as well as any other.
        let framed = only(&|mean| mean.distance(center) < radius).unwrap_or_else(|| masses.to_vec());
        return Some((extent, framed, Framed::Told, None));
    }
    let all = Extent::of(stand_in, masses)?;
    if let Some(region) = region
        && let Some(framed) = only(&|mean| is_within(mean, region))
        && let Some(dense) = Extent::of(stand_in, &framed)
        && all.radius > LARGER * dense.radius
    {
        return Some(match eye(stand_in, &framed, &all, &dense) {
            Some(eye) => (all, masses.to_vec(), Framed::All, Some(eye)),
            None => (dense, framed, Framed::Dense(region), None),
        });
    }
    let eye = eye(stand_in, masses, &all, &all);
    Some((all, masses.to_vec(), Framed::All, eye))
}

/// A scene of at most `n` Gaussians that looks similar from afar, without its backdrop: every so many along the
/// Morton curve, so that it is the same in whatever order a file lists them. The remaining Gaussians are
/// enlarged, so that the total area stays the same.
///
/// # Errors
/// If `work` is canceled.
fn stand_in(scene: &Scene, n: usize, work: &Work) -> Result<Scene, Canceled> {
    work.check()?;
    let near = without_backdrop(scene).unwrap_or_else(|| (0..scene.len() as u32).collect());
    work.at(0.4)?;
    let means: Vec<Vec3> = near.iter().map(|&i| scene.means[i as usize]).collect();
    let stride = near.len().div_ceil(n).max(1);
    let every = morton::order(&means).into_iter().step_by(stride);
    let indices: Vec<u32> = every.map(|i| near[i as usize]).collect();
    // Areas grow with the square of scales, and each Gaussian that is left stands for `stride`.
    let enlarged = (stride as f32).sqrt();
    Ok(Scene {
        means: indices.iter().map(|&i| scene.means[i as usize]).collect(),
        rotations: indices.iter().map(|&i| scene.rotations[i as usize]).collect(),
        scales: indices.iter().map(|&i| scene.scales[i as usize] * enlarged).collect(),
        opacities: indices.iter().map(|&i| scene.opacities[i as usize]).collect(),
        // No colors: only blend weights are computed of this scene, and they do not depend on color.
        n_source: indices.len(),
        up: scene.up,
        filter: scene.filter,
        order: indices,
        ..Default::default()
    })
}

fn masses(scene: &Scene) -> Vec<f32> {
    let areas: Vec<f32> = scene
        .scales
        .iter()
        .map(|scales| {
            let [a, b, c] = scales.to_array();
            (a * b).max(b * c).max(c * a)
        })
        .collect();
    // Backdrops are a few huge Gaussians. They must not outweigh the things before them.
    let [bound] = quantiles(areas.iter().copied(), &vec![1.0; areas.len()], [0.9]);
    areas.iter().zip(&scene.opacities).map(|(area, opacity)| opacity * area.min(bound)).collect()
}
