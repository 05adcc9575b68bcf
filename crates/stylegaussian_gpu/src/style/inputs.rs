//! A scene's inputs to the decoder, packed as the GPU reads them.

use std::{
    future::{Future, ready},
    sync::Arc,
};

use half::f16;
use stylegaussian::{
    Decoder, Scene,
    fold::{self, StylizeError},
    slices::{SLICE, at_once},
};
use stylegaussian_shaders::style::NumberFormat;

use super::{
    blocks::Blocks,
    content::{ContentFold, centered},
    options::StyleOptions,
    planes::PLANE_CHANNELS,
    shape::StyleShape,
};

/// The part of a scene that the style pass uploads. It is made without a GPU: an engine makes it off its main
/// thread.
///
/// Features are centered, and each channel is multiplied by the power of two that brings its largest value to
/// 1,024..2,048. f16 keeps 11 bits of values down to 6e-5, so no value that matters in its channel is rounded
/// more coarsely than that.
#[derive(Clone, Debug)]
pub struct StyleInputs {
    pub(super) content: Arc<ContentFold>,
    pub(super) shape: StyleShape,
    pub(super) options: StyleOptions,
    pub(super) planes: PackedPlanes,
    pub(super) blocks: Blocks,
    /// Base colors `[N]`; empty if the decoder is not residual.
    pub(super) base_colors: Vec<[f16; 4]>,
}

/// Planes of all Gaussians `[planes, N]`.
#[derive(Clone, Debug)]
pub(super) enum PackedPlanes {
    F16(Vec<[f16; PLANE_CHANNELS]>),
    F32(Vec<[f32; PLANE_CHANNELS]>),
}

impl PackedPlanes {
    pub fn bytes(&self) -> &[u8] {
        match self {
            Self::F16(planes) => bytemuck::cast_slice(planes),
            Self::F32(planes) => bytemuck::cast_slice(planes),
        }
    }
}

impl StyleInputs {
    /// Packs the inputs of `decoder` on `scene`: features, noise, base colors, and the K nearest neighbors.
    /// Neighbors are found anew if the scene has none (give it [`Neighbors`](stylegaussian::Neighbors) to save
    /// that time).
    ///
    /// # Errors
    /// If the scene has no features, or if the decoder does not fit them.
    ///
    /// # Panics
    /// If the parts of the scene do not fit together: see [`Scene::validate`].
    pub fn new(scene: &Scene, decoder: &Decoder) -> Result<Self, StylizeError> {
        Self::with_options(scene, decoder, StyleOptions::default())
    }

    /// [`new`](Self::new) with a choice of precision and memory.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    ///
    /// # Panics
    /// As [`new`](Self::new).
    pub fn with_options(
        scene: &Scene,
        decoder: &Decoder,
        options: StyleOptions,
    ) -> Result<Self, StylizeError> {
        at_once(Self::in_slices(scene, decoder, options, &mut || ready(())))
    }

    /// [`with_options`](Self::with_options) in [slices](stylegaussian::slices), after each of which it waits
    /// for a `pause`.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    ///
    /// # Panics
    /// As [`new`](Self::new).
    pub async fn in_slices<P: Future<Output = ()>>(
        scene: &Scene,
        decoder: &Decoder,
        options: StyleOptions,
        pause: &mut impl FnMut() -> P,
    ) -> Result<Self, StylizeError> {
        let shape = StyleShape::of(scene, decoder)?;
        let inputs = fold::inputs_in_slices(scene, decoder, pause).await.ok_or(StylizeError::NoFeatures)?;
        let (mean_latent, values) = centered(&inputs, pause).await;
        let scales = channel_scales(&values, shape.widths[0]);
        pause().await;
        let planes = match options.precision.input_format() {
            NumberFormat::F32 => PackedPlanes::F32(pack_planes(&values, &scales, |value| value, pause).await),
            _ => PackedPlanes::F16(pack_planes(&values, &scales, f16::from_f32, pause).await),
        };
        let mut base_colors = Vec::new();
        if shape.residual {
            for colors in scene.base_colors().chunks(SLICE) {
                base_colors.extend(colors.iter().map(|&[r, g, b]| [r, g, b, 0.0].map(f16::from_f32)));
                pause().await;
            }
        }
        let blocks = Blocks::of_scene(scene, &shape, &options);
        pause().await;
        let content = Arc::new(ContentFold::new(&inputs, mean_latent, scales, pause).await);
        Ok(Self { content, shape, options, planes, blocks, base_colors })
    }

