//! A sky: a painted sphere, as the six faces of a cube map.

use std::f32::consts::FRAC_PI_4;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::{corners::detail_at, split::Split, spots::Spots};
use crate::{
    paint::{Painted, Surface},
    scene::Scene,
    strokes::{StrokeKnobs, StrokeWord},
    work::{Canceled, Work},
};

/// A pixel of the painting on the sky, in radians: a picture of 512 pixels shows 45 degrees, as usual cameras
/// do.
const PIXEL: f32 = FRAC_PI_4 / 512.0;

/// Cells along a side of a face: vertices are 8 pixels apart.
const CELLS: usize = 128;

/// A sky to be painted: vertices on the unit sphere, seen from its center.
pub struct Sky {
    split: Split,
    spots: Spots,
    /// Display-referred color of each vertex.
    own: Vec<[f32; 3]>,
}

/// Where a point of a face lies in the grid: three vertices, and its shares of them.
struct InGrid {
    vertices: [usize; 3],
    shares: Vec3,
}

/// The direction of a point of a face, -1..1 to the right and down, in the axes and the order of cube maps (+x,
/// -x, +y, -y, +z, -z). It is of any length.
pub fn direction_of(face: usize, right: f64, down: f64) -> DVec3 {
    let (u, v) = (right, down);
    match face {
        0 => DVec3::new(1.0, -v, -u),
        1 => DVec3::new(-1.0, -v, u),
        2 => DVec3::new(u, 1.0, v),
        3 => DVec3::new(u, -1.0, -v),
        4 => DVec3::new(u, -v, 1.0),
        _ => DVec3::new(-u, -v, -1.0),
    }
}

/// The face of a direction, and its point on it: the inverse of [`direction_of`].
pub fn face_of(direction: Vec3) -> (usize, [f32; 2]) {
    let Vec3 { x, y, z } = direction;
    let sizes = direction.abs();
    let (face, most, u, v) = if sizes.x >= sizes.y && sizes.x >= sizes.z {
        if x >= 0.0 { (0, x, -z, -y) } else { (1, -x, z, -y) }
    } else if sizes.y >= sizes.z {
        if y >= 0.0 { (2, y, x, z) } else { (3, -y, x, -z) }
    } else if z >= 0.0 {
        (4, z, x, -y)
    } else {
        (5, -z, -x, -y)
    };
    (face, [u, v].map(|at| if most > 0.0 { at / most } else { 0.0 }))
}

impl Sky {
    /// A sky whose display-referred color `color` gives for a direction, as the mean over a patch of so many
    /// radians.
    pub fn new(color: impl Fn(Vec3, f32) -> [f32; 3] + Sync) -> Self {
        let sky = Self::new_if_wanted(color, &Work::default());
        sky.expect("nobody else has the work, so nobody cancels it")
    }

    /// As [`new`](Self::new).
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn new_if_wanted(
        color: impl Fn(Vec3, f32) -> [f32; 3] + Sync,
        work: &Work,
    ) -> Result<Self, Canceled> {
        let row = CELLS + 1;
        let step = |i: usize| 2.0 * i as f64 / CELLS as f64 - 1.0;
        let vertices = (0..6).flat_map(|face| (0..row * row).map(move |i| (face, i % row, i / row)));
        // In f64, so that a vertex of two faces is one to the bit.
        let at =
            |(face, x, y): (usize, usize, usize)| direction_of(face, step(x), step(y)).normalize().as_vec3();
        let positions: Vec<Vec3> = vertices.map(at).collect();
        let cells = (0..6 * CELLS * CELLS).map(|i| {
            let (face, cell) = (i / (CELLS * CELLS), i % (CELLS * CELLS));
            (face * row * row + cell / CELLS * row + cell % CELLS) as u32
        });
        let row = row as u32;
        let triangles = cells.flat_map(|i| [[i, i + 1, i + row + 1], [i, i + row + 1, i + row]]).collect();
        let spacing = std::f32::consts::FRAC_PI_2 / CELLS as f32;
        // The colors of vertices are means over many texels.
        let own = positions.par_iter().map(|at| work.check().map(|()| color(*at, spacing)));
        let own = own.collect::<Result<Vec<_>, Canceled>>()?;
        let split = Split { positions, triangles, parents: Vec::new() };
        // Out of the sphere: of either sign, since strokes have two sides.
        let spots = Spots::new(&split, Some(&split.positions), &own, spacing, Vec3::Y);
        Ok(Self { split, spots, own })
    }

