//! Clouds: scenes placed in the world, in colors of their own.

use glam::Affine3A;

use super::{GpuScene, SplatError};
use crate::colors::GaussianColors;

/// A scene in the world.
#[derive(Clone, Copy, Debug)]
pub struct Cloud<'a> {
    /// Its Gaussians.
    pub scene: &'a GpuScene,
    /// Its colors.
    pub colors: CloudColors<'a>,
    /// Where it is: any affine map, non-uniform scales included.
    pub world_from_scene: Affine3A,
}

/// The colors of a cloud, display-referred.
#[derive(Clone, Copy, Debug)]
pub enum CloudColors<'a> {
    /// The scene's own, view-dependent, clamped at 0 from below; mid-gray where it keeps none.
    Captured,
    /// One RGB per Gaussian, not clamped.
    Rgb(&'a GaussianColors),
    /// On the way from one to the other; `None` stands for the scene's own.
    Fade {
        /// The colors at 0.
        from: Option<&'a GaussianColors>,
        /// The colors at 1.
        to: Option<&'a GaussianColors>,
        /// How far, 0..1.
        t: f32,
    },
}

impl<'a> CloudColors<'a> {
    /// Both ends of the fade, and how far it is.
    pub(super) fn ends(self) -> (Option<&'a GaussianColors>, Option<&'a GaussianColors>, f32) {
        match self {
            Self::Captured => (None, None, 0.0),
            Self::Rgb(colors) => (Some(colors), Some(colors), 0.0),
            // A fade that is over does not read what it came from.
            Self::Fade { to, t, .. } if t >= 1.0 => (to, to, 0.0),
            Self::Fade { from, to, t } if t > 0.0 => (from, to, t),
            Self::Fade { from, .. } => (from, from, 0.0),
        }
    }
}

impl Cloud<'_> {
    /// Whether the cloud has a place and a volume in the world.
    pub(super) fn is_drawable(&self) -> bool {
        let volume = self.world_from_scene.matrix3.determinant().abs();
        self.world_from_scene.is_finite() && volume.is_finite() && volume >= f32::MIN_POSITIVE
    }
}

/// Checks that colors belong to the scenes they are for.
pub(super) fn check(clouds: &[Cloud]) -> Result<(), SplatError> {
    for (i, cloud) in clouds.iter().enumerate() {
        let expected = cloud.scene.n_gaussians();
        let (from, to, _) = cloud.colors.ends();
        for colors in [from, to].into_iter().flatten() {
            if colors.n_gaussians() != expected {
                return Err(SplatError::Colors { cloud: i, found: colors.n_gaussians(), expected });
            }
        }
    }
    Ok(())
}
