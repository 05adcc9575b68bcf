//! Parameters of a network under training, and reading them back.

use burn::tensor::{Device, Tensor, TensorData};

use crate::error::TrainError;

/// One tensor of a network, flattened to two dimensions.
#[derive(Clone)]
pub struct Parameter {
    /// Values; a bias is `[1, D_out]`.
    pub values: Tensor<2>,
}

impl Parameter {
    /// A parameter with row-major values of this shape, which records gradients.
    pub fn new(values: Vec<f32>, shape: [usize; 2], device: &Device) -> Self {
        Self { values: Tensor::from_data(TensorData::new(values, shape), device).require_grad() }
    }
}

/// The values of a tensor, row-major.
///
/// # Errors
/// If the device fails before the values are computed or copied.
pub fn to_vec(tensor: &Tensor<2>) -> Result<Vec<f32>, TrainError> {
    Ok(tensor.try_to_vec_as()?)
}

/// The value of a tensor with one element.
///
/// # Errors
/// If the device fails before the value is computed or copied.
pub fn to_scalar(tensor: &Tensor<1>) -> Result<f32, TrainError> {
    let values: Vec<f32> = tensor.try_to_vec_as()?;
    values
        .first()
        .copied()
        .ok_or_else(|| TrainError::Invalid("found an empty tensor, expected a number".into()))
}
