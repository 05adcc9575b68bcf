//! Pictures without a window: the layer, read back.

use glam::UVec2;
use half::f16;

use super::{
    Camera, Cloud, LAYER_FORMAT, Layer, SplatError, SplatPass, SplatPipeline, SplatSettings, SplatView,
};

/// What a camera sees of splats over nothing. Row-major `[H, W]`, from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width and height, in pixels.
    pub size: UVec2,
    /// Premultiplied, display-referred RGB and alpha `[H, W]`.
    pub rgba: Vec<[f32; 4]>,
}

/// No picture came out.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HeadlessError {
    /// The clouds cannot be drawn.
    #[error(transparent)]
    Splat(#[from] SplatError),
    /// The device has no texture of that size.
    #[error("a picture of {found} pixels, the device allows {limit} on a side")]
    Size {
        /// Width and height.
        found: UVec2,
        /// Of textures.
        limit: u32,
    },
    /// The picture could not be read back.
    #[error("the picture could not be read from the GPU: {0}")]
    Lost(String),
}

/// Renders pictures one by one, each waited for.
#[derive(Debug)]
pub struct Headless {
    pass: SplatPass,
    pipeline: SplatPipeline,
    view: SplatView,
    target: Option<Target>,
}

#[derive(Debug)]
struct Target {
    layer: wgpu::Texture,
    view: wgpu::TextureView,
    read_back: wgpu::Buffer,
}

/// Bytes of a texel of the layer.
const TEXEL: u32 = 8;

impl Headless {
    /// Compiles the pass for pictures of one sample per pixel.
    pub fn new(device: &wgpu::Device) -> Self {
        Self::of(device, SplatPass::new(device))
    }

    /// The same, drawing as on a GPU, whatever the adapter.
    pub fn by_quads(device: &wgpu::Device) -> Self {
        Self::of(device, SplatPass::by_quads(device))
    }

    fn of(device: &wgpu::Device, pass: SplatPass) -> Self {
        let pipeline = pass.pipeline(device, 1, None);
        Self { pass, pipeline, view: SplatView::new(), target: None }
    }

    /// What `camera` sees of `clouds`. The picture ends where the camera's viewport does.
    ///
    /// # Errors
    /// When the clouds or the picture are too large for the device, or it is lost.
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
        self.pass.prepare(device, queue, &mut encoder, &mut self.view, camera, clouds, settings)?;
        let target = match self.target.take() {
            Some(target) if target.size() == size => self.target.insert(target),
            _ => self.target.insert(Target::new(device, size, self.pass.layer_usages())),
        };
        let layer = Layer { color: &target.view, resolved: None, depth: None };
        self.pass.draw_layer(device, queue, &mut encoder, &mut self.view, &layer, &self.pipeline);
        target.copy(&mut encoder);
        queue.submit([encoder.finish()]);
        target.read(device)
    }
}

impl Target {
    fn new(device: &wgpu::Device, size: UVec2, more: wgpu::TextureUsages) -> Self {
        let layer = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("splat_layer"),
            size: wgpu::Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: LAYER_FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC | more,
            view_formats: &[],
        });
        let read_back = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("splat_read_back"),
            size: u64::from(bytes_per_row(size)) * u64::from(size.y),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let view = layer.create_view(&wgpu::TextureViewDescriptor::default());
        Self { layer, view, read_back }
    }

    fn size(&self) -> UVec2 {
        UVec2::new(self.layer.width(), self.layer.height())
    }

    fn copy(&self, encoder: &mut wgpu::CommandEncoder) {
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(bytes_per_row(self.size())),
            rows_per_image: None,
        };
        encoder.copy_texture_to_buffer(
            self.layer.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &self.read_back, layout },
            self.layer.size(),
        );
    }

    /// The picture, once the GPU is done.
    fn read(&self, device: &wgpu::Device) -> Result<Picture, HeadlessError> {
        let lost = |error: &dyn std::fmt::Display| HeadlessError::Lost(error.to_string());
        let (sender, receiver) = std::sync::mpsc::channel();
        self.read_back.map_async(wgpu::MapMode::Read, .., move |result| {
            // The receiver waits below.
            let _ = sender.send(result);
        });
        device.poll(wgpu::PollType::wait_indefinitely()).map_err(|error| lost(&error))?;
        receiver.recv().map_err(|error| lost(&error))?.map_err(|error| lost(&error))?;

        let size = self.size();
        let mapped = self.read_back.get_mapped_range(..);
        let row_bytes = (size.x * TEXEL) as usize;
        let rows = mapped.chunks_exact(bytes_per_row(size) as usize).map(|row| &row[..row_bytes]);
        let rgba = rows.flat_map(|row| row.chunks_exact(TEXEL as usize).map(texel)).collect();
        drop(mapped);
        self.read_back.unmap();
        Ok(Picture { size, rgba })
    }
}

/// Rows of a copy start at multiples of 256 bytes.
fn bytes_per_row(size: UVec2) -> u32 {
    (size.x * TEXEL).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}

fn texel(bytes: &[u8]) -> [f32; 4] {
    [0, 2, 4, 6].map(|i| f16::from_le_bytes([bytes[i], bytes[i + 1]]).to_f32())
}
