//! The pipelines of the splat pass, one for each kind of target. They are built in the background.

use std::sync::Arc;

use bevy::{
    core_pipeline::{core_3d::CORE_3D_DEPTH_FORMAT, tonemapping::TonemappingLuts},
    ecs::system::SystemParam,
    platform::collections::{HashMap, hash_map::Entry},
    prelude::*,
    render::{render_asset::RenderAssets, render_resource::TextureFormat, texture::GpuImage},
};
use stylegaussian_gpu::{
    splat::{
        Composite, CompositeMode, CompositePipeline, InverseTable, LiftPipeline, SplatPass, SplatPipeline,
        ToneCurve, Tonemapping,
    },
    strokes::StrokeStore,
};

use crate::work::{Background, SynchronousCompilation};

/// All pipelines and tables on the present device, ready or being built.
#[derive(Resource, Default)]
pub(super) struct SplatPipelines {
    passes: Option<Background<Arc<Passes>>>,
    parts: HashMap<Part, Background<()>>,
    draw: Option<Background<SplatPipeline>>,
    composites: HashMap<CompositeTarget, Background<CompositePipeline>>,
    /// Draws before tonemappings that make no number of black, by the format of the target.
    lifts: HashMap<TextureFormat, Background<LiftPipeline>>,
    tables: HashMap<Tonemapping, Background<InverseTable>>,
}

/// The passes, which do not depend on the target.
pub(super) struct Passes {
    pub(super) splat: SplatPass,
    pub(super) composite: Composite,
}

/// A part of the passes that is compiled if a view needs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Part {
    /// The kernel for clouds with a mask.
    Masks,
    /// The kernels for two eyes.
    Eyes,
    /// The pipelines of layers of half the size.
    Half,
    /// The kernel of light before a tonemapping, without shadows or with, and without an atmosphere or in one.
    Light(Tonemapping, bool, bool),
    /// The pipelines that draw strokes, of which one is a part of the draw.
    Strokes,
}

/// The kind of image that the layer is composited over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct CompositeTarget {
    pub(super) format: TextureFormat,
    pub(super) samples: u32,
    /// Samples per pixel of the depth.
    pub(super) depth_samples: u32,
    pub(super) mode: CompositeMode,
}

/// Pipelines that are ready.
pub(super) struct Ready<'a> {
    pub(super) passes: &'a Passes,
    pub(super) draw: &'a SplatPipeline,
    pub(super) composite: &'a CompositePipeline,
}

impl SplatPipelines {
    /// Starts to build the pipelines that a layer over `target` needs and that are missing. Strokes are drawn
    /// with the paintings in `store`, which is always the same on a device. Returns whether all are ready.
    pub(super) fn request(
        &mut self,
        device: &wgpu::Device,
        store: &StrokeStore,
        synchronous: SynchronousCompilation,
        target: CompositeTarget,
    ) -> bool {
        let build = {
            let (device, store) = (device.clone(), store.clone());
            move || {
                let splat = SplatPass::with_store(&device, store);
                Arc::new(Passes { splat, composite: Composite::new(&device) })
            }
        };
        let passes = self.passes.get_or_insert_with(|| Background::start(synchronous, build));
        // Pipelines are made from the shader modules and layouts of the passes, so these come first.
        let Some(passes) = passes.get() else { return false };
        // Layers have one format and one sample per pixel, whatever the target has.
        let draw = self.draw.get_or_insert_with(|| {
            let (passes, device) = (Arc::clone(passes), device.clone());
            let build = move || passes.splat.pipeline(&device, 1, Some(CORE_3D_DEPTH_FORMAT));
            Background::start(synchronous, build)
        });
        let composite = self.composites.entry(target).or_insert_with(|| {
            let (passes, device) = (Arc::clone(passes), device.clone());
            let CompositeTarget { format, samples, depth_samples, mode } = target;
            Background::start(synchronous, move || {
                if depth_samples == 1 {
                    return passes.composite.pipeline(&device, format, samples, mode);
                }
                passes.splat.prepare_edges(&device);
                passes.composite.edge_pipeline(&device, format, [samples, depth_samples], mode)
            })
        });
        // Both are polled: `&&` on the calls would leave the second one running until the first is ready.
        let (draw, composite) = (draw.get().is_some(), composite.get().is_some());
        draw && composite
    }

    /// Starts to compile a part. Returns whether it is ready.
    pub(super) fn request_part(
        &mut self,
        device: &wgpu::Device,
        synchronous: SynchronousCompilation,
        part: Part,
    ) -> bool {
        // Both are requested for every view, so they are on their way.
        let Some(passes) = self.passes.as_ref().and_then(Background::get) else { return false };
        let draw = self.draw.as_ref().and_then(Background::get);
        if part == Part::Strokes && draw.is_none() {
            return false;
        }
        let compiled = self.parts.entry(part).or_insert_with(|| {
            let (passes, device, draw) = (Arc::clone(passes), device.clone(), draw.cloned());
            Background::start(synchronous, move || match part {
                Part::Masks => passes.splat.prepare_masks(&device),
                Part::Eyes => passes.splat.prepare_eyes(&device),
                Part::Half => passes.splat.prepare_half(&device),
                Part::Light(tonemapping, shadowed, aerial) => {
                    passes.splat.prepare_light(&device, tonemapping, shadowed, aerial);
                }
                Part::Strokes => passes.splat.prepare_strokes(&device, draw.as_slice()),
            })
        });
        compiled.get().is_some()
    }

