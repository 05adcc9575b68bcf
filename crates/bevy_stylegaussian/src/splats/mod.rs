//! Splats: drawing scenes, in the colors of [`crate::colors`], into the views of cameras.
//!
//! Each frame plans the views ([`view`]) and builds missing pipelines in the background ([`pipelines`]). Each
//! camera then runs the splat pass ([`pass`]). Styles are none of this room's business.

use bevy::{
    core_pipeline::{
        Core3d, Core3dSystems,
        core_3d::{main_opaque_pass_3d, main_transparent_pass_3d, prepare_core_3d_depth_textures},
        tonemapping::tonemapping,
    },
    prelude::*,
    render::{
        GpuResourceAppExt, Render, RenderApp, RenderSystems, extract_component::ExtractComponentPlugin,
    },
};

use crate::scene::{device_serves, upload_scenes};

mod camera;
mod cuts;
mod eyes;
#[cfg(test)]
mod held;
mod living;
mod pass;
mod pipelines;
mod view;

pub use camera::{SplatSortKey, SplatTonemapping};
pub use cuts::SplatCuts;
pub use eyes::SplatEyes;

#[cfg(test)]
pub(crate) use held::Held;

/// The system that draws splats into the main pass.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
struct DrawsSplats;

/// Draws [`GaussianSplats`](crate::GaussianSplats).
pub(crate) struct SplatsPlugin;

impl Plugin for SplatsPlugin {
    fn build(&self, app: &mut App) {
        app.register_type::<SplatTonemapping>()
            .register_type::<SplatSortKey>()
            .register_type::<SplatCuts>()
            .register_type::<SplatEyes>();
        // Apps without rendering, such as servers and tests, still load and style scenes.
        if app.get_sub_app(RenderApp).is_none() {
            return;
        }
        app.add_plugins((
            ExtractComponentPlugin::<SplatTonemapping>::default(),
            ExtractComponentPlugin::<SplatSortKey>::default(),
            ExtractComponentPlugin::<SplatCuts>::default(),
            ExtractComponentPlugin::<SplatEyes>::default(),
        ));
        app.sub_app_mut(RenderApp)
            .init_gpu_resource::<pipelines::SplatPipelines>()
            .init_gpu_resource::<view::SplatViews>()
            .add_systems(
                Render,
                (
                    // The usages of a texture are fixed when it is created.
                    view::allow_reading_depth.before(prepare_core_3d_depth_textures).run_if(device_serves),
                    // A scene that was uploaded in this frame is drawn in this frame.
                    view::prepare_views.after(upload_scenes).run_if(device_serves),
                )
                    .in_set(RenderSystems::PrepareResources),
            )
            .add_systems(
                Core3d,
                (
                    living::redraw_living.before(DrawsSplats).in_set(Core3dSystems::MainPass),
                    // After everything that writes depth, and before everything that is blended over it.
                    pass::draw_splats
                        .after(main_opaque_pass_3d)
                        .before(main_transparent_pass_3d)
                        .in_set(Core3dSystems::MainPass)
                        .in_set(DrawsSplats),
                    // Tonemapping must not see these colors: they are display-referred already.
                    pass::composite_after_tonemapping.after(tonemapping).in_set(Core3dSystems::PostProcess),
                ),
            );
        #[cfg(feature = "pbr")]
        // What transmissive materials refract has been drawn before.
        app.sub_app_mut(RenderApp)
            .configure_sets(Core3d, DrawsSplats.before(bevy::pbr::main_transmissive_pass_3d));
    }
}
