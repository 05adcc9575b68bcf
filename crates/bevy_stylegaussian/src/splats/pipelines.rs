//! The pipelines of the splat pass, one for each kind of target, built in the background.

use std::sync::Arc;

use bevy::{
    core_pipeline::core_3d::CORE_3D_DEPTH_FORMAT, platform::collections::HashMap, prelude::*,
    render::render_resource::TextureFormat,
};
use stylegaussian_gpu::splat::{Composite, CompositeMode, CompositePipeline, SplatPass, SplatPipeline};

use crate::pipeline::Built;

/// All that is built, or being built, on the present device.
#[derive(Resource, Default)]
pub(super) struct SplatPipelines {
    passes: Option<Built<Arc<Passes>>>,
    draws: HashMap<u32, Built<SplatPipeline>>,
    composites: HashMap<CompositeTarget, Built<CompositePipeline>>,
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

    /// What does not depend on the target, once it is ready.
    pub(super) fn passes(&self) -> Option<&Passes> {
        self.passes.as_ref()?.get().map(|passes| &**passes)
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
