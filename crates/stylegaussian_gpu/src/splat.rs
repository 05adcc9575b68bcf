//! The splat pass: what cameras see of any number of clouds, every frame.
//!
//! 1. *project* (`project`): cull and project the Gaussians of each cloud, evaluate their colors, into one array of
//!    records and keys per view;
//! 2. *sort* (`sort`): one radix sort over what is visible of all clouds, so clouds interleave where they overlap;
//! 3. *draw* (`draw`): one indirect draw of quads, back to front, premultiplied over, into a *layer* of the target's size
//!    and sample count in which splats blend among themselves, display-referred; on adapters that are a CPU, where the
//!    layer has one sample per pixel, compute instead (`cells`), in a quarter of the time;
//! 4. *composite* (`composite`): the layer over the picture, in the picture's own space.
//!
//! [`SplatPass::prepare`] encodes 1 and 2, [`SplatPass::draw_layer`] 3, [`Composite::draw`] 4. The rules are those of
//! `stylegaussian::splat`, which is the CPU twin; two things differ: quads finish no pixel early (the rest of its light
//! is under 1e-4), and records keep colors and opacities as f16.

mod bind;
mod camera;
mod cells;
mod cloud;
mod composite;
mod draw;
mod headless;
mod project;
mod scene;
mod sort;
#[cfg(test)]
mod testing;
mod tonemapping;
mod view;

pub use camera::Camera;
pub use cloud::{Cloud, CloudColors};
pub use composite::{Composite, CompositeInput, CompositeMode, CompositePipeline};
pub use draw::{LAYER_FORMAT, SplatPipeline};
pub use headless::{Headless, HeadlessError, Picture};
pub use scene::{GpuScene, GpuSceneError};
pub use tonemapping::{InverseTable, ToneCurve, Tonemapping};
pub use view::SplatView;

use crate::device::is_software;

use cells::Cells;
use draw::Draw;
use project::Project;
use sort::Sort;
use view::Change;

/// What splats are sorted by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SortKey {
    /// Depth along the camera's axis: the original rasterizer's.
    #[default]
    ViewZ,
    /// Distance from the camera: does not change when the camera turns.
    Distance,
}

/// How to draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatSettings {
    /// What splats are sorted by.
    pub sort_key: SortKey,
    /// Gaussians whose mean is at this view depth or nearer are not drawn by perspective cameras, in world units.
    pub near: f32,
}

impl Default for SplatSettings {
    /// By view depth, from 0.2 on: the original rasterizer's rules.
    fn default() -> Self {
        Self { sort_key: SortKey::ViewZ, near: 0.2 }
    }
}

/// A view cannot be drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SplatError {
    /// The clouds of a view have too many Gaussians.
    #[error(
        "a view of {n_gaussians} Gaussians takes a buffer of {found} bytes, the device allows {limit}: \
         show fewer or smaller clouds at once"
    )]
    TooManyGaussians {
        /// Of all clouds together.
        n_gaussians: usize,
        /// Bytes of the buffer that would be too large.
        found: u64,
        /// Bytes of the largest buffer that can be bound.
        limit: u64,
    },
    /// Colors of another scene.
    #[error("cloud {cloud}: found colors of {found} Gaussians, expected {expected}")]
    Colors {
        /// Index of the cloud.
        cloud: usize,
        /// Gaussians that the colors belong to.
        found: usize,
        /// Gaussians of the cloud's scene.
        expected: usize,
    },
}

/// The pipelines of the splat pass. One serves any number of views.
#[derive(Debug)]
pub struct SplatPass {
    project: Project,
    sort: Sort,
    draw: Draw,
    /// On adapters that are a CPU.
    cells: Option<Cells>,
}

/// Where splats blend among themselves.
#[derive(Clone, Copy, Debug)]
pub struct Layer<'a> {
    /// Of [`LAYER_FORMAT`].
    pub color: &'a wgpu::TextureView,
    /// What the samples of `color` are averaged into, which are then not kept.
    pub resolved: Option<&'a wgpu::TextureView>,
    /// Depths of what is there already, reverse z; only read.
    pub depth: Option<&'a wgpu::TextureView>,
}

impl Layer<'_> {
    /// Whether compute can draw into it: single samples, and a depth texture that shaders may read.
    fn takes_cells(&self) -> bool {
        let color = self.color.texture();
        let is_readable = |depth: &wgpu::TextureView| {
            depth.texture().usage().contains(wgpu::TextureUsages::TEXTURE_BINDING)
        };
        color.sample_count() == 1
            && color.usage().contains(wgpu::TextureUsages::STORAGE_BINDING)
            && self.depth.is_none_or(is_readable)
    }

    /// A pass over the cleared layer.
    fn cleared<'a>(&self, encoder: &'a mut wgpu::CommandEncoder) -> wgpu::RenderPass<'a> {
        let store = match self.resolved {
            Some(_) => wgpu::StoreOp::Discard,
            None => wgpu::StoreOp::Store,
        };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("splat_draw"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: self.color,
                depth_slice: None,
                resolve_target: self.resolved,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store },
            })],
            // Without operations it is read only.
            depth_stencil_attachment: self.depth.map(|view| wgpu::RenderPassDepthStencilAttachment {
                view,
                depth_ops: None,
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }
}

