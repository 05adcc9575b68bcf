//! Paintings to train with: random crops, and the statistics of each that the losses and AdaIN need.

use std::{collections::HashMap, path::PathBuf};

use burn::tensor::Tensor;
use stylegaussian::{
    ChannelStatistics, EncoderId,
    random::Random,
    recolor::{ColorMoments, Recoloring},
};
use stylegaussian_encoder::{Encoder, Image, StyleSize, image::MAX_SIDE, style_statistics};

use crate::{
    error::{TrainError, ensure},
    nn::{
        checkpoint::fingerprint_of_files,
        loss_network::{FeatureRows, LossNetwork, RELU3_1, picture_tensor},
        parameter::to_vec,
    },
};

/// Side of a crop in pixels, as in the paper.
const CROP: u32 = 256;

/// Shorter side of a painting before cropping, in pixels. Strokes then have the scale that they have if a whole
/// painting is encoded.
const SHORTER_SIDE: u32 = 512;

/// Crops of each painting. The statistics of a crop are kept, so only its first use costs time.
const CROPS_PER_PAINTING: usize = 16;

/// Palettes of every four crops. A hundred paintings have too few palettes, so two crops keep their painting's,
/// one takes another painting's, and one takes a random palette as vivid as prints and posters.
const PALETTES: [Palette; 4] = [Palette::Own, Palette::OfAnother, Palette::Own, Palette::Random];

/// The colors of a crop.
#[derive(Clone, Copy)]
enum Palette {
    Own,
    OfAnother,
    Random,
}

/// Statistics of a crop.
pub struct Style {
    /// relu3_1 statistics, which AdaIN matches.
    pub statistics: ChannelStatistics,
    /// Mean and standard deviation `[2, D]` at each of the loss's layers.
    pub targets: Vec<Tensor<2>>,
    /// Mean color. It is the background of the scene, so that pixels without scene hardly change the
    /// statistics.
    pub mean_color: [f32; 3],
    /// Mean and covariance of the colors.
    pub colors: ColorMoments,
}

/// Which painting, and which of its crops.
pub type CropKey = (usize, usize);

/// Paintings, and the networks that see them.
pub struct Paintings<'a> {
    paths: Vec<PathBuf>,
    /// The encoder that the scenes were embedded with.
    pub(super) encoder: &'a Encoder,
    pub(super) loss_network: LossNetwork,
    /// Whether the loss network has the encoder's weights, so that relu3_1 need not be computed twice.
    loss_is_encoder: bool,
    pub(super) seed: u64,
    styles: HashMap<CropKey, Style>,
    /// The keys of `styles`, in the order in which they were first used.
    used: Vec<CropKey>,
}

impl<'a> Paintings<'a> {
    /// The image files at `paths`, seen by the scenes' encoder and by the loss network.
    pub fn new(paths: Vec<PathBuf>, encoder: &'a Encoder, loss_network: LossNetwork) -> Self {
        Self {
            paths,
            encoder,
            loss_network,
            loss_is_encoder: false,
            seed: 0,
            styles: HashMap::new(),
            used: Vec::new(),
        }
    }

    /// Takes the encoder's features from the loss network. For a loss network with the encoder's own weights,
    /// which then sees each painting only once.
    pub fn with_encoder_in_loss(mut self) -> Self {
        self.loss_is_encoder = true;
        self
    }

    /// Picks a random crop of a random painting, and computes its statistics if it is new.
    ///
    /// # Errors
    /// If there is no painting or an image cannot be read.
    pub fn pick(&mut self, random: &mut Random) -> Result<CropKey, TrainError> {
        ensure!(!self.paths.is_empty(), "found no painting, expected at least one");
        // Always two numbers, known crop or not, so that what follows in a step does not depend on earlier
        // steps.
        let key = (random.below(self.paths.len()), random.below(CROPS_PER_PAINTING));
        if !self.styles.contains_key(&key) {
            let style = self.compute(key)?;
            self.styles.insert(key, style);
            self.used.push(key);
        }
        Ok(key)
    }

