//! A mesh beside the scene, in the same paint: a ball in the scene's own colors.

use std::f32::consts::{PI, TAU};

use glam::Vec3;
use stylegaussian::{
    Camera, Scene,
    mesh::{MeshPaint, SPACING, Split, Spots, draw},
    paint::{Canvas, Company, Hand, Painted, Surface, lay_beside},
    splat::RenderedImage,
    strokes::PlainSeed,
    views::framing,
    work::{Canceled, Work},
};

use crate::error::TrainError;

/// Radius of the ball over that of the ball that cameras frame: every camera that was chosen from outside sees
/// all of it. Cameras of a capture may see a part, and those within it see it from inside.
const SHARE: f32 = 0.7;

/// Cells around the ball's axis and along it, of its mesh before that is split, and of its colors.
const CELLS: [usize; 2] = [48, 24];

/// A ball in the middle of a scene.
pub(super) struct Ball<'a> {
    surface: &'a Surface,
    center: Vec3,
    own: Surroundings,
    split: Split,
    spots: Spots,
    /// The color of each vertex.
    colors: Vec<[f32; 3]>,
}

impl<'a> Ball<'a> {
    /// The ball of a scene, whose surface is `surface`.
    ///
    /// # Errors
    /// If nothing of the scene is visible.
    pub fn new(scene: &Scene, surface: &'a Surface) -> Result<Self, TrainError> {
        let Some(framing) = framing(scene) else {
            return Err(TrainError::Invalid(format!(
                "found nothing visible among {} Gaussians, expected a scene that a mesh can stand in",
                scene.len()
            )));
        };
        let (center, radius) = (framing.frame.center, SHARE * framing.frame.radius);
        let spacing = SPACING * surface.pixel();
        let (corners, triangles) = unit_ball();
        let corners = corners.into_iter().map(|at| center + radius * at).collect();
        let split = Split::new(corners, triangles, spacing, &Work::default()).map_err(caused)?;
        // The middle of an edge is below the ball.
        let normals: Vec<Vec3> =
            split.positions.iter().map(|at| (at - center).normalize_or(Vec3::Y)).collect();
        let positions = normals.iter().map(|normal| center + radius * normal).collect();
        let split = Split { positions, ..split };
        let own = Surroundings::new(scene, center);
        let colors: Vec<[f32; 3]> = normals.iter().map(|normal| own.toward(*normal).to_array()).collect();
        let spots = Spots::new(&split, Some(&normals), &colors, spacing, framing.up);
        Ok(Self { surface, center, own, split, spots, colors })
    }

    /// The ball in the paint of a canvas, of which the scene is `painted`.
    ///
    /// # Errors
    /// If the scene has no strokes of it.
    pub fn paint(&self, canvas: &Canvas, painted: &Painted) -> Result<MeshPaint, TrainError> {
        let (work, paintings, hand) = (Work::default(), [(canvas, 1.0)], Hand::default());
        let company =
            Company::new(self.surface, &paintings, &hand, &painted.strokes, &work).map_err(caused)?;
        let Some(company) = company else {
            return Err(TrainError::Invalid("found no strokes on the scene, expected a painted one".into()));
        };
        let beside = Surface::beside(&self.spots.scene, self.surface, 1.0, &work).map_err(caused)?;
        let how = (&hand, 0.0, &company);
        let laid = lay_beside(&self.spots.scene, &beside, &paintings, how, &work).map_err(caused)?;
        Ok(MeshPaint::new(&self.split, &self.spots, laid))
    }

    /// The same ball in its own colors.
    pub fn bare(&self, paint: &MeshPaint) -> MeshPaint {
        let mut bare = paint.clone();
        bare.colors = self.spots.scene.base_colors();
        for seed in &mut bare.strokes.seeds {
            *seed = PlainSeed { fine: 0.0, wide: 0.0, ..seed.plain() }.packed();
        }
        bare
    }

    /// The ball as a camera sees it.
    pub fn draw(&self, paint: &MeshPaint, camera: &Camera) -> RenderedImage {
        let own_at = |at: Vec3| self.own.toward((at - self.center).normalize_or(Vec3::Y));
        draw((&self.split, &self.spots), paint, (&self.colors[..], own_at), camera)
    }
}

fn caused(canceled: Canceled) -> TrainError {
    TrainError::Caused(canceled.into())
}

/// The corners and triangles of a ball of radius 1 around the origin. Those of its seam are there twice.
fn unit_ball() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let [around, along] = CELLS;
    let at = |i: usize| direction_of([(i % (around + 1)) as f32, (i / (around + 1)) as f32]);
    let row = (around + 1) as u32;
    let cells = (0..around * along).map(|i| (i / around * (around + 1) + i % around) as u32);
    let triangles = cells.flat_map(|i| [[i, i + row + 1, i + row], [i, i + 1, i + row + 1]]).collect();
    ((0..(around + 1) * (along + 1)).map(at).collect(), triangles)
}

