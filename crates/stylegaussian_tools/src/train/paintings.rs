//! Paintings to train with: random crops, and what the loss and AdaIN want to know of each.

use std::{
    collections::HashMap,
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use burn::tensor::{Device, Tensor, TensorData};
use stylegaussian::{ChannelStatistics, EncoderId};
use stylegaussian_encoder::Image;

use super::{
    loss_network::{LossNetwork, RELU3_1, channel_statistics},
    network::to_vec,
};
use crate::random::Random;

/// Side of a crop, as in the paper.
pub const CROP: u32 = 256;

/// Shorter side of a painting before cropping: strokes keep the scale they have when a whole painting is encoded.
const SHORTER_SIDE: u32 = 512;

/// Crops of each painting; what the networks say of a crop is kept, so only the first look at it costs.
const CROPS_PER_PAINTING: usize = 4;

/// What is known of a crop.
pub struct Style {
    /// relu3_1 statistics, which AdaIN matches.
    pub statistics: ChannelStatistics,
    /// Mean and standard deviation `[1, D]` at each of the loss's layers.
    pub targets: Vec<(Tensor<2>, Tensor<2>)>,
    /// Mean color: what stands behind the scene, so that pixels without scene sway no statistic much.
    pub mean_color: [f32; 3],
}

/// A folder of paintings.
pub struct Paintings {
    paths: Vec<PathBuf>,
    seed: u64,
    known: HashMap<(usize, usize), Style>,
}

/// Files in `folder` with the extension of an image, in the order of their names.
///
/// # Errors
/// When the folder cannot be read or holds no image.
pub fn list_images(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries =
        fs::read_dir(folder).with_context(|| format!("{}: cannot list the folder", folder.display()))?;
    let mut paths = Vec::new();
    for entry in entries {
        let path = entry.with_context(|| format!("{}: cannot list the folder", folder.display()))?.path();
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        if extension.is_some_and(|extension| ["jpg", "jpeg", "png"].contains(&extension.as_str())) {
            paths.push(path);
        }
    }
    ensure!(
        !paths.is_empty(),
        "{}: found no painting; expected images (.jpg, .jpeg, .png) in the folder",
        folder.display()
    );
    paths.sort();
    Ok(paths)
}

impl Paintings {
    /// The paintings at `paths`; `seed` chooses the crops.
    pub fn new(paths: Vec<PathBuf>, seed: u64) -> Self {
        Self { paths, seed, known: HashMap::new() }
    }

    /// The crop that `random` picks of the painting that it picks.
    ///
    /// # Errors
    /// When an image cannot be read.
    pub fn pick(
        &mut self,
        random: &mut Random,
        encoder: &EncoderId,
        network: &LossNetwork,
        device: &Device,
    ) -> Result<&Style> {
        let key = (random.below(self.paths.len()), random.below(CROPS_PER_PAINTING));
        if !self.known.contains_key(&key) {
            let crop = self.crop(key)?;
            self.known.insert(key, Style::of(&crop, encoder, network, device));
        }
        Ok(&self.known[&key])
    }

    fn crop(&self, (painting, crop): (usize, usize)) -> Result<Image> {
        let image = Image::open(&self.paths[painting])?;
        let shorter = image.width.min(image.height);
        let scaled = |side: u32| {
            (u64::from(side) * u64::from(SHORTER_SIDE) / u64::from(shorter)).max(u64::from(CROP)) as u32
        };
        let image = image.resized(scaled(image.width), scaled(image.height));
        let mut random = Random::new(
            self.seed ^ ((painting * CROPS_PER_PAINTING + crop) as u64).wrapping_mul(0x9E37_79B9),
        );
        let x = random.below((image.width - CROP + 1) as usize);
        let y = random.below((image.height - CROP + 1) as usize);
        let row = |row: usize| &image.rgb[((y + row) * image.width as usize + x) * 3..][..CROP as usize * 3];
        Ok(Image { width: CROP, height: CROP, rgb: (0..CROP as usize).flat_map(row).copied().collect() })
    }
}

impl Style {
    /// Looks at a picture for AdaIN and for the loss. `network` holds the weights of `encoder`.
    pub fn of(image: &Image, encoder: &EncoderId, network: &LossNetwork, device: &Device) -> Self {
        let size = [image.width as usize, image.height as usize];
        let features = network.features(picture_tensor(&image.rgb, size, device));
        let targets: Vec<_> = features.into_iter().map(|map| channel_statistics(map, None)).collect();
        // relu3_1 is the encoder's layer: it need not be computed twice.
        let (mean, std_dev) = &targets[RELU3_1];
        let statistics = ChannelStatistics {
            mean: to_vec(mean),
            std_dev: to_vec(std_dev),
            covariance: None,
            encoder: Some(encoder.clone()),
        };
        let n = (image.rgb.len() / 3) as f32;
        let mut mean_color = [0.0; 3];
        for pixel in image.rgb.chunks_exact(3) {
            mean_color.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += value / n);
        }
        Self { statistics, targets, mean_color }
    }
}

/// Interleaved RGB `[H, W, 3]` of `[width, height]` pixels as `[1, 3, H, W]`.
pub fn picture_tensor(rgb: &[f32], [width, height]: [usize; 2], device: &Device) -> Tensor<4> {
    let rows = Tensor::<2>::from_data(TensorData::new(rgb.to_vec(), [width * height, 3]), device);
    rows.transpose().reshape([1, 3, height, width])
}
