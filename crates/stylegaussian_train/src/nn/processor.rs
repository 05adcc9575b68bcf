//! The device that training runs on.

use burn::tensor::Device;

/// The device that training runs on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Processor {
    /// The CPU, with the model's own kernels.
    #[default]
    Cpu,
    /// The default GPU (Vulkan, Metal or DirectX 12).
    #[cfg(feature = "gpu")]
    Gpu,
}

impl Processor {
    /// A device that records gradients.
    pub(crate) fn device(self) -> Device {
        match self {
            Self::Cpu => Device::flex(),
            #[cfg(feature = "gpu")]
            Self::Gpu => Device::wgpu(burn::tensor::DeviceKind::DefaultDevice),
        }
        .autodiff()
    }
}
