//! Frames in which nothing changes only draw.

use bevy::{prelude::*, render::RenderApp};

use crate::{
    GaussianSplats, StyleApplied, StyleSource,
    mask::{MaskVisibility, StyleMask},
    splats::Held,
    style::decoder::StyleBackend,
};

use super::world::{rendering::*, *};

/// Allocations of the device, and the objects of the splat pass.
fn held(app: &mut App) -> (Option<Allocations>, Held) {
    (allocations(app), Held::of(app.sub_app_mut(RenderApp).world_mut()))
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
    // Scratch memory of the style pass is freed after two seconds; frames in flight hold buffers of their own.
    std::thread::sleep(std::time::Duration::from_millis(2100));
    for _ in 0..5 {
        app.update();
        // Waits for the GPU, so that one frame at a time is in flight.
        allocations(&app);
    }
    let before = held(&mut app);
    // Otherwise the comparisons below could hold over nothing.
    assert_eq!(before.1.layers.len(), 1, "expected one layer");
    for frame in 0..20 {
        app.update();
        assert_eq!(held(&mut app), before, "frame {frame}");
    }
}

/// The kernel that hides is compiled when a mask comes, and not in the frame that first hides something.
#[test]
fn masks_are_prepared_before_they_hide() {
    let Some(mut app) = app_with_rendering(StyleBackend::Gpu) else { return };
    let image = render_target(&mut app, UVec2::splat(16));
    app.world_mut().spawn((Camera3d::default(), target(&image), Transform::from_xyz(0.0, 0.0, 5.0)));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(64, 1)));
    let entity = app.world_mut().spawn(splats).id();
    let n_pipelines = |app: &mut App| {
        (0..5).for_each(|_| app.update());
        held(app).1.n_pipelines
    };
    let before = n_pipelines(&mut app);
    app.world_mut().entity_mut(entity).insert(StyleMask::default());
    assert_eq!(n_pipelines(&mut app), before + 1, "with a mask that hides nothing");
    app.world_mut().entity_mut(entity).insert(MaskVisibility::Hide(0));
    assert_eq!(n_pipelines(&mut app), before + 1, "with a mask that hides");
}
