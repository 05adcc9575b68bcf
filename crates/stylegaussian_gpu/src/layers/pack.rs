//! Layers as the kernel takes them.

use half::f16;
use stylegaussian_shaders::layers::{self as shaders, MixLayer};

use super::layer::GpuLayer;
use crate::regions::PackedRegion;

/// A layer's uniforms, or `None` if it covers nothing; its look has no number yet.
pub(super) fn packed(layer: &GpuLayer) -> Option<MixLayer> {
    let region = PackedRegion::new(&layer.region).filter(|_| layer.strength > 0.0)?;
    let [shape_from_scene_x, shape_from_scene_y, shape_from_scene_z] = region.rows;
    Some(MixLayer {
        shape_from_scene_x,
        shape_from_scene_y,
        shape_from_scene_z,
        sizes: region.sizes,
        look: layer.factors.map_or(shaders::NO_LOOK, |_| shaders::BELOW),
        mask: layer.mask.map_or(shaders::NO_MASK, |(_, channel)| channel),
        strength: layer.strength.min(1.0),
        softness: region.softness,
        inverse_softness: region.inverse_softness,
        shape: region.shape,
        factors: layer.factors.map_or(0, |factors| f16s(factors.usual().of_words())),
        ..MixLayer::default()
    })
}

/// Two numbers as f16 in a word, the first in the lower half.
fn f16s(numbers: [f32; 2]) -> u32 {
    let [low, high] = numbers.map(|x| u32::from(f16::from_f32(x).to_bits()));
    low | high << 16
}
