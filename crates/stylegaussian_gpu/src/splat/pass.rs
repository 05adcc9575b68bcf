//! The splat pass as a whole: its pipelines, and the order of its stages.

use std::sync::OnceLock;

use glam::UVec2;

use super::{
    camera::Camera,
    cast::Cast,
    cloud::{self, Cloud},
    depth::Depth,
    draw::{Draw, SplatPipeline},
    edges::{EdgeLayers, Edges},
    error::SplatError,
    half::Half,
    layer::{LAYER_FORMAT, Layer},
    light::LightStage,
    project::Project,
    settings::SplatSettings,
    sort::Sort,
    strokes::ViewStrokes,
    tiles::Tiles,
    tonemapping::Tonemapping,
    view::{Change, SplatView},
};
use crate::{
    bindings::compute_pass,
    device::{GpuEncoder, is_software},
    drawing::attachment,
    strokes::StrokeStore,
};

mod casters;
mod depth;
mod eyes;
mod halves;

/// The pipelines of the splat pass. One pass serves any number of views.
#[derive(Debug)]
pub struct SplatPass {
    pub(super) project: Project,
    pub(super) sort: Sort,
    pub(super) draw: Draw,
    pub(super) light: LightStage,
    /// The compute rasterizer of software adapters.
    pub(super) tiles: Option<Tiles>,
    /// Made when a view asks for depth.
    pub(super) depth: OnceLock<Depth>,
    /// Made when a cloud casts shadows.
    pub(super) cast: OnceLock<Cast>,
    /// The pipelines that split depth with several samples, compiled when they are asked for.
    edges: OnceLock<Edges>,
    /// The pipelines of layers of half the width and height, likewise.
    half: OnceLock<Half>,
}

impl SplatPass {
    /// Compiles everything but the draw, which depends on the target: see [`pipeline`](Self::pipeline).
    pub fn new(device: &wgpu::Device) -> Self {
        Self::with_store(device, StrokeStore::new())
    }

    /// [`new`](Self::new), with the textures of strokes in `store`. Passes of one device may share it.
    pub fn with_store(device: &wgpu::Device, store: StrokeStore) -> Self {
        let is_software = is_software(&device.adapter_info());
        Self { tiles: is_software.then(|| Tiles::new(device)), ..Self::by_quads_with_store(device, store) }
    }

    /// The pass that draws by quads on any adapter, software included.
    pub fn by_quads(device: &wgpu::Device) -> Self {
        Self::by_quads_with_store(device, StrokeStore::new())
    }

    fn by_quads_with_store(device: &wgpu::Device, store: StrokeStore) -> Self {
        let project = Project::new(device, store);
        Self {
            project,
            sort: Sort::new(device),
            draw: Draw::new(device),
            light: LightStage::default(),
            tiles: None,
            depth: OnceLock::new(),
            cast: OnceLock::new(),
            edges: OnceLock::new(),
            half: OnceLock::new(),
        }
    }

    /// The textures of strokes. Clouds are drawn with strokes that were uploaded to it.
    pub fn store(&self) -> &StrokeStore {
        &self.project.strokes.store
    }

    /// Compiles the kernel for clouds with a mask, in any thread, while others draw. Without this call, the
    /// first frame that hides a part of a cloud compiles it.
    pub fn prepare_masks(&self, device: &wgpu::Device) {
        self.project.masked(device);
    }

    /// Compiles the pipelines of clouds with strokes, and the draw of `pipelines` with strokes, in any thread,
    /// while others draw. Without this call, the first frame with strokes compiles it.
    pub fn prepare_strokes(&self, device: &wgpu::Device, pipelines: &[SplatPipeline]) {
        let strokes = &self.project.strokes;
        strokes.kernel(device);
        if let Some(tiles) = &self.tiles {
            tiles.painted(device, strokes);
        }
        for pipeline in pipelines {
            self.draw.painted(pipeline, strokes);
        }
    }

    /// Compiles the kernel of light before a tone mapping, with or without shadows and an atmosphere, in any
    /// thread, while others draw. Without this call, the first frame that needs it compiles it.
    pub fn prepare_light(
        &self,
        device: &wgpu::Device,
        tonemapping: Tonemapping,
        shadowed: bool,
        aerial: bool,
    ) {
        self.light.kernel(device, tonemapping, shadowed, aerial);
    }

