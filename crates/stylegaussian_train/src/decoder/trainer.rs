//! The trainer: one step after another, and the state between them.

use std::{collections::HashMap, path::Path};

use burn::tensor::Device;
use stylegaussian::{Camera, Decoder, EncoderId, look::SceneFingerprint, random::Random};

use super::{
    config::{Start, TrainConfig},
    data::{PreparedScene, TrainingScene, View},
    loss::{Content, Losses, Sample, content_layers},
    network::Network,
    paintings::Paintings,
    warm_start,
};
use crate::{
    error::{TrainError, ensure},
    nn::{
        adam::Adam,
        average::Average,
        checkpoint::{self, History, Origin, fingerprint},
        parameter::to_scalar,
        schedule::cosine,
    },
    watch::{Progress, RunningMeans, Stage, Watch},
};

/// Steps between two checkpoints, and between two states that are averaged.
pub const CHECKPOINT_STEPS: u32 = 100;

/// Metadata value that distinguishes a decoder's checkpoint from other safetensors files.
const FORMAT: &str = "stylegaussian-training";

/// Adam's learning rate at the first step of the warm start, which compares colors and tolerates larger steps
/// than the paper's loss.
const WARM_RATE: f32 = 1e-3;

/// The share of the learning rate that is left at the last step.
const END_RATE: f32 = 0.1;

/// Other paintings in a step's contrastive loss. Their statistics are already computed, so they cost next to
/// nothing.
const N_OTHERS: usize = 24;

/// Weight of the newest step in the losses that are reported.
const REPORTED_RATE: f32 = 0.02;

/// Trains one decoder on scenes and paintings.
///
/// A new decoder first takes [`warm_up`](Self::warm_up) steps, as many as [`TrainConfig::warm_iterations`]
/// says, and then [`step`](Self::step)s with the paper's loss. [`run`](Self::run) takes all steps that are
/// left. Equal seeds and inputs give equal decoders, and a training that is resumed from a checkpoint takes the
/// same steps as one that was not interrupted. The contrastive loss is an exception: its other paintings are
/// those picked since the start.
pub struct Trainer<'a> {
    config: TrainConfig,
    device: Device,
    content_layers: Vec<usize>,
    scenes: Vec<PreparedScene>,
    counts: Vec<ViewCount>,
    paintings: Paintings<'a>,
    /// Features of unstyled views by scene, size and view, computed at the first use of a view.
    contents: HashMap<[usize; 3], Content>,
    network: Network,
    adam: Adam,
    average: Average,
    history: History,
    origin: Origin,
}

/// The number of training pictures of one scene at one size.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ViewCount {
    /// The scene's name.
    pub scene: String,
    /// Longer side of the views, in pixels.
    pub size: u32,
    /// Number of pictures: views or crops of them.
    pub n_pictures: usize,
    /// Gaussians that reach a picture, on average.
    pub n_gaussians_in_picture: usize,
    /// Gaussians in the scene.
    pub n_gaussians: usize,
}

impl<'a> Trainer<'a> {
    /// Prepares a training: computes the blend weights of all views and makes the decoder to start from.
    /// Training runs on the loss network's processor.
    ///
    /// # Errors
    /// If there is no scene, a scene has no features or is not visible in its views, scenes and decoder belong
    /// to other encoders, or a content layer does not exist.
    pub fn new(
        config: TrainConfig,
        scenes: &[TrainingScene],
        mut paintings: Paintings<'a>,
    ) -> Result<Self, TrainError> {
        let content_layers = content_layers(&config.content_layers, &paintings.loss_network)?;
        let decoder = start(&config, scenes, &paintings)?;
        let (mut prepared, mut counts) = (Vec::new(), Vec::new());
        for scene in scenes {
            let (scene, of_scene) = prepare(scene, config.crop, &decoder)?;
            prepared.push(scene);
            counts.extend(of_scene);
        }
        paintings.seed = config.seed;
        let origin = origin(&config, scenes, &paintings)?;
        let device = paintings.loss_network.device().clone();
        let network = Network::new(&decoder, &device)?;
        Ok(Self {
            adam: Adam::new(&network.parameters),
            average: Average::new(&network.parameters),
            history: History::default(),
            origin,
            contents: HashMap::new(),
            scenes: prepared,
            config,
            device,
            content_layers,
            counts,
            paintings,
            network,
        })
    }

    /// The number of training pictures of each scene at each size.
    pub fn view_counts(&self) -> &[ViewCount] {
        &self.counts
    }

    /// Steps with the paper's loss that were taken.
    pub fn steps(&self) -> u32 {
        self.history.steps
    }

    /// Content and style loss of every step with the paper's loss.
    pub fn losses(&self) -> &[[f32; 2]] {
        &self.history.losses
    }

    /// The decoder as trained so far: the mean over the last part of the training, or the current state before
    /// that.
    ///
    /// # Errors
    /// If the device fails.
    pub fn decoder(&self) -> Result<Decoder, TrainError> {
        self.network.decoder(&self.average.values_or_current(&self.network.parameters))
    }

