//! Clouds: scenes placed in the world, each with its own colors.

use glam::Affine3A;

use stylegaussian::{
    mask::{CHANNELS, MaskUse},
    strokes::StrokeKnobs,
};

use super::{error::SplatError, scene::GpuScene, strokes::PaintedColors};
use crate::{colors::GaussianColors, mask::GaussianMask, strokes::GaussianStrokes};

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
    /// The captured, view-dependent colors of the scene, clamped at 0 from below. Mid-gray if the scene has
    /// none.
    Captured,
    /// One RGB per Gaussian, not clamped.
    Rgb(&'a GaussianColors),
    /// Either of them with strokes over it: see [`with_strokes`](Self::with_strokes).
    Painted(PaintedColors<'a>),
}

impl<'a> CloudColors<'a> {
    /// The colors that are not captured.
    pub(super) fn own(self) -> Option<&'a GaussianColors> {
        match self {
            Self::Captured => None,
            Self::Rgb(colors) => Some(colors),
            Self::Painted(painted) => painted.below,
        }
    }

    /// The colors with `strokes` over them, in place of any strokes that they have.
    #[must_use]
    pub fn with_strokes(self, strokes: &'a GaussianStrokes, knobs: StrokeKnobs) -> Self {
        Self::Painted(PaintedColors { below: self.own(), strokes, knobs, seconds: 0.0 })
    }

    /// The same at another time, in seconds, if strokes over them move: see [`GaussianStrokes::moving`].
    #[must_use]
    pub fn at(self, seconds: f64) -> Self {
        match self {
            Self::Painted(painted) => Self::Painted(PaintedColors { seconds, ..painted }),
            still => still,
        }
    }

    /// The strokes over the colors.
    pub(super) fn painted(self) -> Option<PaintedColors<'a>> {
        match self {
            Self::Painted(painted) => Some(painted),
            Self::Captured | Self::Rgb(_) => None,
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

/// Checks that each cloud has as many colors as Gaussians, and strokes and a mask of as many.
pub(super) fn check<'a, 'b: 'a>(clouds: impl IntoIterator<Item = &'a Cloud<'b>>) -> Result<(), SplatError> {
    for (i, cloud) in clouds.into_iter().enumerate() {
        let expected = cloud.scene.n_gaussians();
        let found = cloud.colors.own().map_or(expected, GaussianColors::n_gaussians);
        if found != expected {
            return Err(SplatError::Colors { cloud: i, found, expected });
        }
        let found = cloud.colors.painted().map_or(expected, |painted| painted.strokes.n_gaussians());
        if found != expected {
            return Err(SplatError::Strokes { cloud: i, found, expected });
        }
        let found = cloud.visibility.map_or(expected, |visibility| visibility.mask.n_gaussians());
        if found != expected {
            return Err(SplatError::Mask { cloud: i, found, expected });
        }
    }
    Ok(())
}
