//! The meaning of `--backend`: the CPU, or a GPU without a window.

use anyhow::{Context, Result, ensure};
use glam::Affine3A;
use stylegaussian::{
    Camera, Decoder, Scene,
    fold::{self, ChannelMap},
    splat::{self, Colors, RenderedImage},
    strokes::{StrokeKnobs, StrokeMotion, Strokes},
};
use stylegaussian_gpu::{
    colors::GaussianColors,
    device::{DeviceOptions, HeadlessDevice},
    splat::{Cloud, CloudColors, GpuScene, Headless, SplatSettings},
    strokes::{GaussianStrokes, StrokesError},
    style::{self, StylizeOnGpuError},
};

use stylegaussian_train::nn::Processor;

#[cfg(feature = "gpu")]
use crate::terminal::note;
use crate::{arguments::Backend, terminal::warn};

/// The device that stylizes and draws.
pub struct Compute {
    backend: Backend,
    gpu: Option<HeadlessDevice>,
}

impl Compute {
    /// Opens the device. `gpu` takes any adapter, and is an error if there is none. `auto` takes only hardware
    /// GPUs, because software adapters are slower than our CPU code.
    ///
    /// # Errors
    /// If a GPU is asked for and there is none.
    pub fn open(backend: Backend) -> Result<Self> {
        let gpu = match backend {
            Backend::Cpu => None,
            Backend::Auto => {
                let options = DeviceOptions { hardware_only: true, ..Default::default() };
                // No error: `auto` without a GPU means the CPU.
                pollster::block_on(HeadlessDevice::request(options)).ok()
            }
            Backend::Gpu => {
                let gpu = pollster::block_on(HeadlessDevice::request(DeviceOptions::default()));
                Some(gpu.context("--backend gpu")?)
            }
        };
        if let Some(software) = gpu.as_ref().filter(|gpu| gpu.is_software()) {
            let name = &software.info.name;
            warn([format!("{name} is a software adapter: --backend cpu is faster")]);
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

    /// Colors `[N]` of a scene's mapped features. If `auto` chose the GPU and the scene does not fit it, the
    /// CPU takes over and a warning says so.
    ///
    /// # Errors
    /// If scene, decoder and map do not fit one another, or the GPU that was asked for fails.
    pub fn stylize(&mut self, scene: &Scene, decoder: &Decoder, map: &ChannelMap) -> Result<Vec<[f32; 3]>> {
        if let Some(gpu) = &self.gpu {
            match pollster::block_on(style::stylize(gpu, scene, decoder, map)) {
                Ok(colors) => return Ok(colors),
                // The inputs are at fault, and the CPU would refuse them too.
                Err(StylizeOnGpuError::Stylize(error)) => return Err(error.into()),
                Err(error) => self.fall_back(error.into())?,
            }
        }
        Ok(fold::stylize(scene, decoder, map)?)
    }

    /// Prepares to draw `scene` in `colors` with `strokes` over them, if there are any, drawn by `knobs` and
    /// moving. Falls back as [`stylize`](Self::stylize) does.
    ///
    /// # Errors
    /// If the GPU that was asked for fails.
    pub fn drawing<'a>(
        &'a mut self,
        scene: &'a Scene,
        colors: Colors<'a>,
        strokes: Option<&'a Strokes>,
        knobs: StrokeKnobs,
        motion: StrokeMotion,
    ) -> Result<Drawing<'a>> {
        let strokes = strokes.filter(|strokes| !strokes.seeds.is_empty());
        if let Some(gpu) = &self.gpu {
            match pollster::block_on(OnGpu::new(
                gpu,
                scene,
                colors,
                strokes.map(|strokes| (strokes, knobs, motion)),
            )) {
                Ok(on_gpu) => return Ok(Drawing::Gpu(gpu.clone(), Box::new(on_gpu))),
                Err(error) => self.fall_back(error)?,
            }
        }
        Ok(Drawing::Cpu(scene, colors, strokes.map(|strokes| (strokes, knobs, motion))))
    }

    /// Continues on the CPU with a warning if `auto` chose the GPU.
    fn fall_back(&mut self, error: anyhow::Error) -> Result<()> {
        let error = error.context(format!("on {}", self.adapter().unwrap_or_default()));
        if self.backend != Backend::Auto {
            return Err(error);
        }
        warn([format!("{error:#}; the CPU takes over")]);
        // For the rest of the command, so that stylizing and drawing use one device.
        self.gpu = None;
        Ok(())
    }
}

