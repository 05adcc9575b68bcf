//! Flat Gaussians on the surface of a mesh.

use glam::{IVec3, Quat, Vec3};
use rustc_hash::FxHashMap;

use super::split::{MAX_TRIANGLES, Split};
use crate::scene::Scene;

/// Distance between the vertices of a mesh that is painted, at most, in pixels of the painting: a quarter of
/// that between seeds. Where strokes of two seeds meet, one becomes the other within it.
pub const SPACING: f32 = 7.0;

/// Most spots of a mesh: one for two triangles, as a closed surface has. Beyond, spots are coarser.
pub const MAX_SPOTS: usize = MAX_TRIANGLES / 2;

/// Pixels of the painting along the longest side of a mesh that stands alone, and fills the picture.
const ALONE: f32 = 512.0;

/// Vertices within this part of the spacing are one spot.
const ONE_SPOT: f32 = 0.125;

/// Thickness of a spot over its width. It is flat, and more would change no normal.
const THICKNESS: f32 = 0.05;

/// Opacity of a spot. In the proofs of a mesh that stands alone, nothing shines through.
const OPACITY: f32 = 0.95;

/// The longest edge of the triangles of a mesh that stands alone, whose corners are at `positions`: it is
/// painted as if it filled a picture.
pub fn spacing_alone(positions: &[Vec3]) -> f32 {
    let mut finite = positions.iter().copied().filter(|at| at.is_finite());
    let Some(first) = finite.next() else { return 0.0 };
    let (min, max) = finite.fold((first, first), |(min, max), at| (min.min(at), max.max(at)));
    (max - min).max_element() * SPACING / ALONE
}

/// The spots of a mesh.
#[derive(Clone, Debug)]
pub struct Spots {
    /// A flat Gaussian for each spot.
    pub scene: Scene,
    /// The spot of each vertex; [`Spots::NONE`] for one of no triangle.
    pub of_vertex: Vec<u32>,
}

/// The knowledge of a spot.
struct Spot {
    at: Vec3,
    normal: Vec3,
    area: f64,
    color: Vec3,
    n_vertices: u32,
}

impl Spots {
    /// The spot of a vertex that belongs to no triangle.
    pub const NONE: u32 = u32::MAX;

    /// The spots of a mesh whose vertices have these display-referred `colors`, and these `normals` if it has
    /// some. `spacing` is the longest edge that it was split to, and `up` the direction up on it.
    ///
    /// # Panics
    /// If there is not one color, or not one normal, for each vertex.
    pub fn new(split: &Split, normals: Option<&[Vec3]>, colors: &[[f32; 3]], spacing: f32, up: Vec3) -> Self {
        let n = split.positions.len();
        assert_eq!(colors.len(), n, "one color for each vertex");
        assert!(normals.is_none_or(|normals| normals.len() == n), "one normal for each vertex");
        // The sum of the normals of a vertex's triangles, as long as their area, and a third of that area.
        let mut around = vec![(Vec3::ZERO, 0.0_f64); n];
        let mut is_used = vec![false; n];
        for corners in &split.triangles {
            let [a, b, c] = corners.map(|i| split.positions[i as usize]);
            // Of huge triangles the area is not finite, and of slivers it is 0.
            let normal = Some(0.5 * (b - a).cross(c - a)).filter(|v| v.is_finite()).unwrap_or_default();
            for i in corners {
                let (sum, area) = &mut around[*i as usize];
                *sum += normal;
                *area += f64::from(normal.length()) / 3.0;
                is_used[*i as usize] = true;
            }
        }
        let normal_of = |i: usize| {
            let given = normals.and_then(|normals| normals[i].try_normalize());
            given.or_else(|| around[i].0.try_normalize()).unwrap_or(Vec3::Z)
        };
        let used: Vec<usize> = (0..n).filter(|&i| is_used[i]).collect();
        let mut cell = (ONE_SPOT * spacing).max(f32::MIN_POSITIVE);
        let key =
            |i: usize, cell: f32| ((split.positions[i] / cell).floor().as_ivec3(), side_of(normal_of(i)));
        let of_vertex = loop {
            let mut known: FxHashMap<(IVec3, u8), u32> = FxHashMap::default();
            let mut of_vertex = vec![Self::NONE; n];
            for &i in &used {
                let n_known = known.len() as u32;
                of_vertex[i] = *known.entry(key(i, cell)).or_insert(n_known);
                if known.len() > MAX_SPOTS {
                    break;
                }
            }
            // An endless cell holds all, once for each side.
            if known.len() <= MAX_SPOTS {
                break of_vertex;
            }
            cell *= 2.0;
        };
        let mut spots: Vec<Spot> = Vec::new();
        for &i in &used {
            let (area, normal, color) = (around[i].1, normal_of(i), Vec3::from(colors[i]));
            match spots.get_mut(of_vertex[i] as usize) {
                Some(spot) => {
                    spot.normal += normal;
                    spot.area += area;
                    spot.color += color;
                    spot.n_vertices += 1;
                }
                None => spots.push(Spot { at: split.positions[i], normal, area, color, n_vertices: 1 }),
            }
        }
        Self { scene: scene_of(&spots, spacing, up), of_vertex }
    }
}

/// The side of a cube that faces a direction most: both sides of a leaf are two spots, and so are those of an
/// edge.
fn side_of(normal: Vec3) -> u8 {
    let sizes = normal.abs().to_array();
    let axis = (1..3).fold(0, |most, k| if sizes[k] > sizes[most] { k } else { most });
    2 * axis as u8 + u8::from(normal[axis] < 0.0)
}

/// The Gaussians of spots.
fn scene_of(spots: &[Spot], spacing: f32, up: Vec3) -> Scene {
    let n = spots.len();
    // The side of a spot without an area: a tenth of the usual one.
    let least = (0.1 * spacing).max(f32::MIN_POSITIVE);
    let scales = |spot: &Spot| {
        // Half as wide as spots are apart.
        let side = 0.5 * (spot.area.sqrt() as f32).max(least);
        Vec3::new(side, side, THICKNESS * side)
    };
    let rotation =
        |spot: &Spot| Quat::from_rotation_arc(Vec3::Z, spot.normal.try_normalize().unwrap_or(Vec3::Z));
    let mut scene = Scene {
        means: spots.iter().map(|spot| spot.at).collect(),
        rotations: spots.iter().map(rotation).collect(),
        scales: spots.iter().map(scales).collect(),
        opacities: vec![OPACITY; n],
        order: (0..n as u32).collect(),
        n_source: n,
        up: Some(up),
        ..Scene::default()
    };
    let color = |spot: &Spot| {
        let mean = spot.color / spot.n_vertices as f32;
        if mean.is_finite() { mean.to_array() } else { [0.5; 3] }
    };
    scene.set_colors(&spots.iter().map(color).collect::<Vec<_>>());
    scene
}
