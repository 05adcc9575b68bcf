//! Splats: how scenes are drawn, whatever their style.
//!
//! - Components of cameras: [`SplatTonemapping`] and [`SplatSortKey`] say how their colors and their order come
//!   about, [`SplatCuts`] what is left out on weak GPUs. [`SplatDepth`] writes depth. [`SplatEyes`] makes two
//!   cameras the eyes of one head.
//! - Components of scenes: [`SplatShadows`] and [`SplatCaster`].

// The colors are those of `crate::colors`. Each frame plans the views (`view`), finds their light (`light`) and
// builds missing pipelines in the background (`pipelines`). Splats that cast shadows are drawn into the maps of
// lights (`cast`). Each camera then runs the splat pass (`pass`), and writes depth if it is asked for
// (`depth`). Styles are none of this room's business.

use bevy::{
    core_pipeline::{
        Core3d, Core3dSystems,
        core_3d::{main_opaque_pass_3d, main_transparent_pass_3d, prepare_core_3d_depth_textures},
        prepass::node::late_prepass,
        tonemapping::tonemapping,
    },
    prelude::*,
    render::{
        ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderSystems,
        extract_component::ExtractComponentPlugin,
    },
};

use crate::scene::{device_serves, upload_scenes};

#[cfg(feature = "pbr")]
mod air;
#[cfg(not(feature = "pbr"))]
#[path = "no_air.rs"]
mod air;
mod camera;
#[cfg(feature = "pbr")]
mod cast;
mod caster;
mod cuts;
mod depth;
mod eyes;
mod fade;
#[cfg(test)]
mod held;
mod light;
mod living;
mod pass;
mod pipelines;
#[cfg(feature = "pbr")]
mod sky;
mod view;

pub use camera::{SplatSortKey, SplatTonemapping};
pub use caster::SplatCaster;
pub use cuts::SplatCuts;
pub use depth::SplatDepth;
pub use eyes::SplatEyes;
pub use light::SplatShadows;

pub(crate) use fade::SplatFade;

#[cfg(test)]
pub(crate) use held::Held;

/// The system that draws splats into the main pass.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
struct DrawsSplats;

/// The systems that draw splats into shadow maps. They come after meshes have been drawn there.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
struct CastsShadows;

/// Draws [`GaussianSplats`](crate::GaussianSplats).
pub(crate) struct SplatsPlugin;

impl Plugin for SplatsPlugin {
    fn build(&self, app: &mut App) {
        app.register_type::<SplatTonemapping>()
            .register_type::<SplatSortKey>()
            .register_type::<SplatDepth>()
            .register_type::<SplatCuts>()
            .register_type::<SplatEyes>()
            .register_type::<SplatShadows>()
            .register_type::<SplatCaster>();
        // Apps without rendering, such as servers and tests, still load and style scenes.
        if app.get_sub_app(RenderApp).is_none() {
            return;
        }
        app.add_plugins((
            ExtractComponentPlugin::<SplatTonemapping>::default(),
            ExtractComponentPlugin::<SplatSortKey>::default(),
            ExtractComponentPlugin::<SplatDepth>::default(),
            ExtractComponentPlugin::<SplatCuts>::default(),
            ExtractComponentPlugin::<SplatEyes>::default(),
        ));
        app.sub_app_mut(RenderApp)
            .init_gpu_resource::<pipelines::SplatPipelines>()
            .init_gpu_resource::<view::SplatViews>()
            .init_gpu_resource::<light::SplatLights>()
            .init_resource::<light::CloudLights>()
            .init_resource::<fade::CloudFades>()
            .add_systems(ExtractSchedule, (light::extract_cloud_lights, fade::extract_fades))
            .init_gpu_resource::<depth::SplatDepths>()
            .add_systems(
                Render,
                (
                    // The usages of a texture are fixed when it is created.
                    view::allow_reading_depth.before(prepare_core_3d_depth_textures).run_if(device_serves),
                    // A scene that was uploaded in this frame is drawn in this frame.
                    view::prepare_views.after(upload_scenes).run_if(device_serves),
                    // The passes that its pipelines are parts of have been requested.
                    light::prepare_lights.after(view::prepare_views).run_if(device_serves),
                    depth::prepare_depths.after(view::prepare_views).run_if(device_serves),
                )
                    .in_set(RenderSystems::PrepareResources),
            )
            .add_systems(
                Core3d,
                (
                    // Before the main pass, since ambient occlusion reads the depth of the prepass. Its light
                    // reads shadow maps.
                    pass::sort_splats.after(CastsShadows).in_set(Core3dSystems::Prepass),
                    depth::write_prepass_depth
                        .after(late_prepass)
                        .after(pass::sort_splats)
                        .in_set(Core3dSystems::Prepass),
                    living::redraw_living.before(DrawsSplats).in_set(Core3dSystems::MainPass),
                    // After everything that writes depth, and before everything that is blended over it.
                    pass::draw_splats
                        .after(main_opaque_pass_3d)
                        .before(main_transparent_pass_3d)
                        .in_set(Core3dSystems::MainPass)
                        .in_set(DrawsSplats),
                    depth::write_view_depth
                        .after(pass::draw_splats)
                        .before(main_transparent_pass_3d)
                        .in_set(Core3dSystems::MainPass)
                        .in_set(DrawsSplats),
                    pass::lift_before_tonemapping.before(tonemapping).in_set(Core3dSystems::PostProcess),
                    // Tonemapping must not see these colors: they are display-referred already.
                    pass::composite_after_tonemapping.after(tonemapping).in_set(Core3dSystems::PostProcess),
                ),
            );
        #[cfg(feature = "pbr")]
        {
            let render_app = app.sub_app_mut(RenderApp);
            render_app.add_systems(
                Core3d,
                air::light_in_atmosphere.before(DrawsSplats).in_set(Core3dSystems::MainPass),
            );
            // What transmissive materials refract has been drawn before.
            render_app.configure_sets(Core3d, DrawsSplats.before(bevy::pbr::main_transmissive_pass_3d));
            cast::add_to(render_app);
        }
    }

    #[cfg(feature = "pbr")]
    fn finish(&self, app: &mut App) {
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            sky::draw_over(render_app, DrawsSplats.intern());
        }
    }
}
