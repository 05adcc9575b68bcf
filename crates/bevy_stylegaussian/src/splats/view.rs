//! The state of each view that draws splats: a plan, buffers and a layer.
//!
//! Splats blend among themselves in a *layer* of the target's size, in display-referred colors, tested against
//! the camera's depth. The layer is then composited over the image in the image's color space. It has one
//! sample per pixel; for cameras with MSAA there is a second one, of splats where meshes end. For weak GPUs,
//! splats blend in a layer of half the size, and the others are made of it.

use std::{borrow::Cow, sync::Arc};

use bevy::{
    camera::{CompositingSpace, MainPassResolutionOverride},
    core_pipeline::tonemapping::Tonemapping,
    ecs::system::SystemParam,
    math::{UVec2, UVec4},
    platform::collections::HashMap,
    prelude::*,
    render::{
        camera::ExtractedCamera,
        renderer::{RenderAdapterInfo, RenderDevice, RenderQueue},
        sync_world::MainEntity,
        view::{ExtractedView, RenderVisibleEntities, RetainedViewEntity},
    },
};
use stylegaussian_gpu::splat::{
    self, CompositeInput, CompositeMode, EdgeLayers, HalfLayer, LiftPipeline, SplatPass, SplatSettings,
    SplatView,
};

use crate::{
    colors::{PipelinesReady, ShownColors, StrokeTextures, StrokesReady, WantedColors},
    mask::RenderMasks,
    scene::{GaussianSplats, GpuScenes, RenderClouds},
    work::SynchronousCompilation,
};

use super::{
    camera::{SplatSortKey, SplatTonemapping},
    cuts::SplatCuts,
    eyes::{self, Pair, SplatEyes},
    pipelines::{CompositeTarget, Luts, Part, SplatPipelines},
};

/// The views that show splats, and their layers. Cameras draw one after the other, so views with targets of the
/// same size share a layer.
#[derive(Resource, Default)]
pub(super) struct SplatViews {
    of_view: HashMap<RetainedViewEntity, ViewSplats>,
    layers: Vec<Arc<Layer>>,
}

/// State of a view from frame to frame.
#[derive(Default)]
pub(super) struct ViewSplats {
    pub(super) buffers: SplatView,
    /// The clouds that it sees.
    pub(super) clouds: Vec<MainEntity>,
    /// The way to draw them, or `None` if nothing is visible or pipelines are missing.
    pub(super) plan: Option<Plan>,
    /// The camera as the splat pass takes it, if there is a plan.
    pub(super) camera: Option<splat::Camera>,
    /// The view of the other eye, if this one and that one are made together in this frame.
    pub(super) pair: Option<Pair>,
    /// Whether the view of the other eye has made this one, too.
    pub(super) is_sorted: bool,
    /// Whether it was reported that the device cannot draw all that the view sees.
    pub(super) refused: bool,
    /// The view's number among those that show splats, from 1 on; 0 before it has one. It keeps it.
    number: u32,
    layer: Option<(Arc<Layer>, CompositeInput)>,
    /// The tonemapping of the bound inverse table, or `None` if none is needed.
    inverted: Option<splat::Tonemapping>,
    /// The exposure that was written to `CompositeInput`, in stops.
    exposure: f32,
    /// Whether the view's camera exists in this frame.
    present: bool,
}

/// The way in which a view draws its splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plan {
    pub(super) composite: CompositeTarget,
    /// Whether the layer is composited after tonemapping, over an image of one sample per pixel.
    pub(super) after_tonemapping: bool,
    /// Whether what is exactly black must be lifted before tonemapping, or nothing could be composited over it.
    pub(super) lifts: bool,
    /// Left, top, width and height in pixels of the target.
    pub(super) viewport: UVec4,
    pub(super) settings: SplatSettings,
    /// Size of the target.
    size: UVec2,
    /// The camera's exposure, in stops.
    exposure: f32,
}

/// Textures in which splats blend.
pub(super) struct Layer {
    pub(super) whole: Whole,
    /// The textures that the whole ones are made of, of views that are drawn at half the size.
    pub(super) half: Option<HalfLayer>,
}

/// The textures that are composited.
pub(super) enum Whole {
    /// Of views with one sample per pixel, and their size.
    Single(wgpu::TextureView, UVec2),
    /// Of views with several.
    Edges(Box<EdgeLayers>),
}

/// The components of a camera in the render world that its plan depends on.
type ViewComponents = (
    &'static ExtractedView,
    &'static ExtractedCamera,
    &'static Msaa,
    &'static RenderVisibleEntities,
    Option<&'static Tonemapping>,
    Option<&'static SplatTonemapping>,
    Option<&'static SplatSortKey>,
    Option<&'static MainPassResolutionOverride>,
    Option<&'static SplatCuts>,
    Option<&'static SplatEyes>,
);

