//! Clouds: scenes placed in the world, each with its own colors.

use glam::Affine3A;

use stylegaussian::mask::{CHANNELS, MaskUse};

use super::{error::SplatError, scene::GpuScene};
use crate::{colors::GaussianColors, mask::GaussianMask};

/// A scene in the world.
#[derive(Clone, Copy, Debug)]
pub struct Cloud<'a> {
    /// The scene.
    pub scene: &'a GpuScene,
    /// The colors to draw it with.
    pub colors: CloudColors<'a>,
    /// The cloud's place: any affine map, non-uniform scales included.
    pub world_from_scene: Affine3A,
    /// The mask that hides a part of it, if there is one. A mask costs nothing where there is none.
    pub visibility: Option<CloudVisibility<'a>>,
}

/// A mask that hides a part of a cloud, or crops the cloud to it.
#[derive(Clone, Copy, Debug)]
pub struct CloudVisibility<'a> {
    /// The weights.
    pub mask: &'a GaussianMask,
    /// The channel that counts. No weight is painted in a channel beyond the fourth.
    pub channel: usize,
    /// Its meaning.
    pub is: MaskUse,
}

/// The colors of a cloud, display-referred.
#[derive(Clone, Copy, Debug)]
pub enum CloudColors<'a> {
    /// The captured, view-dependent colors of the scene, clamped at 0 from below. Mid-gray if the scene has none.
    Captured,
    /// One RGB per Gaussian, not clamped.
    Rgb(&'a GaussianColors),
    /// A mix of two sources. `None` stands for the captured colors.
    Fade {
        /// The colors for t = 0.
        from: Option<&'a GaussianColors>,
        /// The colors for t = 1.
        to: Option<&'a GaussianColors>,
        /// Share of the second source, 0..1.
        t: f32,
    },
}

impl<'a> CloudColors<'a> {
    /// Both ends of the fade and the share of the second. `None` stands for the captured colors.
    pub(super) fn ends(self) -> (Option<&'a GaussianColors>, Option<&'a GaussianColors>, f32) {
        match self {
            Self::Captured => (None, None, 0.0),
            Self::Rgb(colors) => (Some(colors), Some(colors), 0.0),
            // A fade that is over reads one source only.
            Self::Fade { to, t, .. } if t >= 1.0 => (to, to, 0.0),
            Self::Fade { from, to, t } if t > 0.0 => (from, to, t),
            Self::Fade { from, .. } => (from, from, 0.0),
        }
    }
}

impl<'a> Cloud<'a> {
    /// The mask, if it changes anything.
    pub(super) fn mask(&self) -> Option<CloudVisibility<'a>> {
        self.visibility.filter(|visibility| visibility.channel < CHANNELS)
    }

    /// Whether the cloud has a finite place and a volume in the world, and is not cropped to nothing.
    pub(super) fn is_drawable(&self) -> bool {
        if self.visibility.is_some_and(|mask| mask.channel >= CHANNELS && mask.is == MaskUse::Crop) {
            return false;
        }
        let volume = self.world_from_scene.matrix3.determinant().abs();
        self.world_from_scene.is_finite() && volume.is_finite() && volume >= f32::MIN_POSITIVE
    }
}

/// Checks that each cloud has as many colors as Gaussians, and a mask of as many.
pub(super) fn check(clouds: &[Cloud]) -> Result<(), SplatError> {
    for (i, cloud) in clouds.iter().enumerate() {
        let expected = cloud.scene.n_gaussians();
        let (from, to, _) = cloud.colors.ends();
        for colors in [from, to].into_iter().flatten() {
            if colors.n_gaussians() != expected {
                return Err(SplatError::Colors { cloud: i, found: colors.n_gaussians(), expected });
            }
        }
        let found = cloud.visibility.map_or(expected, |visibility| visibility.mask.n_gaussians());
        if found != expected {
            return Err(SplatError::Mask { cloud: i, found, expected });
        }
    }
    Ok(())
}