    /// Its vertices as Gaussians.
    pub fn spots(&self) -> &Scene {
        &self.spots.scene
    }

    /// The size of a unit of a painted scene in units of the sky, with which its surface is made
    /// [beside](Surface::beside) the scene's.
    pub fn scale(painted: &Surface) -> f32 {
        PIXEL / painted.pixel()
    }

    /// The six faces, each of `side` x `side` texels: display-referred RGB, 0..1, row by row. `color` is the
    /// sky's.
    ///
    /// # Errors
    /// If `work` is canceled.
    ///
    /// # Panics
    /// If something else was painted.
    pub fn faces(
        &self,
        painted: &Painted,
        color: impl Fn(Vec3, f32) -> [f32; 3] + Sync,
        side: usize,
        work: &Work,
    ) -> Result<Vec<[f32; 3]>, Canceled> {
        assert_eq!(painted.colors.len(), self.spots.scene.len(), "the paint of this sky");
        let texel = std::f32::consts::FRAC_PI_2 / side as f32;
        let level = (texel / PIXEL).log2().max(0.0);
        let mut faces = vec![[0.0; 3]; 6 * side * side];
        faces.par_chunks_mut(side.max(1)).enumerate().try_for_each(|(row, out)| {
            work.check()?;
            let (face, y) = (row / side, row % side);
            for (x, out) in out.iter_mut().enumerate() {
                let [u, v] = [x, y].map(|i| (2 * i + 1) as f64 / side as f64 - 1.0);
                let own = |direction: Vec3| color(direction, texel);
                *out = self.color_at(painted, face, [u, v], level, &own);
            }
            Ok(())
        })?;
        Ok(faces)
    }

    /// The painted color of a point of a face.
    fn color_at(
        &self,
        painted: &Painted,
        face: usize,
        [u, v]: [f64; 2],
        level: f32,
        own: &dyn Fn(Vec3) -> [f32; 3],
    ) -> [f32; 3] {
        let InGrid { vertices, shares } = in_grid(face, u, v);
        let mean = |of: &dyn Fn(usize) -> Vec3| -> Vec3 { (0..3).map(|k| shares[k] * of(vertices[k])).sum() };
        let spot = |vertex: usize| self.spots.of_vertex[vertex] as usize;
        let words = vertices.map(|vertex| painted.strokes.words[spot(vertex)]);
        let at = mean(&|vertex| self.split.positions[vertex]);
        let strokes = (&*painted.strokes.seeds, &*painted.strokes.textures);
        // Without strokes, words name no seed.
        let has_strokes = words.iter().any(|word| StrokeWord::unpacked(*word).share > 0.0);
        let detail = match has_strokes {
            true => detail_at((words, shares), at, strokes, &StrokeKnobs::DEFAULT, level),
            false => Vec3::ZERO,
        };
        let protection: f32 = (0..3).map(|k| shares[k] * StrokeWord::unpacked(words[k]).protection).sum();
        let low = mean(&|vertex| Vec3::from(self.own[vertex]));
        let kept = protection * (Vec3::from(own(at.normalize_or_zero())) - low);
        let color = mean(&|vertex| Vec3::from(painted.colors[spot(vertex)])) + kept + detail;
        color.clamp(Vec3::ZERO, Vec3::ONE).to_array()
    }
}

