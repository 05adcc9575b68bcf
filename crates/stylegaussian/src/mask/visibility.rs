//! Hiding and cropping by a channel.

use super::weights::{CHANNELS, share};

/// The meaning of a channel for drawing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MaskUse {
    /// Hides painted Gaussians: opacities are multiplied by 1 - weight.
    #[default]
    Hide,
    /// Keeps painted Gaussians alone: opacities are multiplied by the weight.
    Crop,
}

/// A channel of a mask by which Gaussians are drawn or not.
#[derive(Clone, Copy, Debug)]
pub struct Visibility<'a> {
    /// The mask's weights `[N]`.
    pub weights: &'a [[u8; CHANNELS]],
    /// The channel, 0..4.
    pub channel: usize,
    /// Its meaning.
    pub is: MaskUse,
}

impl Visibility<'_> {
    /// The share of its opacity that Gaussian `i` keeps, 0..1.
    ///
    /// # Panics
    /// If `i` is not below N.
    pub fn share(&self, i: usize) -> f32 {
        let weight = share(self.weights[i], self.channel);
        match self.is {
            MaskUse::Hide => 1.0 - weight,
            MaskUse::Crop => weight,
        }
    }
}
