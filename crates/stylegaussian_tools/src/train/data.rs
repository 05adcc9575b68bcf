//! Scenes as training sees them: for each view its blending weights and only the Gaussians that reach the picture.

use std::sync::Arc;

use rayon::prelude::*;
use stylegaussian::{
    Camera, Features, Neighbors, Scene,
    fold::{centered_inputs, neighbors_for},
    splat::{BlendWeights, blend_weights},
    statistics::{ContentStatistics, mean_low},
};

use super::ops::Windows;

/// Blending weights below this are dropped and the rest of the pixel scaled up to its alpha: together they carry about
/// a hundredth of a picture, and half of the Gaussians.
const MIN_WEIGHT: f32 = 2e-3;

/// A scene that is trained on.
pub struct TrainingScene {
    /// Centered inputs `[N, L + E]`.
    pub inputs: Vec<f32>,
    /// L + E.
    pub n_inputs: usize,
    /// The features, for the fold.
    pub features: Features,
    /// The mean of f' `[L]`.
    pub mean_low: Vec<f64>,
    /// Content statistics, for AdaIN.
    pub statistics: ContentStatistics,
    /// Neighbor lists at the decoder's K.
    pub neighbors: Neighbors,
    /// Unstyled colors `[N]`.
    pub base_colors: Vec<[f32; 3]>,
    /// The views.
    pub views: Vec<View>,
}

/// One view of a scene.
pub struct View {
    /// Weights over the rows of the last layer's output `[H * W, M]`.
    pub weights: Arc<BlendWeights>,
    /// One set of windows for each layer, from the rows it takes to the rows the next one needs.
    pub windows: Vec<Arc<Windows>>,
    /// The first layer's rows: Gaussian indices `[N_0]`.
    pub input_rows: Vec<u32>,
    /// The last layer's rows: Gaussian indices `[M]`, those that reach the picture.
    pub output_rows: Vec<u32>,
    /// Coverage of each pixel `[H * W]`.
    pub alpha: Vec<f32>,
    /// The unstyled picture `[H * W, 3]`, premultiplied.
    pub picture: Vec<f32>,
}

impl TrainingScene {
    /// Prepares `scene` as seen by `cameras` for decoders of `n_layers` layers and window `k`; `None` when it was never
    /// embedded. A view that shows nothing is left out.
    pub fn new(scene: &Scene, cameras: &[Camera], k: usize, n_layers: usize) -> Option<Self> {
        let features = scene.features.clone()?;
        let mean_low = mean_low(&features);
        let neighbors = neighbors_for(scene, k).into_owned();
        let base_colors = scene.base_colors();
        let views =
            cameras.iter().filter_map(|camera| View::new(scene, camera, &neighbors, &base_colors, n_layers));
        Some(Self {
            views: views.collect(),
            inputs: centered_inputs(&features, &mean_low),
            n_inputs: features.n_low + features.n_extra,
            statistics: ContentStatistics::of(&features),
            features,
            mean_low,
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
        scene: &Scene,
        camera: &Camera,
        neighbors: &Neighbors,
        base_colors: &[[f32; 3]],
        n_layers: usize,
    ) -> Option<Self> {
        let weights = without_faint(&blend_weights(scene, camera));
        let mut reaches = vec![false; scene.len()];
        weights.indices.iter().for_each(|&gaussian| reaches[gaussian as usize] = true);
        let output_rows: Vec<u32> = (0..scene.len() as u32).filter(|&i| reaches[i as usize]).collect();
        if output_rows.is_empty() {
            return None;
        }
        let (windows, input_rows) = window_chain(neighbors, &output_rows, n_layers);
        let colors: Vec<f32> = output_rows.iter().flat_map(|&row| base_colors[row as usize]).collect();
        let weights = relabeled(weights, &output_rows);
        Some(Self {
            alpha: weights.alpha(),
            picture: weights.apply(&colors, 3),
            weights: Arc::new(weights),
            windows,
            input_rows,
            output_rows,
        })
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.weights.size.x as usize, self.weights.size.y as usize]
    }
}

/// From the last layer back to the first: the rows a layer must give are those the next one's windows look at.
/// Everything is exact: a row outside is looked at by no one.
pub fn window_chain(
    neighbors: &Neighbors,
    output_rows: &[u32],
    n_layers: usize,
) -> (Vec<Arc<Windows>>, Vec<u32>) {
    let n = neighbors.indices.len() / neighbors.k;
    let mut rows = output_rows.to_vec();
    let mut windows = Vec::new();
    for _ in 0..n_layers {
        let mut position = vec![u32::MAX; n];
        let lists =
            || rows.iter().flat_map(|&row| &neighbors.indices[row as usize * neighbors.k..][..neighbors.k]);
        lists().for_each(|&row| position[row as usize] = 0);
        let needed: Vec<u32> = (0..n as u32).filter(|&row| position[row as usize] == 0).collect();
        needed.iter().enumerate().for_each(|(i, &row)| position[row as usize] = i as u32);
        let local: Vec<u32> = lists().map(|&row| position[row as usize]).collect();
        windows.push(Arc::new(Windows::new(local, neighbors.k, needed.len())));
        rows = needed;
    }
    windows.reverse();
    (windows, rows)
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
    fn a_chain_holds_just_what_is_looked_at() {
        // A line of Gaussians, each seeing itself and the next; the last sees itself twice.
        let neighbors = Neighbors { k: 2, indices: vec![0, 1, 1, 2, 2, 3, 3, 4, 4, 4] };
        let (windows, rows) = window_chain(&neighbors, &[1], 2);
        assert_eq!(rows, [1, 2, 3]);
        assert_eq!(windows[0].neighbors, [0, 1, 1, 2]);
        assert_eq!(windows[1].neighbors, [0, 1]);
    }
}
