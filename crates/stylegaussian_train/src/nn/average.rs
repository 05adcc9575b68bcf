//! The mean of the parameters over the last part of a training. A step sees one view and one painting, and its
//! fit to these alone averages out (Polyak and Juditsky 1992).

use burn::tensor::Tensor;

use super::parameter::Parameter;

/// A running mean of every parameter.
pub struct Average {
    /// Number of states averaged.
    pub count: u32,
    /// The means, in the parameters' order.
    pub means: Vec<Tensor<2>>,
}

impl Average {
    /// An empty mean.
    pub fn new(parameters: &[Parameter]) -> Self {
        let zeros = |tensor: &Tensor<2>| Tensor::zeros(tensor.dims(), &tensor.device()).inner();
        Self { count: 0, means: parameters.iter().map(|p| zeros(&p.values)).collect() }
    }

    /// Adds the current parameters to the mean.
    pub fn add(&mut self, parameters: &[Parameter]) {
        self.count += 1;
        for (mean, parameter) in self.means.iter_mut().zip(parameters) {
            // A running mean, and not a sum to be divided, which would lose digits of the differences between
            // states.
            let difference = parameter.values.clone().inner() - mean.clone();
            *mean = mean.clone() + difference / self.count as f32;
        }
    }

    /// The mean parameters, or the current ones if nothing has been averaged yet.
    pub fn values_or_current(&self, parameters: &[Parameter]) -> Vec<Tensor<2>> {
        match self.count {
            0 => parameters.iter().map(|parameter| parameter.values.clone()).collect(),
            _ => self.means.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::nn::parameter::to_vec;

    #[test]
    fn the_mean_of_three_states() {
        let device = Device::flex().autodiff();
        let parameters = |weight: f32, bias: f32| {
            [Parameter::new(vec![weight; 3], [3, 1], &device), Parameter::new(vec![bias; 3], [1, 3], &device)]
        };
        let mut average = Average::new(&parameters(9.0, 9.0));
        let current = parameters(9.0, 9.0);
        let values = |average: &Average| {
            let tensors = average.values_or_current(&current);
            tensors.iter().map(|tensor| to_vec(tensor).unwrap()).collect::<Vec<_>>()
        };
        assert_eq!(values(&average), [[9.0; 3]; 2], "nothing averaged: the current parameters");
        for (weight, bias) in [(1.0, 0.0), (2.0, 0.5), (6.0, 1.0)] {
            average.add(&parameters(weight, bias));
        }
        assert_eq!(values(&average), [[3.0; 3], [0.5; 3]]);
    }
}
