//! Folding all that is affine in the latent features into the decoder's first layer.
//!
//! f = A f' + b, AdaIN, mixing and the blend with the content are affine. The pre-activation of the first layer
//! is therefore affine in f':
//!
//! ```text
//! sum_k W_k (g * (A f'_{n(p,k)} + b) + s) + B = sum_k (W_k diag(g) A) (f'_{n(p,k)} - m') + const
//! ```
//!
//! with m' the mean of f'. Features enter centered, so that a large gain (a nearly constant channel) multiplies
//! small numbers and not the difference of two large ones. Folding costs the same for any number of Gaussians,
//! and is done in f64: gains reach 1e8 (1 / [`STD_DEV_EPSILON`](crate::statistics::STD_DEV_EPSILON)), beyond
//! the digits of f32.

use std::{
    borrow::Cow,
    future::{Future, ready},
};

use rayon::prelude::*;

use crate::{
    decoder::{
        Decoder, Layer,
        product::{Matrix, product},
        run_layers, smoothing_pass,
    },
    encoder_id::{EncoderId, EncoderMismatch},
    neighbors::Neighbors,
    noise::noise,
    scene::{Features, Scene},
    slices::{SLICE, at_once},
    statistics::{ChannelStatistics, ContentStatistics},
    work::{Canceled, Work},
};

/// An affine map of features, f -> gain * f + shift, in each of the encoder's D channels.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelMap {
    /// Factor of each channel `[D]`.
    pub gain: Vec<f64>,
    /// Added to each channel `[D]`.
    pub shift: Vec<f64>,
}

impl ChannelMap {
    /// The map that keeps the content's features: f -> f.
    pub fn identity(n_channels: usize) -> Self {
        Self { gain: vec![1.0; n_channels], shift: vec![0.0; n_channels] }
    }

    /// AdaIN (Huang and Belongie 2017, eq. 8): f -> std_s (f - mean(f)) / std(f) + mean_s.
    ///
    /// # Errors
    /// If the style has another number of channels than the content.
    pub fn adain(content: &ContentStatistics, style: &ChannelStatistics) -> Result<Self, StylizeError> {
        let n_channels = content.mean.len();
        if style.mean.len() != n_channels || style.std_dev.len() != n_channels {
            return Err(StylizeError::StyleChannels { found: style.mean.len(), expected: n_channels });
        }
        // No division by zero: content deviations include an epsilon.
        let gain: Vec<f64> =
            style.std_dev.iter().zip(&content.std_dev).map(|(s, c)| f64::from(*s) / c).collect();
        let shifts = style.mean.iter().zip(&gain).zip(&content.mean);
        // The constant term of the equation, mean_s - gain mean(f).
        let shift = shifts.map(|((mean, gain), c)| f64::from(*mean) - gain * c).collect();
        Ok(Self { gain, shift })
    }

    /// Means, then standard deviations, of the content's features after the map `[2 D]`.
    pub fn statistics(&self, content: &ContentStatistics) -> Vec<f64> {
        let channels = || self.gain.iter().zip(&self.shift).zip(content.mean.iter().zip(&content.std_dev));
        let means = channels().map(|((gain, shift), (mean, _))| gain * mean + shift);
        // A negative gain mirrors a channel, and deviations stay positive.
        means.chain(channels().map(|((gain, _), (_, std_dev))| gain.abs() * std_dev)).collect()
    }

    /// The weighted mean of maps: sum_j w_j map_j, with weights normalized to sum 1.
    ///
    /// # Errors
    /// If there is no map, or the weights are not finite, negative, or sum to 0.
    pub fn mix(maps: &[(Self, f64)]) -> Result<Self, StylizeError> {
        let weights = normalized(&maps.iter().map(|(_, weight)| *weight).collect::<Vec<_>>())?;
        let n_channels = maps.first().map_or(0, |(first, _)| first.gain.len());
        let sum = |part: fn(&Self) -> &Vec<f64>| {
            let channel = |d: usize| maps.iter().zip(&weights).map(|((map, _), w)| w * part(map)[d]).sum();
            (0..n_channels).map(channel).collect()
        };
        Ok(Self { gain: sum(|map| &map.gain), shift: sum(|map| &map.shift) })
    }