/// The device that training runs on. With the `gpu` feature, `gpu` takes any adapter and `auto` only a hardware
/// GPU.
///
/// # Errors
/// If a GPU is asked for, but there is none or this build cannot train on one.
pub fn processor(backend: Backend) -> Result<Processor> {
    #[cfg(feature = "gpu")]
    if let Some(adapter) = Compute::open(backend)?.adapter() {
        note(format!("training on {adapter}"));
        return Ok(Processor::Gpu);
    }
    ensure!(
        cfg!(feature = "gpu") || backend != Backend::Gpu,
        "this build cannot train on a GPU: build with `--features gpu`, or use --backend cpu"
    );
    Ok(Processor::Cpu)
}

/// A scene in its colors, ready to be drawn from any camera.
pub enum Drawing<'a> {
    /// On the CPU.
    Cpu(&'a Scene, Colors<'a>, Option<(&'a Strokes, StrokeKnobs, StrokeMotion)>),
    /// On a GPU.
    Gpu(HeadlessDevice, Box<OnGpu>),
}

/// The scene and the renderer on the GPU.
pub struct OnGpu {
    headless: Headless,
    scene: GpuScene,
    colors: Option<GaussianColors>,
    strokes: Option<(GaussianStrokes, StrokeKnobs)>,
}

impl Drawing<'_> {
    /// `cpu` or `gpu`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Cpu(..) => "cpu",
            Self::Gpu(..) => "gpu",
        }
    }

    /// The view of `camera` at a time in seconds. Without depth if the GPU draws.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn view(&mut self, camera: &Camera, seconds: f64) -> Result<RenderedImage> {
        match self {
            Self::Cpu(scene, colors, None) => Ok(splat::render(scene, *colors, camera)),
            Self::Cpu(scene, colors, Some((strokes, knobs, motion))) => {
                let moved = strokes.moved(*motion, seconds);
                Ok(splat::render_strokes(scene, *colors, (&moved, knobs), camera, None))
            }
            Self::Gpu(gpu, on_gpu) => {
                on_gpu.view(gpu, camera, seconds).with_context(|| format!("on {}", gpu.info.name))
            }
        }
    }
}

impl OnGpu {
    async fn new(
        gpu: &HeadlessDevice,
        scene: &Scene,
        colors: Colors<'_>,
        strokes: Option<(&Strokes, StrokeKnobs, StrokeMotion)>,
    ) -> Result<Self> {
        let HeadlessDevice { device, queue, .. } = gpu;
        // wgpu reports a lack of memory through a scope and not as a result. No `?` before it is popped.
        let scope = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let gpu_scene = GpuScene::new(device, scene);
        let colors = match colors {
            Colors::Captured => Ok(None),
            Colors::Rgb(rgb) => GaussianColors::from_rgb(device, queue, rgb).map(Some),
            Colors::Mixed(mixed) => GaussianColors::from_premultiplied(device, queue, mixed).map(Some),
        };
        let headless = Headless::new(device);
        let upload = |(strokes, knobs, motion): (&Strokes, _, _)| {
            let uploaded = headless.store().upload(device, queue, strokes)?;
            Ok::<_, StrokesError>((uploaded.moving(motion), knobs))
        };
        let strokes = strokes.map(upload).transpose();
        if let Some(error) = scope.pop().await {
            return Err(error).context("the GPU has no memory left for the scene");
        }
        Ok(Self { headless, scene: gpu_scene?, colors: colors?, strokes: strokes? })
    }

    fn view(&mut self, gpu: &HeadlessDevice, camera: &Camera, seconds: f64) -> Result<RenderedImage> {
        let colors = self.colors.as_ref().map_or(CloudColors::Captured, CloudColors::Rgb);
        let cloud = Cloud {
            scene: &self.scene,
            colors: match &self.strokes {
                Some((strokes, knobs)) => colors.with_strokes(strokes, *knobs).at(seconds),
                None => colors,
            },
            world_from_scene: Affine3A::IDENTITY,
            visibility: None,
        };
        let settings = SplatSettings { near: camera.near, ..SplatSettings::default() };
        let camera = stylegaussian_gpu::splat::Camera::pinhole(camera);
        let picture = self.headless.render(&gpu.device, &gpu.queue, &camera, &[cloud], &settings)?;
        Ok(RenderedImage {
            size: picture.size,
            color: picture.rgba.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
            alpha: picture.rgba.iter().map(|&[.., alpha]| alpha).collect(),
            // The splat pass draws no depth of its own.
            depth: Vec::new(),
        })
    }
}
