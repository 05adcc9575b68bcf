//! Clouds: scenes placed in the world, each with its own colors.

use glam::Affine3A;

use super::{error::SplatError, scene::GpuScene};
use crate::colors::GaussianColors;

/// A scene in the world.
#[derive(Clone, Copy, Debug)]
pub struct Cloud<'a> {
    /// The scene.
    pub scene: &'a GpuScene,
    /// The colors to draw it with.
    pub colors: CloudColors<'a>,
    /// The cloud's place: any affine map, non-uniform scales included.
    pub world_from_scene: Affine3A,
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

impl Cloud<'_> {
    /// Whether the cloud has a finite place and a volume in the world.
    pub(super) fn is_drawable(&self) -> bool {
        let volume = self.world_from_scene.matrix3.determinant().abs();
        self.world_from_scene.is_finite() && volume.is_finite() && volume >= f32::MIN_POSITIVE
    }
}

/// Checks that each cloud has as many colors as Gaussians.
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
