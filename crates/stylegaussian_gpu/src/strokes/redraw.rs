//! Strokes of a painting whose image changes: its texture is made anew on the GPU, from the image that is
//! there. CPU twin: [`stylegaussian::paint::redraw`].
//!
//! Seeds and words stay, and so does the texture's layer in the store, so nothing else has to be made anew.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use stylegaussian::paint::Paint;
use stylegaussian_shaders::paint::{PaintStage as Stage, PaintStep};

use super::{
    plan::{Plan, PlanKey},
    store::{StrokeLayer, StrokeStore},
};
use crate::{
    bindings::{
        at_strides, bind_group, compute_pass, compute_pipeline, group_layout, one_of, pipeline_layout,
        storage_binding, stride, texture_binding, uniforms_binding,
    },
    buffers::{self, ReadBackError, TooLarge},
    device::GpuEncoder,
};

/// Least width and height of an image that changes, in pixels: there is no stroke in less.
pub const LEAST_SIDE: u32 = 8;

/// An image cannot be read as a painting.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ImageError {
    /// It is too small.
    #[error("found {}x{} pixels, expected at least {LEAST_SIDE}x{LEAST_SIDE}", found[0], found[1])]
    TooSmall {
        /// Its width and height.
        found: [u32; 2],
    },
    /// Its texels are no colors, or of a format that is not read.
    #[error("found texels of {found:?}, expected plain or floating-point colors, such as Rgba8UnormSrgb")]
    Format {
        /// Its format.
        found: wgpu::TextureFormat,
    },
}

/// An image that may change, on the GPU.
#[derive(Clone, Copy, Debug)]
pub struct PaintImage<'a> {
    /// Its first level and layer, as a texture of two dimensions.
    pub view: &'a wgpu::TextureView,
    /// The format of the view.
    pub format: wgpu::TextureFormat,
    /// Its width and height in pixels.
    pub size: [u32; 2],
}

impl PaintImage<'_> {
    /// Checks that an image of this format and size can be read.
    ///
    /// # Errors
    /// If it cannot.
    pub fn check(format: wgpu::TextureFormat, size: [u32; 2]) -> Result<(), ImageError> {
        if size.into_iter().any(|side| side < LEAST_SIDE) {
            return Err(ImageError::TooSmall { found: size });
        }
        channels(format).map(|_| ())
    }

    /// The plan of its steps.
    fn key(&self, reading: Option<[u32; 2]>) -> Result<PlanKey, ImageError> {
        Self::check(self.format, self.size)?;
        let (n_channels, is_linear) = channels(self.format)?;
        let original = Paint::size_of(self.size[0], self.size[1]).into();
        Ok(PlanKey { original, reading, n_channels, is_linear })
    }
}

/// Channels of a format, and whether it is read as linear colors. Values of 8 bits are display-referred, as in
/// a file, whether or not the texture says so. Of two channels, the second is alpha.
fn channels(format: wgpu::TextureFormat) -> Result<(u32, bool), ImageError> {
    use wgpu::TextureFormat as Format;
    Ok(match format {
        Format::R8Unorm => (1, false),
        Format::Rg8Unorm => (2, false),
        Format::Rgba8Unorm | Format::Bgra8Unorm | Format::Rgb10a2Unorm => (4, false),
        Format::Rgba8UnormSrgb | Format::Bgra8UnormSrgb => (4, true),
        Format::Rg11b10Ufloat => (3, true),
        Format::Rgba16Float | Format::Rgba32Float => (4, true),
        found => return Err(ImageError::Format { found }),
    })
}

/// The texture of an image was not made anew.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RedrawError {
    /// The image cannot be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The device has no room for the pictures on the way.
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
}

/// The kernels that make textures anew, and their memory, which all images share.
#[derive(Debug)]
pub struct StrokeRedrawer {
    step_layout: wgpu::BindGroupLayout,
    image_layout: wgpu::BindGroupLayout,
    /// In the order of [`Stage::ALL`].
    pipelines: Vec<wgpu::ComputePipeline>,
    scratch: Mutex<Scratch>,
}

/// Buffers, and the plans that were made on them.
#[derive(Debug, Default)]
struct Scratch {
    /// The pictures, and packed texels.
    buffers: Option<[wgpu::Buffer; 2]>,
    plans: Vec<Arc<Planned>>,
}

