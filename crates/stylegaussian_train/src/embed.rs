//! Embedding: lifts an image encoder's features from views into the Gaussians of a scene, once per scene.
//!
//! The model (StyleGaussian, Liu et al. 2024, section 3.2) is f_p = A f'_p + b with few channels L in f', so
//! that a view's features are A sum_i w_i f'_i + b sum_i w_i with the blend weights w of the rasterizer.
//! Embedding finds the f', A and b that minimize the mean absolute difference between rendered features and the
//! encoder's.
//!
//! The stages, one module each: `view` (pictures to learn from), `samples` (training data of a view),
//! `closed_form` (PCA and weighted means), `refine` (descent), `under_observed` (filling in Gaussians that
//! views hardly show), `model` (the model itself).

mod closed_form;
mod model;
mod refine;
mod samples;
#[cfg(test)]
mod tests;
mod under_observed;
mod view;

use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;
use serde::Serialize;
use stylegaussian::{Features, Neighbors, Scene, random::Random};
use stylegaussian_encoder::{Encoder, EncoderError, ImageError, image::Warned};
use web_time::Instant;

use crate::watch::{Stage, Watch};
use model::Model;
use refine::Schedule;
use samples::{CellSizeError, Samples};
pub use view::{Picture, TrainingView};

/// L, the number of latent features f' of each Gaussian, as in the paper.
pub const N_LATENT: usize = 32;

/// Neighbors from which an under-observed Gaussian may take features. These are more than a decoder's
/// neighborhood has, because many of them are under-observed too.
const N_FILLING_NEIGHBORS: usize = 16;

/// Steps of the default method for each view; a step uses a quarter of a view. On the playbot scene (20 views)
/// the held-out error after 5, 10, 20 and 40 steps for each view is 1.316, 1.304, 1.293 and 1.288.
const DEFAULT_ITERATIONS_PER_VIEW: u32 = 20;
/// Least number of steps of the default method: if there are few views, each must be used more often.
const DEFAULT_MIN_ITERATIONS: u32 = 200;
/// Steps of `optimize`: on the playbot scene its held-out error is least about here, 1.294, from 1.311 after
/// half of them to 1.309 after 5,000.
const OPTIMIZE_ITERATIONS: u32 = 2000;

/// The method of embedding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EmbedMethod {
    /// Closed form, then a short descent of the L1 error with falling learning rates.
    #[default]
    Default,
    /// PCA basis and weighted means only: immediate, less exact.
    ClosedForm,
    /// The paper's method: descent from noise, with its learning rates.
    Optimize,
}

/// Options of embedding.
#[derive(Clone, Debug, Default)]
pub struct EmbedOptions {
    /// The method.
    pub method: EmbedMethod,
    /// Steps of the descent. If `None`, 20 per view with the default method and 2000 with
    /// [`EmbedMethod::Optimize`].
    pub iterations: Option<u32>,
    /// If K > 0, every K-th view, including the first, is held out of training, and the report has the error on
    /// those.
    pub holdout: u32,
    /// Seed of the starting noise and of the order of views. Equal seeds give equal results.
    pub seed: u64,
}

impl EmbedOptions {
    fn iterations(&self, n_views: usize) -> u32 {
        let default = match self.method {
            EmbedMethod::ClosedForm => return 0,
            EmbedMethod::Default => {
                (DEFAULT_ITERATIONS_PER_VIEW * n_views as u32).max(DEFAULT_MIN_ITERATIONS)
            }
            EmbedMethod::Optimize => OPTIMIZE_ITERATIONS,
        };
        self.iterations.unwrap_or(default)
    }
}

