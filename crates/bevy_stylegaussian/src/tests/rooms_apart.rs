//! Splats are shown without the style plugin.

use bevy::prelude::*;

use crate::{GaussianSceneFailed, GaussianSplats, StyleSource, plugin::GaussianSplatsPlugin};

use super::world::{rendering::*, *};

#[test]
fn splats_need_no_styles() {
    let Some(mut app) = app_without_splats(default()) else { return };
    app.add_plugins(GaussianSplatsPlugin { synchronous_pipeline_compilation: true });
    let mut app = finish(app);
    let image = render_target(&mut app, UVec2::splat(16));
    let place = Transform::from_xyz(0.0, 0.0, 4.0);
    app.world_mut().spawn((
        Camera3d::default(),
        Camera { clear_color: Color::BLACK.into(), ..default() },
        target(&image),
        place,
    ));
    let splats = GaussianSplats(add_scene(&mut app, small_scene(100, 1)));
    let entity = app.world_mut().spawn(splats).id();
    for _ in 0..3 {
        app.update();
    }
    let light: f32 = read_back(&app, &image).iter().map(|pixel| pixel[..3].iter().sum::<f32>()).sum();
    assert!(light > 1.0, "{light}");
    assert!(!app.world().entity(entity).contains::<StyleSource>());
    // Failures of scenes are reported, too.
    let mut broken = small_scene(8, 1);
    // One array is shorter than the others: no file gives this, but a program may.
    broken.scales.pop();
    let broken = GaussianSplats(add_scene(&mut app, broken));
    app.world_mut().spawn(broken);
    app.update();
    assert_eq!(drain::<GaussianSceneFailed>(&mut app).len(), 1);
}
