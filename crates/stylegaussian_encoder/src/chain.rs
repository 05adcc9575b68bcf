//! Chains of convolutions, with their gradients: the engine of this project's own networks.
//!
//! A chain takes a picture of C channels to features. The default encoder, VGG-19 and the loss networks of
//! baking are chains, read from safetensors files ([`Chain::from_bytes`], [`vgg`](crate::vgg)).
//!
//! Pictures are rows of pixels with channels last, `[h * w, C]`. A result is the same for any number of
//! threads.

mod convolution;
mod file;
mod pixels;
mod size;

pub use convolution::{Convolution, Kernel, Padding};
pub use file::ChainFile;
pub(crate) use file::is_chain;
pub use pixels::add;
pub use size::Size;

use stylegaussian::work::{Canceled, Work};

/// One operation. Value 0 is the picture, value i + 1 the result of operation i.
#[derive(Clone, Debug)]
pub enum Operation {
    /// A convolution of the value before.
    Convolution(Convolution),
    /// The sum of the value before and an earlier one.
    Add(usize),
    /// relu(x) and relu(-x) of the value before, in twice as many channels (CReLU: Shang et al. 2016).
    BothSigns,
    /// The largest of 2x2 pixels. An odd last line is kept if `ceil`, otherwise dropped.
    MaxPool {
        /// Whether an odd last line is kept.
        ceil: bool,
    },
    /// Each pixel becomes 2x2 pixels.
    Double,
}

/// A chain of operations.
#[derive(Clone, Debug)]
pub struct Chain {
    operations: Vec<Operation>,
    /// Channels of each value.
    channels: Vec<usize>,
}

/// The values of a chain on one picture: rows `[h * w, C]` of the picture and of each operation's result.
pub struct Values(Vec<Vec<f32>>);

/// Operations do not fit one another.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("operation {operation} {found}, expected {expected}")]
pub struct ChainError {
    /// Number of the operation, from 0.
    pub operation: usize,
    /// Description of the operation.
    pub found: String,
    /// Description of a fitting one.
    pub expected: String,
}

impl Values {
    /// The rows `[h * w, C]` of a value.
    pub fn rows(&self, value: usize) -> &[f32] {
        &self.0[value]
    }
}

impl Chain {
    /// A chain over pictures of `channels`.
    ///
    /// # Errors
    /// If a convolution takes another number of channels than it gets, or if an addition names a value that
    /// does not come before it, or one of other channels.
    pub fn new(channels: usize, operations: Vec<Operation>) -> Result<Self, ChainError> {
        let mut all = vec![channels];
        for (i, operation) in operations.iter().enumerate() {
            let channels = all[i];
            let wrong = |found: String, expected: String| ChainError { operation: i, found, expected };
            all.push(match operation {
                Operation::Convolution(convolution) if convolution.d_in() != channels => {
                    let found = format!("is a convolution of {} channels", convolution.d_in());
                    return Err(wrong(found, format!("the {channels} of the value before it")));
                }
                Operation::Convolution(convolution) => convolution.d_out(),
                Operation::Add(value) if all.get(*value) != Some(&channels) => {
                    let found = format!("adds value {value}");
                    return Err(wrong(found, format!("a value before it of {channels} channels")));
                }
                Operation::BothSigns => channels.saturating_mul(2),
                Operation::Add(_) | Operation::MaxPool { .. } | Operation::Double => channels,
            });
        }
        Ok(Self { operations, channels: all })
    }

    /// The operations.
    pub fn operations(&self) -> &[Operation] {
        &self.operations
    }

    /// Number of the last value, which is the number of operations.
    pub fn last(&self) -> usize {
        self.operations.len()
    }

    /// Channels of a value.
    pub fn channels(&self, value: usize) -> usize {
        self.channels[value]
    }

    /// The size of each value for a picture of `size`.
    pub fn sizes(&self, size: Size) -> Vec<Size> {
        let mut sizes = vec![size];
        for operation in &self.operations {
            let size = sizes[sizes.len() - 1];
            sizes.push(match operation {
                Operation::Convolution(convolution) => convolution.size_after(size),
                Operation::Add(_) | Operation::BothSigns => size,
                Operation::MaxPool { ceil } => size.halved(*ceil),
                Operation::Double => {
                    Size { width: size.width.saturating_mul(2), height: size.height.saturating_mul(2) }
                }
            });
        }
        sizes
    }

    /// Whether every value of a picture of `size` has pixels, and sums are of values of one size.
    pub fn takes(&self, size: Size) -> bool {
        let sizes = self.sizes(size);
        let adds = |(i, operation): (usize, &Operation)| match operation {
            Operation::Add(value) => sizes[*value] == sizes[i],
            _ => true,
        };
        sizes.iter().all(|size| size.width > 0 && size.height > 0)
            && self.operations.iter().enumerate().all(adds)
    }

    /// The most numbers of a value on a picture of `size`.
    pub fn largest(&self, size: Size) -> f64 {
        // In f64: a file of a few bytes may ask for more than a `usize` counts.
        let numbers =
            |(size, channels): (&Size, &usize)| size.width as f64 * size.height as f64 * *channels as f64;
        self.sizes(size).iter().zip(&self.channels).map(numbers).fold(0.0, f64::max)
    }

    /// All values on a picture `[h * w, C]` whose values have the `sizes`: see [`sizes`](Self::sizes).
    ///
    /// # Panics
    /// If the chain does not [take](Self::takes) the picture.
    pub fn forward(&self, sizes: &[Size], picture: &[f32]) -> Values {
        let values = self.forward_if_wanted(sizes, picture, &Work::default());
        values.expect("nobody else has the work, so nobody cancels it")
    }