/// A plan and its uniforms.
#[derive(Debug)]
struct Planned {
    key: PlanKey,
    plan: Plan,
    group: wgpu::BindGroup,
    packed: wgpu::Buffer,
}

/// Most plans that are kept: images of as many sizes can change in turn without making one anew.
const MAX_PLANS: usize = 8;

impl Scratch {
    /// The buffers, of these sizes at least.
    fn with_room(&mut self, device: &wgpu::Device, sizes: [u64; 2]) -> [wgpu::Buffer; 2] {
        let fit = |buffers: &[wgpu::Buffer; 2]| buffers.iter().zip(sizes).all(|(b, size)| b.size() >= size);
        if let Some(buffers) = self.buffers.as_ref().filter(|buffers| fit(buffers)) {
            return buffers.clone();
        }
        // The groups of other plans name the old buffers, which go before the new ones come.
        self.plans.clear();
        self.buffers = None;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let labels = ["paint_pictures", "paint_packed"];
        let new = std::array::from_fn(|i| buffers::create(device, labels[i], sizes[i], usage));
        self.buffers.insert(new).clone()
    }
}

impl StrokeRedrawer {
    /// Compiles the kernels.
    pub fn new(device: &wgpu::Device) -> Self {
        let write = storage_binding(false);
        let bindings = [uniforms_binding::<PaintStep>(), write, write];
        let step_layout = group_layout(device, "paint_step", wgpu::ShaderStages::COMPUTE, &bindings);
        let sample_type = wgpu::TextureSampleType::Float { filterable: false };
        let image = texture_binding(sample_type, wgpu::TextureViewDimension::D2);
        let image_layout = group_layout(device, "paint_image", wgpu::ShaderStages::COMPUTE, &[image]);
        let of_image = pipeline_layout(device, "paint_read", &[&step_layout, &image_layout]);
        let of_pictures = pipeline_layout(device, "paint_step", &[&step_layout]);
        let pipeline = |stage: Stage| {
            let layout = if stage == Stage::Read { &of_image } else { &of_pictures };
            compute_pipeline(device, stage.source(), layout, wgpu::PipelineCompilationOptions::default())
        };
        let pipelines = Stage::ALL.into_iter().map(pipeline).collect();
        Self { step_layout, image_layout, pipelines, scratch: Mutex::default() }
    }

