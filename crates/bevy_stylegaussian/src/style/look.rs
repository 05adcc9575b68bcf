//! An entity's look as the render world should have it, and what the render world says back.

use std::sync::{Arc, Mutex, PoisonError};

use bevy::prelude::*;
use stylegaussian_gpu::style::{FoldedLayers, StyleInputs};

/// The colors of an entity's splats. Each change has a higher `generation`.
#[derive(Component, Clone, Default)]
pub(crate) struct Look {
    pub(crate) generation: u64,
    pub(crate) colors: LookColors,
}

/// Where the colors come from.
#[derive(Clone, Default)]
pub(crate) enum LookColors {
    /// The scene's own.
    #[default]
    Captured,
    /// Decoded already `[N]`.
    Rgb(Arc<[[f32; 3]]>),
    /// The GPU is to decode them.
    Folded(Arc<FoldedStyle>),
}

/// A style folded into weights, for the GPU to decode.
pub(crate) struct FoldedStyle {
    /// The scene's part.
    pub(crate) inputs: Arc<StyleInputs>,
    /// The style's part.
    pub(crate) layers: FoldedLayers,
}

impl Look {
    pub(crate) fn set(&mut self, colors: LookColors) {
        self.generation += 1;
        self.colors = colors;
    }
}

/// What became of something that the render world was to do for an entity.
pub(crate) enum GpuReport {
    /// The style pass of the look of this generation was run.
    Styled { entity: Entity, generation: u64 },
    /// It cannot be.
    StyleRefused { entity: Entity, generation: u64, reason: String },
    /// The entity's scene cannot be drawn.
    SceneRefused { entity: Entity, reason: String },
}

/// Reports from the render world, which both worlds hold.
#[derive(Resource, Clone, Default)]
pub(crate) struct GpuReports(Arc<Mutex<Vec<GpuReport>>>);

impl GpuReports {
    pub(crate) fn push(&self, report: GpuReport) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(report);
    }

    pub(crate) fn take(&self) -> Vec<GpuReport> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
