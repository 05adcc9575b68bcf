//! Masks as they are kept: for one scene, in the order of its source.

use super::weights::{CHANNELS, Mask};
use crate::{look::SceneFingerprint, scene::Scene};

/// A mask of one scene, in the order of its source, because readers order Gaussians differently.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredMask {
    /// Weights `[N]` in the order of the scene's source.
    pub weights: Vec<[u8; CHANNELS]>,
    /// Names of the channels, for people.
    pub names: [String; CHANNELS],
    /// The scene that the mask belongs to.
    pub scene: SceneFingerprint,
}

/// A mask that belongs to another scene, or has not one weight per Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found a mask of another scene ({found}), expected one of this scene ({expected})")]
pub struct MaskError {
    /// The scene that the mask belongs to, with the number of its weights.
    pub found: SceneFingerprint,
    /// The scene that it was asked for.
    pub expected: SceneFingerprint,
}

impl StoredMask {
    /// The mask `mask` of `scene`.
    ///
    /// # Panics
    /// If there are not as many weights as Gaussians.
    pub fn new(scene: &Scene, mask: &Mask) -> Self {
        assert_eq!(mask.len(), scene.len(), "one weight per Gaussian");
        let by_source = mask.subset(&scene.by_source());
        Self { weights: by_source.weights, names: by_source.names, scene: SceneFingerprint::of(scene) }
    }

    /// The mask in the order of `scene`.
    ///
    /// # Errors
    /// If it belongs to another scene, or has not one weight per Gaussian.
    pub fn mask_for(&self, scene: &Scene) -> Result<Mask, MaskError> {
        let expected = SceneFingerprint::of(scene);
        let found = SceneFingerprint { n_gaussians: self.len(), ..self.scene };
        if self.scene != expected || found != expected {
            return Err(MaskError { found, expected });
        }
        let mut mask = Mask { names: self.names.clone(), ..Mask::new(scene.len()) };
        for (weights, i) in self.weights.iter().zip(scene.by_source()) {
            mask.weights[i as usize] = *weights;
        }
        Ok(mask)
    }

    /// N, the number of Gaussians.
    pub fn len(&self) -> usize {
        self.weights.len()
    }

    /// Whether there is no Gaussian.
    pub fn is_empty(&self) -> bool {
        self.weights.is_empty()
    }

    /// For each channel the number of Gaussians that are painted at all.
    pub fn n_painted(&self) -> [usize; CHANNELS] {
        std::array::from_fn(|channel| self.weights.iter().filter(|weights| weights[channel] > 0).count())
    }
}