    /// The map's blend with the identity: c f + (1 - c) map(f), with `content` c from 0 (the map alone) to 1
    /// (the content's features as they are).
    ///
    /// # Errors
    /// If `content` is not in 0..=1.
    pub fn with_content(mut self, content: f64) -> Result<Self, StylizeError> {
        if !(0.0..=1.0).contains(&content) {
            return Err(StylizeError::Content { found: content });
        }
        self.gain.iter_mut().for_each(|gain| *gain = content + (1.0 - content) * *gain);
        self.shift.iter_mut().for_each(|shift| *shift *= 1.0 - content);
        Ok(self)
    }
}

/// The weights of a mix, normalized to sum 1.
///
/// # Errors
/// If there is no weight, or they are not finite, negative, or sum to 0.
pub fn normalized(weights: &[f64]) -> Result<Vec<f64>, StylizeError> {
    let total: f64 = weights.iter().sum();
    // Comparisons with NaN are false, so that NaN is refused too.
    let valid = weights.iter().all(|weight| *weight >= 0.0) && total.is_finite() && total > 0.0;
    if !valid {
        return Err(StylizeError::MixWeights { found: weights.into() });
    }
    Ok(weights.iter().map(|weight| weight / total).collect())
}

/// A scene that could not be stylized.
#[derive(Debug, thiserror::Error)]
pub enum StylizeError {
    /// The scene was never embedded.
    #[error("the scene has no features: embed it first (stylegaussian embed SCENE -o OUT.sgs)")]
    NoFeatures,
    /// Style statistics of another width.
    #[error("the style statistics have {found} channels, the scene's features {expected}")]
    StyleChannels {
        /// Channels of the style.
        found: usize,
        /// Channels of the scene.
        expected: usize,
    },
    /// A decoder for other features.
    #[error("the decoder takes {found} input channels, the scene has {expected} (features and extra inputs)")]
    DecoderChannels {
        /// D_in of the first layer.
        found: usize,
        /// D + E of the scene.
        expected: usize,
    },
    /// A decoder that takes statistics of another width.
    #[error("the decoder sees statistics of {found} channels, the scene's features have {expected}")]
    DecoderStatistics {
        /// Number of channels of the statistics that the decoder takes.
        found: usize,
        /// D of the scene.
        expected: usize,
    },
    /// A decoder that cannot run.
    #[error("the decoder's layers do not lead to 3 colors: {found}")]
    DecoderShape {
        /// The layers' widths.
        found: String,
    },
    /// Mix weights that cannot be normalized.
    #[error("mix weights {found:?}: expected non-negative numbers with a positive sum")]
    MixWeights {
        /// The weights.
        found: Vec<f64>,
    },
    /// A content blend outside its range.
    #[error("content {found}: expected a number from 0 to 1")]
    Content {
        /// The blend.
        found: f64,
    },
    /// Two parts were made with different encoders.
    #[error(transparent)]
    Encoder(#[from] EncoderMismatch),
}

/// Folds the basis, the offset and a channel map into a first layer of D + E inputs. The result has L + E
/// inputs and takes *centered* latent features, f' - `mean_latent`.
///
/// # Panics
/// If the layer does not take D + E inputs.
pub fn fold_layer(
    layer: &Layer,
    k: usize,
    features: &Features,
    map: &ChannelMap,
    mean_latent: &[f64],
) -> Layer {
    let (n_channels, n_latent, n_extra) = (features.n_channels(), features.n_latent, features.n_extra);
    assert_eq!(layer.d_in, n_channels + n_extra, "the first layer takes D + E inputs");
    // diag(g) A and, as one more column, the mapped features of a Gaussian at the mean [D, L + 1]. One product
    // then folds weights and bias together.
    let width = n_latent + 1;
    let mut basis = Vec::with_capacity(n_channels * width);
    for (d, row) in features.basis.chunks_exact(n_latent).enumerate() {
        let gain = map.gain[d];
        // The column L is g (A m' + b) + s.
        let mean: f64 = row.iter().zip(mean_latent).map(|(a, m)| f64::from(*a) * m).sum();
        basis.extend(row.iter().map(|a| gain * f64::from(*a)));
        basis.push(gain * (f64::from(features.offset[d]) + mean) + map.shift[d]);
    }
    let d_in = n_latent + n_extra;
    let mut weight = vec![0.0_f32; layer.d_out * k * d_in];
    // Chunks of no values panic, and a layer without inputs or outputs must not.
    let sources = layer.weight.par_chunks_exact((k * layer.d_in).max(1)).zip(&layer.bias);
    let outputs = weight.par_chunks_exact_mut((k * d_in).max(1)).zip(sources);
    let bias = outputs.map(|(weight, (source, bias))| {
        // The K rows of one output. The products are small, but threads share nothing.
        let slots = source.chunks_exact(layer.d_in);
        let wide: Vec<f64> =
            slots.clone().flat_map(|slot| &slot[..n_channels]).map(|w| f64::from(*w)).collect();
        let mut folded = vec![0.0; k * width];
        let (wide, basis) = (Matrix::dense(&wide, k, n_channels), Matrix::dense(&basis, n_channels, width));
        product(&mut folded, false, wide, basis);
        let mut bias = f64::from(*bias);
        for ((target, source), folded) in
            weight.chunks_exact_mut(d_in).zip(slots).zip(folded.chunks_exact(width))
        {
            target[..n_latent].iter_mut().zip(folded).for_each(|(t, f)| *t = *f as f32);
            // The transfer does not touch the extra inputs, so their columns stay as they are.
            target[n_latent..].copy_from_slice(&source[n_channels..]);
            // The last column is the response of this slot to a Gaussian at the mean. It is the same for every
            // Gaussian.
            bias += folded[n_latent];
        }
        bias as f32
    });
    Layer { bias: bias.collect(), weight, d_in, d_out: layer.d_out }
}

/// Inputs of a folded first layer: f' - m' beside the extra inputs `[N, L + E]`.
pub fn centered_inputs(features: &Features, mean_latent: &[f64]) -> Vec<f32> {
    at_once(centered_inputs_in_slices(features, mean_latent, &mut || ready(())))
}

/// [`centered_inputs`] in [slices](crate::slices).
pub async fn centered_inputs_in_slices<P: Future<Output = ()>>(
    features: &Features,
    mean_latent: &[f64],
    pause: &mut impl FnMut() -> P,
) -> Vec<f32> {
    let (n_latent, n_extra) = (features.n_latent, features.n_extra);
    let n = features.values.len() / n_latent;
    let mut inputs = Vec::with_capacity(n * (n_latent + n_extra));
    for (i, row) in features.values.chunks_exact(n_latent).enumerate() {
        if i % SLICE == 0 {
            pause().await;
        }
        // Subtracted in f64 and rounded once. A mean in f32 would cost small features around a large mean their
        // digits.
        inputs.extend(row.iter().zip(mean_latent).map(|(value, mean)| (f64::from(*value) - mean) as f32));
        inputs.extend_from_slice(&features.extra[i * n_extra..][..n_extra]);
    }
    inputs
}

/// A scene's features with the decoder's procedural inputs (noise and base color) appended to the extra inputs,
/// or `None` if the scene has no features.
pub fn inputs_of<'a>(scene: &'a Scene, decoder: &Decoder) -> Option<Cow<'a, Features>> {
    at_once(inputs_in_slices(scene, decoder, &mut || ready(())))
}

