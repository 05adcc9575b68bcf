//! The passes are among Bevy's render diagnostics.

use bevy::{
    camera::Hdr,
    diagnostic::{DiagnosticPath, DiagnosticsStore},
    prelude::*,
    render::diagnostic::RenderDiagnosticsPlugin,
};

use crate::{
    GaussianSplats, StyleGaussianPlugin, StyleSource,
    splats::SplatTonemapping,
    style::decoder::{StyleBackend, StyleBudget},
};

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
        until_measured(&mut app, name);
    }
}

fn path(name: &'static str) -> DiagnosticPath {
    DiagnosticPath::from_components(["render", name, "elapsed_cpu"])
}

fn until_measured(app: &mut App, name: &'static str) {
    update_until(app, name, |world| {
        world.resource::<DiagnosticsStore>().get_measurement(&path(name)).is_some()
    });
}

#[test]
fn two_views_have_spans_of_their_own_and_a_view_keeps_its_name() {
    let Some(mut app) = app_without_splats(default()) else { return };
    app.add_plugins((
        RenderDiagnosticsPlugin,
        StyleGaussianPlugin { synchronous_pipeline_compilation: true },
    ));
    let mut app = finish(app);
    let cameras = [0.0, 0.1].map(|x| {
        let image = render_target(&mut app, UVec2::splat(16));
        let place = Transform::from_xyz(x, 0.0, 5.0);
        app.world_mut().spawn((Camera3d::default(), target(&image), place)).id()
    });
    let splats = GaussianSplats(add_scene(&mut app, small_scene(1000, 1)));
    app.world_mut().spawn(splats);
    for name in ["splat_project_and_sort", "splat_draw", "splat_composite"] {
        until_measured(&mut app, name);
    }
    for name in ["splat_project_and_sort_2", "splat_draw_2", "splat_composite_2"] {
        until_measured(&mut app, name);
    }
    assert!(app.world().resource::<DiagnosticsStore>().get(&path("splat_draw_3")).is_none());
    // The second camera alone.
    app.world_mut().despawn(cameras[0]);
    let measured = |app: &App, name| {
        let diagnostics = app.world().resource::<DiagnosticsStore>();
        diagnostics.get_measurement(&path(name)).map(|measurement| measurement.time)
    };
    (0..5).for_each(|_| app.update());
    let (first, second) = (measured(&app, "splat_draw"), measured(&app, "splat_draw_2"));
    update_until(&mut app, "splat_draw_2 again", |world| {
        let diagnostics = world.resource::<DiagnosticsStore>();
        diagnostics.get_measurement(&path("splat_draw_2")).map(|measurement| measurement.time) != second
    });
    assert_eq!(measured(&app, "splat_draw"), first, "a view took over another one's name");
}
