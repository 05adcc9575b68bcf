//! Scenes prepared for training: for each view the blend weights, and only the Gaussians that reach the
//! picture.

use std::sync::Arc;

use glam::UVec2;
use rayon::prelude::*;
use stylegaussian::{
    Camera, Decoder, Features, Neighbors, Scene,
    fold::{centered_inputs, inputs_of, neighbors_for},
    recolor::ColorMoments,
    splat::{BlendWeights, blend_weights},
    statistics::{ContentStatistics, mean_latent},
};

use super::network::Neighborhoods;
use crate::{cameras::scaled, nn::ops::Windows};

/// Crops of a view with less coverage are left out, unless all have less.
const MIN_COVERAGE: f32 = 0.6;

/// Blend weights below this are dropped, and the rest of the pixel is scaled up to its alpha. Together the
/// dropped weights carry about a hundredth of a picture, but half of the Gaussians.
const MIN_WEIGHT: f32 = 2e-3;

/// A scene to train on, and the cameras that it is seen from.
pub struct TrainingScene<'a> {
    /// A name for messages, such as the file.
    pub name: String,
    /// The scene, with features.
    pub scene: &'a Scene,
    /// The longer side of the views, in pixels, and the cameras at that size.
    pub views: Vec<(u32, Vec<Camera>)>,
}

impl<'a> TrainingScene<'a> {
    /// A scene seen from `cameras`, at each of several sizes: the longer sides of the views, in pixels. With
    /// several sizes the decoder learns how a style looks from near and from far.
    pub fn new(name: impl Into<String>, scene: &'a Scene, cameras: &[Camera], sizes: &[u32]) -> Self {
        let at = |&size: &u32| (size, cameras.iter().map(|camera| scaled(camera, size)).collect());
        Self { name: name.into(), scene, views: sizes.iter().map(at).collect() }
    }
}

/// A scene as the trainer uses it.
pub struct PreparedScene {
    /// Centered inputs `[N, L + E]`.
    pub inputs: Vec<f32>,
    /// L + E.
    pub n_inputs: usize,
    /// The features, for the fold.
    pub features: Features,
    /// The mean of f' `[L]`.
    pub mean_latent: Vec<f64>,
    /// Content statistics, for AdaIN.
    pub statistics: ContentStatistics,
    /// Neighbor lists at the decoder's K.
    pub neighbors: Neighbors,
    /// Base colors `[N]`.
    pub base_colors: Vec<[f32; 3]>,
    /// Mean and covariance of the colors in the views.
    pub colors: ColorMoments,
    /// The views, at each size.
    pub views: Vec<Vec<View>>,
}

/// One view of a scene.
pub struct View {
    /// Blend weights over the final colors `[H * W, M]`.
    pub weights: Arc<BlendWeights>,
    /// The Gaussians' neighborhoods, restricted to the rows that are needed.
    pub neighborhoods: Neighborhoods,
    /// The first layer's rows: Gaussian indices `[N_0]`.
    pub input_rows: Vec<u32>,
    /// Gaussian indices of the final colors `[M]`: those that reach the picture.
    pub output_rows: Vec<u32>,
    /// Coverage of each pixel `[H * W]`.
    pub alpha: Vec<f32>,
    /// The unstyled picture `[H * W, 3]`, premultiplied.
    pub picture: Vec<f32>,
}

impl PreparedScene {
    /// Prepares a scene for decoders shaped like `decoder`, or returns `None` if it has no features. Views
    /// larger than `crop` pixels on a side are cut into crops of that size, which overlap by half. A view that
    /// shows nothing is left out.
    pub fn new(scene: &TrainingScene, crop: u32, decoder: &Decoder) -> Option<Self> {
        let (views, scene) = (&scene.views, scene.scene);
        let features = inputs_of(scene, decoder)?.into_owned();
        let k = decoder.k;
        let mean_latent = mean_latent(&features);
        let neighbors = neighbors_for(scene, k).into_owned();
        let base_colors = scene.base_colors();
        let at_size = |(_, cameras): &(u32, Vec<Camera>)| -> Vec<View> {
            let crops =
                // Faint weights go first, so that crops and lists of rows are made of the rest.
                cameras.iter().flat_map(|camera| crops(without_faint(&blend_weights(scene, camera)), crop));
            crops.filter_map(|weights| View::new(weights, &neighbors, &base_colors, decoder)).collect()
        };
        let views: Vec<Vec<View>> = views.iter().map(at_size).collect();
        Some(Self {
            colors: ColorMoments::of_pixels(views.iter().flatten().flat_map(View::pixels)),
            views,
            inputs: centered_inputs(&features, &mean_latent),
            n_inputs: features.n_latent + features.n_extra,
            statistics: ContentStatistics::of(&features),
            features,
            mean_latent,
            neighbors,
            base_colors,
        })
    }