    /// Writes a checkpoint atomically.
    ///
    /// # Errors
    /// If the device fails or the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), TrainError> {
        let Self { network, adam, average, history, origin, .. } = self;
        checkpoint::save(path, FORMAT, &network.parameters, adam, average, history, origin)
    }

    /// Continues from a checkpoint of the same training. Returns the parts of the training that the file does
    /// not name, such as `scenes`: they may be others.
    ///
    /// # Errors
    /// If the file cannot be read, belongs to another decoder, or to a training with other scenes, views or
    /// paintings, or another seed.
    pub fn resume(&mut self, path: &Path) -> Result<Vec<&'static str>, TrainError> {
        let Self { network, adam, average, device, origin, .. } = self;
        let parameters = &mut network.parameters;
        let (history, unnamed) = checkpoint::load(path, FORMAT, parameters, adam, average, device, origin)?;
        self.history = history;
        Ok(unnamed)
    }

    /// Whether steps of the warm start are left.
    pub fn is_cold(&self) -> bool {
        self.history.warm_steps < self.config.warm_steps()
    }

    /// Takes a step of the warm start: regression on a recolored scene. Returns the mean absolute error of the
    /// colors.
    ///
    /// # Errors
    /// If a painting cannot be read or belongs to another encoder, or the device fails.
    pub fn warm_up(&mut self) -> Result<f32, TrainError> {
        let (done, total) = (self.history.warm_steps, self.config.warm_steps());
        // A new sequence for each step, so that a resumed training draws the same numbers. The shift keeps
        // steps apart from small seeds. The last number is `WARM` in ASCII: it keeps this stage apart from the
        // next.
        let mut random = Random::new(self.config.seed ^ (u64::from(done) << 20) ^ 0x5741_524D);
        let scene = &self.scenes[random.below(self.scenes.len())];
        let key = self.paintings.pick(&mut random)?;
        let style = self.paintings.style(key);
        let loss = warm_start::loss(&self.network, scene, style, &mut random, &self.device)?;
        let rate = cosine(WARM_RATE, END_RATE, done, total);
        self.adam.update(&mut self.network.parameters, &loss.backward(), rate)?;
        self.history.warm_steps += 1;
        if !self.is_cold() {
            // The two losses' gradients differ in scale, so the moments of one do not suit the other.
            self.adam = Adam::new(&self.network.parameters);
        }
        to_scalar(&loss)
    }

    /// Takes a step with the paper's loss, on a random view in the style of a random painting. Returns its
    /// losses.
    ///
    /// # Errors
    /// If a painting cannot be read or belongs to another encoder, or the device fails.
    pub fn step(&mut self) -> Result<Losses, TrainError> {
        let (done, total) = (self.history.steps, self.config.iterations);
        // `STEP`, as in the warm start.
        let mut random = Random::new(self.config.seed ^ (u64::from(done) << 20) ^ 0x5354_4550);
        let scene_index = random.below(self.scenes.len());
        let scene = &self.scenes[scene_index];
        // With one size no number is drawn, so the choice of views is that of a training without sizes.
        let size_index = if scene.views.len() > 1 { random.below(scene.views.len()) } else { 0 };
        let view_index = random.below(scene.views[size_index].len());
        let view = &scene.views[size_index][view_index];
        let key = self.paintings.pick(&mut random)?;
        let weights = self.config.weights;
        let n_others = if weights.contrastive > 0.0 { N_OTHERS } else { 0 };
        let others = self.paintings.others(key, n_others, &mut random);
        let (style, loss_network) = (self.paintings.style(key), &self.paintings.loss_network);
        // The first use costs a pass through VGG-19; a training uses each view many times.
        let content = self
            .contents
            .entry([scene_index, size_index, view_index])
            .or_insert_with(|| Content::new(view, loss_network, &self.content_layers));
        let sample = Sample { scene, view, content, style, others: &others };
        let losses = sample.losses(&self.network, loss_network, &self.content_layers, &weights)?;
        let rate = cosine(self.config.learning_rate, END_RATE, done, total);
        self.adam.update(&mut self.network.parameters, &losses.total(&weights).backward(), rate)?;
        let losses = losses.values()?;
        self.history.losses.push([losses.content, losses.style]);
        self.history.steps += 1;
        self.average_now_and_then();
        Ok(losses)
    }

    /// Every [`CHECKPOINT_STEPS`], adds the parameters to the average if the training is in its last part.
    fn average_now_and_then(&mut self) {
        let steps = self.history.steps;
        if !steps.is_multiple_of(CHECKPOINT_STEPS) {
            return;
        }
        // Multiplied in f64, in which every step number is exact.
        if f64::from(steps) > f64::from(self.config.iterations) * (1.0 - self.config.average) {
            self.average.add(&self.network.parameters);
        } else {
            // A shorter training that is now continued may have averaged steps that are not the last ones any
            // more.
            self.average = Average::new(&self.network.parameters);
        }
    }

    /// Takes all steps that are left. Calls `save` every [`CHECKPOINT_STEPS`], at the end of the warm start and
    /// when it stops. Returns whether all steps were taken, which is false if `watch` interrupted.
    ///
    /// # Errors
    /// If a step or `save` fails.
    pub fn run<E: From<TrainError>>(
        &mut self,
        watch: Watch,
        mut save: impl FnMut(&Self) -> Result<(), E>,
    ) -> Result<bool, E> {
        let mut means = RunningMeans::new(["color error", ""], REPORTED_RATE);
        while self.is_cold() && !watch.is_interrupted() {
            means.add([self.warm_up()?, 0.0]);
            let (done, losses) = (self.history.warm_steps, [means.losses()[0], None]);
            let total = self.config.warm_steps();
            (watch.progress)(Progress { stage: Stage::WarmStart, done, total, losses });
            if done.is_multiple_of(CHECKPOINT_STEPS) || !self.is_cold() {
                save(self)?;
            }
        }
        let mut means = RunningMeans::new(["content", "style"], REPORTED_RATE);
        let total = self.config.iterations;
        while self.history.steps < total && !watch.is_interrupted() {
            let losses = self.step()?;
            means.add([losses.content, losses.style]);
            let done = self.history.steps;
            (watch.progress)(Progress { stage: Stage::Training, done, total, losses: means.losses() });
            // The last state is saved after the loop.
            if done.is_multiple_of(CHECKPOINT_STEPS) && done < total {
                save(self)?;
            }
        }
        save(self)?;
        // An interruption during the warm start skips the second loop too, and a training of 0 steps would look
        // complete.
        Ok(!self.is_cold() && self.history.steps >= total)
    }
}