    /// Encodes the texture of `image`, read at `reading` pixels
    /// ([`Canvas::reading_size`](stylegaussian::paint::Canvas::reading_size)), into a layer of the store.
    /// Nothing is encoded if the layer is no longer in use.
    ///
    /// # Errors
    /// If the image cannot be read, or if it takes more memory than the device has room for. The layer stays as
    /// it is.
    pub fn encode(
        &self,
        gpu: &mut GpuEncoder,
        image: &PaintImage,
        reading: [u32; 2],
        store: &StrokeStore,
        layer: &StrokeLayer,
    ) -> Result<(), RedrawError> {
        let Some(layer) = layer.number() else { return Ok(()) };
        let planned = self.planned(gpu, image.key(Some(reading))?)?;
        self.dispatch(gpu, image, &planned);
        let arrays = store.arrays(gpu.device);
        for level in &planned.plan.levels {
            let array = if level.is_wide { &arrays.wide } else { &arrays.fine };
            let from = wgpu::TexelCopyBufferInfo {
                buffer: &planned.packed,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 4 * u64::from(level.first),
                    bytes_per_row: Some(4 * level.stride),
                    rows_per_image: None,
                },
            };
            let to = wgpu::TexelCopyTextureInfo {
                mip_level: level.level,
                origin: wgpu::Origin3d { x: 0, y: 0, z: u32::from(layer) },
                ..array.as_image_copy()
            };
            let size = wgpu::Extent3d { width: level.side, height: level.side, depth_or_array_layers: 1 };
            gpu.encoder.copy_buffer_to_texture(from, to, size);
        }
        Ok(())
    }

    /// Encodes a copy of `image` as a painting to main memory.
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    pub fn encode_read(
        &self,
        gpu: &mut GpuEncoder,
        image: &PaintImage,
    ) -> Result<PaintReadBack, RedrawError> {
        let planned = self.planned(gpu, image.key(None)?)?;
        self.dispatch(gpu, image, &planned);
        let size @ [width, height] = planned.key.original;
        let bytes = 4 * u64::from(width) * u64::from(height);
        let copy = buffers::read_back(gpu.device, "paint_read_back", bytes);
        gpu.encoder.copy_buffer_to_buffer(&planned.packed, 0, &copy, 0, bytes);
        Ok(PaintReadBack { copy, size, mapped: None })
    }

    /// Frees the memory. The next call takes it again.
    pub fn release_scratch(&self) {
        *self.scratch.lock().unwrap_or_else(PoisonError::into_inner) = Scratch::default();
    }

    fn dispatch(&self, gpu: &mut GpuEncoder, image: &PaintImage, planned: &Planned) {
        let view = wgpu::BindingResource::TextureView(image.view);
        let of_image = bind_group(gpu.device, "paint_image", &self.image_layout, &[view]);
        let mut pass = compute_pass(gpu.encoder, "redraw_strokes");
        for (i, step) in planned.plan.steps.iter().enumerate() {
            pass.set_pipeline(&self.pipelines[step.stage as usize]);
            pass.set_bind_group(0, &planned.group, &[(i * stride::<PaintStep>()) as u32]);
            if step.stage == Stage::Read {
                pass.set_bind_group(1, &of_image, &[]);
            }
            pass.dispatch_workgroups(step.workgroups[0], step.workgroups[1], 1);
        }
    }

    /// A plan and its buffers, made now if they are not there.
    fn planned(&self, gpu: &GpuEncoder, key: PlanKey) -> Result<Arc<Planned>, TooLarge> {
        let mut scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = scratch.plans.iter().position(|planned| planned.key == key) {
            // Those used last are at the end.
            let known = scratch.plans.remove(known);
            scratch.plans.push(Arc::clone(&known));
            return Ok(known);
        }
        let plan = Plan::new(key);
        let pixel = size_of::<[f32; 4]>() as u64;
        let sizes = [pixel * u64::from(plan.n_pixels), 4 * u64::from(plan.n_packed)];
        let limit = buffers::largest_binding(gpu.device);
        TooLarge::check("the pictures of a painting that changes", sizes[0], limit)?;
        TooLarge::check("the texels of a painting that changes", sizes[1], limit)?;
        let [pictures, packed] = scratch.with_room(gpu.device, sizes);
        let bytes = at_strides(plan.steps.iter().map(|step| step.uniforms));
        let uniforms = buffers::uniforms(gpu.device, "paint_steps", bytes.len() as u64);
        gpu.queue.write_buffer(&uniforms, 0, &bytes);
        let [of_pictures, of_packed] = [&pictures, &packed].map(wgpu::Buffer::as_entire_binding);
        let resources = [one_of::<PaintStep>(&uniforms), of_pictures, of_packed];
        let group = bind_group(gpu.device, "paint_step", &self.step_layout, &resources);
        let planned = Arc::new(Planned { key, plan, group, packed });
        scratch.plans.push(Arc::clone(&planned));
        if scratch.plans.len() > MAX_PLANS {
            scratch.plans.remove(0);
        }
        Ok(planned)
    }
}

/// An image on its way to main memory.
#[derive(Debug)]
pub struct PaintReadBack {
    copy: wgpu::Buffer,
    size: [u32; 2],
    mapped: Option<Arc<OnceLock<bool>>>,
}

impl PaintReadBack {
    /// The painting, or `None` until it is there. Never waits. The first call is made after the commands were
    /// submitted, and no call after the first result.
    pub fn poll(&mut self) -> Option<Result<Paint, ReadBackError>> {
        let mapped = self.mapped.get_or_insert_with(|| buffers::start_mapping(&self.copy));
        if !*mapped.get()? {
            return Some(Err(ReadBackError::Lost));
        }
        let rgb = |texel: &[u8; 4]| [texel[0], texel[1], texel[2]];
        let pixels = self.copy.get_mapped_range(..).as_chunks().0.iter().flat_map(rgb).collect();
        self.copy.unmap();
        let [width, height] = self.size.map(|side| side as usize);
        Some(Ok(Paint { width, height, pixels, used: None }))
    }
}