    /// Rows of the inputs `[len, L + E]`.
    pub fn input_rows(&self, rows: &[u32]) -> Vec<f32> {
        rows.iter()
            .flat_map(|&row| &self.inputs[row as usize * self.n_inputs..][..self.n_inputs])
            .copied()
            .collect()
    }
}

impl View {
    fn new(
        weights: BlendWeights,
        neighbors: &Neighbors,
        base_colors: &[[f32; 3]],
        decoder: &Decoder,
    ) -> Option<Self> {
        let n = weights.n_gaussians;
        let mut reaches = vec![false; n];
        weights.indices.iter().for_each(|&gaussian| reaches[gaussian as usize] = true);
        let output_rows: Vec<u32> = (0..n as u32).filter(|&i| reaches[i as usize]).collect();
        if output_rows.is_empty() {
            return None;
        }
        let (windows, input_rows) = window_chain(neighbors, &output_rows, decoder.n_neighborhoods());
        let colors: Vec<f32> = output_rows.iter().flat_map(|&row| base_colors[row as usize]).collect();
        let weights = relabeled(weights, &output_rows);
        Some(Self {
            alpha: weights.alpha(),
            picture: weights.apply(&colors, 3),
            weights: Arc::new(weights),
            neighborhoods: Neighborhoods::new(windows, decoder.layers.len()),
            input_rows,
            output_rows,
        })
    }

    /// Premultiplied color and coverage of each pixel.
    fn pixels(&self) -> impl Iterator<Item = ([f32; 3], f32)> {
        self.picture.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).zip(self.alpha.iter().copied())
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.weights.size.x as usize, self.weights.size.y as usize]
    }
}

/// The rows that each stage must compute, from the last stage back to the first: those in the next stage's
/// neighborhoods. This is exact, because no row outside is used.
fn window_chain(
    neighbors: &Neighbors,
    output_rows: &[u32],
    n_layers: usize,
) -> (Vec<Arc<Windows>>, Vec<u32>) {
    let n = neighbors.indices.len() / neighbors.k;
    let mut rows = output_rows.to_vec();
    let mut windows = Vec::new();
    for _ in 0..n_layers {
        // Three uses in turn: MAX if a row is not needed, 0 if it is, then its place among the needed ones.
        let mut position = vec![u32::MAX; n];
        let lists =
            || rows.iter().flat_map(|&row| &neighbors.indices[row as usize * neighbors.k..][..neighbors.k]);
        lists().for_each(|&row| position[row as usize] = 0);
        // Ascending, so rows keep the scene's order, in which neighbors are close in memory.
        let needed: Vec<u32> = (0..n as u32).filter(|&row| position[row as usize] == 0).collect();
        needed.iter().enumerate().for_each(|(i, &row)| position[row as usize] = i as u32);
        let local: Vec<u32> = lists().map(|&row| position[row as usize]).collect();
        windows.push(Arc::new(Windows::new(local, neighbors.k, needed.len())));
        rows = needed;
    }
    windows.reverse();
    (windows, rows)
}

