//! Paintings to train with: random crops, and what the loss and AdaIN want to know of each.

use std::{
    collections::HashMap,
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use burn::tensor::{Device, Tensor, TensorData};
use stylegaussian::{ChannelStatistics, EncoderId};
use stylegaussian_encoder::{Encoder, Image, StyleSize, style_statistics};

use super::{
    loss_network::{FeatureRows, LossNetwork, RELU3_1},
    network::to_vec,
};
use crate::{
    random::Random,
    recolor::{ColorMoments, Recoloring},
};

/// Side of a crop, as in the paper.
pub const CROP: u32 = 256;

/// Shorter side of a painting before cropping: strokes keep the scale they have when a whole painting is encoded.
const SHORTER_SIDE: u32 = 512;

/// Crops of each painting; what the networks say of a crop is kept, so only the first look at it costs.
const CROPS_PER_PAINTING: usize = 16;

/// Palettes are what a hundred paintings have too few of: of every four crops two keep their painting's own, one takes
/// that of another painting, and one takes a random one, as vivid as prints and posters are.
const PALETTES: [Palette; 4] = [Palette::Own, Palette::OfAnother, Palette::Own, Palette::Random];

/// Whose colors a crop has.
#[derive(Clone, Copy)]
enum Palette {
    Own,
    OfAnother,
    Random,
}

/// What is known of a crop.
pub struct Style {
    /// relu3_1 statistics, which AdaIN matches.
    pub statistics: ChannelStatistics,
    /// Mean and standard deviation `[2, D]` at each of the loss's layers.
    pub targets: Vec<Tensor<2>>,
    /// Mean color: what stands behind the scene, so that pixels without scene sway no statistic much.
    pub mean_color: [f32; 3],
    /// Mean and covariance of the colors.
    pub colors: ColorMoments,
}

/// A folder of paintings.
pub struct Paintings {
    paths: Vec<PathBuf>,
    seed: u64,
    encoder_is_loss: bool,
    known: HashMap<CropKey, Style>,
    /// The keys of `known`, in the order in which they were looked at.
    seen: Vec<CropKey>,
}

/// Which painting, and which of its crops.
pub type CropKey = (usize, usize);

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
    /// The paintings at `paths`; `seed` chooses the crops. `encoder_is_loss`: the loss's network has the encoder's weights.
    pub fn new(paths: Vec<PathBuf>, seed: u64, encoder_is_loss: bool) -> Self {
        Self { paths, seed, encoder_is_loss, known: HashMap::new(), seen: Vec::new() }
    }

    /// The crop that `random` picks of the painting that it picks; looks at it, where it is the first time.
    ///
    /// # Errors
    /// When an image cannot be read.
    pub fn pick(
        &mut self,
        random: &mut Random,
        encoder: &Encoder,
        network: &LossNetwork,
        device: &Device,
    ) -> Result<CropKey> {
        let key = (random.below(self.paths.len()), random.below(CROPS_PER_PAINTING));
        if !self.known.contains_key(&key) {
            let mut crop = self.crop(key)?;
            if let Some(palette) = self.palette(key)? {
                let recoloring = Recoloring::new(&ColorMoments::of_image(&crop), &palette);
                for pixel in crop.rgb.chunks_exact_mut(3) {
                    let color = recoloring.color([pixel[0], pixel[1], pixel[2]]);
                    pixel.copy_from_slice(&color.map(|channel| channel.clamp(0.0, 1.0)));
                }
            }
            let mut style = Style::of(&crop, encoder.id(), network, device);
            if !self.encoder_is_loss {
                style.statistics = style_statistics(encoder, &crop, StyleSize::default())?;
            }
            self.known.insert(key, style);
            self.seen.push(key);
        }
        Ok(key)
    }

    /// What is known of a crop that was picked.
    pub fn style(&self, key: CropKey) -> &Style {
        &self.known[&key]
    }

    /// `n` crops, or as many as were picked so far, of other paintings than `key`'s.
    pub fn others(&self, key: CropKey, n: usize, random: &mut Random) -> Vec<&Style> {
        let mut others: Vec<CropKey> = self.seen.iter().copied().filter(|other| other.0 != key.0).collect();
        for i in 0..n.min(others.len()) {
            let chosen = i + random.below(others.len() - i);
            others.swap(i, chosen);
        }
        others.iter().take(n).map(|other| &self.known[other]).collect()
    }

    /// What a crop's colors become; `None` keeps them.
    fn palette(&self, key: (usize, usize)) -> Result<Option<ColorMoments>> {
        let mut random = Random::new(self.seed_of(key) ^ 0x5041_4C45);
        Ok(match PALETTES[key.1 % PALETTES.len()] {
            Palette::Own => None,
            Palette::OfAnother => {
                Some(ColorMoments::of_image(&self.crop((random.below(self.paths.len()), key.1))?))
            }
            Palette::Random => Some(ColorMoments::random(&mut random)),
        })
    }

    /// One seed for each crop: which part of the painting it is does not depend on what was looked at before.
    fn seed_of(&self, (painting, crop): (usize, usize)) -> u64 {
        self.seed ^ ((painting * CROPS_PER_PAINTING + crop) as u64).wrapping_mul(0x9E37_79B9)
    }

    fn crop(&self, (painting, crop): (usize, usize)) -> Result<Image> {
        let image = Image::open(&self.paths[painting])?;
        let shorter = image.width.min(image.height);
        let scaled = |side: u32| {
            (u64::from(side) * u64::from(SHORTER_SIDE) / u64::from(shorter)).max(u64::from(CROP)) as u32
        };
        let image = image.resized(scaled(image.width), scaled(image.height));
        let mut random = Random::new(self.seed_of((painting, crop)));
        let x = random.below((image.width - CROP + 1) as usize);
        let y = random.below((image.height - CROP + 1) as usize);
        let row = |row: usize| &image.rgb[((y + row) * image.width as usize + x) * 3..][..CROP as usize * 3];
        Ok(Image { width: CROP, height: CROP, rgb: (0..CROP as usize).flat_map(row).copied().collect() })
    }
}

impl Style {
    /// Looks at a picture for AdaIN and for the loss. `network` holds the weights of `encoder`.
    fn of(image: &Image, encoder: &EncoderId, network: &LossNetwork, device: &Device) -> Self {
        let size = [image.width as usize, image.height as usize];
        let features = network.features(picture_tensor(&image.rgb, device), size);
        let targets: Vec<_> = features.iter().map(FeatureRows::statistics).collect();
        // relu3_1 is the encoder's layer: it need not be computed twice.
        let values = to_vec(&targets[RELU3_1]);
        let (mean, std_dev) = values.split_at(values.len() / 2);
        let statistics = ChannelStatistics {
            mean: mean.to_vec(),
            std_dev: std_dev.to_vec(),
            covariance: None,
            encoder: Some(encoder.clone()),
        };
        let n = (image.rgb.len() / 3) as f32;
        let mut mean_color = [0.0; 3];
        for pixel in image.rgb.chunks_exact(3) {
            mean_color.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += value / n);
        }
        Self { statistics, targets, mean_color, colors: ColorMoments::of_image(image) }
    }
}

/// Interleaved RGB `[H, W, 3]` as `[H * W, 3]`.
pub fn picture_tensor(rgb: &[f32], device: &Device) -> Tensor<2> {
    Tensor::from_data(TensorData::new(rgb.to_vec(), [rgb.len() / 3, 3]), device)
}
