//! The mean of the parameters over the last part of a training: a step looks at one view and one painting, and what it
//! does for these alone averages out (Polyak and Juditsky 1992).

use burn::tensor::Tensor;
use stylegaussian::Decoder;

use super::network::{Network, Parameter};

/// A running mean of every parameter.
pub struct Average {
    /// Of how many states of the network.
    pub count: u32,
    /// The means, in the parameters' order.
    pub means: Vec<Tensor<2>>,
}

impl Average {
    /// Of nothing yet.
    pub fn new(parameters: &[Parameter]) -> Self {
        let zeros = |tensor: &Tensor<2>| Tensor::zeros(tensor.dims(), &tensor.device()).inner();
        Self { count: 0, means: parameters.iter().map(|p| zeros(&p.values)).collect() }
    }

    /// Takes in the parameters as they are.
    pub fn add(&mut self, parameters: &[Parameter]) {
        self.count += 1;
        for (mean, parameter) in self.means.iter_mut().zip(parameters) {
            let difference = parameter.values.clone().inner() - mean.clone();
            *mean = mean.clone() + difference / self.count as f32;
        }
    }

    /// The mean decoder, or where there is none yet, the network's own.
    pub fn decoder(&self, network: &Network) -> Decoder {
        if self.count == 0 { network.decoder() } else { network.decoder_of(&self.means) }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, TensorData};
    use stylegaussian::{Activation, Layer};

    use super::*;

    fn decoder(weight: f32, bias: f32) -> Decoder {
        Decoder {
            layers: vec![Layer { weight: vec![weight; 3], bias: vec![bias; 3], d_in: 1, d_out: 3 }],
            k: 1,
            ..Decoder::default()
        }
    }

    #[test]
    fn the_mean_of_three_states() {
        let device = Device::flex().autodiff();
        let mut network = Network::new(&decoder(9.0, 9.0), &device).unwrap();
        let mut average = Average::new(&network.parameters);
        assert_eq!(average.decoder(&network), decoder(9.0, 9.0), "of nothing: the network's own");
        for (weight, bias) in [(1.0, 0.0), (2.0, 0.5), (6.0, 1.0)] {
            let values = |value: f32, shape: [usize; 2]| {
                Tensor::from_data(TensorData::new(vec![value; 3], shape), &device).require_grad()
            };
            network.parameters[0].values = values(weight, [3, 1]);
            network.parameters[1].values = values(bias, [1, 3]);
            average.add(&network.parameters);
        }
        assert_eq!(average.decoder(&network), decoder(3.0, 0.5));
    }
}