    /// As [`forward`](Self::forward). It tells no progress.
    ///
    /// # Errors
    /// If `work` is canceled.
    ///
    /// # Panics
    /// If the chain does not [take](Self::takes) the picture.
    pub fn forward_if_wanted(
        &self,
        sizes: &[Size],
        picture: &[f32],
        work: &Work,
    ) -> Result<Values, Canceled> {
        let mut values = vec![picture.to_vec()];
        for i in 0..self.operations.len() {
            let result = self.result(i, sizes, &values[i], |value| &values[value], work);
            // The result of a canceled operation is not whole.
            work.check()?;
            values.push(result);
        }
        Ok(Values(values))
    }

    /// The last value on a picture `[h * w, C]`, without keeping the others.
    ///
    /// # Panics
    /// If the chain does not [take](Self::takes) the picture.
    pub fn output(&self, sizes: &[Size], picture: Vec<f32>) -> Vec<f32> {
        let output = self.output_if_wanted(sizes, picture, &Work::default());
        output.expect("nobody else has the work, so nobody cancels it")
    }

    /// As [`output`](Self::output).
    ///
    /// # Errors
    /// If `work` is canceled.
    ///
    /// # Panics
    /// If the chain does not [take](Self::takes) the picture.
    pub fn output_if_wanted(
        &self,
        sizes: &[Size],
        picture: Vec<f32>,
        work: &Work,
    ) -> Result<Vec<f32>, Canceled> {
        // Each value is kept up to the last operation that needs it.
        let mut needed: Vec<usize> = (0..=self.operations.len()).collect();
        for (i, operation) in self.operations.iter().enumerate() {
            if let Operation::Add(value) = operation {
                needed[*value] = i;
            }
        }
        let mut values = vec![picture];
        for i in 0..self.operations.len() {
            let result = self.result(i, sizes, &values[i], |value| &values[value], work);
            // The result of a canceled operation is not whole.
            work.at((i + 1) as f32 / self.operations.len() as f32)?;
            values.push(result);
            for (value, _) in needed.iter().enumerate().filter(|(_, last)| **last == i) {
                values[value] = Vec::new();
            }
        }
        Ok(values.pop().unwrap_or_default())
    }

    /// The result of operation i on the value x before it. `earlier` gives the values before that. If `work` is
    /// canceled, parts of it may be missing.
    fn result<'a>(
        &self,
        i: usize,
        sizes: &[Size],
        x: &[f32],
        earlier: impl FnOnce(usize) -> &'a Vec<f32>,
        work: &Work,
    ) -> Vec<f32> {
        match &self.operations[i] {
            Operation::Convolution(convolution) => convolution.forward(x, sizes[i], work),
            Operation::Add(value) => {
                let mut sum = x.to_vec();
                add(&mut sum, earlier(*value));
                sum
            }
            Operation::BothSigns => pixels::both_signs(x, self.channels(i)),
            Operation::MaxPool { .. } => pixels::max_pool(x, self.channels(i), [sizes[i], sizes[i + 1]]),
            Operation::Double => pixels::double(x, self.channels(i), sizes[i]),
        }
    }

    /// The gradient with respect to the picture `[h * w, C]`, from the gradients with respect to some values,
    /// one entry for each value; none if there are none.
    pub fn backward(
        &self,
        sizes: &[Size],
        values: &Values,
        grads: Vec<Option<Vec<f32>>>,
    ) -> Option<Vec<f32>> {
        let grad = self.backward_if_wanted(sizes, values, grads, &Work::default());
        grad.expect("nobody else has the work, so nobody cancels it")
    }

    /// As [`backward`](Self::backward). It tells no progress.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn backward_if_wanted(
        &self,
        sizes: &[Size],
        values: &Values,
        mut grads: Vec<Option<Vec<f32>>>,
        work: &Work,
    ) -> Result<Option<Vec<f32>>, Canceled> {
        for (i, operation) in self.operations.iter().enumerate().rev() {
            let Some(mut grad) = grads[i + 1].take() else { continue };
            let c = self.channels(i);
            match operation {
                Operation::Convolution(convolution) => {
                    if convolution.relu() {
                        pixels::gate(&mut grad, &values.0[i + 1]);
                    }
                    accumulate(&mut grads[i], convolution.backward(&grad, sizes[i], work));
                }
                Operation::Add(value) => {
                    match &mut grads[*value] {
                        Some(sum) => add(sum, &grad),
                        none => *none = Some(grad.clone()),
                    }
                    accumulate(&mut grads[i], grad);
                }
                Operation::BothSigns => {
                    accumulate(&mut grads[i], pixels::both_signs_backward(&values.0[i], &grad, c));
                }
                Operation::MaxPool { .. } => {
                    let (x, y) = (&values.0[i], &values.0[i + 1]);
                    let sizes = [sizes[i], sizes[i + 1]];
                    accumulate(&mut grads[i], pixels::max_pool_backward(x, y, &grad, c, sizes));
                }
                Operation::Double => {
                    accumulate(&mut grads[i], pixels::double_backward(&grad, c, sizes[i]));
                }
            }
            work.check()?;
        }
        Ok(grads.swap_remove(0))
    }
}

fn accumulate(sum: &mut Option<Vec<f32>>, grad: Vec<f32>) {
    match sum {
        None => *sum = Some(grad),
        Some(sum) => add(sum, &grad),
    }
}

#[cfg(test)]
mod tests;
