//! The bake itself.

use std::{f32::consts::PI, path::Path, sync::Arc};

use rayon::prelude::*;
use stylegaussian::{
    Camera, Scene,
    look::SceneFingerprint,
    random::Random,
    recolor::Recoloring,
    splat::{BlendWeights, blend_weights_from},
    strokes::{StrokeSeed, Strokes},
    work::{Canceled, Work},
};
use stylegaussian_encoder::Image;
use stylegaussian_files::tensors::Dimension;

use crate::{
    adam::Adam,
    cameras::{Cameras, DISTANCES},
    checkpoint::{Identity, State},
    config::BakeConfig,
    error::BakeError,
    loss::{
        self, Losses, matching,
        shapes::ShapeAim,
        statistics::{self, Moments},
    },
    network::{Features, Layer, LossNetwork, Size, Sizes},
    picture::{Mask, over, strokes_over},
    start::{Start, Whole},
    target::{LayerTarget, Paintings},
};

/// The share of the rate at the last step.
const LAST_RATE: f32 = 0.3;

/// The share of the steps, at the end, over which colors are averaged (Polyak and Juditsky 1992). Each step
/// sees one crop. Colors that fit this crop alone are grain in the others, which quiet paintings do not have
/// (docs/notes.md, "Bakes").
const AVERAGED: f32 = 0.2;

/// Least blend weight that is drawn and gets a gradient. Two fifths of all are smaller, and make up 0.3% of the
/// pictures of the demo scene and 0.5% of those of the bonsai.
const LEAST_WEIGHT: f32 = 0.001;

/// The view of one step, apart from colors.
struct Crop {
    /// The number of the step.
    step: u32,
    /// The group by distance of its view.
    distance: usize,
    weights: BlendWeights,
    alpha: Vec<f32>,
    mask: Mask,
    /// The detail that strokes add to the picture `[h * w * 3]`.
    strokes: Vec<f32>,
    /// The step's random numbers, after those of its camera.
    random: Random,
}

impl Crop {
    fn draw(step: u32, config: &BakeConfig, cameras: &Cameras, scene: &Scene, strokes: &Strokes) -> Self {
        let mut random = Random::new(config.seed ^ (u64::from(step) + 1).wrapping_mul(0xD134_2543_DE82_EF95));
        let camera = cameras.sample(step, config.crop, &mut random, config.seed);
        let weights = blend_weights_from(scene, &camera, LEAST_WEIGHT);
        let alpha = weights.alpha();
        let side = config.crop as usize;
        let mask = Mask::new(Size { width: side, height: side }, &alpha);
        let strokes = strokes_over(scene, strokes, &camera, &weights);
        Self { step, distance: cameras.distance(step, config.seed), weights, alpha, mask, strokes, random }
    }
}

/// A bake: colors under a painting's strokes, moved step by step from instant paint toward the painting.
pub struct Baker {
    config: BakeConfig,
    network: LossNetwork,
    sizes: Sizes,
    paintings: Paintings,
    cameras: Arc<Cameras>,
    /// The view of the next step, if it was drawn beside the last one.
    next: Option<Crop>,
    /// The aim for large shapes.
    aim: ShapeAim,
    /// Colors and strokes at the start. The strokes stay as they are.
    start: Arc<Start>,
    /// `[N * 3]`.
    colors: Vec<f32>,
    /// The mean of the colors before and after the last steps so far `[N * 3]`; empty before them.
    average: Vec<f32>,
    adam: Adam,
    /// Running moments of each layer, in color and as gray, for each distance; none before the first step
    /// there.
    pooled: [[Vec<Option<Moments>>; DISTANCES]; 2],
    steps: u32,
    /// Scene, paintings, network and settings, as a hash.
    identity: String,
}

impl Baker {
    /// Prepares a bake and paints the scene. `cameras` are those of a capture; if there are none, they are the
    /// scene's own, or chosen. Paintings have weights in the mix.
    ///
    /// # Errors
    /// If nothing of the scene is visible, or no painting can be used. If `work` is canceled.
    pub fn new(
        config: BakeConfig,
        scene: &Scene,
        cameras: &[Camera],
        paintings: &[(Image, f32)],
        network: LossNetwork,
        work: &Work,
    ) -> Result<Self, BakeError> {
        Self::made(config, (scene, None), cameras, paintings, network, work)
    }

