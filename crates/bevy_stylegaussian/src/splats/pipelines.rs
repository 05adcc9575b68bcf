//! The pipelines of the splat pass, one for each kind of target, built in the background.

use std::sync::Arc;

use bevy::{
    core_pipeline::{core_3d::CORE_3D_DEPTH_FORMAT, tonemapping::TonemappingLuts},
    ecs::system::SystemParam,
    platform::collections::{HashMap, hash_map::Entry},
    prelude::*,
    render::{render_asset::RenderAssets, render_resource::TextureFormat, texture::GpuImage},
};
use stylegaussian_gpu::splat::{
    Composite, CompositeMode, CompositePipeline, InverseTable, SplatPass, SplatPipeline, ToneCurve,
    Tonemapping,
};

use crate::pipeline::Built;

/// All that is built, or being built, on the present device.
#[derive(Resource, Default)]
pub(super) struct SplatPipelines {
    passes: Option<Built<Arc<Passes>>>,
    draws: HashMap<u32, Built<SplatPipeline>>,
    composites: HashMap<CompositeTarget, Built<CompositePipeline>>,
    tables: HashMap<Tonemapping, Built<InverseTable>>,
}

/// What does not depend on the target.
pub(super) struct Passes {
    pub(super) splat: SplatPass,
    pub(super) composite: Composite,
}

/// What the layer is put over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct CompositeTarget {
    pub(super) format: TextureFormat,
    pub(super) samples: u32,
    pub(super) mode: CompositeMode,
}

/// Pipelines that are ready.
pub(super) struct Ready<'a> {
    pub(super) passes: &'a Passes,
    pub(super) draw: &'a SplatPipeline,
    pub(super) composite: &'a CompositePipeline,
}

impl SplatPipelines {
    /// Starts to build what is missing for a layer of `samples` samples over `target`, or with `at_once` builds it.
    /// Whether all is ready.
    pub(super) fn request(
        &mut self,
        device: &wgpu::Device,
        at_once: bool,
        samples: u32,
        target: CompositeTarget,
    ) -> bool {
        let build = |device: wgpu::Device| {
            move || Arc::new(Passes { splat: SplatPass::new(&device), composite: Composite::new(&device) })
        };
        let passes = self.passes.get_or_insert_with(|| Built::start(at_once, build(device.clone())));
        let Some(passes) = passes.poll() else { return false };
        let draw = self.draws.entry(samples).or_insert_with(|| {
            let (passes, device) = (Arc::clone(passes), device.clone());
            let build = move || passes.splat.pipeline(&device, samples, Some(CORE_3D_DEPTH_FORMAT));
            Built::start(at_once, build)
        });
        let composite = self.composites.entry(target).or_insert_with(|| {
            let (passes, device) = (Arc::clone(passes), device.clone());
            let CompositeTarget { format, samples, mode } = target;
            Built::start(at_once, move || passes.composite.pipeline(&device, format, samples, mode))
        });
        // Both are polled, so that neither waits for the other to be asked for.
        let (draw, composite) = (draw.poll().is_some(), composite.poll().is_some());
        draw && composite
    }

    /// Starts to build what undoes a tone mapping that has no inverse, or with `at_once` builds it. Whether it is ready,
    /// which takes the table that defines the tone mapping.
    pub(super) fn request_table(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        at_once: bool,
        tonemapping: Tonemapping,
        luts: &Luts,
    ) -> bool {
        let table = match self.tables.entry(tonemapping) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => {
                let Some(curve) = luts.curve(tonemapping) else { return false };
                let (device, queue) = (device.clone(), queue.clone());
                entry.insert(Built::start(at_once, move || {
                    let mut encoder =
                        device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                    let table = InverseTable::new(&device, &mut encoder, curve.borrow());
                    queue.submit([encoder.finish()]);
                    table
                }))
            }
        };
        table.poll().is_some()
    }

    /// What undoes a tone mapping that has no inverse, once [requested](Self::request_table) and ready.
    pub(super) fn table(&self, tonemapping: Tonemapping) -> Option<&InverseTable> {
        self.tables.get(&tonemapping)?.get()
    }

    /// What does not depend on the target, once it is ready.
    pub(super) fn passes(&self) -> Option<&Passes> {
        self.passes.as_ref()?.get().map(|passes| &**passes)
    }

    /// How many pipelines and tables were ever asked for.
    #[cfg(test)]
    pub(super) fn n_requested(&self) -> usize {
        self.draws.len() + self.composites.len() + self.tables.len()
    }

    /// The pipelines for a layer of `samples` samples over `target`, once [requested](Self::request) and ready.
    pub(super) fn get(&self, samples: u32, target: CompositeTarget) -> Option<Ready<'_>> {
        Some(Ready {
            passes: self.passes()?,
            draw: self.draws.get(&samples)?.get()?,
            composite: self.composites.get(&target)?.get()?,
        })
    }
}

/// The tables that define some of Bevy's tone mappings.
#[derive(SystemParam)]
pub(super) struct Luts<'w> {
    handles: Res<'w, TonemappingLuts>,
    images: Res<'w, RenderAssets<GpuImage>>,
}

/// A tone mapping to undo, with its table where it is one.
struct Curve {
    tonemapping: Tonemapping,
    table: Option<wgpu::TextureView>,
}

impl Luts<'_> {
    /// A tone mapping to undo; `None` while its table is not on the GPU.
    fn curve(&self, tonemapping: Tonemapping) -> Option<Curve> {
        let handle = match tonemapping {
            Tonemapping::AgX => Some(&self.handles.agx),
            Tonemapping::TonyMcMapface => Some(&self.handles.tony_mc_mapface),
            Tonemapping::BlenderFilmic => Some(&self.handles.blender_filmic),
            _ => None,
        };
        let table = match handle {
            Some(handle) => Some((*self.images.get(handle)?.texture_view).clone()),
            None => None,
        };
        Some(Curve { tonemapping, table })
    }
}

impl Curve {
    fn borrow(&self) -> ToneCurve<'_> {
        match (self.tonemapping, &self.table) {
            (Tonemapping::AgX, Some(table)) => ToneCurve::AgX(table),
            (Tonemapping::TonyMcMapface, Some(table)) => ToneCurve::TonyMcMapface(table),
            (Tonemapping::BlenderFilmic, Some(table)) => ToneCurve::BlenderFilmic(table),
            (Tonemapping::KhronosPbrNeutral, _) => ToneCurve::KhronosPbrNeutral,
            (Tonemapping::SomewhatBoringDisplayTransform, _) => ToneCurve::SomewhatBoringDisplayTransform,
            _ => ToneCurve::AcesFitted,
        }
    }
}
