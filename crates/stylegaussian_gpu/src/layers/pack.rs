//! Layers as the kernel takes them.

use glam::{Affine3A, Vec3, Vec4};
use half::f16;
use stylegaussian::layers::{Region, Shape};
use stylegaussian_shaders::layers::{self as shaders, MixLayer};

use super::layer::GpuLayer;

/// Sizes and distances beyond this are drawn in to it: their squares stay within f32, and no scene reaches
/// there.
const FAR: f32 = 1e9;

/// A layer's uniforms, or `None` if it covers nothing; its look has no number yet. WGSL leaves NaN and infinity
/// undefined, so that they are sorted out here, with the twin's meaning.
pub(super) fn packed(layer: &GpuLayer) -> Option<MixLayer> {
    let Region { shape, shape_from_scene, softness } = layer.region;
    let (kind, sizes) = kind_and_sizes(shape);
    let everywhere = kind == shaders::SHAPE_EVERYTHING;
    // An ellipsoid and noise divide by their sizes. The comparisons are false for NaN as well.
    let divides = [shaders::SHAPE_ELLIPSOID, shaders::SHAPE_NOISE].contains(&kind);
    let n_divisors = if kind == shaders::SHAPE_ELLIPSOID { 3 } else { 1 };
    let has_size = sizes.iter().all(|&size| size >= 0.0)
        && (!divides || sizes[..n_divisors].iter().all(|&size| size > 0.0));
    let covers = everywhere || (shape_from_scene.is_finite() && has_size);
    let is_seen = layer.strength > 0.0;
    if !covers || softness.is_nan() || !is_seen {
        return None;
    }
    let Affine3A { matrix3, translation } = shape_from_scene;
    let row = |i: usize| {
        let row = Vec3::from(matrix3.row(i)).extend(translation[i]);
        row.clamp(Vec4::splat(-FAR), Vec4::splat(FAR)).to_array()
    };
    let rows = if everywhere { [[0.0; 4]; 3] } else { [row(0), row(1), row(2)] };
    let softness = softness.clamp(0.0, FAR);
    Some(MixLayer {
        shape_from_scene_x: rows[0],
        shape_from_scene_y: rows[1],
        shape_from_scene_z: rows[2],
        sizes: sizes.map(|size| size.min(FAR)),
        look: layer.factors.map_or(shaders::NO_LOOK, |_| shaders::BELOW),
        mask: layer.mask.map_or(shaders::NO_MASK, |(_, channel)| channel),
        strength: layer.strength.min(1.0),
        softness,
        // The reciprocal of a width below 1e-38 is infinite. Such an edge is hard.
        inverse_softness: Some(softness.recip()).filter(|value| value.is_finite()).unwrap_or(0.0),
        shape: kind,
        factors: layer.factors.map_or(0, |factors| f16s(factors.usual().of_words())),
        ..MixLayer::default()
    })
}

/// Two numbers as f16 in a word, the first in the lower half.
fn f16s(numbers: [f32; 2]) -> u32 {
    let [low, high] = numbers.map(|x| u32::from(f16::from_f32(x).to_bits()));
    low | high << 16
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