    /// As [`new`](Self::new), for a part of a larger scene, such as a chunk of a world and what is around it.
    /// `whole` is the larger scene, in few Gaussians: it is painted first, and the part begins in its colors,
    /// its strokes and its contrast, so that parts that are baked apart fit together.
    ///
    /// # Errors
    /// As [`new`](Self::new), of both scenes.
    pub fn of_part(
        config: BakeConfig,
        (scene, whole): (&Scene, &Scene),
        cameras: &[Camera],
        paintings: &[(Image, f32)],
        network: LossNetwork,
        work: &Work,
    ) -> Result<Self, BakeError> {
        Self::made(config, (scene, Some(whole)), cameras, paintings, network, work)
    }

    fn made(
        config: BakeConfig,
        (scene, whole): (&Scene, Option<&Scene>),
        cameras: &[Camera],
        paintings: &[(Image, f32)],
        network: LossNetwork,
        work: &Work,
    ) -> Result<Self, BakeError> {
        let images = paintings;
        // Other random numbers than those of any step.
        let mut random = Random::new(!config.seed);
        let paintings = Paintings::new(images, config.view, config.keys, &mut random, &network, work)?;
        work.at(0.1)?;
        let cameras = Cameras::survey(scene, cameras, config.view, config.crop, work)?
            .ok_or(BakeError::NothingVisible { n_gaussians: scene.len() })?;
        let side = config.crop as usize;
        let sizes = network.sizes(Size { width: side, height: side });
        let captured = scene.base_colors();
        let whole =
            whole.map(|whole| Whole::new(whole, &config, images, &work.part(0.5, 0.6))).transpose()?;
        let shown = whole.as_ref().map_or(&cameras.colors, |whole| &whole.colors);
        let recoloring = Recoloring::new(shown, &paintings.colors);
        let recolored: Vec<f32> = captured.iter().flat_map(|&color| recoloring.color(color)).collect();
        let aim = ShapeAim::new(paintings.shapes, cameras.contrast(&recoloring));
        let seen = (&cameras, whole.as_ref());
        let start = Start::new(scene, seen, images, recolored, config.paint, &work.part(0.6, 1.0))?;
        let adam = Adam::new(scene.len());
        let identity = identity(&config, scene, captured.as_flattened(), &paintings, &cameras, &start);
        let none = || vec![None; network.layers().len()];
        let pooled = [(); 2].map(|()| [(); DISTANCES].map(|()| none()));
        Ok(Self {
            config,
            network,
            sizes,
            paintings,
            cameras: Arc::new(cameras),
            next: None,
            aim,
            colors: start.colors.clone(),
            start: Arc::new(start),
            average: Vec::new(),
            adam,
            pooled,
            steps: 0,
            identity,
        })
    }

    /// The colors so far `[N]`, in scene order: those under [`strokes`](Self::strokes).
    pub fn colors(&self) -> &[[f32; 3]] {
        self.colors.as_chunks::<3>().0
    }

    /// The strokes that are drawn over the colors, from the start to the end. None if [`BakeConfig::paint`] is
    /// 0.
    pub fn strokes(&self) -> &Strokes {
        &self.start.strokes
    }

    /// Steps so far.
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// Whether all steps are done.
    pub fn is_complete(&self) -> bool {
        self.steps >= self.config.steps
    }

    /// Writes the state to a checkpoint, from which [`Self::resume`] goes on.
    ///
    /// # Errors
    /// If the file cannot be written. An older one then stays as it was.
    pub fn save(&self, path: &Path) -> Result<(), BakeError> {
        let mut values = vec![
            ("colors".into(), self.colors.clone()),
            ("average".into(), self.average.clone()),
            ("adam.mean".into(), self.adam.mean.clone()),
            ("adam.square".into(), self.adam.square.clone()),
        ];
        for (group, layers) in self.pooled.iter().flatten().enumerate() {
            for (i, moments) in layers.iter().enumerate() {
                let both = moments.as_ref().map(|moments| [&moments.mean[..], &moments.square[..]].concat());
                values.push((format!("pooled.{group}.{i}"), both.unwrap_or_default()));
            }
        }
        // Empty lists: nothing is pooled before the first step, and nothing averaged before the last ones.
        State { steps: self.steps, identity: self.identity.clone(), values }.write(path)
    }

