//! Channel statistics of features: what AdaIN matches.

use crate::encoder_id::EncoderId;

/// Mean and unbiased standard deviation of D channels, over pixels of an image or over Gaussians of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChannelStatistics {
    /// Mean of each channel `[D]`.
    pub mean: Vec<f32>,
    /// Unbiased (n - 1) standard deviation of each channel `[D]`.
    pub std_dev: Vec<f32>,
    /// Unbiased covariance `[D, D]`, row-major, for transfers beyond AdaIN.
    pub covariance: Option<Vec<f32>>,
    /// The encoder the channels belong to; `None` when the file did not say.
    pub encoder: Option<EncoderId>,
}