/// Outcome of an embedding.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EmbedReport {
    /// The method used.
    pub method: EmbedMethod,
    /// Training views.
    pub n_training_views: usize,
    /// Views held out.
    pub n_held_out_views: usize,
    /// Steps of descent taken.
    pub iterations: u32,
    /// Mean over training views of the mean |rendered - encoder's| over channels and the cells with a coverage
    /// above 0.9. `None` if there is no such cell.
    pub training_error: Option<f64>,
    /// The same on the held-out views.
    pub held_out_error: Option<f64>,
    /// Gaussians that fill less than a tenth of a cell over all training views. They took their features from
    /// neighbors.
    pub n_badly_seen: usize,
    /// Seconds for the views: rendering, encoding, blend weights.
    pub view_seconds: f64,
    /// Seconds for the fit of features to them.
    pub fit_seconds: f64,
    /// Warnings for people, about photos with damaged files, in the order of views.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Whether it was interrupted, so that it used fewer views or steps than asked for.
    pub interrupted: bool,
}

/// A scene could not be embedded.
#[derive(Debug, thiserror::Error)]
pub enum EmbedError {
    /// The scene has no Gaussian.
    #[error("the scene is empty, expected at least one Gaussian")]
    EmptyScene,
    /// All views are held out.
    #[error(
        "found {n_views} views with every {holdout}-th held out, expected at least one more to learn from"
    )]
    NoTrainingViews {
        /// All views.
        n_views: usize,
        /// The option [`EmbedOptions::holdout`].
        holdout: u32,
    },
    /// No training view shows the scene.
    #[error("none of the {n_views} training views shows the scene; do its cameras belong to it?")]
    NothingSeen {
        /// Training views.
        n_views: usize,
    },
    /// The caller interrupted before the first view was ready.
    #[error("interrupted before the first view was ready")]
    Interrupted,
    /// A photo could not be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A view could not be encoded.
    #[error("view {view}: {source}")]
    Encoder {
        /// The view's name.
        view: String,
        /// The encoder's error.
        source: Box<EncoderError>,
    },
    /// The encoder's feature map does not fit the view.
    #[error("view {view}: {source}")]
    CellSize {
        /// The view's name.
        view: String,
        /// Both sizes.
        source: CellSizeError,
    },
}

/// Gives `scene` the features of `encoder`, learned from `views`.
///
/// Features have mean 0 and standard deviation 1 per channel over the Gaussians. The result depends on the
/// options and the views alone, not on the number of threads. Under-observed Gaussians take features from their
/// neighbors.
///
/// # Errors
/// If the scene is empty, a view cannot be read or encoded, or no view shows the scene. The scene is then
/// unchanged.
pub fn embed(
    scene: &mut Scene,
    views: &[TrainingView],
    encoder: &Encoder,
    options: &EmbedOptions,
    watch: Watch,
) -> Result<EmbedReport, EmbedError> {
    if scene.is_empty() {
        return Err(EmbedError::EmptyScene);
    }
    // Counted over all views, before any is dropped by an interruption, so the same views are held out each
    // time.
    let is_held_out = |view: usize| options.holdout > 0 && view.is_multiple_of(options.holdout as usize);
    if (0..views.len()).all(is_held_out) {
        return Err(EmbedError::NoTrainingViews { n_views: views.len(), holdout: options.holdout });
    }
    let start = Instant::now();
    let samples = sample_views(scene, views, encoder, watch)?;
    let view_seconds = start.elapsed().as_secs_f64();
    let of_kind = |held_out: bool| -> Vec<&[Samples]> {
        let kept = samples.iter().filter(|sampled| is_held_out(sampled.view) == held_out);
        kept.map(|sampled| sampled.parts.as_slice()).collect()
    };
    let (training, held_out) = (of_kind(false), of_kind(true));

    let start = Instant::now();
    let (mut model, iterations) = fit(&training, scene.len(), encoder.n_channels(), options, watch)?;
    // Before standardization, whose mean and deviation are over all Gaussians, filled in or not.
    let n_badly_seen = fill_in(&mut model, &training, scene);
    model.standardize();
    let report = EmbedReport {
        method: options.method,
        n_training_views: training.len(),
        n_held_out_views: held_out.len(),
        iterations,
        training_error: model.mean_error(&training),
        held_out_error: model.mean_error(&held_out),
        n_badly_seen,
        view_seconds,
        fit_seconds: start.elapsed().as_secs_f64(),
        warnings: samples.iter().filter_map(|sampled| sampled.warning.clone()).collect(),
        interrupted: samples.len() < views.len() || iterations < options.iterations(training.len()),
    };
    scene.features = Some(Features {
        values: model.features,
        n_latent: model.n_latent,
        basis: model.basis,
        offset: model.offset,
        extra: Vec::new(),
        n_extra: 0,
        encoder: Some(encoder.id().clone()),
    });
    Ok(report)
}

