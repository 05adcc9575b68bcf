//! What `--backend` comes to: the CPU, or a GPU without a window.

use anyhow::{Context, Result};
use glam::Affine3A;
use stylegaussian::{
    Camera, Decoder, Scene,
    fold::{self, ChannelMap},
    splat::{self, Colors, RenderedImage},
};
use stylegaussian_gpu::{
    colors::GaussianColors,
    device::{DeviceOptions, HeadlessDevice},
    splat::{Cloud, CloudColors, GpuScene, Headless, SplatSettings},
    style::{self, StylizeOnGpuError},
};

use super::{arguments::Backend, output::warn};

/// What computes.
pub struct Compute {
    backend: Backend,
    gpu: Option<HeadlessDevice>,
}

impl Compute {
    /// `gpu` takes any adapter, and is an error where there is none; `auto` takes real GPUs only, because software that
    /// acts as one is slower than the CPU's own code.
    pub fn open(backend: Backend) -> Result<Self> {
        let gpu = match backend {
            Backend::Cpu => None,
            Backend::Auto => {
                let options = DeviceOptions { hardware_only: true, ..Default::default() };
                pollster::block_on(HeadlessDevice::request(options)).ok()
            }
            Backend::Gpu => {
                let gpu = pollster::block_on(HeadlessDevice::request(DeviceOptions::default()));
                Some(gpu.context("--backend gpu")?)
            }
        };
        if let Some(software) = gpu.as_ref().filter(|gpu| gpu.is_software()) {
            let name = &software.info.name;
            warn([format!("{name} is not a GPU but software that acts as one: the CPU is faster")]);
        }
        Ok(Self { backend, gpu })
    }

    /// `cpu` or `gpu`.
    pub fn name(&self) -> &'static str {
        if self.gpu.is_some() { "gpu" } else { "cpu" }
    }

    /// The GPU's name.
    pub fn adapter(&self) -> Option<String> {
        self.gpu.as_ref().map(|gpu| gpu.info.name.clone())
    }

    /// Colors `[N]` of a scene's mapped features. Where `auto` chose the GPU and the scene does not fit it, the CPU takes
    /// over and a warning says so.
    pub fn stylize(&mut self, scene: &Scene, decoder: &Decoder, map: &ChannelMap) -> Result<Vec<[f32; 3]>> {
        if let Some(gpu) = &self.gpu {
            match pollster::block_on(style::stylize(gpu, scene, decoder, map)) {
                Ok(colors) => return Ok(colors),
                Err(StylizeOnGpuError::Stylize(error)) => return Err(error.into()),
                Err(error) => self.fall_back(error.into())?,
            }
        }
        Ok(fold::stylize(scene, decoder, map)?)
    }

    /// Prepares to draw `scene` in `colors`; falls back as [`stylize`](Self::stylize) does.
    pub fn drawing<'a>(&'a mut self, scene: &'a Scene, colors: Colors<'a>) -> Result<Drawing<'a>> {
        if let Some(gpu) = &self.gpu {
            match pollster::block_on(OnGpu::new(gpu, scene, colors)) {
                Ok(on_gpu) => return Ok(Drawing::Gpu(gpu.clone(), Box::new(on_gpu))),
                Err(error) => self.fall_back(error)?,
            }
        }
        Ok(Drawing::Cpu(scene, colors))
    }

    /// Goes on with the CPU where `auto` chose the GPU, and says so.
    fn fall_back(&mut self, error: anyhow::Error) -> Result<()> {
        let error = error.context(format!("on {}", self.adapter().unwrap_or_default()));
        if self.backend != Backend::Auto {
            return Err(error);
        }
        warn([format!("{error:#}; the CPU takes over")]);
        self.gpu = None;
        Ok(())
    }
}

/// A scene in its colors, ready to be drawn from any camera.
pub enum Drawing<'a> {
    Cpu(&'a Scene, Colors<'a>),
    Gpu(HeadlessDevice, Box<OnGpu>),
}

/// What drawing keeps on the GPU.
pub struct OnGpu {
    headless: Headless,
    scene: GpuScene,
    colors: Option<GaussianColors>,
}

impl Drawing<'_> {
    /// `cpu` or `gpu`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Cpu(..) => "cpu",
            Self::Gpu(..) => "gpu",
        }
    }

    /// What `camera` sees; without depth where the GPU draws.
    pub fn view(&mut self, camera: &Camera) -> Result<RenderedImage> {
        match self {
            Self::Cpu(scene, colors) => Ok(splat::render(scene, *colors, camera)),
            Self::Gpu(gpu, on_gpu) => {
                on_gpu.view(gpu, camera).with_context(|| format!("on {}", gpu.info.name))
            }
        }
    }
}

impl OnGpu {
    async fn new(gpu: &HeadlessDevice, scene: &Scene, colors: Colors<'_>) -> Result<Self> {
        let HeadlessDevice { device, queue, .. } = gpu;
        let scope = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let gpu_scene = GpuScene::new(device, scene);
        let colors = match colors {
            Colors::Captured => Ok(None),
            Colors::Rgb(rgb) => GaussianColors::from_rgb(device, queue, rgb).map(Some),
        };
        if let Some(error) = scope.pop().await {
            return Err(error).context("the GPU has no memory left for the scene");
        }
        Ok(Self { headless: Headless::new(device), scene: gpu_scene?, colors: colors? })
    }

    fn view(&mut self, gpu: &HeadlessDevice, camera: &Camera) -> Result<RenderedImage> {
        let cloud = Cloud {
            scene: &self.scene,
            colors: self.colors.as_ref().map_or(CloudColors::Captured, CloudColors::Rgb),
            world_from_scene: Affine3A::IDENTITY,
        };
        let camera = stylegaussian_gpu::splat::Camera::pinhole(camera);
        let settings = SplatSettings::default();
        let picture = self.headless.render(&gpu.device, &gpu.queue, &camera, &[cloud], &settings)?;
        Ok(RenderedImage {
            size: picture.size,
            color: picture.rgba.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
            alpha: picture.rgba.iter().map(|&[.., alpha]| alpha).collect(),
            depth: Vec::new(),
        })
    }
}