/// Mean colors of a scene in each direction from its middle, in cells around an axis and along it.
struct Surroundings(Vec<Vec3>);

impl Surroundings {
    fn new(scene: &Scene, center: Vec3) -> Self {
        let [around, along] = CELLS;
        let mut sums = vec![(Vec3::ZERO, 0.0_f32); around * along];
        let mut all = (Vec3::ZERO, 0.0_f32);
        for ((mean, color), &opacity) in scene.means.iter().zip(scene.base_colors()).zip(&scene.opacities) {
            let [x, y] = place(mean - center);
            let (column, row) = ((x as usize).min(around - 1), (y as usize).min(along - 1));
            for (sum, weight) in [&mut sums[row * around + column], &mut all] {
                *sum += opacity * Vec3::from(color);
                *weight += opacity;
            }
        }
        let mean = |(sum, weight): (Vec3, f32)| (weight > 0.0).then(|| sum / weight);
        // A cell without Gaussians has the mean color of the scene.
        let usual = mean(all).unwrap_or(Vec3::splat(0.5));
        Self(sums.into_iter().map(|sum| mean(sum).unwrap_or(usual).clamp(Vec3::ZERO, Vec3::ONE)).collect())
    }

    /// The color in a unit direction, interpolated between the middles of cells.
    fn toward(&self, direction: Vec3) -> Vec3 {
        let [around, along] = CELLS;
        let [x, y] = place(direction);
        let (x, y) = (x + around as f32 - 0.5, (y - 0.5).clamp(0.0, (along - 1) as f32));
        let at = |dx: usize, dy: usize| {
            let (column, row) = ((x as usize + dx) % around, (y as usize + dy).min(along - 1));
            self.0[row * around + column]
        };
        let row = |dy: usize| at(0, dy).lerp(at(1, dy), x.fract());
        row(0).lerp(row(1), y.fract())
    }
}

/// The direction of a place among the cells: cells around the axis, and along it from the top.
fn direction_of([x, y]: [f32; 2]) -> Vec3 {
    let [around, along] = CELLS.map(|n| n as f32);
    let (turn, down) = (TAU * x / around, PI * y / along);
    Vec3::new(down.sin() * turn.sin(), down.cos(), -down.sin() * turn.cos())
}

/// The place of a direction.
fn place(direction: Vec3) -> [f32; 2] {
    let [around, along] = CELLS.map(|n| n as f32);
    let turn = direction.x.atan2(-direction.z) / TAU;
    let down = direction.normalize_or(Vec3::Y).y.clamp(-1.0, 1.0).acos() / PI;
    [around * turn.rem_euclid(1.0), along * down]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two Gaussians in the middle of two cells: there the ball has their colors, and far from both the usual
    /// one.
    #[test]
    fn a_ball_has_the_colors_around_it() {
        let (center, red, blue) = (Vec3::new(1.0, 2.0, 3.0), Vec3::X, Vec3::Z);
        let [toward_red, toward_blue] = [[12.5, 12.5], [36.5, 9.5]].map(direction_of);
        let mut scene = Scene {
            means: vec![center + 2.0 * toward_red, center + toward_blue],
            opacities: vec![0.5, 1.0],
            ..Scene::default()
        };
        scene.set_colors(&[red.to_array(), blue.to_array()]);
        let own = Surroundings::new(&scene, center);
        let usual = (red + 2.0 * blue) / 3.0;
        for (toward, expected) in [(toward_red, red), (toward_blue, blue), (Vec3::Y, usual)] {
            let found = own.toward(toward);
            assert!(found.distance(expected) < 1e-3, "{toward}: {found}, expected {expected}");
        }
        // In the middle between two cells, both count half.
        let between = own.toward(direction_of([13.0, 12.5]));
        assert!(between.distance(0.5 * (red + usual)) < 1e-3, "{between}");
    }

    #[test]
    fn the_ball_is_closed_and_faces_outward() {
        let (corners, triangles) = unit_ball();
        let mut area = 0.0;
        for [a, b, c] in triangles.iter().map(|corners_of| corners_of.map(|i| corners[i as usize])) {
            let normal = 0.5 * (b - a).cross(c - a);
            assert!(normal.dot(a + b + c) >= -1e-6);
            area += normal.length();
        }
        assert!((area - 4.0 * PI).abs() < 0.1, "{area}");
    }
}
