//! The style pass: once for each change of a look, before any camera draws.

use std::{sync::Arc, time::Duration};

use bevy::{
    platform::collections::HashMap,
    prelude::*,
    render::{
        renderer::{RenderContext, RenderDevice, RenderQueue},
        sync_world::MainEntity,
    },
};
use stylegaussian_gpu::style::{GpuDecoder, StyleInputs, StylePass, StyleScene};

use crate::{
    pipeline::{AtOnce, Built},
    splats::{RenderCloud, RenderClouds},
};

use super::{
    event::StylePassCount,
    look::{FoldedStyle, GpuReport, GpuReports, LookColors},
    looks::{CloudLook, CloudLooks},
};

/// The pipelines of the style pass, and the scenes that it runs on, by the address of their packed inputs.
#[derive(Resource, Default)]
pub(super) struct StylePasses {
    pass: Option<Built<StylePass>>,
    scenes: HashMap<usize, StyledScene>,
    /// Whether a look waits for the pipelines.
    waits: bool,
}

struct StyledScene {
    /// Keeps the address taken.
    inputs: Arc<StyleInputs>,
    scene: StyleScene,
}

/// What a look needs of the renderer.
struct Gpu<'a> {
    device: &'a wgpu::Device,
    queue: &'a wgpu::Queue,
    encoder: &'a mut wgpu::CommandEncoder,
}

/// Brings each cloud's look up to date: uploads colors, runs style passes. Does nothing where nothing changed.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(super) fn update_looks(
    clouds: Res<RenderClouds>,
    mut looks: ResMut<CloudLooks>,
    mut passes: ResMut<StylePasses>,
    at_once: Res<AtOnce>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    time: Res<Time>,
    reports: Res<GpuReports>,
    count: Res<StylePassCount>,
    mut context: RenderContext,
) {
    if !clouds.is_changed() && !looks.is_added() && !passes.waits {
        return;
    }
    looks.0.retain(|entity, _| clouds.0.contains_key(entity));
    passes.forget_unused(&clouds);
    passes.waits = false;
    for (&entity, cloud) in &clouds.0 {
        let look = looks.0.entry(entity).or_default();
        if look.generation == Some(cloud.look.generation) {
            continue;
        }
        match &cloud.look.colors {
            LookColors::Own => look.show(None, cloud.fade, time.elapsed(), cloud.look.generation),
            LookColors::Rgb(rgb) => {
                match look.next(device.wgpu_device(), rgb.len(), cloud.fade) {
                    Ok((index, colors)) => {
                        colors.write(&queue, rgb);
                        look.show(Some(index), cloud.fade, time.elapsed(), cloud.look.generation);
                    }
                    Err(error) => refuse(&reports, entity, cloud, look, error.to_string()),
                }
            }
            LookColors::Folded(style) => {
                let Some(pass) = passes.pass(at_once.0, &device) else {
                    passes.waits = true;
                    continue;
                };
            }
        }
    }
}