/// [`inputs_of`] in [slices](crate::slices).
pub async fn inputs_in_slices<'a, P: Future<Output = ()>>(
    scene: &'a Scene,
    decoder: &Decoder,
    pause: &mut impl FnMut() -> P,
) -> Option<Cow<'a, Features>> {
    let features = scene.features.as_ref()?;
    if decoder.n_procedural() == 0 {
        return Some(Cow::Borrowed(features));
    }
    let mut inputs = features.clone();
    inputs.n_extra += decoder.n_procedural();
    inputs.extra.clear();
    // Noise goes by the index in the source, so that sorting or thinning a scene leaves its strokes alone.
    for (i, (color, source_index)) in scene.base_colors().iter().zip(&scene.order).enumerate() {
        if i % SLICE == 0 {
            pause().await;
        }
        inputs.extra.extend_from_slice(&features.extra[i * features.n_extra..][..features.n_extra]);
        inputs.extra.extend((0..decoder.n_noise as u32).map(|channel| noise(*source_index, channel)));
        if decoder.base_color {
            inputs.extra.extend(color.map(|channel| Decoder::BASE_COLOR_SCALE * (channel - 0.5)));
        }
    }
    Some(Cow::Owned(inputs))
}

/// The channel map of a mix of styles over a scene: c f + (1 - c) sum_j w_j AdaIN_j.
///
/// # Errors
/// If there is no style, a weight or `content` is out of range, or channels or encoders differ.
pub fn transfer(
    features: &Features,
    styles: &[(&ChannelStatistics, f64)],
    content: f64,
) -> Result<ChannelMap, StylizeError> {
    transfer_from(&ContentStatistics::of(features), features.encoder.as_ref(), styles, content)
}