/// The state of strokes, for which there are pipelines of their own.
#[derive(SystemParam)]
pub(super) struct Strokes<'w> {
    wanted: Res<'w, WantedColors>,
    textures: Res<'w, StrokeTextures>,
    shown: Res<'w, ShownColors>,
    ready: ResMut<'w, StrokesReady>,
}

/// Lets shaders read depth: with MSAA they look for the edges of meshes, layers of half the size are made whole
/// by it, and on software adapters a compute shader draws the splats.
pub(super) fn allow_reading_depth(
    adapter: Res<RenderAdapterInfo>,
    mut cameras: Query<(&mut Camera3d, &Msaa, Option<&SplatCuts>)>,
) {
    let is_software = stylegaussian_gpu::device::is_software(&adapter);
    // In each frame, since the extraction overwrites the render world's `Camera3d`.
    for (mut camera, msaa, cuts) in &mut cameras {
        if is_software || msaa.samples() > 1 || cuts.is_some_and(|cuts| cuts.half_size) {
            camera.depth_texture_usages.0 |= wgpu::TextureUsages::TEXTURE_BINDING.bits();
        }
    }
}

/// Plans each view, requests its pipelines and gives it a layer.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(super) fn prepare_views(
    cameras: Query<ViewComponents, With<Camera3d>>,
    clouds: Res<RenderClouds>,
    scenes: Res<GpuScenes>,
    masks: Res<RenderMasks>,
    mut views: ResMut<SplatViews>,
    mut pipelines: ResMut<SplatPipelines>,
    mut all_ready: ResMut<PipelinesReady>,
    mut strokes: Strokes,
    luts: Luts,
    synchronous: Res<SynchronousCompilation>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let SplatViews { of_view, layers } = &mut *views;
    // Views whose camera is gone, or has no pixels, are found by not being planned in this frame.
    of_view.values_mut().for_each(|view| view.present = false);
    let device = device.wgpu_device();
    all_ready.0 = true;
    strokes.ready.0 = true;
    let mut planned = Vec::new();
    let mut pairs = Vec::new();
    for camera in &cameras {
        let (extracted, _, _, visible, .., eyes) = camera;
        let Some(plan) = plan(camera) else { continue };
        planned.push(extracted.retained_view_entity);
        let view = of_view.entry(extracted.retained_view_entity).or_default();
        view.present = true;
        // Whatever is missing below, an old plan must not be drawn.
        view.plan = None;
        (view.pair, view.is_sorted) = (None, false);
        view.clouds.clear();
        view.clouds.extend(visible.get::<GaussianSplats>().into_iter().flat_map(|class| {
            let entities = class.iter_visible().map(|(_, &entity)| entity);
            entities
                .filter(|entity| clouds.0.get(entity).is_some_and(|cloud| scenes.get(&cloud.scene).is_some()))
        }));
        // Requested before there is anything to draw, so that compiling overlaps with the loading of scenes.
        let store = &strokes.textures.0;
        let is_ready = pipelines.request(device, store, *synchronous, plan.composite);
        // New paintings wait for it, while the view shows the others. One that already is in other views keeps
        // this one waiting.
        let draws_strokes =
            !strokes.wanted.strokes || pipelines.request_part(device, *synchronous, Part::Strokes);
        strokes.ready.0 &= draws_strokes;
        let is_ready = is_ready && (draws_strokes || !strokes.shown.has_strokes());
        // A cloud that shows before its mask's kernel is there would flash its hidden splats. One that is shown
        // already stays, and is hidden in part a few frames later.
        let is_ready = is_ready
            && (masks.is_empty()
                || pipelines.request_part(device, *synchronous, Part::Masks)
                || view.layer.is_some());
        let is_ready = is_ready
            && (!plan.settings.half_size || pipelines.request_part(device, *synchronous, Part::Half));
        let is_ready =
            is_ready && (!plan.lifts || pipelines.request_lift(device, *synchronous, plan.composite.format));
        all_ready.0 &= is_ready;
        if view.clouds.is_empty() || !is_ready {
            continue;
        }
        if let Some(tonemapping) = plan.inverted()
            // Without its table the composite would show other colors for a few frames, so the splats wait.
            && !pipelines.request_table(device, &queue, *synchronous, tonemapping, &luts)
        {
            all_ready.0 = false;
            continue;
        }
        view.attach_layer(device, &queue, &pipelines, &plan, layers);
        view.plan = Some(plan);
        view.camera = Some(splat::Camera {
            world_from_view: extracted.world_from_view.affine(),
            clip_from_view: extracted.clip_from_view,
            viewport: plan.viewport,
        });
        // Until the kernel is there, eyes are drawn one by one.
        pairs.extend(
            eyes.filter(|_| pipelines.request_part(device, *synchronous, Part::Eyes))
                .map(|&eyes| (extracted.retained_view_entity, eyes)),
        );
    }
    eyes::pair(of_view, &pairs);
    of_view.retain(|_, view| view.present);
    number_views(of_view, &planned);
    // Only the list itself holds a layer that no view uses. So a resized window leaves none behind.
    layers.retain(|layer| Arc::strong_count(layer) > 1);
}

