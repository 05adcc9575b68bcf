//! The up direction of a scene whose file does not give one.
//!
//! Captures do not record gravity, but floors and table tops show it: up is the direction that most surfaces
//! share. Trainers start from COLMAP, and its y axis mostly points down, so that axis is the first guess.

use crate::Scene;
use glam::{Mat3, Vec3};

/// Gaussians flatter than this (thinnest over middle axis) have a normal.
const FLAT: f32 = 0.5;
/// Normals within these cosines of a direction pull it toward them (25, 12 and 8 degrees), one step each.
const PULLING_COSINES: [f32; 6] = [0.906, 0.906, 0.978, 0.978, 0.99, 0.99];
/// Normals within this cosine of a direction belong to its surfaces (12 degrees).
const LEVEL_COSINE: f32 = 0.978;
/// Standard deviations of chance by which the level mass of a direction must exceed that of random normals.
/// Otherwise nothing is known of it. In synthetic scenes of random normals the best direction has 3.4; the
/// table of the bonsai has 6.7.
const EVIDENT: f32 = 5.0;
/// Factor of level mass that another axis needs over y to replace it. Chest and back of a man who stands have
/// 2.5 times as much as floors and soles. The table of the bonsai has 3.8 times as much as one of the axes
/// within it.
const PRIOR_OF_Y: f32 = 3.0;
/// A scene thinner than this along another axis, relative to its larger extents, is a panel that could stand
/// upright.
const PANEL: f32 = 0.25;
/// Factor of level mass on one side over the other from which on it decides where down is, instead of the
/// convention.
const FLOOR_OVER_CEILING: f32 = 2.0;
/// Least share of all mass that counts as a floor.
const FLOOR_SHARE: f32 = 0.1;

/// A unit vector: the scene's own `up`, or a guess. `half_size` is half the scene's box, along the world's
/// axes.
pub(super) fn up(scene: &Scene, masses: &[f32], half_size: Vec3) -> Vec3 {
    if let Some(up) = scene.up.and_then(Vec3::try_normalize) {
        return up;
    }
    let normals = normals(scene, masses);
    // The conventions: y down (3DGS), z up (Blender); x up is not used by anyone.
    let evident = evident_mass(&normals);
    let [x, y, z] = [Vec3::X, Vec3::NEG_Y, Vec3::Z].map(|custom| {
        let axis = refined(custom, &normals);
        (axis, level_mass(axis, &normals))
    });
    let (rival, half_height) = if x.1 > z.1 { (x, half_size.x) } else { (z, half_size.z) };
    // A panel's normals all point one way, which is no sign that it lies flat.
    let is_panel = half_height < PANEL * half_size.max_element();
    let axis = if rival.1 > (PRIOR_OF_Y * y.1).max(evident) && !is_panel {
        rival.0
    } else if y.1 > evident {
        y.0
    } else {
        Vec3::NEG_Y
    };
    if is_upside_down(axis, &normals) { -axis } else { axis }
}

/// A flat Gaussian: its position, its normal (of either sign) and its mass.
struct Surface {
    at: Vec3,
    normal: Vec3,
    mass: f32,
}

fn normals(scene: &Scene, masses: &[f32]) -> Vec<Surface> {
    let surface = |i: usize| {
        let scales = scene.scales[i];
        let thinnest = if scales.x <= scales.y && scales.x <= scales.z {
            0
        } else if scales.y <= scales.z {
            1
        } else {
            2
        };
        let [low, middle] = {
            let mut sorted = scales.to_array();
            sorted.sort_by(f32::total_cmp);
            [sorted[0], sorted[1]]
        };
        // The thinnest axis of the ellipsoid, in the world.
        let normal = Mat3::from_quat(scene.rotations[i]).col(thinnest);
        (low < FLAT * middle).then_some(Surface { at: scene.means[i], normal, mass: masses[i] })
    };
    (0..scene.len()).filter_map(surface).collect()
}

/// The direction near `axis` in which normals cluster: a few steps of mean shift.
fn refined(axis: Vec3, surfaces: &[Surface]) -> Vec3 {
    PULLING_COSINES.into_iter().fold(axis, |axis, near| {
        let pull = |surface: &Surface| {
            let cosine = surface.normal.dot(axis);
            // A normal has no sign of its own. It takes the axis' before it is added.
            if cosine.abs() < near { Vec3::ZERO } else { surface.mass * cosine.signum() * surface.normal }
        };
        surfaces.iter().map(pull).sum::<Vec3>().try_normalize().unwrap_or(axis)
    })
}

/// The level mass from which on a direction is no chance. With m the masses and p the share of directions that
/// are level, 1 - [`LEVEL_COSINE`], that of random normals has
///
/// ```text
/// mean p sum m, variance p (1 - p) sum m^2
/// ```
///
/// The two largest Gaussians are no evidence by themselves: they may be pieces of a sky.
fn evident_mass(surfaces: &[Surface]) -> f32 {
    let sum = |power: i32| surfaces.iter().map(|surface| surface.mass.powi(power)).sum::<f32>();
    let largest = surfaces.iter().map(|surface| surface.mass).fold(0.0, f32::max);
    let share = 1.0 - LEVEL_COSINE;
    share * sum(1) + EVIDENT * (share * (1.0 - share) * sum(2)).sqrt() + 2.0 * largest
}

fn level_mass(axis: Vec3, surfaces: &[Surface]) -> f32 {
    let level = surfaces.iter().filter(|surface| surface.normal.dot(axis).abs() > LEVEL_COSINE);
    level.map(|surface| surface.mass).sum()
}

/// Whether level surfaces lie above everything else. Then the guess is upside down, because things stand on
/// floors.
fn is_upside_down(axis: Vec3, surfaces: &[Surface]) -> bool {
    let total: f32 = surfaces.iter().map(|surface| surface.mass).sum();
    // NaN without surfaces. No comparison with it is true, so the axis stays as it is.
    let middle = surfaces.iter().map(|surface| surface.mass * surface.at.dot(axis)).sum::<f32>() / total;
    let side = |sign: f32| -> f32 {
        let there = surfaces.iter().filter(|surface| sign * (surface.at.dot(axis) - middle) > 0.0);
        there
            .filter(|surface| surface.normal.dot(axis).abs() > LEVEL_COSINE)
            .map(|surface| surface.mass)
            .sum()
    };
    let above = side(1.0);
    above > FLOOR_SHARE * total && above > FLOOR_OVER_CEILING * side(-1.0)
}