    /// The part of the scene that folding needs.
    pub fn content(&self) -> &Arc<ContentFold> {
        &self.content
    }
}

/// For each channel of `values` `[N, width]`, the power of two that brings its largest value to 1,024..2,048.
fn channel_scales(values: &[f32], width: usize) -> Vec<f32> {
    let mut largest = vec![0.0_f32; width];
    for row in values.chunks_exact(width) {
        largest.iter_mut().zip(row).for_each(|(max, value)| *max = max.max(value.abs()));
    }
    // Powers of two change no digit. The clamp keeps the scale and its inverse finite.
    let scale = |max: f32| {
        if max > 0.0 && max.is_finite() {
            2.0_f32.powi((10 - max.log2().floor() as i32).clamp(-100, 100))
        } else {
            1.0
        }
    };
    largest.into_iter().map(scale).collect()
}

/// `values` `[N, width]` times `scales` `[width]`, as planes `[planes, N]` of 8 channels. Zeros fill the last
/// plane.
async fn pack_planes<T: Copy, P: Future<Output = ()>>(
    values: &[f32],
    scales: &[f32],
    number: impl Fn(f32) -> T,
    pause: &mut impl FnMut() -> P,
) -> Vec<[T; PLANE_CHANNELS]> {
    let width = scales.len();
    let n = values.len() / width;
    let mut planes = vec![[number(0.0); PLANE_CHANNELS]; width.div_ceil(PLANE_CHANNELS) * n];
    for (gaussian, row) in values.chunks_exact(width).enumerate() {
        if gaussian % SLICE == 0 {
            pause().await;
        }
        let channels = row.chunks(PLANE_CHANNELS).zip(scales.chunks(PLANE_CHANNELS));
        for (plane, (values, scales)) in channels.enumerate() {
            let packed = planes[plane * n + gaussian].iter_mut();
            packed.zip(values.iter().zip(scales)).for_each(|(p, (v, s))| *p = number(v * s));
        }
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_hold_eight_scaled_channels_of_each_gaussian() {
        let values: Vec<f32> =
            (0..2 * 9).map(|i| if i % 9 == 8 { 3e-6 * i as f32 } else { i as f32 }).collect();
        let scales = channel_scales(&values, 9);
        // The largest values of channels 0 and 8 are 9 and 5.1e-5: 2^3 and 2^-15, to be brought to 2^10.
        assert_eq!((scales[0], scales[8]), (128.0, 2.0_f32.powi(25)));
        let planes = at_once(pack_planes(&values, &scales, f16::from_f32, &mut || ready(())));
        assert_eq!(planes.len(), 4);
        assert_eq!(planes[1][0].to_f32(), 9.0 * 128.0);
        assert_eq!(planes[0][7].to_f32(), 7.0 * scales[7]);
        let last = planes[3][0].to_f32() / scales[8];
        assert!((last / 5.1e-5 - 1.0).abs() < 5e-4, "{last}");
        assert_eq!(planes[3][1..], [f16::ZERO; 7]);
    }

    #[test]
    fn channels_of_zeros_keep_their_scale() {
        assert_eq!(channel_scales(&[0.0, 1.0, 0.0, 2.0], 2), [1.0, 512.0]);
        assert_eq!(channel_scales(&[], 2), [1.0, 1.0]);
    }
}