    fn compute(&self, key: CropKey) -> Result<Style, TrainError> {
        let mut crop = self.crop(key)?;
        if let Some(palette) = self.palette(key)? {
            let recoloring = Recoloring::new(&ColorMoments::of_rgb(&crop.rgb), &palette);
            for pixel in crop.rgb.chunks_exact_mut(3) {
                let color = recoloring.color([pixel[0], pixel[1], pixel[2]]);
                pixel.copy_from_slice(&color.map(|channel| channel.clamp(0.0, 1.0)));
            }
        }
        let mut style = Style::of(&crop, self.encoder.id(), &self.loss_network)?;
        if !self.loss_is_encoder {
            // The recolored crop, not the file: both networks must see the same picture.
            style.statistics = style_statistics(self.encoder, &crop, StyleSize::default())?;
        }
        Ok(style)
    }

    /// The statistics of a crop that was picked.
    pub fn style(&self, key: CropKey) -> &Style {
        &self.styles[&key]
    }

    /// Random crops of other paintings than `key`'s, `n` or as many as were picked so far.
    pub fn others(&self, key: CropKey, n: usize, random: &mut Random) -> Vec<&Style> {
        // Only crops whose statistics are there already. A resumed training has none at first.
        let mut others: Vec<CropKey> = self.used.iter().copied().filter(|other| other.0 != key.0).collect();
        // The first n steps of a Fisher-Yates shuffle.
        for i in 0..n.min(others.len()) {
            let chosen = i + random.below(others.len() - i);
            others.swap(i, chosen);
        }
        others.iter().take(n).map(|other| &self.styles[other]).collect()
    }

    /// The palette that a crop takes, or `None` if it keeps its own.
    fn palette(&self, key: CropKey) -> Result<Option<ColorMoments>, TrainError> {
        // `PALE` in ASCII: other numbers than those that place the crop.
        let mut random = Random::new(self.seed_of(key) ^ 0x5041_4C45);
        Ok(match PALETTES[key.1 % PALETTES.len()] {
            Palette::Own => None,
            // The draw can be the painting itself, whose crop then keeps its colors.
            Palette::OfAnother => {
                Some(ColorMoments::of_rgb(&self.crop((random.below(self.paths.len()), key.1))?.rgb))
            }
            Palette::Random => Some(ColorMoments::random(&mut random)),
        })
    }

    /// A fingerprint of all paintings.
    pub(super) fn fingerprint(&self) -> Result<String, TrainError> {
        fingerprint_of_files(&self.paths)
    }

    /// One seed for each crop: its part of the painting does not depend on the order in which crops are picked.
    fn seed_of(&self, (painting, crop): CropKey) -> u64 {
        self.seed ^ ((painting * CROPS_PER_PAINTING + crop) as u64).wrapping_mul(0x9E37_79B9)
    }

    fn crop(&self, (painting, crop): CropKey) -> Result<Image, TrainError> {
        let image = Image::open_painting(&self.paths[painting])?;
        let shorter = image.width.min(image.height);
        let scaled = |side: u32| {
            // In 64 bits, because a side times 512 can overflow 32.
            let scaled = u64::from(side) * u64::from(SHORTER_SIDE) / u64::from(shorter);
            // A strip of a few pixels by thousands would otherwise take gigabytes.
            scaled.clamp(u64::from(CROP), u64::from(MAX_SIDE)) as u32
        };
        let image = image.resized(scaled(image.width), scaled(image.height));
        let mut random = Random::new(self.seed_of((painting, crop)));
        let x = random.below((image.width - CROP + 1) as usize);
        let y = random.below((image.height - CROP + 1) as usize);
        let row = |row: usize| &image.rgb[((y + row) * image.width as usize + x) * 3..][..CROP as usize * 3];
        Ok(Image {
            width: CROP,
            height: CROP,
            rgb: (0..CROP as usize).flat_map(row).copied().collect(),
            alpha: None,
        })
    }
}

impl Style {
    /// Statistics of a picture. Those for AdaIN hold if `network` has the weights of `encoder`.
    fn of(image: &Image, encoder: &EncoderId, network: &LossNetwork) -> Result<Self, TrainError> {
        let size = [image.width as usize, image.height as usize];
        let features = network.features(picture_tensor(&image.rgb, network.device()), size);
        let targets: Vec<_> = features.iter().map(FeatureRows::statistics).collect();
        // relu3_1 is the encoder's layer: it need not be computed twice.
        let values = to_vec(&targets[RELU3_1])?;
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
        Ok(Self { statistics, targets, mean_color, colors: ColorMoments::of_rgb(&image.rgb) })
    }
}
