//! The scene asset.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use bevy::{camera::primitives::Aabb, prelude::*};
use stylegaussian::{
    Decoder, Neighbors, Scene,
    scene::SceneError,
    views::{self, Framing},
    work::{Canceled, Work},
};

/// A captured scene. It loads from every format that [`stylegaussian_files`] reads. The content of the file
/// decides its kind, not the name, except for formats without a mark. [`SceneSettings`](super::SceneSettings)
/// are those of the load.
///
/// Files in general formats, `.glb`, `.gltf` and `.json`, load if a scene is asked for: as a
/// `Handle<GaussianScene>`, and not by their extension.
///
/// Any scene can be painted. The decoder needs features, which `stylegaussian embed` computes for any scene.
///
/// There is one copy in main memory, shared by both worlds, so cloning is cheap. The copy always stays, and
/// there is no `RenderAssetUsages` setting to drop it: styling on the CPU, saving a styled scene and restoring
/// a lost GPU device all read it.
#[derive(Asset, Clone, Debug, Reflect)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct GaussianScene {
    scene: Arc<Scene>,
    decoder: Option<Arc<Decoder>>,
    /// The box around all visible splats, or `None` if there are none. An error if the scene cannot be shown.
    bounds: Result<Option<Aabb>, SceneError>,
    /// The box of the scene's bulk: the middle 98% of the means along each axis, without surroundings. `None`
    /// without Gaussians.
    usual: Option<[Vec3; 2]>,
    /// Its dense part and its up direction. `None` if nothing of it is visible.
    framing: Option<Framing>,
    /// Whether the GPU has it, or has refused it. The render world says so.
    is_on_gpu: Arc<AtomicBool>,
    /// Whether the GPU has refused it.
    is_refused: Arc<AtomicBool>,
}

impl GaussianScene {
    /// Makes an asset of a scene and checks the scene's parts. If they do not fit together, entities that show
    /// the scene get a [`GaussianSceneFailed`](crate::GaussianSceneFailed).
    ///
    /// If the scene has features but no neighbor lists of the length that its decoder needs (8 for the default
    /// one), the neighbors are found here. This takes about a second for half a million Gaussians, so use a
    /// task for large scenes.
    pub fn new(scene: Scene) -> Self {
        let asset = Self::new_if_wanted(scene, &Work::default());
        asset.expect("nobody else has the work, so nobody cancels it")
    }

    /// As [`new`](Self::new).
    ///
    /// # Errors
    /// If `work` is canceled.
    pub(crate) fn new_if_wanted(mut scene: Scene, work: &Work) -> Result<Self, Canceled> {
        work.check()?;
        // At least 1: a decoder that a program made may have k = 0.
        let k = scene.decoder.as_ref().map_or(Decoder::K, |decoder| decoder.k).max(1);
        let has_lists = scene.neighbors.as_ref().is_some_and(|neighbors| neighbors.k >= k);
        // Scenes that cannot be decoded need no neighbors. Longer lists serve as well: a decoder reads the
        // first k.
        if scene.features.is_some() && !has_lists && has_finite_means(&scene) {
            scene.neighbors = Some(Neighbors::find_if_wanted(&scene.means, &scene.order, k, work)?);
        }
        work.at(0.8)?;
        // An invalid scene becomes an asset all the same: `new` cannot fail, and the error is reported per
        // entity.
        let bounds = scene.validate().map(|()| scene.splat_bounds());
        let bounds = bounds.map(|bounds| bounds.map(|[min, max]| Aabb::from_min_max(min, max)));
        // An `Arc` of its own, so that its address identifies the decoder wherever inputs are packed for it.
        let decoder = scene.decoder.clone().map(Arc::new);
        let is_valid = bounds.is_ok();
        let usual = if is_valid { scene.bulk(OUTSIDE) } else { None };
        work.at(0.9)?;
        let framing = if is_valid { views::framing_if_wanted(&scene, &work.part(0.9, 1.0))? } else { None };
        let (is_on_gpu, is_refused) = (Arc::default(), Arc::default());
        Ok(Self { scene: Arc::new(scene), decoder, bounds, usual, framing, is_on_gpu, is_refused })
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The decoder that the scene carries, or `None` if it has none.
    pub fn decoder(&self) -> Option<&Arc<Decoder>> {
        self.decoder.as_ref()
    }

    /// The ball around the dense part of the scene, the scene's up direction, and the spot from which it was
    /// captured if that is within, all in scene space, or `None` if nothing of it is visible.
    /// [`FitScene`](super::FitScene) uses them.
    pub fn framing(&self) -> Option<Framing> {
        self.framing
    }

    /// Corners of the box that holds almost all means, in scene space, or `None` without Gaussians.
    pub(crate) fn usual_bounds(&self) -> Option<[Vec3; 2]> {
        self.usual
    }

    /// Whether an entity can show it at once: the GPU has it, or has refused it.
    pub(crate) fn is_on_gpu(&self) -> bool {
        self.is_on_gpu.load(Ordering::Relaxed)
    }

    /// Whether it will never be drawn: the GPU has refused it.
    pub(crate) fn is_refused(&self) -> bool {
        self.is_refused.load(Ordering::Relaxed)
    }

    /// Tells whether the GPU has it.
    pub(crate) fn set_on_gpu(&self, is_on_gpu: bool) {
        self.is_refused.store(false, Ordering::Relaxed);
        self.is_on_gpu.store(is_on_gpu, Ordering::Relaxed);
    }

    /// Tells that the GPU has refused it.
    pub(crate) fn set_refused(&self) {
        self.is_refused.store(true, Ordering::Relaxed);
        self.is_on_gpu.store(true, Ordering::Relaxed);
    }

    /// The box around all visible splats, or `None` if there are none.
    ///
    /// # Errors
    /// If the scene's parts do not fit together.
    pub(crate) fn bounds(&self) -> Result<Option<Aabb>, SceneError> {
        self.bounds.clone()
    }
}

/// Share of the means that lie outside of the usual box on each side.
const OUTSIDE: f64 = 0.01;

/// Whether neighbors can be searched. Scenes from files always have finite means; a program's may not.
fn has_finite_means(scene: &Scene) -> bool {
    // `find` reads both arrays before `validate` has seen them.
    scene.means.iter().all(|mean| mean.is_finite()) && scene.order.len() == scene.len()
}
