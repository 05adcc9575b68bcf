//! The bake behind refining, as an interface: tests replace it by one that takes no time.

use std::sync::Arc;

use bevy::prelude::*;
use stylegaussian::{Scene, strokes::Strokes, work::Work};
use stylegaussian_bake::{BakeConfig, BakeError, Baker, LossNetwork};
use stylegaussian_encoder::Image as Painting;

use crate::style::wish::error::StyleError;

/// A bake under way.
pub(super) trait Baking {
    /// One step. If `work` is canceled, the bake must not go on.
    fn step(&mut self, scene: &Scene, work: &Work);

    /// The colors so far `[N]`, in scene order.
    fn colors(&self) -> &[[f32; 3]];

    /// The strokes over them, which no step changes.
    fn strokes(&self) -> &Strokes;
}

/// Begins a bake of a scene toward paintings and their weights, which will take this number of steps.
type Begin =
    dyn Fn(&Scene, Vec<(Painting, f32)>, u32, &Work) -> Result<Box<dyn Baking>, StyleError> + Send + Sync;

/// The function that begins bakes.
#[derive(Resource, Clone)]
pub(crate) struct Engine(pub(super) Arc<Begin>);

impl Engine {
    /// Begins a bake. Takes a while: not for the main thread.
    ///
    /// # Errors
    /// If scene and paintings cannot be baked, or `work` is canceled.
    pub(super) fn begin(
        &self,
        scene: &Scene,
        paintings: Vec<(Painting, f32)>,
        steps: u32,
        work: &Work,
    ) -> Result<Box<dyn Baking>, StyleError> {
        (self.0)(scene, paintings, steps, work)
    }
}

impl Default for Engine {
    fn default() -> Self {
        Self(Arc::new(|scene, paintings, steps, work| {
            let config = BakeConfig { steps, ..BakeConfig::default() };
            let failed = |error: BakeError| StyleError::Refine(error.to_string());
            let baker = Baker::new(config, scene, &[], &paintings, loss_network()?, work).map_err(failed)?;
            Ok(Box::new(baker))
        }))
    }
}

impl Baking for Baker {
    fn step(&mut self, scene: &Scene, work: &Work) {
        // Losses are for people who watch a bake.
        let _ = self.step_if_wanted(scene, work);
    }

    fn colors(&self) -> &[[f32; 3]] {
        Baker::colors(self)
    }

    fn strokes(&self) -> &Strokes {
        Baker::strokes(self)
    }
}

/// The network that compares pictures with paintings.
///
/// # Errors
/// If it is not compiled in.
#[cfg(feature = "bundled_models")]
fn loss_network() -> Result<LossNetwork, StyleError> {
    use stylegaussian_defaults::{ENCODER, ENCODER_NAME};

    LossNetwork::distilled(ENCODER_NAME, ENCODER).map_err(|error| StyleError::Refine(error.to_string()))
}

#[cfg(not(feature = "bundled_models"))]
fn loss_network() -> Result<LossNetwork, StyleError> {
    Err(StyleError::Refine("the plugin was built without the feature `bundled_models`".into()))
}