/// Gives views without a number the smallest ones that are free, in this order.
fn number_views(of_view: &mut HashMap<RetainedViewEntity, ViewSplats>, order: &[RetainedViewEntity]) {
    for new in order {
        if of_view.get(new).is_none_or(|view| view.number > 0) {
            continue;
        }
        let is_taken = |number: &u32| of_view.values().any(|view| view.number == *number);
        let free = (1..).find(|number| !is_taken(number));
        if let Some((view, number)) = of_view.get_mut(new).zip(free) {
            view.number = number;
        }
    }
}

impl SplatViews {
    pub(super) fn get(&self, view: &RetainedViewEntity) -> Option<&ViewSplats> {
        self.of_view.get(view)
    }

    /// Takes a view out, to change two at once. [`insert`](Self::insert) brings it back.
    pub(super) fn take(&mut self, view: &RetainedViewEntity) -> Option<ViewSplats> {
        self.of_view.remove(view)
    }

    pub(super) fn insert(&mut self, view: RetainedViewEntity, splats: ViewSplats) {
        self.of_view.insert(view, splats);
    }

    pub(super) fn get_mut(&mut self, view: &RetainedViewEntity) -> Option<&mut ViewSplats> {
        self.of_view.get_mut(view)
    }
}

impl ViewSplats {
    /// The name of one of the view's spans. Bevy adds up nothing: two spans of one name would be measurements
    /// of one diagnostic, one after the other. So the names of the second and further views have a number.
    pub(super) fn span(&self, name: &'static str) -> Cow<'static, str> {
        match self.number {
            0 | 1 => Cow::Borrowed(name),
            number => Cow::Owned(format!("{name}_{number}")),
        }
    }

    /// The layer and its binding for the composite. Present if there is a plan.
    pub(super) fn layer(&self) -> Option<(&Layer, &CompositeInput)> {
        self.layer.as_ref().map(|(layer, input)| (&**layer, input))
    }

    /// The layer to draw into, and the buffers to draw from.
    pub(super) fn layer_and_buffers(&mut self) -> Option<(&Layer, &mut SplatView)> {
        let (layer, _) = self.layer.as_ref()?;
        Some((&**layer, &mut self.buffers))
    }

    /// Takes a layer that fits the plan, or a new one if none of `layers` does.
    fn attach_layer(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        pipelines: &SplatPipelines,
        plan: &Plan,
        layers: &mut Vec<Arc<Layer>>,
    ) {
        // The binding refers to the layer and to the table, so a change of either makes a new one.
        let fits = self.layer.as_ref().is_some_and(|(layer, _)| layer.fits(plan));
        if let (false, Some(passes)) = (fits && self.inverted == plan.inverted(), pipelines.passes()) {
            let layer = match layers.iter().find(|layer| layer.fits(plan)) {
                Some(layer) => Arc::clone(layer),
                None => {
                    let layer = Arc::new(Layer::new(device, plan, &passes.splat));
                    layers.push(Arc::clone(&layer));
                    layer
                }
            };
            let table = plan.inverted().and_then(|tonemapping| pipelines.table(tonemapping));
            let input = match &layer.whole {
                Whole::Single(color, _) => passes.composite.bind(device, color, table),
                Whole::Edges(layers) => passes.composite.bind_edges(device, layers, table),
            };
            self.inverted = plan.inverted();
            self.layer = Some((layer, input));
            // In stops: a new binding holds a factor of 1.
            self.exposure = 0.0;
        }
        if let Some((_, input)) = &self.layer
            && self.exposure != plan.exposure
        {
            input.set_exposure(queue, plan.exposure);
            self.exposure = plan.exposure;
        }
    }
}

impl Layer {
    fn new(device: &wgpu::Device, plan: &Plan, pass: &SplatPass) -> Self {
        let half = plan.settings.half_size.then(|| pass.half_layer(device, plan.size));
        if plan.composite.depth_samples > 1 {
            return Self { whole: Whole::Edges(Box::new(pass.edge_layers(device, plan.size))), half };
        }
        let color = pass.layer(device, plan.size);
        Self { whole: Whole::Single(color, plan.size), half }
    }

