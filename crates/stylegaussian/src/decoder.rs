//! The decoder: a CNN whose window is each Gaussian's K nearest neighbors.

use crate::encoder_id::EncoderId;

/// What stands between the layers; there is none after the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Activation {
    /// 1 / (1 + exp(-x)), the paper's.
    Sigmoid,
    /// x for x > 0, slope * x otherwise.
    LeakyRelu {
        /// The slope for negative inputs.
        slope: f32,
    },
}

/// One KNN convolution: y_p = sum_k W_k x_{n(p,k)} + B.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// W `[D_out, K, D_in]`, row-major.
    pub weight: Vec<f32>,
    /// B `[D_out]`.
    pub bias: Vec<f32>,
    /// D_in.
    pub d_in: usize,
    /// D_out.
    pub d_out: usize,
}

/// KNN convolutions with an activation between them, from D + E input channels to RGB.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoder {
    /// The layers, first to last.
    pub layers: Vec<Layer>,
    /// K, the window of every layer.
    pub k: usize,
    /// The activation between layers.
    pub activation: Activation,
    /// Whether the output is an offset from the Gaussian's unstyled color (SH 0) and not the color itself.
    pub residual: bool,
    /// The encoder its input belongs to; `None` when the file did not say.
    pub encoder: Option<EncoderId>,
}