/// The crops of a picture that the scene covers well, or, if there is none, the one that it covers best.
fn crops(weights: BlendWeights, side: u32) -> Vec<BlendWeights> {
    let size = weights.size.min(UVec2::splat(side));
    let corners = |whole: u32, part: u32| {
        // Steps of at most half a crop. The last crop ends at the border.
        let n_steps = (whole - part).div_ceil(part.div_ceil(2));
        (0..=n_steps).map(move |i| (whole - part) * i / n_steps.max(1))
    };
    let rows = corners(weights.size.y, size.y);
    let crops = rows.flat_map(|y| corners(weights.size.x, size.x).map(move |x| UVec2::new(x, y)));
    let mut crops: Vec<(f32, BlendWeights)> = crops
        .map(|corner| {
            let crop = weights.crop(corner, size);
            (crop.weights.iter().sum::<f32>() / (size.x * size.y) as f32, crop)
        })
        .collect();
    // The best first, so truncation keeps the covered ones, and a stable sort keeps the order of equal ones.
    crops.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let n_covered = crops.iter().filter(|(coverage, _)| *coverage >= MIN_COVERAGE).count();
    crops.truncate(n_covered.max(1));
    crops.into_iter().map(|(_, crop)| crop).collect()
}

fn without_faint(weights: &BlendWeights) -> BlendWeights {
    let pixels: Vec<Vec<(u32, f32)>> = (0..weights.starts.len() - 1)
        .into_par_iter()
        .map(|pixel| {
            let entries = || weights.pixel(pixel).map(|(gaussian, weight)| (gaussian as u32, weight));
            let (mut kept, mut total, mut kept_total) = (Vec::new(), 0.0, 0.0);
            for (gaussian, weight) in entries() {
                total += weight;
                if weight >= MIN_WEIGHT {
                    kept_total += weight;
                    kept.push((gaussian, weight));
                }
            }
            // If all weights of a pixel are faint, it becomes empty.
            let scale = if kept_total > 0.0 { total / kept_total } else { 0.0 };
            kept.iter_mut().for_each(|(_, weight)| *weight *= scale);
            kept
        })
        .collect();
    let mut starts = vec![0];
    let (mut indices, mut kept) = (Vec::new(), Vec::new());
    for pixel in pixels {
        indices.extend(pixel.iter().map(|(gaussian, _)| gaussian));
        kept.extend(pixel.iter().map(|(_, weight)| weight));
        starts.push(indices.len() as u32);
    }
    BlendWeights { starts, indices, weights: kept, ..*weights }
}

fn relabeled(mut weights: BlendWeights, rows: &[u32]) -> BlendWeights {
    let mut position = vec![0; weights.n_gaussians];
    rows.iter().enumerate().for_each(|(i, &row)| position[row as usize] = i as u32);
    weights.indices.iter_mut().for_each(|index| *index = position[*index as usize]);
    BlendWeights { n_gaussians: rows.len(), ..weights }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crops_keep_what_the_scene_covers() {
        // 8x4 pixels, the left 5 columns covered by Gaussian 0: of the corners x = 0, 2, 4 the last sees 1
        // column of 4.
        let is_covered = |pixel: usize| pixel % 8 < 5;
        let mut weights = BlendWeights {
            size: UVec2::new(8, 4),
            n_gaussians: 1,
            starts: vec![0],
            indices: Vec::new(),
            weights: Vec::new(),
        };
        for pixel in 0..32 {
            if is_covered(pixel) {
                weights.indices.push(0);
                weights.weights.push(0.5 + pixel as f32 / 64.0);
            }
            weights.starts.push(weights.indices.len() as u32);
        }
        let crops = crops(weights.clone(), 4);
        assert_eq!(
            crops.len(),
            1,
            "the best where none is covered well: weights are about 0.75, 3/4 of the second"
        );
        assert_eq!(
            crops[0].alpha(),
            [0, 1, 2, 3].map(|y| [0, 1, 2, 3].map(|x| weights.alpha()[y * 8 + x])).as_flattened()
        );
        weights.weights.fill(1.0);
        assert_eq!(super::crops(weights, 4).len(), 2);
    }

    #[test]
    fn a_chain_holds_just_what_is_looked_at() {
        // A line of Gaussians, each seeing itself and the next; the last sees itself twice.
        let neighbors = Neighbors { k: 2, indices: vec![0, 1, 1, 2, 2, 3, 3, 4, 4, 4] };
        let (windows, rows) = window_chain(&neighbors, &[1], 2);
        assert_eq!(rows, [1, 2, 3]);
        assert_eq!(windows[0].neighbors, [0, 1, 1, 2]);
        assert_eq!(windows[1].neighbors, [0, 1]);
    }
}