/// [`transfer`] for a scene with known statistics. `encoder` is the one that its features belong to.
///
/// # Errors
/// As [`transfer`].
pub fn transfer_from(
    statistics: &ContentStatistics,
    encoder: Option<&EncoderId>,
    styles: &[(&ChannelStatistics, f64)],
    content: f64,
) -> Result<ChannelMap, StylizeError> {
    let mut maps = Vec::with_capacity(styles.len());
    for (style, weight) in styles {
        EncoderId::expect_same(("a style", style.encoder.as_ref()), (FEATURES, encoder))?;
        maps.push((ChannelMap::adain(statistics, style)?, *weight));
    }
    ChannelMap::mix(&maps)?.with_content(content)
}

/// The scene's part in an [`EncoderMismatch`].
const FEATURES: &str = "the scene's features";

/// Checks that `decoder` can run on `scene`, and returns the scene's features. Encoders and widths must agree,
/// and the layers must chain and end in 3 colors.
///
/// # Errors
/// If the scene has no features, or the decoder does not fit them.
pub fn check_decoder<'a>(scene: &'a Scene, decoder: &Decoder) -> Result<&'a Features, StylizeError> {
    let features = scene.features.as_ref().ok_or(StylizeError::NoFeatures)?;
    let encoders = (decoder.encoder.as_ref(), features.encoder.as_ref());
    EncoderId::expect_same(("the decoder", encoders.0), (FEATURES, encoders.1))?;
    // Saturating, since a file may ask for any number of noise inputs. Such a decoder fails the next check.
    let n_inputs = (features.n_channels() + features.n_extra).saturating_add(decoder.n_procedural());
    if decoder.n_inputs() != n_inputs {
        return Err(StylizeError::DecoderChannels { found: decoder.n_inputs(), expected: n_inputs });
    }
    let n_statistics = decoder.statistics_weight.len();
    if n_statistics > 0 && n_statistics != decoder.layers[0].d_out * 2 * features.n_channels() {
        let found = n_statistics / decoder.layers[0].d_out.max(1) / 2;
        return Err(StylizeError::DecoderStatistics { found, expected: features.n_channels() });
    }
    let chained = decoder.layers.windows(2).all(|pair| pair[0].d_out == pair[1].d_in);
    if !chained || decoder.layers.last().is_none_or(|layer| layer.d_out != 3) {
        let widths: Vec<_> =
            decoder.layers.iter().map(|layer| format!("{}>{}", layer.d_in, layer.d_out)).collect();
        return Err(StylizeError::DecoderShape { found: widths.join(" ") });
    }
    Ok(features)
}

