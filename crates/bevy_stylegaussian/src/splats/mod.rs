//! Splats in the world: the component, its cameras' settings, and when what happens.

use std::sync::Arc;

use bevy::{
    asset::AssetEventSystems,
    camera::visibility::{VisibilityClass, VisibilitySystems, add_visibility_class},
    core_pipeline::{
        Core3d, Core3dSystems,
        core_3d::{main_opaque_pass_3d, main_transparent_pass_3d, prepare_core_3d_depth_textures},
        tonemapping::tonemapping,
    },
    pbr::main_transmissive_pass_3d,
    prelude::*,
    render::{
        ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderSystems,
        extract_component::{ExtractComponent, ExtractComponentPlugin},
        sync_component::SyncComponent,
    },
};

use crate::{asset::GaussianScene, plugin::StyleGaussianSystems, style::Look};

mod attach;
mod bounds;
mod extract;
mod node;
mod pipelines;
mod prepare;
#[cfg(test)]
mod tests;
mod view;

pub(crate) use attach::CloudScene;
pub(crate) use bounds::bounds;
pub(crate) use extract::{RenderCloud, RenderClouds};

/// Shows a scene of Gaussians, wherever the entity's `Transform` puts it (any scale and shear included).
///
/// Splats are depth-tested against opaque meshes and drawn before transparent ones, in the colors they were captured
/// with, which lights do not change. Any number of entities may share a scene; overlapping ones blend in the right
/// order.
#[derive(Component, Clone, Debug, Default, PartialEq, Eq, Reflect)]
#[require(Transform, Visibility, VisibilityClass, Look)]
#[component(on_add = add_visibility_class::<GaussianSplats>)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct GaussianSplats(pub Handle<GaussianScene>);

/// How splats, whose colors are meant for a display as they are, get into the picture of a camera that tone-maps after
/// drawing, which is one with `Hdr` and a `Tonemapping`. Other cameras need no such choice. A component of the camera.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub enum SplatTonemapping {
    /// Undo the camera's tonemapping first, so that it gives the splats' colors back. Bloom, transparent meshes and
    /// everything else sees them in their place. Very bright and saturated colors come out a little duller where the
    /// tonemapping never reaches them.
    #[default]
    Invert,
    /// Draw the splats after tonemapping: exact colors, but transparent meshes in front of them do not cover them, and
    /// effects that follow tonemapping, such as FXAA, may not see them.
    Bypass,
}

/// In which order splats blend. A component of the camera.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub enum SortKey {
    /// By depth along the camera's axis, as scenes are trained.
    #[default]
    ViewZ,
    /// By distance from the camera, which does not change when the camera turns: for stereo, and for scenes that were
    /// trained so (glTF's `KHR_gaussian_splatting`).
    Distance,
}

macro_rules! extract_as_is {
    ($component:ty) => {
        impl SyncComponent for $component {
            type Target = Self;
        }

        impl ExtractComponent for $component {
            type QueryData = &'static Self;
            type QueryFilter = With<Camera3d>;
            type Out = Self;

            fn extract_component(component: &Self) -> Option<Self> {
                Some(*component)
            }
        }
    };
}

extract_as_is!(SplatTonemapping);
extract_as_is!(SortKey);

/// An entity's scene cannot be shown; the app goes on without it.
///
/// Written as a message and triggered on the entity for observers.
#[derive(Message, EntityEvent, Clone, Debug, Reflect)]
#[reflect(Clone, Debug)]
pub struct SceneFailed {
    /// The entity.
    pub entity: Entity,
    /// Why.
    #[reflect(ignore, default = "unknown_error")]
    pub error: Arc<SceneError>,
}

/// What a [`SceneFailed`] made by reflection says, as errors do not reflect.
fn unknown_error() -> Arc<SceneError> {
    Arc::new(SceneError::Gpu("unknown".into()))
}

/// Why a scene cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The asset could not be loaded. The message names it.
    #[error("{0}")]
    Load(String),
    /// The parts of a scene made by a program do not fit together.
    #[error(transparent)]
    Scene(#[from] stylegaussian::scene::SceneError),
    /// The graphics processor cannot take it: the message says how many bytes were found and how many it allows.
    #[error("the scene cannot be drawn on this GPU: {0}")]
    Gpu(String),
}

/// Shows [`GaussianSplats`].
pub(crate) struct SplatsPlugin;

impl Plugin for SplatsPlugin {
    fn build(&self, app: &mut App) {
        app.add_message::<SceneFailed>()
            .register_type::<GaussianSplats>()
            .register_type::<SplatTonemapping>()
            .register_type::<SortKey>()
            .register_type::<SceneFailed>()
            .add_systems(
                PostUpdate,
                (attach::mark_changed_scenes, attach::attach_scenes, attach::report_failed_loads)
                    .chain()
                    .in_set(StyleGaussianSystems::Scenes)
                    .after(AssetEventSystems)
                    .before(VisibilitySystems::CheckVisibility),
            );
        if app.get_sub_app(RenderApp).is_none() {
            return;
        }
        app.add_plugins((
            ExtractComponentPlugin::<SplatTonemapping>::default(),
            ExtractComponentPlugin::<SortKey>::default(),
        ));
        let render_app = app.sub_app_mut(RenderApp);
        render_app
            .init_resource::<RenderClouds>()
            // Rebuilt from `RenderClouds` after a lost device.
            .init_gpu_resource::<prepare::GpuScenes>()
            .init_gpu_resource::<pipelines::SplatPipelines>()
            .init_gpu_resource::<view::SplatViews>()
            .add_systems(ExtractSchedule, extract::extract_clouds)
            .add_systems(
                Render,
                (
                    view::allow_reading_depth
                        .in_set(RenderSystems::PrepareResources)
                        .before(prepare_core_3d_depth_textures),
                    (prepare::prepare_scenes, view::prepare_views)
                        .chain()
                        .in_set(RenderSystems::PrepareResources),
                ),
            )
            .add_systems(
                Core3d,
                (
                    node::draw_splats
                        .after(main_opaque_pass_3d)
                        .before(main_transmissive_pass_3d)
                        .before(main_transparent_pass_3d)
                        .in_set(Core3dSystems::MainPass),
                    node::composite_after_tonemapping.after(tonemapping).in_set(Core3dSystems::PostProcess),
                ),
            );
    }
}
