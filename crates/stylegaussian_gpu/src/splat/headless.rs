//! Pictures without a window: the layer, read back.

use glam::UVec2;
use half::f16;

use super::{
    camera::Camera,
    cloud::Cloud,
    draw::SplatPipeline,
    error::SplatError,
    layer::{LAYER_FORMAT, Layer},
    pass::SplatPass,
    settings::SplatSettings,
    view::SplatView,
};
use crate::{
    buffers::{self, ReadBackError},
    device::GpuEncoder,
    drawing::attachment,
    strokes::StrokeStore,
};

/// A picture of splats over nothing. Row-major `[H, W]`, from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width and height, in pixels.
    pub size: UVec2,
    /// Premultiplied, display-referred RGB and alpha `[H, W]`.
    pub rgba: Vec<[f32; 4]>,
}

/// A picture could not be drawn or read back.
#[derive(Debug, thiserror::Error)]
pub enum HeadlessError {
    /// The clouds cannot be drawn.
    #[error(transparent)]
    Splat(#[from] SplatError),
    /// The device has no texture of that size.
    #[error("a picture of {found} pixels, the device allows {limit} on a side")]
    Size {
        /// Width and height.
        found: UVec2,
        /// The largest width or height of a texture.
        limit: u32,
    },
    /// The picture could not be read back.
    #[error("the picture: {0}")]
    ReadBack(#[from] ReadBackError),
}

/// Renders pictures one by one and waits for each.
#[derive(Debug)]
pub struct Headless {
    pass: SplatPass,
    pipeline: SplatPipeline,
    view: SplatView,
    target: Option<Target>,
}

#[derive(Debug)]
struct Target {
    layer: wgpu::TextureView,
    read_back: wgpu::Buffer,
}

/// Bytes of a texel of the layer.
const TEXEL: u32 = 8;

impl Headless {
    /// Compiles the pass for pictures of one sample per pixel.
    pub fn new(device: &wgpu::Device) -> Self {
        Self::of(device, SplatPass::new(device))
    }

    /// The same with the textures of strokes in `store`.
    pub fn with_store(device: &wgpu::Device, store: StrokeStore) -> Self {
        Self::of(device, SplatPass::with_store(device, store))
    }

    /// The same, but draws by quads on any adapter, software included.
    pub fn by_quads(device: &wgpu::Device) -> Self {
        Self::of(device, SplatPass::by_quads(device))
    }

    fn of(device: &wgpu::Device, pass: SplatPass) -> Self {
        let pipeline = pass.pipeline(device, 1, None);
        Self { pass, pipeline, view: SplatView::new(), target: None }
    }

    /// The textures of strokes. Clouds are drawn with strokes that were uploaded to it.
    pub fn store(&self) -> &StrokeStore {
        self.pass.store()
    }

    /// Draws `clouds` as `camera` sees them. The picture ends with the camera's viewport.
    ///
    /// # Errors
    /// If the clouds or the picture are too large for the device, or if it is lost.
    pub fn render(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        camera: &Camera,
        clouds: &[Cloud],
        settings: &SplatSettings,
    ) -> Result<Picture, HeadlessError> {
        let viewport = camera.viewport;
        let size = UVec2::new(viewport.x + viewport.z, viewport.y + viewport.w);
        let limit = device.limits().max_texture_dimension_2d;
        if size.min_element() == 0 || size.max_element() > limit {
            return Err(HeadlessError::Size { found: size, limit });
        }
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let gpu = &mut GpuEncoder { device, queue, encoder: &mut encoder };
        self.pass.project_and_sort(gpu, &mut self.view, camera, clouds, settings)?;
        // The target is kept as long as pictures have one size.
        let target = match self.target.take() {
            Some(target) if target.size() == size => self.target.insert(target),
            _ => self.target.insert(Target::new(device, size, self.pass.layer_usages())),
        };
        let layer = Layer { color: &target.layer, depth: None };
        self.pass.draw_layer(gpu, &mut self.view, &layer, &self.pipeline);
        target.copy(&mut encoder);
        queue.submit([encoder.finish()]);
        target.read(device)
    }
}

impl Target {
    fn new(device: &wgpu::Device, size: UVec2, more: wgpu::TextureUsages) -> Self {
        let more = wgpu::TextureUsages::COPY_SRC | more;
        let layer = attachment(device, "splat_layer", size, LAYER_FORMAT, more);
        let size_in_bytes = u64::from(bytes_per_row(size)) * u64::from(size.y);
        let read_back = buffers::read_back(device, "splat_read_back", size_in_bytes);
        Self { layer, read_back }
    }

    fn size(&self) -> UVec2 {
        let layer = self.layer.texture();
        UVec2::new(layer.width(), layer.height())
    }

    fn copy(&self, encoder: &mut wgpu::CommandEncoder) {
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(bytes_per_row(self.size())),
            rows_per_image: None,
        };
        let (from, to) =
            (self.layer.texture(), wgpu::TexelCopyBufferInfo { buffer: &self.read_back, layout });
        encoder.copy_texture_to_buffer(from.as_image_copy(), to, from.size());
    }

    /// The picture, once the GPU is done.
    fn read(&self, device: &wgpu::Device) -> Result<Picture, HeadlessError> {
        let size = self.size();
        let row_bytes = (size.x * TEXEL) as usize;
        let rgba = buffers::read_mapped(device, &self.read_back, |bytes| {
            let rows = bytes.chunks_exact(bytes_per_row(size) as usize).map(|row| &row[..row_bytes]);
            rows.flat_map(|row| row.chunks_exact(TEXEL as usize).map(texel)).collect()
        })?;
        Ok(Picture { size, rgba })
    }
}

/// Bytes of a row in the buffer: WebGPU starts rows of a copy at multiples of 256 bytes.
fn bytes_per_row(size: UVec2) -> u32 {
    (size.x * TEXEL).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}

fn texel(bytes: &[u8]) -> [f32; 4] {
    [0, 2, 4, 6].map(|i| f16::from_le_bytes([bytes[i], bytes[i + 1]]).to_f32())
}
