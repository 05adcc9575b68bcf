//! Shadows that splats cast: their cores in the shadow maps of Bevy's lights.
//!
//! They are drawn into each map after Bevy's meshes and before all that reads it, since Bevy clears its maps in
//! each frame. They are projected anew if the light or a caster changed. The maps of directional lights belong
//! to a camera each; those of spot lights and point lights are drawn once, before all cameras.

use std::borrow::Cow;

use bevy::{
    camera::{primitives::Frustum, visibility::RenderLayers},
    core_pipeline::Core3d,
    ecs::{query::QueryItem, system::SystemParam},
    math::UVec4,
    pbr::{LATE_SHADOW_PASS, ShadowView, ViewLightEntities, per_view_shadow_pass, shared_shadow_pass},
    platform::collections::HashMap,
    prelude::*,
    render::{
        Extract, ExtractSchedule, GpuResourceAppExt, Render, RenderSystems,
        renderer::{RenderDevice, ViewQuery},
        sync_world::{MainEntity, MainEntityHashMap},
        view::{ExtractedView, RetainedViewEntity},
    },
};
use stylegaussian_gpu::splat;
use wgpu::{RenderPassDescriptor, StoreOp};

use crate::{
    colors::{PipelinesReady, ShownColors, StrokeClock},
    commands::GpuCommands,
    mask::RenderMasks,
    scene::{GpuScenes, RenderClouds, device_serves},
    work::{Background, SynchronousCompilation},
};

use super::{
    CastsShadows,
    caster::SplatCaster,
    fade::CloudFades,
    pipelines::SplatPipelines,
    view::{self, SplatViews},
};

/// Adds what casting takes to the render world.
pub(super) fn add_to(render_app: &mut SubApp) {
    render_app
        .init_gpu_resource::<SplatCasts>()
        .init_resource::<Casters>()
        .add_systems(ExtractSchedule, extract_casters)
        .add_systems(
            Render,
            prepare_casts
                .after(view::prepare_views)
                .run_if(device_serves)
                .in_set(RenderSystems::PrepareResources),
        )
        .configure_sets(
            Core3d,
            CastsShadows
                .after(per_view_shadow_pass::<LATE_SHADOW_PASS>)
                .after(shared_shadow_pass::<LATE_SHADOW_PASS>),
        )
        .add_systems(Core3d, (cast_for_camera, cast_for_all).in_set(CastsShadows));
}

/// The entities that cast shadows.
#[derive(Resource, Default)]
pub(super) struct Casters(MainEntityHashMap<Caster>);

/// An entity that casts shadows.
struct Caster {
    threshold: f32,
    layers: RenderLayers,
}