/// Adds the decoder's response to the statistics of the transferred features to the bias of its folded first
/// layer.
pub fn fold_statistics(first: &mut Layer, decoder: &Decoder, map: &ChannelMap, content: &ContentStatistics) {
    let statistics = map.statistics(content);
    let rows = decoder.statistics_weight.chunks_exact(statistics.len().max(1));
    for (bias, row) in first.bias.iter_mut().zip(rows) {
        let sum: f64 = row.iter().zip(&statistics).map(|(w, s)| f64::from(*w) * s).sum();
        *bias = (f64::from(*bias) + sum) as f32;
    }
}

/// Decodes a scene's mapped features to colors `[N]`, display-referred RGB, not clamped.
///
/// # Errors
/// If the scene has no features, or the decoder does not fit them.
pub fn stylize(scene: &Scene, decoder: &Decoder, map: &ChannelMap) -> Result<Vec<[f32; 3]>, StylizeError> {
    let colors = stylize_if_wanted(scene, decoder, map, &Work::default());
    colors.expect("nobody else has the work, so nobody cancels it")
}

/// As [`stylize`].
///
/// # Errors
/// If `work` is canceled; inside, as those of [`stylize`].
pub fn stylize_if_wanted(
    scene: &Scene,
    decoder: &Decoder,
    map: &ChannelMap,
    work: &Work,
) -> Result<Result<Vec<[f32; 3]>, StylizeError>, Canceled> {
    work.check()?;
    if let Err(error) = check_decoder(scene, decoder) {
        return Ok(Err(error));
    }
    let Some(features) = inputs_of(scene, decoder) else { return Ok(Err(StylizeError::NoFeatures)) };
    let features = &*features;
    let mean_latent = crate::statistics::mean_latent(features);
    let mut first = fold_layer(&decoder.layers[0], decoder.k, features, map, &mean_latent);
    if !decoder.statistics_weight.is_empty() {
        fold_statistics(&mut first, decoder, map, &ContentStatistics::of(features));
    }
    let layers: Vec<&Layer> = std::iter::once(&first).chain(&decoder.layers[1..]).collect();
    work.at(0.05)?;
    let neighbors = match &scene.neighbors {
        Some(neighbors) if neighbors.k >= decoder.k => neighbors_for(scene, decoder.k),
        _ => Cow::Owned(Neighbors::find_if_wanted(
            &scene.means,
            &scene.order,
            decoder.k,
            &work.part(0.05, 0.1),
        )?),
    };
    work.at(0.1)?;
    let inputs = centered_inputs(features, &mean_latent);
    let rgb = run_layers(&layers, decoder.activation, &neighbors, inputs, &work.part(0.1, 0.9))?;
    let mut colors: Vec<[f32; 3]> = rgb.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
    // The base color is added after smoothing, which would blur its detail.
    for _ in 0..decoder.smoothing_passes {
        work.check()?;
        colors = smoothing_pass(&colors, &neighbors);
    }
    if decoder.residual != 0.0 {
        for (color, base) in colors.iter_mut().zip(scene.base_colors()) {
            color.iter_mut().zip(base).for_each(|(c, b)| *c += decoder.residual * b);
        }
    }
    Ok(Ok(colors))
}

/// The scene's neighbor lists at K. Longer lists are shortened, and a search runs only if there are none of
/// that length.
pub fn neighbors_for(scene: &Scene, k: usize) -> Cow<'_, Neighbors> {
    match &scene.neighbors {
        Some(neighbors) if neighbors.k == k => Cow::Borrowed(neighbors),
        // Lists ascend by distance, so the first k of a longer one are the list for k.
        Some(neighbors) if neighbors.k > k => Cow::Owned(neighbors.truncated(k)),
        _ => Cow::Owned(Neighbors::find(&scene.means, &scene.order, k)),
    }
}
