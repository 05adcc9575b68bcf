//! What `--backend` comes to: the CPU, or a GPU without a window.

use anyhow::{Context, Result};
use stylegaussian::{
    Decoder, Scene,
    fold::{self, ChannelMap},
};
use stylegaussian_gpu::{
    device::HeadlessDevice,
    style::{self, StylizeOnGpuError},
};

use super::{arguments::Backend, output::warn};

/// What computes.
pub enum Compute {
    Cpu,
    Gpu(Box<HeadlessDevice>),
}

impl Compute {
    /// `gpu` takes any adapter, and is an error where there is none; `auto` takes real GPUs only, because software that
    /// acts as one is slower than the CPU's own code.
    pub fn open(backend: Backend) -> Result<Self> {
        let gpu = || pollster::block_on(HeadlessDevice::request());
        match backend {
            Backend::Cpu => Ok(Self::Cpu),
            Backend::Gpu => {
                let device = gpu().context("--backend gpu")?;
                if !device.is_gpu() {
                    let name = &device.info.name;
                    warn([format!("{name} is not a GPU but software that acts as one: the CPU is faster")]);
                }
                Ok(Self::Gpu(Box::new(device)))
            }
            Backend::Auto => {
                let device = pollster::block_on(HeadlessDevice::request_gpu());
                Ok(device.map_or(Self::Cpu, |device| Self::Gpu(Box::new(device))))
            }
        }
    }

    /// Colors `[N]` of a scene's mapped features. Where `auto` chose the GPU and the scene does not fit it, the CPU takes
    /// over and a warning says so.
    pub fn stylize(
        &mut self,
        backend: Backend,
        scene: &Scene,
        decoder: &Decoder,
        map: &ChannelMap,
    ) -> Result<Vec<[f32; 3]>> {
        if let Self::Gpu(device) = self {
            match pollster::block_on(style::stylize(device, scene, decoder, map)) {
                Err(StylizeOnGpuError::Stylize(error)) => return Err(error.into()),
                Err(error) if backend == Backend::Auto => warn([format!("{error}; the CPU takes over")]),
                result => return result.with_context(|| format!("on {}", device.info.name)),
            }
            *self = Self::Cpu;
        }
        Ok(fold::stylize(scene, decoder, map)?)
    }

    /// `cpu` or `gpu`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu(_) => "gpu",
        }
    }

    /// The GPU's name.
    pub fn adapter(&self) -> Option<String> {
        match self {
            Self::Cpu => None,
            Self::Gpu(device) => Some(device.info.name.clone()),
        }
    }
}
