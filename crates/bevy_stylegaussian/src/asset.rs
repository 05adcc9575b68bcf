//! Assets: scenes, style statistics, decoders. Each is a handle on data that both worlds share.

use std::sync::Arc;

use bevy::{camera::primitives::Aabb, prelude::*};
use stylegaussian::{ChannelStatistics, Decoder, Neighbors, Scene, scene::SceneError};

use crate::splats::bounds;

/// A captured scene: `.sgs` files, `.ply` files as 3D Gaussian Splatting writes them, and checkpoints of StyleGaussian.
///
/// There is one copy of it in main memory, shared by both worlds; cloning is cheap. Only scenes with features can be
/// styled: `stylegaussian embed` computes them for any other.
#[derive(Asset, Clone, Debug, Reflect)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct GaussianScene {
    scene: Arc<Scene>,
    decoder: Option<Arc<Decoder>>,
    /// The box around all that is drawn, `None` where nothing is; or why the scene cannot be shown.
    bounds: Result<Option<Aabb>, SceneError>,
}

impl GaussianScene {
    /// A scene made by a program. Its parts are checked here, and where it has features but no neighbor lists as long as
    /// its decoder wants them (8 for the default one), they are found, which takes about a second for half a million
    /// Gaussians: call it on the task pool for large ones. What does not fit together is told by a
    /// [`SceneFailed`](crate::SceneFailed) to whoever shows the scene.
    pub fn new(mut scene: Scene) -> Self {
        let k = scene.decoder.as_ref().map_or(Decoder::K, |decoder| decoder.k).max(1);
        let has_lists = scene.neighbors.as_ref().is_some_and(|neighbors| neighbors.k >= k);
        if scene.features.is_some() && !has_lists && has_finite_means(&scene) {
            scene.neighbors = Some(Neighbors::find(&scene.means, &scene.order, k));
        }
        let bounds = scene.validate().map(|()| bounds(&scene));
        let decoder = scene.decoder.clone().map(Arc::new);
        Self { scene: Arc::new(scene), decoder, bounds }
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The decoder that the scene carries, if any.
    pub fn decoder(&self) -> Option<&Arc<Decoder>> {
        self.decoder.as_ref()
    }

    /// The box around all that is drawn of it; `None` where nothing is.
    ///
    /// # Errors
    /// When its parts do not fit together.
    pub(crate) fn bounds(&self) -> Result<Option<Aabb>, SceneError> {
        self.bounds.clone()
    }
}

/// Files never hold other means; a program may.
fn has_finite_means(scene: &Scene) -> bool {
    scene.means.iter().all(|mean| mean.is_finite()) && scene.order.len() == scene.len()
}

/// Statistics of a style's features, computed beforehand: `.style.safetensors`, as `stylegaussian style IMAGE` writes
/// them. A style given this way needs no encoder at run time.
#[derive(Asset, Clone, Debug, Reflect)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct StyleStatistics(pub Arc<ChannelStatistics>);

/// A decoder from features to colors: `.decoder.safetensors`, as `stylegaussian train` writes them. [`StyleDecoder`]
/// puts it to use.
///
/// [`StyleDecoder`]: crate::StyleDecoder
#[derive(Asset, Clone, Debug, Reflect)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct GaussianDecoder(pub Arc<Decoder>);