    /// Compiles what [`draw_edge_layers`](Self::draw_edge_layers) needs, in any thread, while others draw.
    /// Without this call, the first such frame compiles it.
    pub fn prepare_edges(&self, device: &wgpu::Device) {
        self.edges.get_or_init(|| Edges::new(device));
    }

    /// The draw into a target of [`LAYER_FORMAT`] at `samples` samples; layers have one.
    /// If `depth_format` is given, splats are tested against a depth attachment of that format (reverse z).
    pub fn pipeline(
        &self,
        device: &wgpu::Device,
        samples: u32,
        depth_format: Option<wgpu::TextureFormat>,
    ) -> SplatPipeline {
        self.draw.pipeline(device, samples, depth_format)
    }

    /// Projects and sorts the splats of `clouds` that `camera` sees, into `view`.
    ///
    /// Skips everything if camera, clouds, colors and light are unchanged, and skips the sort if only colors or
    /// light changed. With shadows on splats, and in an atmosphere, light always counts as changed.
    /// Commands must be submitted in the order in which they were encoded, and before `view` is used again,
    /// because uniforms are written by `queue`. Nothing is allocated unless `view` sees more Gaussians, other
    /// clouds or other color buffers than before.
    ///
    /// Clouds with a transform that is not finite or has no volume, and cameras without a picture, show
    /// nothing.
    ///
    /// # Errors
    /// If the clouds have too many Gaussians for the device, or if colors or strokes belong to another scene.
    /// Nothing is encoded then, and `view` shows nothing.
    pub fn project_and_sort(
        &self,
        gpu: &mut GpuEncoder,
        view: &mut SplatView,
        camera: &Camera,
        clouds: &[Cloud],
        settings: &SplatSettings,
    ) -> Result<(), SplatError> {
        view.clear();
        cloud::check(clouds)?;
        view.note_drawn(clouds);
        let drawn: Vec<&Cloud> = clouds.iter().filter(|cloud| cloud.is_drawable()).collect();
        let n_records = drawn.iter().map(|cloud| cloud.scene.n_gaussians()).sum();
        if n_records == 0 || !camera.is_drawable() {
            view.forget_all();
            return Ok(());
        }
        view.reserve(gpu.device, &self.sort, &self.draw.layout, n_records)?;
        view.set_paired(false);
        view.set_half_of(settings.whole(camera));
        let camera = &*settings.camera(camera);
        view.set_camera(gpu.queue, camera, n_records as u32);
        let change = self.project.write(gpu.device, gpu.queue, view, (camera, None), &drawn, settings);
        let change = self.relight(gpu.device, gpu.queue, view, camera, clouds, change);
        if change == Change::Nothing {
            return Ok(());
        }
        if change == Change::Order {
            view.empty_lists();
        }
        let Some(sort) = view.sort() else { return Ok(()) };
        view.clear_strokes(gpu.encoder);
        let mut pass = compute_pass(gpu.encoder, "splat");
        self.project.encode(&mut pass, view);
        self.project.encode_strokes(gpu.device, &mut pass, view);
        self.light.encode(gpu.device, &mut pass, &view.lit);
        if change == Change::Order {
            self.sort.encode(&mut pass, sort, n_records as u32);
        }
        Ok(())
    }

    /// Lights the splats of a view in an atmosphere, once its tables are made for this frame. It comes after
    /// [`project_and_sort`](Self::project_and_sort), which leaves all light of such views to it, and before the
    /// splats are drawn. Other views stay as they are.
    pub fn light_in_atmosphere(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        view: &mut SplatView,
    ) {
        self.light.encode_waiting(device, encoder, &mut view.lit);
    }

    /// Finds the light on the records of `clouds`. Returns the change of the frame with that of light.
    pub(super) fn relight(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        view: &mut SplatView,
        camera: &Camera,
        clouds: &[Cloud],
        change: Change,
    ) -> Change {
        let is_new = change != Change::Nothing;
        let is_relit = view.light_parts().is_some_and(|(lit, buffers)| {
            self.light.write(device, queue, lit, &buffers, camera, clouds, is_new)
        });
        if is_relit && !is_new { Change::Colors } else { change }
    }