    fn fits(&self, plan: &Plan) -> bool {
        let is_multi = plan.composite.depth_samples > 1;
        let whole_fits = match &self.whole {
            Whole::Single(_, size) => !is_multi && *size == plan.size,
            Whole::Edges(layers) => is_multi && layers.size() == plan.size,
        };
        whole_fits && self.half.is_some() == plan.settings.half_size
    }
}

impl Plan {
    /// The tonemapping to invert, if that needs a table.
    fn inverted(&self) -> Option<splat::Tonemapping> {
        match self.composite.mode {
            CompositeMode::InvertTonemapping(tonemapping) if tonemapping.needs_table() => Some(tonemapping),
            _ => None,
        }
    }
}

/// The plan for a camera, or `None` if its target has no pixels.
fn plan(
    (view, camera, msaa, _, tonemapping, choice, sort_key, resolution, cuts, _): bevy::ecs::query::QueryItem<
        '_,
        '_,
        ViewComponents,
    >,
) -> Option<Plan> {
    let size = camera.physical_target_size.filter(|size| size.min_element() > 0)?;
    let mut viewport = view.viewport;
    // As Bevy's own main pass: the corner stays and the size is replaced.
    if let Some(&MainPassResolutionOverride(size)) = resolution {
        viewport = viewport.truncate().truncate().extend(size.x).extend(size.y);
    }
    let (mode, after_tonemapping) = match tonemapping.filter(|t| camera.hdr && t.is_enabled()) {
        Some(&tonemapping) => match choice.copied().unwrap_or_default() {
            SplatTonemapping::Invert => (CompositeMode::InvertTonemapping(method(tonemapping)), false),
            SplatTonemapping::Bypass => (CompositeMode::LinearFromSrgb, true),
        },
        // Without HDR, meshes are tonemapped by their own shaders, so the target is display-referred already.
        None if camera.compositing_space == Some(CompositingSpace::Srgb) => (CompositeMode::Encoded, false),
        None => (CompositeMode::LinearFromSrgb, false),
    };
    let samples = msaa.samples();
    let composite = CompositeTarget {
        format: view.target_format,
        // Tonemapping writes an image of one sample per pixel.
        samples: if after_tonemapping { 1 } else { samples },
        depth_samples: samples,
        mode,
    };
    let sort_key = match sort_key.copied().unwrap_or_default() {
        SplatSortKey::ViewZ => splat::SortKey::ViewZ,
        SplatSortKey::Distance => splat::SortKey::Distance,
    };
    let cuts = cuts.copied().unwrap_or_default();
    let (half_size, cuts) = (cuts.half_size, cuts.for_pass());
    let settings = SplatSettings { sort_key, near: near(view), cuts, half_size };
    let exposure = view.color_grading.global.exposure;
    let makes_nan = tonemapping.is_some_and(|&tonemapping| LiftPipeline::is_needed(method(tonemapping)));
    let lifts = after_tonemapping && makes_nan;
    Some(Plan { composite, after_tonemapping, lifts, viewport, settings, size, exposure })
}

/// Least view depth of splats, in world units: 0.2 as in training, or twice the camera's near plane if that is
/// less. Bevy's default near plane of 0.1 gives 0.2; a world of a smaller scale has a nearer one.
pub(super) fn near(view: &ExtractedView) -> f32 {
    // Reverse z without a far plane maps view depth d to near / d, so this entry is `near`. In an orthographic
    // projection, it is far / (far - near), about 1, and 0.2 stays.
    let near_plane = view.clip_from_view.w_axis.z;
    SplatSettings::default().near.min(2.0 * near_plane.abs())
}

/// Bevy's tonemapping as the GPU crate's enum. That crate does not depend on Bevy.
pub(super) fn method(tonemapping: Tonemapping) -> splat::Tonemapping {
    match tonemapping {
        Tonemapping::None => splat::Tonemapping::None,
        Tonemapping::Reinhard => splat::Tonemapping::Reinhard,
        Tonemapping::ReinhardLuminance => splat::Tonemapping::ReinhardLuminance,
        Tonemapping::AcesFitted => splat::Tonemapping::AcesFitted,
        Tonemapping::AgX => splat::Tonemapping::AgX,
        Tonemapping::SomewhatBoringDisplayTransform => splat::Tonemapping::SomewhatBoringDisplayTransform,
        Tonemapping::TonyMcMapface => splat::Tonemapping::TonyMcMapface,
        Tonemapping::BlenderFilmic => splat::Tonemapping::BlenderFilmic,
        Tonemapping::KhronosPbrNeutral => splat::Tonemapping::KhronosPbrNeutral,
    }
}