    /// Goes on from a checkpoint of the same scene, paintings, network and settings. The result is that of a
    /// bake without the interruption, bit by bit.
    ///
    /// # Errors
    /// If the file cannot be read, or is another bake's. The state then stays as it was.
    pub fn resume(&mut self, path: &Path) -> Result<(), BakeError> {
        let n = self.adam.square.len();
        let mut lengths = vec![
            ("colors".into(), Dimension::Is(3 * n)),
            ("average".into(), Dimension::IsOrNone(3 * n)),
            ("adam.mean".into(), Dimension::Is(3 * n)),
            ("adam.square".into(), Dimension::Is(n)),
        ];
        for (group, layers) in self.pooled.iter().flatten().enumerate() {
            let of_layer = |(i, layer): (usize, &Layer)| {
                (format!("pooled.{group}.{i}"), Dimension::IsOrNone(2 * layer.channels))
            };
            lengths.extend(self.network.layers()[..layers.len()].iter().enumerate().map(of_layer));
        }
        let state = State::read(path, &self.identity, &lengths)?;
        let mut values = state.values.into_iter().map(|(_, values)| values);
        let mut next = || values.next().unwrap_or_default();
        (self.colors, self.average) = (next(), next());
        (self.adam.mean, self.adam.square) = (next(), next());
        for moments in self.pooled.iter_mut().flatten().flatten() {
            let both = next();
            let (mean, square) = both.split_at(both.len() / 2);
            let found = Moments { mean: mean.into(), square: square.into() };
            *moments = (!both.is_empty()).then_some(found);
        }
        self.steps = state.steps;
        Ok(())
    }

    /// One step: compares one crop, and moves the colors that it shows.
    ///
    /// # Panics
    /// If `scene` has another number of Gaussians than the one that the bake began with.
    pub fn step(&mut self, scene: &Scene) -> Losses {
        let losses = self.step_if_wanted(scene, &Work::default());
        losses.expect("nobody else has the work, so nobody cancels it")
    }

    /// As [`step`](Self::step). It tells no progress.
    ///
    /// # Errors
    /// If `work` is canceled. No color has moved then, but moments may have: the bake must not go on.
    ///
    /// # Panics
    /// As [`step`](Self::step).
    pub fn step_if_wanted(&mut self, scene: &Scene, work: &Work) -> Result<Losses, Canceled> {
        work.check()?;
        assert_eq!(self.colors.len(), scene.len() * 3, "one color per Gaussian");
        let (step, config, cameras, start) =
            (self.steps, self.config, self.cameras.clone(), self.start.clone());
        let draw = |step| Crop::draw(step, &config, &cameras, scene, &start.strokes);
        let drawn = self.next.take().filter(|crop| crop.step == step);
        let crop = drawn.unwrap_or_else(|| draw(step));
        // Drawn beside this step, parts of which run on one thread.
        let ahead = || (step + 1 < config.steps).then(|| draw(step + 1));
        work.check()?;
        let (losses, next) = rayon::join(|| self.step_on(crop, work), ahead);
        self.next = next;
        losses
    }

    fn step_on(&mut self, crop: Crop, work: &Work) -> Result<Losses, Canceled> {
        let Crop { distance, weights, alpha, mask, strokes, mut random, .. } = crop;
        let config = self.config;
        let side = config.crop as usize;
        let size = Size { width: side, height: side };
        let mut rgb = over(&weights, &alpha, &self.colors, self.paintings.mean);
        rgb.iter_mut().zip(&strokes).for_each(|(value, stroke)| *value += stroke);
        let pixels = mask.cells(size);
        // Every other step compares texture alone.
        let gray = self.steps % 2 == 1;
        let tone = gray.then_some(self.paintings.tone);
        let seen = tone.map_or_else(|| rgb.clone(), |tone| tone.gray(&rgb));
        let features = self.network.forward(&self.sizes, &seen, work)?;
        let (mut losses, grads) = self.compare(gray, distance, &features, &mask, &mut random);
        let mut grad = self.network.backward(&self.sizes, &features, grads, work)?;
        if let Some(tone) = tone {
            grad = tone.backward(&grad, self.paintings.line);
        }
        losses.shapes = (config.weights.shapes > 0.0 && !gray).then(|| {
            let start = over(&weights, &alpha, &self.start.colors, self.paintings.mean);
            self.aim.loss([&rgb, &start], side, &pixels, config.weights.shapes, &mut grad)
        });
        losses.range = loss::range(&rgb, &pixels, config.weights.range, &mut grad);
        let grad = weights.apply_transposed(&grad, 3);
        let progress = self.steps as f32 / config.steps.max(1) as f32;
        let rate = config.rate * (LAST_RATE + (1.0 - LAST_RATE) * 0.5 * (1.0 + (PI * progress).cos()));
        let scale: Vec<f32> = self.cameras.pixels.iter().map(|pixels| pixels.min(1.0)).collect();
        self.adam.step(&mut self.colors, &grad, self.steps, rate, &scale);
        self.protect(rate * config.protection);
        losses.palette = self.paintings.palette.pull(&mut self.colors, config.weights.palette);
        self.steps += 1;
        self.average_last();
        Ok(losses)
    }

