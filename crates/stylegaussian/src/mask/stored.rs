//! Masks as they are kept: for one scene, in the order of its source.

use super::weights::{CHANNELS, Mask};
use crate::{
    look::SceneFingerprint,
    scene::Scene,
    work::{Canceled, Work},
};

/// Gaussians between two looks at whether a mask is still wanted: 256 KiB of weights.
const SOME: usize = 1 << 16;

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
        let by_source = scene.by_source();
        let scene = SceneFingerprint::in_order(scene, &by_source);
        let Mask { weights, names, .. } = mask.subset(&by_source);
        Self { weights, names, scene }
    }

    /// The mask in the order of `scene`.
    ///
    /// # Errors
    /// If it belongs to another scene, or has not one weight per Gaussian.
    pub fn mask_for(&self, scene: &Scene) -> Result<Mask, MaskError> {
        let mask = self.mask_for_if_wanted(scene, &Work::default());
        mask.expect("nobody else has the work, so nobody cancels it")
    }

    /// As [`mask_for`](Self::mask_for).
    ///
    /// # Errors
    /// If `work` is canceled; inside, as those of [`mask_for`](Self::mask_for).
    pub fn mask_for_if_wanted(
        &self,
        scene: &Scene,
        work: &Work,
    ) -> Result<Result<Mask, MaskError>, Canceled> {
        work.check()?;
        let by_source = scene.by_source();
        work.at(0.5)?;
        let expected = SceneFingerprint::in_order(scene, &by_source);
        let found = SceneFingerprint { n_gaussians: self.len(), ..self.scene };
        if self.scene != expected || found != expected {
            return Ok(Err(MaskError { found, expected }));
        }
        work.at(0.7)?;
        let mut mask = Mask { names: self.names.clone(), ..Mask::new(scene.len()) };
        let given = self.weights.chunks(SOME).zip(by_source.chunks(SOME));
        for (weights, indices) in given {
            work.check()?;
            for (weights, i) in weights.iter().zip(indices) {
                mask.weights[*i as usize] = *weights;
            }
        }
        Ok(Ok(mask))
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
