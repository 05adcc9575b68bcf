//! The example `stereo`: an eye sees the same in its half of an image as alone.

#[expect(dead_code, reason = "an example is a program; its projection is what is tested")]
#[path = "../examples/stereo.rs"]
mod stereo;
#[path = "../crates/bevy_stylegaussian/src/tests/world/mod.rs"]
mod world;

use bevy::{camera::Viewport, core_pipeline::tonemapping::Tonemapping, prelude::*};
// `world` is written for the plugin's own tests and finds these names in its crate.
use bevy_stylegaussian::{
    GaussianScene, GaussianSplats, StyleGaussianPlugin, StyleThreads,
    style::{self, decoder::StyleBackend},
};
use stereo::OffAxis;
use world::{add_scene, rendering::*, small_scene};

/// One eye's picture, in pixels.
const SIZE: UVec2 = UVec2::new(96, 80);

/// An eye `x` beside the middle, its screen 6 away.
fn eye(x: f32) -> impl Bundle {
    // The half size is a tangent: 0.3 at distance 1 is 1.8 at the distance of the screen.
    let projection = OffAxis { half_size: Vec2::splat(0.3), middle: Vec2::new(-x / 6.0, 0.0), near: 0.1 };
    let place = Transform::from_xyz(x, 0.3, 6.0);
    (Camera3d::default(), Projection::custom(projection), Tonemapping::None, place)
}

fn app() -> Option<App> {
    let mut app = app_with_rendering(StyleBackend::Cpu)?;
    let scene = add_scene(&mut app, small_scene(400, 7));
    app.world_mut().spawn(GaussianSplats(scene));
    Some(app)
}

/// Spawns cameras on one picture, draws, and gives the picture's colors.
fn picture(size: UVec2, cameras: impl IntoIterator<Item = (f32, Option<Viewport>)>) -> Option<Vec<[f32; 3]>> {
    let mut app = app()?;
    let image = render_target(&mut app, size);
    for (order, (x, viewport)) in cameras.into_iter().enumerate() {
        let clear_color = if order == 0 { Color::BLACK.into() } else { ClearColorConfig::None };
        let camera = Camera { order: order as isize, viewport, clear_color, ..default() };
        app.world_mut().spawn((eye(x), target(&image), camera));
    }
    (0..3).for_each(|_| app.update());
    Some(read_back(&app, &image).iter().map(|&[r, g, b, _]| [r, g, b]).collect())
}

#[test]
fn each_eye_sees_what_it_sees_alone() {
    let eyes = [-0.4, 0.4];
    let half = |i: u32| {
        let physical_position = UVec2::new(i * SIZE.x, 0);
        Some(Viewport { physical_position, physical_size: SIZE, ..default() })
    };
    let both = [(eyes[0], half(0)), (eyes[1], half(1))];
    let Some(both) = picture(SIZE * UVec2::new(2, 1), both) else { return };
    let alone = eyes.map(|x| picture(SIZE, [(x, None)]).expect("there was an adapter a moment ago"));
    for (i, alone) in alone.iter().enumerate() {
        let rows = both.chunks_exact(2 * SIZE.x as usize);
        let half: Vec<[f32; 3]> =
            rows.flat_map(|row| &row[i * SIZE.x as usize..][..SIZE.x as usize]).copied().collect();
        let n_seen = alone.iter().filter(|color| color.iter().sum::<f32>() > 0.1).count();
        assert!(n_seen > alone.len() / 10, "eye {i} sees hardly anything: {n_seen} pixels");
        // The smallest difference that 8 bits can show, in a single value, keeps equal pictures finite.
        let psnr = psnr(&half, alone, |_| true).min(99.0);
        eprintln!("eye {i}: {psnr:.1} dB");
        assert!(psnr >= 50.0, "eye {i}: {psnr:.1} dB");
    }
    let difference = psnr(&alone[0], &alone[1], |_| true);
    // Otherwise two identical pictures would pass the test above.
    assert!(difference < 40.0, "the eyes see the same: {difference:.1} dB");
}
