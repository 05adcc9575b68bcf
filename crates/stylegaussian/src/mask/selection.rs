//! Selections, which set a channel at once.

use glam::Vec3;

use super::{
    lasso::Lasso,
    weights::{CHANNELS, Edit, Mask, share},
};
use crate::layers::Region;

/// A part of a scene.
#[derive(Clone, Debug)]
pub enum Selection {
    /// A box, a sphere or another shape, with its edge. [`Region::EVERYWHERE`] is the whole scene.
    Region(Region),
    /// A line drawn over a view.
    Lasso(Lasso),
    /// Another channel of the mask, or the same one.
    Channel(usize),
}

/// The change that a selection makes of a channel. With s the selection's weight and w the channel's, both
/// 0..1:
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Combine {
    /// s.
    #[default]
    Replace,
    /// The larger of both.
    Add,
    /// The smaller of w and 1 - s. The channel subtracted from everything is its inverse.
    Subtract,
    /// The smaller of both.
    Intersect,
}

impl Combine {
    fn apply(self, weight: u8, selected: u8) -> u8 {
        match self {
            Self::Replace => selected,
            Self::Add => weight.max(selected),
            Self::Subtract => weight.min(255 - selected),
            Self::Intersect => weight.min(selected),
        }
    }
}

impl Selection {
    /// The weight of a Gaussian, 0..1.
    fn weight(&self, mean: Vec3, weights: [u8; CHANNELS]) -> f32 {
        match self {
            Self::Region(region) => region.weight(mean),
            Self::Lasso(lasso) => f32::from(lasso.contains(mean)),
            Self::Channel(channel) => share(weights, *channel),
        }
    }
}

impl Mask {
    /// Combines `channel` with a selection among Gaussians with these means `[N]`.
    ///
    /// # Panics
    /// If there is not one mean per Gaussian.
    pub fn select(
        &mut self,
        means: &[Vec3],
        channel: usize,
        selection: &Selection,
        combine: Combine,
    ) -> Edit {
        assert_eq!(means.len(), self.len(), "one mean per Gaussian");
        self.edit(|i, mut weights| {
            let selected = (255.0 * selection.weight(means[i], weights)).round() as u8;
            if let Some(weight) = weights.get_mut(channel) {
                *weight = combine.apply(*weight, selected);
            }
            weights
        })
    }

    /// Makes 255 - w of each weight w of `channel`.
    pub fn invert(&mut self, channel: usize) -> Edit {
        self.edit(|_, mut weights| {
            weights.iter_mut().skip(channel).take(1).for_each(|weight| *weight = 255 - *weight);
            weights
        })
    }
}