    /// Takes the colors into the average, if they are before or after one of the last steps. At the very end
    /// the colors are the average.
    fn average_last(&mut self) {
        let first = self.config.steps - (AVERAGED * self.config.steps as f32) as u32;
        if self.steps < first {
            return;
        }
        self.average.resize(self.colors.len(), 0.0);
        let share = 1.0 / (self.steps - first + 1) as f32;
        for (average, color) in self.average.iter_mut().zip(&self.colors) {
            *average += share * (color - *average);
        }
        if self.is_complete() {
            self.colors.clone_from(&self.average);
        }
    }

    /// Moves colors of protected Gaussians toward the start, by the share `share` times their protection.
    fn protect(&mut self, share: f32) {
        let starts = self.start.colors.chunks_exact(3).zip(&self.start.protected);
        for (color, (start, protected)) in self.colors.chunks_exact_mut(3).zip(starts) {
            let share = (share * protected).min(1.0);
            color.iter_mut().zip(start).for_each(|(color, start)| *color += share * (start - *color));
        }
    }

    /// The losses of features and their gradients with respect to each layer's rows, of a view of the group
    /// `distance`.
    fn compare(
        &mut self,
        gray: bool,
        distance: usize,
        features: &Features,
        mask: &Mask,
        random: &mut Random,
    ) -> (Losses, Vec<Vec<f32>>) {
        let (mut losses, mut grads) = (Losses::default(), Vec::new());
        let BakeConfig { weights, pool, queries, .. } = self.config;
        // Random numbers are drawn in order, before the layers are shared out among threads.
        let drawn: Vec<(Vec<u32>, Vec<u32>)> = (self.network.layers().iter())
            .map(|layer| {
                let cells = mask.cells(self.sizes.size(layer));
                let matched = layer.matching > 0.0;
                let some = if matched { matching::some_of(&cells, queries, random) } else { Vec::new() };
                (cells, some)
            })
            .collect();
        let targets = self.paintings.layers(gray);
        let pooled = &mut self.pooled[usize::from(gray)][distance];
        let layers = self.network.layers().par_iter().zip(drawn).zip(pooled).zip(targets);
        let compared: Vec<(Losses, Vec<f32>)> = layers
            .map(|(((layer, (cells, queries)), pooled), LayerTarget { statistics: target, keys })| {
                let (mut losses, rows) = (Losses::default(), features.rows(layer));
                let mut grad = vec![0.0; rows.len()];
                if cells.is_empty() {
                    return (losses, grad);
                }
                let n = layer.channels;
                let moments = Moments::of(rows, n, cells.iter().map(|&cell| cell as usize));
                match pooled {
                    Some(pooled) => pooled.blend(&moments, pool),
                    None => *pooled = Some(moments.clone()),
                }
                let pooled = pooled.as_ref().unwrap_or(&moments);
                let weight = weights.statistics * layer.statistics;
                losses.statistics = layer.statistics
                    * statistics::statistics(rows, &cells, pooled, target, weight, &mut grad);
                let weight = weights.matching * layer.matching;
                losses.matching = matching::matching(rows, &queries, keys, weight, &mut grad);
                (losses, grad)
            })
            .collect();
        for (of_layer, grad) in compared {
            losses.statistics += of_layer.statistics;
            losses.matching += of_layer.matching;
            grads.push(grad);
        }
        (losses, grads)
    }
}

/// A hash of all that a bake depends on. The paintings' statistics depend on the network, and stand for both.
fn identity(
    config: &BakeConfig,
    scene: &Scene,
    captured: &[f32],
    paintings: &Paintings,
    cameras: &Cameras,
    start: &Start,
) -> String {
    let mut identity = Identity::new();
    identity.add(format!("{config:?} {}", SceneFingerprint::of(scene)).into_bytes());
    identity.add_floats(captured);
    identity.add_floats(&cameras.pixels);
    identity.add_floats(&[cameras.pixel_size]);
    identity.add_floats(&paintings.mean);
    for layer in paintings.layers(false) {
        identity.add_floats(&layer.statistics.mean);
        identity.add_floats(&layer.statistics.deviation);
    }
    identity.add_floats(&start.colors);
    let of_seed = |seed: &StrokeSeed| [seed.place, seed.look];
    let strokes = start.strokes.words.iter().copied().chain(start.strokes.seeds.iter().flat_map(of_seed));
    identity.add(strokes.flat_map(u32::to_le_bytes));
    identity.text()
}

#[cfg(test)]
mod tests;
