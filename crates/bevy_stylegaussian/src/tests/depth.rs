//! Depth of splats, as transparent meshes and other readers of the camera's depth find it.

use bevy::{
    camera::Viewport,
    core_pipeline::prepass::DepthPrepass,
    pbr::ScreenSpaceAmbientOcclusion,
    prelude::*,
    render::{RenderApp, renderer::RenderDevice},
};

use crate::splats::{Held, SplatDepth};

use super::{
    pictures::{EYE, GREEN, RED, SIZE, Studio, pixel},
    world::{rendering::*, *},
};

const WATER: [f32; 3] = [0.1, 0.2, 0.9];

/// A Gaussian so large that its alpha in the middle of the image is its opacity, and thin in z.
fn wall(z: f32, opacity: f32, color: [f32; 3]) -> Ball {
    Ball { mean: Vec3::new(0.0, 0.0, z), scale: 40.0, opacity, color }
}

/// Lets Bevy load the shaders of an effect, which are assets.
fn warm_up(studio: &mut Studio) {
    for _ in 0..40 {
        studio.app.update();
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

/// Whether there is water: more blue than red.
fn is_blue(color: [f32; 3]) -> bool {
    color[2] > color[0] + 0.05
}

/// Checks that two colors differ by at most two steps of 8 bits.
#[track_caller]
fn near(found: [f32; 3], expected: [f32; 3], what: &str) {
    let error = (0..3).map(|i| (found[i] - expected[i]).abs()).fold(0.0, f32::max);
    assert!(error <= 2.0 / 255.0, "{what}: found {found:?}, expected {expected:?}");
}

/// Panes of glass before an opaque wall, and behind it. With depth, only those before are seen, in views of one
/// sample and of four.
#[test]
fn glass_behind_splats_is_hidden_and_glass_before_them_is_not() {
    for msaa in [Msaa::Off, Msaa::Sample4] {
        let Some(mut studio) = Studio::new() else { return };
        let camera = studio.camera(EYE, msaa);
        studio.splats(balls(&[wall(0.0, 0.99, RED)]), Transform::default());
        studio.cuboid(Vec3::new(3.0, 8.0, 0.1), Vec3::new(-2.0, 0.0, 1.0), WATER, 0.5);
        studio.cuboid(Vec3::new(3.0, 8.0, 0.1), Vec3::new(2.0, 0.0, -1.0), WATER, 0.5);
        let before = studio.shoot();
        assert!(is_blue(pixel(&before, 16, 32)) && is_blue(pixel(&before, 48, 32)), "{msaa:?}");
        studio.app.world_mut().entity_mut(camera).insert(SplatDepth::default());
        let after = studio.shoot();
        near(pixel(&after, 16, 32), pixel(&before, 16, 32), "glass before the splat");
        near(pixel(&after, 48, 32), pixel(&before, 32, 32), "glass behind the splat");
        studio.app.world_mut().entity_mut(camera).remove::<SplatDepth>();
        assert_eq!(studio.shoot(), before, "{msaa:?}: without it, the picture is what it was");
    }
}

/// Two walls that let some of the light through: the threshold decides which of them is the surface, and glass
/// between the two is seen if it is the second.
#[test]
fn the_threshold_says_which_splat_is_the_surface() {
    let Some(mut studio) = Studio::new() else { return };
    let camera = studio.camera(EYE, Msaa::Off);
    // Light of 0.6 passes the first, and 0.24 both.
    studio.splats(balls(&[wall(1.0, 0.4, RED), wall(-1.0, 0.6, GREEN)]), Transform::default());
    studio.cuboid(Vec3::new(8.0, 8.0, 0.1), Vec3::ZERO, WATER, 0.5);
    let mut blue = |threshold: f32| {
        studio.app.world_mut().entity_mut(camera).insert(SplatDepth { threshold });
        pixel(&studio.shoot(), 32, 32)[2]
    };
    let (seen, hidden) = (blue(0.5), blue(0.7));
    assert!(seen > hidden + 0.1, "{seen} with the second wall as the surface, {hidden} with the first");
    assert_eq!([blue(0.1), blue(f32::NAN)], [seen; 2], "no surface, and the default");
}

/// A plane of water through a cloud, from above and from below: its upper half is behind opaque splats from
/// below, and before them from above.
#[test]
fn water_through_a_cloud_is_right_from_above_and_from_below() {
    let Some(mut studio) = Studio::new() else { return };
    // A rock in the water: a ball around the origin, of opaque splats as small as its skin is thick.
    let mut next = numbers(9);
    let rock: Vec<Ball> = (0..3000)
        .map(|_| {
            let mean = 1.5 * Vec3::new(next(), next(), next()).normalize();
            Ball { mean, scale: 0.08, opacity: 0.95, color: RED }
        })
        .collect();
    studio.splats(balls(&rock), Transform::default());
    studio.cuboid(Vec3::new(12.0, 0.02, 12.0), Vec3::ZERO, WATER, 0.6);
    let camera = studio.camera(EYE, (Msaa::Off, SplatDepth::default()));
    for height in [3.0, -3.0] {
        let eye = Vec3::new(0.0, height, 9.0);
        let at = Transform::from_translation(eye).looking_at(Vec3::ZERO, Vec3::Y);
        *studio.app.world_mut().get_mut::<Transform>(camera).unwrap() = at;
        let picture = studio.shoot();
        // The near half of the rock is dry on the eye's side of the water, and seen through it on the other.
        // 7.2 pixels to a unit: the rock reaches 11 pixels up and down.
        let (dry, wet) = if height > 0.0 { (25, 39) } else { (39, 25) };
        assert!(!is_blue(pixel(&picture, 32, dry)), "{height}: {:?} is dry", pixel(&picture, 32, dry));
        assert!(pixel(&picture, 32, wet)[2] > pixel(&picture, 32, dry)[2] + 0.1, "{height}: under water");
        assert!(is_blue(pixel(&picture, 60, 32)), "{height}: water beside the rock");
    }
}

/// Each camera has the depth that it asks for, in its own viewport of one picture.
#[test]
fn each_viewport_has_its_own_depth() {
    let Some(mut studio) = Studio::new() else { return };
    let camera = |x: u32, order: isize| Camera {
        viewport: Some(Viewport {
            physical_position: UVec2::new(x, 0),
            physical_size: UVec2::new(32, 64),
            ..default()
        }),
        order,
        clear_color: if order == 0 { Color::BLACK.into() } else { ClearColorConfig::None },
        ..default()
    };
    studio.camera(EYE, (Msaa::Off, camera(0, 0), SplatDepth::default()));
    studio.camera(EYE, (Msaa::Off, camera(32, 1)));
    studio.splats(balls(&[wall(0.0, 0.99, RED)]), Transform::default());
    studio.cuboid(Vec3::new(8.0, 8.0, 0.1), Vec3::new(0.0, 0.0, -1.0), WATER, 0.5);
    let picture = studio.shoot();
    assert!(!is_blue(pixel(&picture, 16, 32)), "left, with depth: {:?}", pixel(&picture, 16, 32));
    assert!(is_blue(pixel(&picture, 48, 32)), "right, without: {:?}", pixel(&picture, 48, 32));
}

/// A camera with ambient occlusion has splats in its prepass: a white floor is darker beside a wall of splats.
#[test]
fn ambient_occlusion_sees_splats() {
    let Some(mut studio) = Studio::new() else { return };
    let device = studio.app.sub_app(RenderApp).world().resource::<RenderDevice>();
    if device.limits().max_storage_textures_per_shader_stage < 5 {
        eprintln!("SKIPPED: the adapter has no ambient occlusion");
        return;
    }
    let eye = Vec3::new(0.0, 4.0, 8.0);
    let lit = AmbientLight { brightness: 2000.0, ..default() };
    let camera = studio.camera(eye, (Msaa::Off, lit, DepthPrepass, ScreenSpaceAmbientOcclusion::default()));
    let material = add(&mut studio.app, StandardMaterial { base_color: Color::WHITE, ..default() });
    let mesh = add(&mut studio.app, Mesh::from(Plane3d::new(Vec3::Y, Vec2::splat(6.0))));
    studio.app.world_mut().spawn((Mesh3d(mesh), MeshMaterial3d(material)));
    // An upright wall across the floor.
    let brick = |i: usize| {
        let (column, row) = (i % 30, i / 30);
        let mean = Vec3::new(0.15 * column as f32 - 2.2, 0.1 + 0.15 * row as f32, 0.0);
        Ball { mean, scale: 0.08, opacity: 0.95, color: RED }
    };
    studio.splats(balls(&(0..240).map(brick).collect::<Vec<_>>()), Transform::default());
    let floor = |studio: &mut Studio| -> f32 {
        let picture = studio.shoot();
        // The rows below the wall's foot, in the middle of the picture.
        (33..36).flat_map(|y| (26..38).map(move |x| (x, y))).map(|(x, y)| pixel(&picture, x, y)[1]).sum()
    };
    warm_up(&mut studio);
    let without = floor(&mut studio);
    studio.app.world_mut().entity_mut(camera).insert(SplatDepth::default());
    let with = floor(&mut studio);
    // Few of the rows are within its reach.
    assert!(with < 0.999 * without, "{with} with depth, {without} without");
}

/// A view that does not ask for depth requests nothing and holds nothing, and its picture does not change while
/// another view asks.
#[test]
fn depth_is_free_for_views_that_do_not_ask() {
    let Some(mut studio) = Studio::new() else { return };
    let other = render_target(&mut studio.app, SIZE);
    studio.camera(EYE, Msaa::Off);
    studio.splats(small_scene(80, 21), Transform::default());
    studio.cuboid(Vec3::new(8.0, 8.0, 0.1), Vec3::ZERO, WATER, 0.5);
    let before = studio.shoot();
    let held = |studio: &mut Studio| Held::of(studio.app.sub_app_mut(RenderApp).world_mut());
    assert_eq!(held(&mut studio).n_depths, 0);
    let asking = studio.camera_on(&other, -EYE, (Msaa::Off, SplatDepth::default()));
    assert_eq!(studio.shoot(), before);
    assert_eq!(held(&mut studio).n_depths, 1);
    studio.app.world_mut().despawn(asking);
    assert_eq!(studio.shoot(), before);
    assert_eq!(held(&mut studio).n_depths, 0);
}