    /// Starts to compile the lift of targets of a format. Returns whether it is ready.
    pub(super) fn request_lift(
        &mut self,
        device: &wgpu::Device,
        synchronous: SynchronousCompilation,
        format: TextureFormat,
    ) -> bool {
        let lift = self.lifts.entry(format).or_insert_with(|| {
            let device = device.clone();
            Background::start(synchronous, move || LiftPipeline::new(&device, format))
        });
        lift.get().is_some()
    }

    /// The lift of targets of a format, or `None` if it was not [requested](Self::request_lift) or is not
    /// ready.
    pub(super) fn lift(&self, format: TextureFormat) -> Option<&LiftPipeline> {
        self.lifts.get(&format)?.get()
    }

    /// Whether the kernel for clouds with a mask is ready.
    pub(super) fn has_masks(&self) -> bool {
        self.parts.get(&Part::Masks).is_some_and(|masks| masks.get().is_some())
    }

    /// Starts to build the table that inverts a tonemapping without a formula for its inverse. Returns whether
    /// the table is ready. It cannot be built before Bevy's table of that tonemapping is on the GPU.
    pub(super) fn request_table(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        synchronous: SynchronousCompilation,
        tonemapping: Tonemapping,
        luts: &Luts,
    ) -> bool {
        let table = match self.tables.entry(tonemapping) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => {
                // Not entered in the map yet, so the next frame asks again.
                let Some(curve) = luts.curve(tonemapping) else { return false };
                let (device, queue) = (device.clone(), queue.clone());
                entry.insert(Background::start(synchronous, move || {
                    let mut encoder =
                        device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                    let table = InverseTable::new(&device, &mut encoder, &curve);
                    // An encoder of its own: a task has no access to the frame's. wgpu orders submissions, so a
                    // later frame sees the table.
                    queue.submit([encoder.finish()]);
                    table
                }))
            }
        };
        table.get().is_some()
    }

    /// The table that inverts a tonemapping, or `None` if it was not [requested](Self::request_table) or is not
    /// ready.
    pub(super) fn table(&self, tonemapping: Tonemapping) -> Option<&InverseTable> {
        self.tables.get(&tonemapping)?.get()
    }

    /// The passes, or `None` if they are not ready.
    pub(super) fn passes(&self) -> Option<&Passes> {
        self.passes.as_ref()?.get().map(|passes| &**passes)
    }

    /// The same, to be kept.
    pub(super) fn shared(&self) -> Option<Arc<Passes>> {
        self.passes.as_ref()?.get().cloned()
    }

    /// Number of pipelines and tables requested so far.
    #[cfg(test)]
    pub(super) fn n_requested(&self) -> usize {
        let by_kind = [self.parts.len(), self.composites.len(), self.tables.len(), self.lifts.len()];
        by_kind.iter().sum::<usize>() + usize::from(self.draw.is_some())
    }

    /// The pipelines for a layer over `target`, or `None` if they were not [requested](Self::request) or are
    /// not ready.
    pub(super) fn get(&self, target: CompositeTarget) -> Option<Ready<'_>> {
        Some(Ready {
            passes: self.passes()?,
            draw: self.draw.as_ref()?.get()?,
            composite: self.composites.get(&target)?.get()?,
        })
    }
}

/// The tables that define some of Bevy's tonemappings.
#[derive(SystemParam)]
pub(super) struct Luts<'w> {
    handles: Res<'w, TonemappingLuts>,
    images: Res<'w, RenderAssets<GpuImage>>,
}

impl Luts<'_> {
    /// A tonemapping to invert, or `None` while its table is not on the GPU.
    fn curve(&self, tonemapping: Tonemapping) -> Option<ToneCurve> {
        // Bevy loads its tables like any image, so one may be missing in the first frames.
        let table = |handle| Some((*self.images.get(handle)?.texture_view).clone());
        Some(match tonemapping {
            Tonemapping::AgX => ToneCurve::AgX(table(&self.handles.agx)?),
            Tonemapping::TonyMcMapface => ToneCurve::TonyMcMapface(table(&self.handles.tony_mc_mapface)?),
            Tonemapping::BlenderFilmic => ToneCurve::BlenderFilmic(table(&self.handles.blender_filmic)?),
            Tonemapping::KhronosPbrNeutral => ToneCurve::KhronosPbrNeutral,
            Tonemapping::SomewhatBoringDisplayTransform => ToneCurve::SomewhatBoringDisplayTransform,
            _ => ToneCurve::AcesFitted,
        })
    }
}
