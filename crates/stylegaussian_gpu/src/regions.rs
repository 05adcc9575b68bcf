//! Regions as kernels take them.

use glam::{Affine3A, Vec3, Vec4};
use stylegaussian::layers::{Region, Shape};
use stylegaussian_shaders::layers as shaders;

/// Sizes and distances beyond this are drawn in to it: their squares stay within f32, and no scene reaches
/// there.
const FAR: f32 = 1e9;

/// A region in the numbers of `regions.wgsl`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PackedRegion {
    /// Rows of the shape's space from that of the points.
    pub rows: [[f32; 4]; 3],
    /// Sizes of the shape, in the order of their names.
    pub sizes: [f32; 4],
    /// Width of the edge.
    pub softness: f32,
    /// 1 / softness, or 0 for a hard edge.
    pub inverse_softness: f32,
    /// The shape, one of the `SHAPE_` constants.
    pub shape: u32,
}

impl PackedRegion {
    /// The region, or `None` if it covers nothing. WGSL leaves NaN and infinity undefined, so that they are
    /// sorted out here, with the twin's meaning.
    pub fn new(region: &Region) -> Option<Self> {
        let Region { shape, shape_from_scene, softness } = *region;
        let (kind, sizes) = kind_and_sizes(shape);
        let everywhere = kind == shaders::SHAPE_EVERYTHING;
        // An ellipsoid and noise divide by their sizes. The comparisons are false for NaN as well.
        let divides = [shaders::SHAPE_ELLIPSOID, shaders::SHAPE_NOISE].contains(&kind);
        let n_divisors = if kind == shaders::SHAPE_ELLIPSOID { 3 } else { 1 };
        let has_size = sizes.iter().all(|&size| size >= 0.0)
            && (!divides || sizes[..n_divisors].iter().all(|&size| size > 0.0));
        let covers = everywhere || (shape_from_scene.is_finite() && has_size);
        if !covers || softness.is_nan() {
            return None;
        }
        let Affine3A { matrix3, translation } = shape_from_scene;
        let row = |i: usize| {
            let row = Vec3::from(matrix3.row(i)).extend(translation[i]);
            row.clamp(Vec4::splat(-FAR), Vec4::splat(FAR)).to_array()
        };
        let softness = softness.clamp(0.0, FAR);
        Some(Self {
            rows: if everywhere { [[0.0; 4]; 3] } else { [row(0), row(1), row(2)] },
            sizes: sizes.map(|size| size.min(FAR)),
            softness,
            // The reciprocal of a width below 1e-38 is infinite. Such an edge is hard.
            inverse_softness: Some(softness.recip()).filter(|value| value.is_finite()).unwrap_or(0.0),
            shape: kind,
        })
    }
}

/// The number of a shape, and its sizes in the order of their names.
fn kind_and_sizes(shape: Shape) -> (u32, [f32; 4]) {
    match shape {
        Shape::Everything => (shaders::SHAPE_EVERYTHING, [0.0; 4]),
        Shape::HalfSpace => (shaders::SHAPE_HALF_SPACE, [0.0; 4]),
        Shape::Ellipsoid { radii } => (shaders::SHAPE_ELLIPSOID, radii.extend(0.0).to_array()),
        Shape::Cuboid { half_size } => (shaders::SHAPE_CUBOID, half_size.extend(0.0).to_array()),
        Shape::Cylinder { radius, half_height } => (shaders::SHAPE_CYLINDER, [radius, half_height, 0.0, 0.0]),
        Shape::Capsule { radius, half_length } => (shaders::SHAPE_CAPSULE, [radius, half_length, 0.0, 0.0]),
        Shape::Cone { radius, height } => (shaders::SHAPE_CONE, [radius, height, 0.0, 0.0]),
        Shape::Torus { major_radius, minor_radius } => {
            (shaders::SHAPE_TORUS, [major_radius, minor_radius, 0.0, 0.0])
        }
        Shape::Noise { size, level } => (shaders::SHAPE_NOISE, [size, level, 0.0, 0.0]),
    }
}
