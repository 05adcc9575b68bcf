//! What frames do in which nothing changes: draw.

use bevy::{
    prelude::*,
    render::{RenderApp, view::ExtractedView},
};

use super::{pipelines::SplatPipelines, view::SplatViews};
use crate::{
    GaussianSplats, StyleApplied, StyleBackend, StyleSource,
    world::{rendering::*, *},
};

/// What the device holds, how many pipelines were asked for, and where the view's layer is.
fn held(app: &mut App) -> (Option<Allocations>, usize, Vec<usize>) {
    let allocations = allocations(app);
    let world = app.sub_app_mut(RenderApp).world_mut();
    let n_pipelines = world.resource::<SplatPipelines>().n_requested();
    let views: Vec<_> =
        world.query::<&ExtractedView>().iter(world).map(|view| view.retained_view_entity).collect();
    let views = views.iter().filter_map(|view| world.resource::<SplatViews>().get(view));
    let layers = views.filter_map(|view| Some(std::ptr::from_ref(view.layer()?.0).addr())).collect();
    (allocations, n_pipelines, layers)
}

#[test]
fn still_frames_build_and_allocate_nothing() {
    let Some(mut app) = app_with_rendering(StyleBackend::Gpu) else { return };
    let image = render_target(&mut app, UVec2::splat(16));
    app.world_mut().spawn((Camera3d::default(), target(&image), Transform::from_xyz(0.0, 0.0, 5.0)));
    let style = add_style(&mut app, small_style(1));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(64, 1)));
    app.world_mut().spawn((splats, StyleSource::preset(style)));
    update_until(&mut app, "StyleApplied", |world| !world.resource::<Messages<StyleApplied>>().is_empty());
    // Memory of the style pass is given back after a while; frames in flight hold buffers of their own.
    std::thread::sleep(std::time::Duration::from_millis(2100));
    for _ in 0..5 {
        app.update();
        allocations(&app);
    }
    let before = held(&mut app);
    assert_eq!(before.2.len(), 1, "there is no layer");
    for frame in 0..20 {
        app.update();
        assert_eq!(held(&mut app), before, "frame {frame}");
    }
}