/// Samples of a view.
struct Sampled {
    /// The view's index.
    view: usize,
    parts: Vec<Samples>,
    /// A warning about its photo.
    warning: Option<String>,
}

/// Samples of the views in order. Fewer if interrupted.
fn sample_views(
    scene: &Scene,
    views: &[TrainingView],
    encoder: &Encoder,
    watch: Watch,
) -> Result<Vec<Sampled>, EmbedError> {
    let (done, total) = (AtomicU32::new(0), views.len() as u32);
    let sample = |(index, view): (usize, &TrainingView)| -> Option<Result<Sampled, EmbedError>> {
        if watch.is_interrupted() {
            return None;
        }
        let samples = sample_view(scene, view, encoder);
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        watch.report(Stage::Views, done, total);
        Some(samples.map(|(parts, warning)| Sampled { view: index, parts, warning }))
    };
    // The collected order is that of the views, however they were scheduled.
    views.par_iter().enumerate().filter_map(sample).collect()
}

/// Samples of a view, and the warning about its photo.
fn sample_view(
    scene: &Scene,
    view: &TrainingView,
    encoder: &Encoder,
) -> Result<(Vec<Samples>, Option<String>), EmbedError> {
    // At the picture's full size. `Samples` averages over cells, because rendering at the map's size widens
    // splats.
    let weights = stylegaussian::splat::blend_weights(scene, &view.camera);
    let Warned { image, warning } = view.load(scene)?;
    let features = encoder
        .encode(&image)
        .map_err(|source| EmbedError::Encoder { view: view.name.clone(), source: source.into() })?;
    let parts = Samples::of_view(&weights, &features)
        .map_err(|source| EmbedError::CellSize { view: view.name.clone(), source })?;
    Ok((parts, warning))
}

/// Fits the model, and returns it with the number of steps taken.
fn fit(
    views: &[&[Samples]],
    n_gaussians: usize,
    n_channels: usize,
    options: &EmbedOptions,
    watch: Watch,
) -> Result<(Model, u32), EmbedError> {
    if views.is_empty() {
        return Err(EmbedError::Interrupted);
    }
    // A view without any of the scene would only waste steps.
    let n_views = views.len();
    let views: Vec<&[Samples]> = views.iter().copied().filter(|parts| !parts.is_empty()).collect();
    if views.is_empty() {
        return Err(EmbedError::NothingSeen { n_views });
    }
    let total = options.iterations(views.len());
    let mut random = Random::new(options.seed);
    let (mut model, schedule, batches) = match options.method {
        // The paper takes a whole view in each step.
        EmbedMethod::Optimize => {
            (Model::noise(n_gaussians, n_channels, N_LATENT, &mut random), Schedule::optimize(total), views)
        }
        EmbedMethod::ClosedForm | EmbedMethod::Default => {
            // A batch is one of a view's four parts: nearly the gradient of the view at a quarter of its cost.
            let parts = views.iter().flat_map(|view| view.chunks(1)).collect();
            let model = closed_form::closed_form(&views, n_channels, n_gaussians, N_LATENT);
            let schedule = Schedule::after_closed_form(total, &model);
            (model, schedule, parts)
        }
    };
    let iterations = refine::refine(&mut model, &batches, schedule, &mut random, |done| {
        watch.report(Stage::Refine, done, total);
        !watch.is_interrupted()
    });
    Ok((model, iterations))
}

/// Fills in under-observed Gaussians and returns their number.
fn fill_in(model: &mut Model, views: &[&[Samples]], scene: &Scene) -> usize {
    let seen_weights = under_observed::seen_weights(views, scene.len());
    let neighbors = Neighbors::find(&scene.means, &scene.order, N_FILLING_NEIGHBORS);
    under_observed::fill_in(model, &seen_weights, &neighbors)
}