/// The parts of a training that its checkpoints belong to. Steps and weights of losses may change on the way.
fn origin(
    config: &TrainConfig,
    scenes: &[TrainingScene],
    paintings: &Paintings,
) -> Result<Origin, TrainError> {
    let bytes = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let of_scene = |scene: &TrainingScene| {
        let features = scene.scene.features.as_ref().map_or(&[][..], |features| &features.values);
        format!("{} {}", SceneFingerprint::of(scene.scene), fingerprint(bytes(features)))
    };
    let of_camera = |camera: &Camera| {
        let [size, focal, center] =
            [camera.size.as_vec2(), camera.focal, camera.center].map(|v| v.to_array());
        [&camera.view_from_world.to_cols_array()[..], &size, &focal, &center].concat()
    };
    let cameras = scenes.iter().flat_map(|scene| scene.views.iter().flat_map(|(_, cameras)| cameras));
    let mut views: Vec<f32> = cameras.flat_map(of_camera).collect();
    views.push(config.crop as f32);
    Ok(vec![
        ("scenes", scenes.iter().map(of_scene).collect::<Vec<_>>().join(", ")),
        ("views", fingerprint(bytes(&views))),
        ("paintings", paintings.fingerprint()?),
        ("seed", config.seed.to_string()),
    ])
}

/// The decoder to start from, checked against the scenes' encoder.
fn start(
    config: &TrainConfig,
    scenes: &[TrainingScene],
    paintings: &Paintings,
) -> Result<Decoder, TrainError> {
    let encoder = paintings.encoder;
    let Some(first) = scenes.first() else {
        return Err(TrainError::Invalid("found no scene, expected at least one".into()));
    };
    let n_extra = first.scene.features.as_ref().map_or(0, |features| features.n_extra);
    let decoder = match &config.start {
        Start::New(kind) => {
            kind.with_random_weights(encoder.n_channels(), n_extra, Some(encoder.id().clone()), config.seed)
        }
        Start::From(decoder) => (**decoder).clone(),
    };
    let expected = ("the encoder", Some(encoder.id()));
    for scene in scenes {
        let found = scene.scene.features.as_ref().and_then(|features| features.encoder.as_ref());
        EncoderId::expect_same((&scene.name, found), expected)?;
    }
    EncoderId::expect_same(("the decoder to start from", decoder.encoder.as_ref()), expected)?;
    Ok(decoder)
}

/// A scene ready for training, and the numbers of its pictures.
fn prepare(
    scene: &TrainingScene,
    crop: u32,
    decoder: &Decoder,
) -> Result<(PreparedScene, Vec<ViewCount>), TrainError> {
    let name = &scene.name;
    let Some(prepared) = PreparedScene::new(scene, crop, decoder) else {
        return Err(TrainError::Invalid(format!("{name}: no features: embed it first")));
    };
    ensure!(
        !prepared.views.is_empty() && prepared.views.iter().all(|views| !views.is_empty()),
        "{name}: no view shows any of its Gaussians"
    );
    let found = prepared.features.n_channels() + prepared.features.n_extra;
    ensure!(
        decoder.n_inputs() == found,
        "{name}: has {found} channels, the decoder takes {}",
        decoder.n_inputs()
    );
    let count = |((size, _), views): (&(u32, _), &Vec<View>)| ViewCount {
        scene: name.clone(),
        size: *size,
        n_pictures: views.len(),
        n_gaussians_in_picture: views.iter().map(|view| view.output_rows.len()).sum::<usize>() / views.len(),
        n_gaussians: scene.scene.len(),
    };
    let counts = scene.views.iter().zip(&prepared.views).map(count).collect();
    Ok((prepared, counts))
}