impl SplatPass {
    /// Compiles everything but the draw, which depends on the target: see [`pipeline`](Self::pipeline).
    pub fn new(device: &wgpu::Device) -> Self {
        let is_software = is_software(&device.adapter_info());
        Self { cells: is_software.then(|| Cells::new(device)), ..Self::by_quads(device) }
    }

    /// The pass that draws as on a GPU, whatever the adapter.
    pub fn by_quads(device: &wgpu::Device) -> Self {
        Self { project: Project::new(device), sort: Sort::new(device), draw: Draw::new(device), cells: None }
    }

    /// The draw into a layer of [`LAYER_FORMAT`] at `samples` samples, tested against a depth attachment of
    /// `depth_format` (reverse z) where there is one.
    pub fn pipeline(
        &self,
        device: &wgpu::Device,
        samples: u32,
        depth_format: Option<wgpu::TextureFormat>,
    ) -> SplatPipeline {
        self.draw.pipeline(device, samples, depth_format)
    }

    /// Projects and sorts what `camera` sees of `clouds`, into `view`.
    ///
    /// Nothing is allocated and nothing built unless `view` sees more Gaussians, clouds or other colors than before. Nothing is
    /// encoded where the camera, the clouds and their colors are those of the last time, and nothing sorted where only
    /// colors are others; that the last commands and this one's were submitted in order is taken for granted. Uniforms
    /// travel by `queue`, so the commands must be submitted before `view` is prepared again.
    ///
    /// Clouds under a transform that is not finite or has no volume, and cameras without a picture, show nothing.
    ///
    /// # Errors
    /// When the clouds have too many Gaussians for the device, or colors belong to another scene; nothing is encoded
    /// then, and `view` shows nothing.
    #[expect(clippy::too_many_arguments, reason = "three of them are what every wgpu call site has at hand")]
    pub fn prepare(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        view: &mut SplatView,
        camera: &Camera,
        clouds: &[Cloud],
        settings: &SplatSettings,
    ) -> Result<(), SplatError> {
        view.clear();
        cloud::check(clouds)?;
        let drawn: Vec<&Cloud> = clouds.iter().filter(|cloud| cloud.is_drawable()).collect();
        let n_slots = drawn.iter().map(|cloud| cloud.scene.n_gaussians()).sum();
        if n_slots == 0 || !camera.is_drawable() {
            view.forget_all();
            return Ok(());
        }
        view.reserve(device, self, n_slots)?;
        view.set_camera(queue, camera, n_slots as u32);
        let change = self.project.write(device, queue, view, camera, &drawn, settings);
        if change == Change::Nothing {
            return Ok(());
        }
        if change == Change::Order {
            view.empty_cells();
        }
        let Some(sort) = view.sort() else { return Ok(()) };
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("splat"),
            timestamp_writes: None,
        });
        self.project.encode(&mut pass, view);
        if change == Change::Order {
            self.sort.encode(&mut pass, sort, n_slots as u32);
        }
        Ok(())
    }

    /// What the texture of a layer must allow besides being an attachment.
    pub fn layer_usages(&self) -> wgpu::TextureUsages {
        match self.cells {
            Some(_) => wgpu::TextureUsages::STORAGE_BINDING,
            None => wgpu::TextureUsages::empty(),
        }
    }

    /// Clears a layer and draws into it what [`prepare`](Self::prepare) put into `view`, within the camera's viewport, by
    /// whatever is fastest on the adapter. `pipeline` must fit the layer.
    pub fn draw_layer(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        view: &mut SplatView,
        layer: &Layer,
        pipeline: &SplatPipeline,
    ) {
        let Some(cells) = self.cells.as_ref().filter(|_| layer.takes_cells()) else {
            self.draw(&mut layer.cleared(encoder), view, pipeline);
            return;
        };
        let Some(lists) = view.lists(device, queue, cells) else {
            layer.cleared(encoder);
            return;
        };
        cells.fill(encoder, lists);
        // No quad, but where the lists did not fit.
        let commands = lists.commands().clone();
        let mut pass = layer.cleared(encoder);
        self.draw.encode_indirect(&mut pass, view, pipeline, &commands);
        drop(pass);
        if let Some(lists) = view.lists(device, queue, cells) {
            cells.blend(device, encoder, lists, layer.color, layer.depth);
        }
    }

    /// Draws what [`prepare`](Self::prepare) put into `view` by quads, within the camera's viewport. `pipeline` must fit the
    /// attachments of `pass`. What [`draw_layer`](Self::draw_layer) does on a GPU.
    pub fn draw(&self, pass: &mut wgpu::RenderPass, view: &SplatView, pipeline: &SplatPipeline) {
        self.draw.encode(pass, view, pipeline);
    }
}