    /// Usages that the texture of a layer needs besides that of an attachment.
    pub fn layer_usages(&self) -> wgpu::TextureUsages {
        match self.tiles {
            Some(_) => wgpu::TextureUsages::STORAGE_BINDING,
            None => wgpu::TextureUsages::empty(),
        }
    }

    /// The texture of a layer of `size` in pixels.
    pub fn layer(&self, device: &wgpu::Device, size: UVec2) -> wgpu::TextureView {
        attachment(device, "splat_layer", size, LAYER_FORMAT, self.layer_usages())
    }

    /// Clears a layer and draws `view` into it, within the camera's viewport, by the fastest way of the
    /// adapter. [`project_and_sort`](Self::project_and_sort) comes before. `pipeline` must fit the layer.
    pub fn draw_layer(
        &self,
        gpu: &mut GpuEncoder,
        view: &mut SplatView,
        layer: &Layer,
        pipeline: &SplatPipeline,
    ) {
        let Some(tiles) = self.tiles.as_ref().filter(|_| layer.takes_tiles()) else {
            self.draw(&mut layer.cleared(gpu.encoder), view, pipeline);
            return;
        };
        let Some(lists) = view.lists(gpu.device, gpu.queue, tiles) else {
            layer.cleared(gpu.encoder);
            return;
        };
        tiles.fill(gpu.encoder, lists);
        // The CPU does not know whether the lists fit. If they do, the GPU sets this draw to no quads at all;
        // otherwise it sets the blend to no workgroups.
        let commands = lists.commands().clone();
        let mut pass = layer.cleared(gpu.encoder);
        if let Some(source) = view.draw_source() {
            self.draw.encode(&mut pass, pipeline, &self.project.strokes, &source, &commands);
        }
        drop(pass);
        let strokes = view.strokes().and_then(ViewStrokes::draw_group).cloned();
        if let Some(lists) = view.lists(gpu.device, gpu.queue, tiles) {
            let strokes = strokes.as_ref().map(|group| (&self.project.strokes, group));
            tiles.blend(gpu, lists, (layer.color, layer.depth), strokes);
        }
    }

    /// The textures of views with several samples per pixel, of `size` in pixels.
    pub fn edge_layers(&self, device: &wgpu::Device, size: UVec2) -> EdgeLayers {
        EdgeLayers::new(device, size, self.layer_usages())
    }

    /// Draws `view` for a target with several samples per pixel, once per pixel and twice where meshes end, and
    /// clears `layers` first. `depth` is what the meshes left, reverse z with several samples, which shaders
    /// may read. [`project_and_sort`](Self::project_and_sort) with `camera` comes before. `pipeline` is that
    /// of one sample and `Depth32Float`.
    pub fn draw_edge_layers(
        &self,
        gpu: &mut GpuEncoder,
        view: &mut SplatView,
        camera: &Camera,
        (layers, depth): (&EdgeLayers, &wgpu::TextureView),
        pipeline: &SplatPipeline,
    ) {
        self.split_depth(gpu, view, camera, (layers, depth));
        for (color, depth) in
            [(&layers.farther, &layers.farther_depth), (&layers.nearer, &layers.nearer_depth)]
        {
            let layer = Layer { color, depth: Some(depth) };
            self.draw_layer(gpu, view, &layer, pipeline);
        }
    }

    /// Splits a depth with several samples into those of both sides of `layers`.
    fn split_depth(
        &self,
        gpu: &mut GpuEncoder,
        view: &mut SplatView,
        camera: &Camera,
        (layers, depth): (&EdgeLayers, &wgpu::TextureView),
    ) {
        if let Some(edges) = view.edges(gpu.device, gpu.queue, camera) {
            self.edges.get_or_init(|| Edges::new(gpu.device)).encode(gpu, edges, layers, depth);
        }
    }

    /// Draws `view` by quads, within the camera's viewport, as [`draw_layer`](Self::draw_layer) does on a GPU.
    /// [`project_and_sort`](Self::project_and_sort) comes before. `pipeline` must fit the attachments of
    /// `pass`.
    pub fn draw(&self, pass: &mut wgpu::RenderPass, view: &SplatView, pipeline: &SplatPipeline) {
        if let Some(source) = view.draw_source() {
            self.draw.encode(pass, pipeline, &self.project.strokes, &source, source.commands);
        }
    }
}
