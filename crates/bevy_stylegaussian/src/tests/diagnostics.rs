//! The passes are among Bevy's render diagnostics.

use bevy::{
    camera::Hdr,
    diagnostic::{DiagnosticPath, DiagnosticsStore},
    prelude::*,
    render::diagnostic::RenderDiagnosticsPlugin,
};

use crate::{GaussianSplats, SplatTonemapping, StyleBackend, StyleBudget, StyleGaussianPlugin, StyleSource};

use super::world::{rendering::*, *};

#[test]
fn every_pass_has_a_span() {
    let Some(mut app) = app_without_splats(default()) else { return };
    // Bevy keeps the measurements of the latest frame alone. A budget of zero spreads the style over many
    // frames, so that some of them are seen.
    app.insert_resource(StyleBackend::Gpu).insert_resource(StyleBudget { ms_per_frame: 0.0 });
    app.add_plugins((
        RenderDiagnosticsPlugin,
        StyleGaussianPlugin { synchronous_pipeline_compilation: true },
    ));
    let mut app = finish(app);
    let image = render_target(&mut app, UVec2::splat(16));
    // `SplatTonemapping` requires a `Camera3d`, which brings a tonemapping. So the layer is composited after
    // it.
    let place = Transform::from_xyz(0.0, 0.0, 5.0);
    app.world_mut().spawn((SplatTonemapping::Bypass, Hdr, target(&image), place));
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(1000, 1)));
    app.world_mut().spawn((splats, StyleSource::preset(style)));
    for name in ["splat_project_and_sort", "splat_draw", "splat_composite", "style_pass"] {
        let path = DiagnosticPath::from_components(["render", name, "elapsed_cpu"]);
        update_until(&mut app, name, |world| {
            world.resource::<DiagnosticsStore>().get_measurement(&path).is_some()
        });
    }
}
