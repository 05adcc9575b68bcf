//! Light and air of splats: the tints of entities, and the fog of cameras.
//!
//! Views without either have nothing of it: no pipeline, no buffer, no dispatch.

use bevy::{
    camera::visibility::RenderLayers,
    core_pipeline::tonemapping::Tonemapping,
    ecs::system::SystemParam,
    platform::collections::HashMap,
    prelude::*,
    render::{
        Extract,
        camera::ExtractedCamera,
        renderer::{RenderDevice, RenderQueue},
        sync_world::{MainEntity, MainEntityHashMap},
        view::{ExtractedView, RetainedViewEntity},
    },
};
use stylegaussian::light::Tint;
use stylegaussian_gpu::splat::{self, ViewLight};

use crate::work::SynchronousCompilation;

use super::{
    fog::{CameraFog, Suns},
    pipelines::{Luts, SplatPipelines},
    view,
};

/// Changes the colors of a [`GaussianSplats`](crate::GaussianSplats) in the same frame: darker at night, redder
/// in the evening, gray where life has gone. A component of the entity, beside any style.
///
/// It works on linear light, before the exposure and the tone mapping of the camera: first the saturation, then
/// the color, then the exposure. So it changes splats as another lamp changes an unlit mesh. Numbers that are
/// not finite change nothing. Strokes lose or gain contrast with the colors below them.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::SplatTint;
/// # fn system(mut commands: Commands, garden: Entity) {
/// let dusk = SplatTint { color: Color::srgb(1.0, 0.7, 0.5), exposure: -1.5, ..default() };
/// commands.entity(garden).insert(dusk);
/// # }
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct SplatTint {
    /// Factors of red, green and blue, as a linear color. White, the default, changes nothing; alpha is not
    /// used.
    pub color: Color,
    /// Brightening in stops: 1 doubles the light, -1 halves it.
    pub exposure: f32,
    /// Distance from gray: 0 is gray, 1, the default, as it is, 2 twice as colorful.
    pub saturation: f32,
}

impl Default for SplatTint {
    fn default() -> Self {
        Self { color: Color::WHITE, exposure: 0.0, saturation: 1.0 }
    }
}

impl From<SplatTint> for Tint {
    fn from(tint: SplatTint) -> Self {
        let color = tint.color.to_linear().to_vec3();
        Self { color, exposure: tint.exposure, saturation: tint.saturation }
    }
}

/// The tints of all entities that have one.
#[derive(Resource, Default)]
pub(super) struct RenderTints(MainEntityHashMap<Tint>);

/// Copies them.
pub(super) fn extract_tints(mut tints: ResMut<RenderTints>, all: Extract<Query<(Entity, &SplatTint)>>) {
    tints.0.clear();
    tints.0.extend(all.iter().map(|(entity, &tint)| (MainEntity::from(entity), Tint::from(tint))));
}

/// The light of the views that have any, without the tints of their clouds.
#[derive(Resource, Default)]
pub(super) struct SplatLights(HashMap<RetainedViewEntity, ViewLight>);

/// The components of a camera in the render world that its light depends on.
type LitCamera = (
    &'static ExtractedView,
    &'static ExtractedCamera,
    Option<&'static Tonemapping>,
    Option<&'static RenderLayers>,
    CameraFog,
);

/// Finds the light of each view, and requests its pipelines. Splats are drawn without it until they are there.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(super) fn prepare_lights(
    cameras: Query<LitCamera, With<Camera3d>>,
    suns: Suns,
    tints: Res<RenderTints>,
    mut lights: ResMut<SplatLights>,
    mut pipelines: ResMut<SplatPipelines>,
    luts: Luts,
    synchronous: Res<SynchronousCompilation>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    lights.0.clear();
    let has_tints = tints.0.values().any(|tint| tint.matrix().is_some());
    let device = device.wgpu_device();
    for (extracted, camera, tonemapping, layers, fog) in &cameras {
        let fog = suns.fog(fog, layers, camera.exposure);
        if fog.is_none() && !has_tints {
            continue;
        }
        // Without tonemapping, Bevy does not apply the exposure of color grading either.
        let (tonemapping, exposure) = match tonemapping.filter(|tonemapping| tonemapping.is_enabled()) {
            Some(&tonemapping) => (view::method(tonemapping), extracted.color_grading.global.exposure),
            None => (splat::Tonemapping::None, 0.0),
        };
        let is_ready = pipelines.request_light(device, *synchronous, tonemapping);
        let has_table = !tonemapping.needs_table()
            || pipelines.request_table(device, &queue, *synchronous, tonemapping, &luts);
        if is_ready && has_table {
            let table = pipelines.table(tonemapping).cloned();
            let light = ViewLight { fog, tints: Vec::new(), tonemapping, exposure, table };
            lights.0.insert(extracted.retained_view_entity, light);
        }
    }
}

/// The light of all views, and the tints of all clouds.
#[derive(SystemParam)]
pub(super) struct Lights<'w> {
    of_view: Res<'w, SplatLights>,
    tints: Res<'w, RenderTints>,
}

impl Lights<'_> {
    /// The light of a view that draws these clouds, if it has any.
    pub(super) fn of(&self, view: &RetainedViewEntity, clouds: &[MainEntity]) -> Option<ViewLight> {
        let light = self.of_view.0.get(view)?.clone();
        let tint = |cloud| self.tints.0.get(cloud).copied().unwrap_or_default();
        Some(ViewLight { tints: clouds.iter().map(tint).collect(), ..light })
    }
}