/// The triangle of the grid in which a point of a face lies.
fn in_grid(face: usize, u: f64, v: f64) -> InGrid {
    let cell = |at: f64| {
        let at = (0.5 * (at + 1.0) * CELLS as f64).clamp(0.0, CELLS as f64);
        let cell = (at as usize).min(CELLS - 1);
        (cell, (at - cell as f64) as f32)
    };
    let ((x, a), (y, b)) = (cell(u), cell(v));
    let row = CELLS + 1;
    let first = face * row * row + y * row + x;
    let beyond = first + row + 1;
    if a >= b {
        InGrid { vertices: [first, first + 1, beyond], shares: Vec3::new(1.0 - a, a - b, b) }
    } else {
        InGrid { vertices: [first, beyond, first + row], shares: Vec3::new(1.0 - b, a, b - a) }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    use super::*;
    use crate::paint::{Canvas, Company, Hand, Paint, lay, lay_beside};

    #[test]
    fn faces_and_directions_are_inverse() {
        for face in 0..6 {
            for [u, v] in [[0.0, 0.0], [0.5, -0.3], [-0.9, 0.8]] {
                let (found, at) = face_of(direction_of(face, u, v).as_vec3() * 3.0);
                assert_eq!(found, face);
                assert!((at[0] - u as f32).abs() < 1e-6 && (at[1] - v as f32).abs() < 1e-6);
            }
        }
        assert_eq!(face_of(Vec3::ZERO).1, [0.0, 0.0]);
    }

    /// A sky that is bright above and dark below.
    fn gradient(direction: Vec3, _: f32) -> [f32; 3] {
        let height = 0.5 + 0.4 * direction.y;
        [0.8 * height, height, 0.6 + 0.3 * height]
    }

    #[test]
    fn a_painted_sky_has_no_seams_and_keeps_its_horizon() {
        let (sky, work) = (Sky::new(gradient), Work::default());
        let pixel = |x: usize| if (x / 4).is_multiple_of(2) { [230, 180, 30] } else { [20, 40, 120] };
        let pixels = (0..128 * 128).flat_map(|i| pixel(i % 128)).collect();
        let canvas = Canvas::new(&Paint { width: 128, height: 128, pixels, used: None });
        // A wall is the scene beside it.
        let n = 40;
        let mut wall = Scene {
            means: (0..n * n).map(|i| Vec3::new((i % n) as f32, (i / n) as f32, 0.0)).collect(),
            rotations: vec![glam::Quat::IDENTITY; n * n],
            scales: vec![Vec3::new(0.5, 0.5, 0.02); n * n],
            opacities: vec![0.9; n * n],
            order: (0..(n * n) as u32).collect(),
            n_source: n * n,
            ..Scene::default()
        };
        wall.set_colors(&(0..n * n).map(|i| [i as f32 / (n * n) as f32; 3]).collect::<Vec<_>>());
        let surface = Surface::new(&wall, &work).unwrap();
        let (paintings, hand) = ([(&canvas, 1.0)], Hand::default());
        let of_wall = lay(&wall, &surface, &paintings, &hand, 0.0, &work).unwrap();
        let company = Company::new(&surface, &paintings, &hand, &of_wall.strokes, &work).unwrap().unwrap();
        let beside = Surface::beside(sky.spots(), &surface, Sky::scale(&surface), &work).unwrap();
        let how = (&hand, 0.0, &company);
        let painted = lay_beside(sky.spots(), &beside, &paintings, how, &work).unwrap();

        // The same direction has the same color on two faces, wherever they meet.
        let color = |face: usize, at: [f64; 2]| {
            let own = |direction: Vec3| gradient(direction, 0.0);
            Vec3::from(sky.color_at(&painted, face, at, 0.0, &own))
        };
        for i in 0..400 {
            let t = 2.0 * (f64::from(i) + 0.5) / 400.0 - 1.0;
            for (a, b) in [((0, [-1.0, t]), (4, [1.0, t])), ((2, [t, 1.0]), (4, [t, -1.0]))] {
                let apart = color(a.0, a.1).distance(color(b.0, b.1));
                assert!(apart < 2e-3, "{a:?} {b:?}: {apart}");
            }
        }
        let side = 64;
        let faces = sky.faces(&painted, gradient, side, &work).unwrap();
        assert_eq!(faces.len(), 6 * side * side);
        let mean = |face: usize| {
            let part = &faces[face * side * side..][..side * side];
            part.iter().map(|c| Vec3::from(*c)).sum::<Vec3>() / (side * side) as f32
        };
        let [above, below] = [2, 3].map(|face| mean(face).dot(crate::palette::LUMINANCE));
        assert!(above > below + 0.05, "{above} {below}");
        work.cancel();
        assert_eq!(sky.faces(&painted, gradient, side, &work).err(), Some(Canceled));
    }

    #[test]
    fn a_sky_that_nobody_wants_is_looked_at_no_further() {
        let (work, n_seen) = (Work::default(), AtomicUsize::new(0));
        let color = |_: Vec3, _: f32| {
            n_seen.fetch_add(1, Relaxed);
            work.cancel();
            [0.5; 3]
        };
        assert_eq!(Sky::new_if_wanted(color, &work).err(), Some(Canceled));
        // Of some 100,000 vertices, one or two for each thread.
        assert!(n_seen.load(Relaxed) < 1000, "{n_seen:?}");
    }
}