/// An entity with its components that casting depends on.
type CasterParts =
    (Entity, &'static SplatCaster, &'static InheritedVisibility, Option<&'static RenderLayers>);

/// Copies the entities that cast shadows, in sight of a camera or not.
fn extract_casters(mut casters: ResMut<Casters>, all: Extract<Query<CasterParts>>) {
    casters.0.clear();
    casters.0.extend(all.iter().filter(|(_, _, visibility, _)| visibility.get()).map(
        |(entity, caster, _, layers)| {
            let layers = layers.cloned().unwrap_or_default();
            (MainEntity::from(entity), Caster { threshold: caster.threshold, layers })
        },
    ));
}

/// The casters of each shadow map.
#[derive(Resource, Default)]
pub(super) struct SplatCasts {
    of_map: HashMap<RetainedViewEntity, splat::CastView>,
    /// The draws of clouds without a mask and with one, which are parts of the passes.
    draws: [Option<Background<()>>; 2],
}

#[cfg(test)]
impl SplatCasts {
    /// Number of draws requested, and of shadow maps with casters.
    pub(super) fn n(&self) -> usize {
        self.draws.iter().flatten().count() + self.of_map.len()
    }

    /// How often casters were projected into the shadow maps that have any.
    pub(super) fn n_projections(&self) -> u64 {
        self.of_map.values().map(splat::CastView::n_projections).sum()
    }
}

/// Requests the draws, and forgets shadow maps that are gone.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
fn prepare_casts(
    maps: Query<&ExtractedView, With<ShadowView>>,
    casters: Res<Casters>,
    mut casts: ResMut<SplatCasts>,
    pipelines: Res<SplatPipelines>,
    masks: Res<RenderMasks>,
    mut all_ready: ResMut<PipelinesReady>,
    synchronous: Res<SynchronousCompilation>,
    device: Res<RenderDevice>,
) {
    if casters.0.is_empty() {
        if !casts.of_map.is_empty() {
            casts.of_map.clear();
        }
        return;
    }
    let SplatCasts { of_map, draws } = &mut *casts;
    of_map.retain(|map, _| maps.iter().any(|view| view.retained_view_entity == *map));
    // Requested for every camera, so they are on their way.
    let Some(passes) = pipelines.shared() else { return };
    let mut request = |masked: bool| {
        let draw = draws[usize::from(masked)].get_or_insert_with(|| {
            let (passes, device) = (passes.clone(), device.wgpu_device().clone());
            Background::start(*synchronous, move || passes.splat.prepare_cast(&device, masked))
        });
        draw.get().is_some()
    };
    all_ready.0 &= request(false);
    all_ready.0 &= masks.is_empty() || request(true);
}

/// The components of a shadow map in the render world.
type ShadowMap = (&'static ShadowView, &'static ExtractedView, &'static Frustum, &'static RenderLayers);

/// Everything that casting takes.
#[derive(SystemParam)]
struct Casting<'w, 's> {
    casters: Res<'w, Casters>,
    casts: ResMut<'w, SplatCasts>,
    pipelines: Res<'w, SplatPipelines>,
    clouds: Res<'w, RenderClouds>,
    scenes: Res<'w, GpuScenes>,
    colors: Res<'w, ShownColors>,
    clock: Res<'w, StrokeClock>,
    masks: Res<'w, RenderMasks>,
    fades: Res<'w, CloudFades>,
    gpu: GpuCommands<'w, 's>,
}

/// Draws splats into the shadow maps of a camera: those of directional lights.
fn cast_for_camera(
    camera: ViewQuery<(&ExtractedView, &ViewLightEntities)>,
    maps: Query<ShadowMap>,
    views: Res<SplatViews>,
    mut casting: Casting,
) {
    let (view, lights) = camera.into_inner();
    let name = match views.get(&view.retained_view_entity) {
        Some(splats) => splats.span("splat_cast"),
        None => Cow::Borrowed("splat_cast"),
    };
    let maps: Vec<_> = lights.lights.iter().filter_map(|&map| maps.get(map).ok()).collect();
    casting.cast(name, &maps);
}

/// Draws splats into a shadow map that all cameras share: that of a spot light, or a side of a point light's.
fn cast_for_all(map: ViewQuery<ShadowMap>, mut casting: Casting) {
    let map = map.into_inner();
    let name = format!("splat_cast_{}", map.0.pass_name);
    casting.cast(name.into(), &[map]);
}

impl Casting<'_, '_> {
    /// Draws all casters that each of `maps` sees. `span` is the name of this among the diagnostics.
    fn cast(&mut self, span: Cow<'static, str>, maps: &[QueryItem<'_, '_, ShadowMap>]) {
        let Some(passes) = self.pipelines.passes().filter(|_| !self.casters.0.is_empty()) else { return };
        let largest = self.gpu.device().limits().max_texture_dimension_2d;
        let [is_ready, has_masks] =
            self.casts.draws.each_ref().map(|draw| draw.as_ref().is_some_and(|draw| draw.get().is_some()));
        if !is_ready {
            return;
        }
        let mut seen = Vec::with_capacity(maps.len());
        for &(map, view, frustum, layers) in maps {
            let casters: Vec<splat::Caster> = self
                .casters
                .0
                .iter()
                .filter(|(_, caster)| layers.intersects(&caster.layers))
                .filter_map(|(entity, caster)| {
                    let cloud = self.clouds.0.get(entity)?;
                    let bounds = cloud.scene.asset.bounds().ok()??;
                    let world_from_scene = cloud.world_from_scene;
                    // The near planes of directional lights are infinitely near.
                    if !frustum.intersects_obb(&bounds, &world_from_scene, true, true) {
                        return None;
                    }
                    // Without colors yet, it is not shown either.
                    let colors = self.colors.get(*entity)?.at(self.clock.0);
                    let scene = self.scenes.get(&cloud.scene)?;
                    let visibility = self.masks.visibility(*entity, scene.n_gaussians());
                    let visibility = visibility.filter(|_| has_masks);
                    let cloud = splat::Cloud { scene, colors, world_from_scene, visibility };
                    let faded = self.fades.share(*entity);
                    Some(splat::Caster { cloud, threshold: caster.threshold, faded })
                })
                .collect();
            let key = view.retained_view_entity;
            if casters.is_empty() {
                self.casts.of_map.remove(&key);
                continue;
            }
            let camera = splat::Camera {
                world_from_view: view.world_from_view.affine(),
                clip_from_view: view.clip_from_view,
                // Bevy limits the texture alone.
                viewport: view.viewport.min(UVec4::splat(largest)),
            };
            seen.push((map, key, camera, view::near(view), casters));
        }
        if seen.is_empty() {
            return;
        }
        self.gpu.timed(span, |gpu| {
            for (map, key, camera, near, casters) in seen {
                let of_map = self.casts.of_map.entry(key).or_default();
                // The draw of the clouds themselves tells of an error.
                if passes.splat.project_casters(gpu, of_map, (&camera, near), &casters).is_err() {
                    continue;
                }
                let mut pass = gpu.encoder.begin_render_pass(&RenderPassDescriptor {
                    label: Some("splat_cast"),
                    depth_stencil_attachment: Some(map.depth_attachment.get_attachment(StoreOp::Store)),
                    ..default()
                });
                passes.splat.cast(&mut pass, of_map);
            }
        });
    }
}
