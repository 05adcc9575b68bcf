//! Cameras and entities as games use them, compared with the CPU rasterizer's picture: turned and mirrored
//! entities, places far away, cameras and targets that come, go and change their size, and HDR.

use bevy::{
    camera::{Hdr, RenderTarget},
    core_pipeline::tonemapping::Tonemapping,
    prelude::*,
    render::render_resource::Extent3d,
};
use stylegaussian::{Camera as Pinhole, Scene};

use crate::splats::{SplatSortKey, SplatTonemapping};

use super::{
    pictures::{
        EYE, FOV_Y, GREEN, RED, SIZE, Studio, check_picture, pixel, rasterized, reference, translucent,
    },
    world::{rendering::*, *},
};

/// Moves an entity or a camera.
fn place(studio: &mut Studio, entity: Entity, transform: Transform) {
    *studio.app.world_mut().get_mut::<Transform>(entity).unwrap() = transform;
}

/// The place of a camera that looks at the origin.
fn at(eye: Vec3) -> Transform {
    Transform::from_translation(eye).looking_at(Vec3::ZERO, Vec3::Y)
}

/// The rasterizer's camera of a picture of another size.
fn pinhole(eye: Vec3, size: UVec2) -> Pinhole {
    Pinhole::look_at(eye, Vec3::ZERO, Vec3::Y, FOV_Y, size)
}

#[test]
fn two_clouds_in_one_place_are_one_cloud_from_any_side() {
    let Some(mut studio) = Studio::new() else { return };
    let camera = studio.camera(EYE, Msaa::Off);
    let all = translucent(80, 5);
    // The second is stored elsewhere and turned, and its entity puts it in place.
    let world_from_second = Transform::from_xyz(0.5, -1.0, 2.0).with_rotation(Quat::from_rotation_y(1.1));
    let second_from_world = world_from_second.compute_affine().inverse();
    let moved = |ball: &Ball| Ball { mean: second_from_world.transform_point3(ball.mean), ..*ball };
    let second: Vec<Ball> = all[40..].iter().map(moved).collect();
    studio.splats(balls(&all[..40]), Transform::default());
    studio.splats(balls(&second), world_from_second);
    for eye in [EYE, -EYE, Vec3::new(10.0, 0.0, 0.0), Vec3::new(-6.0, 7.0, -4.0)] {
        place(&mut studio, camera, at(eye));
        check_picture(&format!("from {eye}"), &studio.shoot(), &reference(&balls(&all), eye));
    }
}

#[test]
fn a_flat_floor_is_drawn_at_a_grazing_angle() {
    let Some(mut studio) = Studio::new() else { return };
    let camera = studio.camera(EYE, Msaa::Off);
    let tile = |i: usize| {
        let (column, row) = (i % 16, i / 16);
        let mean = 0.5 * Vec3::new(column as f32 - 7.5, 0.0, row as f32 - 7.5);
        let color = if (column + row).is_multiple_of(2) { RED } else { GREEN };
        Ball { mean, scale: 0.2, opacity: 0.9, color }
    };
    let tiles: Vec<Ball> = (0..256).map(tile).collect();
    let floor = Scene { scales: vec![Vec3::new(0.2, 0.001, 0.2); 256], ..balls(&tiles) };
    studio.splats(floor.clone(), Transform::default());
    // From just above, from a little higher, and from below. Not along the grid: that would be ties in depth.
    for height in [0.1, 0.6, -0.3] {
        let eye = Vec3::new(1.3, height, 8.0);
        place(&mut studio, camera, at(eye));
        check_picture(&format!("{height} above the floor"), &studio.shoot(), &reference(&floor, eye));
    }
}

/// A mirrored scene looks like the mirrored picture from behind, in the colors that are seen from there.
#[test]
fn a_mirrored_entity_shows_the_mirrored_picture_in_its_colors() {
    let Some(mut studio) = Studio::new() else { return };
    let scene = small_scene(80, 8);
    studio.camera(EYE, (Msaa::Off, SplatSortKey::ViewZ));
    studio.splats(scene.clone(), Transform::from_scale(Vec3::new(1.0, 1.0, -1.0)));
    let behind = reference(&scene, -EYE);
    let rows = behind.chunks_exact(SIZE.x as usize);
    let expected: Vec<[f32; 3]> = rows.flat_map(|row| row.iter().rev().copied()).collect();
    check_picture("mirrored", &studio.shoot(), &expected);
    // Otherwise a mirror that is left out would not be found.
    let plain = psnr(&expected, &reference(&scene, EYE), |i| expected[i].iter().any(|&c| c > 0.02));
    assert!(plain < 36.0, "the scene looks the same without a mirror: {plain:.1} dB");
}

#[test]
fn a_child_of_a_turned_parent_turns_with_its_colors_once() {
    let Some(mut studio) = Studio::new() else { return };
    let scene = small_scene(80, 9);
    studio.camera(EYE, Msaa::Off);
    let parent = Transform::from_xyz(0.3, -0.2, 0.4).with_rotation(Quat::from_rotation_y(0.9));
    let child = Transform::from_xyz(-0.1, 0.2, 0.3).with_rotation(Quat::from_rotation_x(-0.6));
    let above = studio.app.world_mut().spawn((parent, Visibility::default())).id();
    let entity = studio.splats(scene.clone(), child);
    studio.app.world_mut().entity_mut(entity).insert(ChildOf(above));
    // Turning the scene is turning the camera the other way.
    let still = pinhole(EYE, SIZE);
    let world_from_scene = parent.compute_affine() * child.compute_affine();
    let camera = Pinhole { view_from_world: still.view_from_world * world_from_scene, ..still };
    check_picture("a child", &studio.shoot(), &rasterized(&scene, &camera));
}

#[test]
fn a_million_units_from_the_origin_the_picture_is_the_same() {
    let Some(mut studio) = Studio::new() else { return };
    let (scene, eye) = (small_scene(80, 10), Vec3::new(6.0, 3.0, 7.0));
    let camera = studio.camera(eye, Msaa::Off);
    let entity = studio.splats(scene.clone(), Transform::default());
    let near = studio.shoot();
    check_picture("at the origin", &near, &reference(&scene, eye));
    // Numbers of this size are 1/16 apart, so these sums are exact.
    let away = Vec3::new(1e6, -1e6, 1e6);
    for moved in [camera, entity] {
        studio.app.world_mut().get_mut::<Transform>(moved).unwrap().translation += away;
    }
    check_picture("a million units away", &studio.shoot(), &near);
}

/// A scene of 2,000 units, at last five times as far away as a camera's `far`, which Bevy does not cull by.
#[test]
fn a_camera_moves_back_five_thousand_units() {
    let Some(mut studio) = Studio::new() else { return };
    let (scene, factor) = (small_scene(80, 11), 1000.0);
    let camera = studio.camera(EYE, Msaa::Off);
    studio.splats(scene.clone(), Transform::from_scale(Vec3::splat(factor)));
    let large = Scene {
        means: scene.means.iter().map(|mean| factor * mean).collect(),
        scales: scene.scales.iter().map(|scale| factor * scale).collect(),
        ..scene
    };
    for distance in [2000.0, 3500.0, 5000.0] {
        let eye = Vec3::Z * distance;
        place(&mut studio, camera, at(eye));
        check_picture(&format!("{distance} units back"), &studio.shoot(), &reference(&large, eye));
    }
}

#[test]
fn a_camera_flies_through_splats() {
    let Some(mut studio) = Studio::new() else { return };
    let scene = small_scene(80, 13);
    let camera = studio.camera(EYE, Msaa::Off);
    studio.splats(scene.clone(), Transform::default());
    for step in 0..12 {
        let eye = Vec3::new(0.1, 0.05, 2.0 - 0.3 * step as f32);
        place(&mut studio, camera, Transform::from_translation(eye));
        let ahead = Pinhole::look_at(eye, eye + Vec3::NEG_Z, Vec3::Y, FOV_Y, SIZE);
        let psnr = psnr(&studio.shoot(), &rasterized(&scene, &ahead), |_| true);
        assert!(psnr > 38.0, "step {step}: {psnr:.1} dB");
    }
}

#[test]
fn a_target_shrinks_to_a_pixel_becomes_wide_vanishes_and_comes_back() {
    let Some(mut studio) = Studio::new() else { return };
    let scene = small_scene(80, 12);
    let camera = studio.camera(EYE, Msaa::Off);
    studio.splats(scene.clone(), Transform::default());
    let image = studio.image.clone();
    for size in [UVec2::ONE, UVec2::new(192, 64), UVec2::new(64, 192), UVec2::ONE, SIZE] {
        let extent = Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 };
        studio.app.world_mut().resource_mut::<Assets<Image>>().get_mut(&image).unwrap().resize(extent);
        let found = studio.shoot();
        assert_eq!(found.len(), size.element_product() as usize);
        if size != UVec2::ONE {
            check_picture(&format!("{size} pixels"), &found, &rasterized(&scene, &pinhole(EYE, size)));
        }
    }
    // A minimized window has no pixels.
    studio.app.world_mut().entity_mut(camera).insert(RenderTarget::None { size: UVec2::ZERO });
    (0..3).for_each(|_| studio.app.update());
    studio.app.world_mut().entity_mut(camera).insert(target(&image));
    check_picture("back again", &studio.shoot(), &reference(&scene, EYE));
}

/// Two targets stand for two windows.
#[test]
fn another_camera_takes_over_beside_a_second_window() {
    let Some(mut studio) = Studio::new() else { return };
    let scene = small_scene(80, 14);
    let other = render_target(&mut studio.app, SIZE);
    let first = studio.camera(EYE, Msaa::Off);
    studio.camera_on(&other, -EYE, Msaa::Off);
    studio.splats(scene.clone(), Transform::default());
    check_picture("the first camera", &studio.shoot(), &reference(&scene, EYE));
    studio.app.world_mut().despawn(first);
    let eye = Vec3::new(7.0, 5.0, 5.0);
    let next = studio.camera(eye, Msaa::Off);
    check_picture("the next camera", &studio.shoot(), &reference(&scene, eye));
    check_picture("the second window", &studio.shoot_on(&other), &reference(&scene, -EYE));
    studio.app.world_mut().despawn(next);
    check_picture("the second window alone", &studio.shoot_on(&other), &reference(&scene, -EYE));
}

#[test]
fn a_texture_of_another_size_and_sample_count_is_drawn_beside_the_main_camera() {
    let Some(mut studio) = Studio::new() else { return };
    let (scene, size, eye) = (balls(&translucent(60, 15)), UVec2::new(48, 24), Vec3::new(0.0, 6.0, 8.0));
    let texture = render_target(&mut studio.app, size);
    studio.camera(EYE, Msaa::Sample4);
    // Before the main camera, as a texture that a mesh shows.
    let order = Camera { clear_color: Color::BLACK.into(), order: -1, ..default() };
    studio.camera_on(&texture, eye, (Msaa::Off, order));
    studio.splats(scene.clone(), Transform::default());
    for frame in ["at first", "afterwards"] {
        check_picture(&format!("main {frame}"), &studio.shoot(), &reference(&scene, EYE));
        let expected = rasterized(&scene, &pinhole(eye, size));
        check_picture(&format!("texture {frame}"), &studio.shoot_on(&texture), &expected);
    }
}

/// White balls over and beside a white box: no pixel becomes darker than it was without them.
#[test]
fn white_splats_on_a_white_mesh_have_no_dark_fringe() {
    let modes = [
        (false, Tonemapping::None, SplatTonemapping::Invert),
        (true, Tonemapping::None, SplatTonemapping::Invert),
        (true, Tonemapping::TonyMcMapface, SplatTonemapping::Invert),
        (true, Tonemapping::TonyMcMapface, SplatTonemapping::Bypass),
    ];
    for msaa in [Msaa::Off, Msaa::Sample4] {
        let Some(mut studio) = Studio::new() else { return };
        studio.cuboid(Vec3::splat(4.0), Vec3::new(0.0, 0.0, -2.0), [1.0; 3], 1.0);
        let targets = modes.map(|(is_hdr, tonemapping, splats)| {
            let image = render_target(&mut studio.app, SIZE);
            let white = Camera { clear_color: Color::WHITE.into(), ..default() };
            let camera = studio.camera_on(&image, EYE, (msaa, white, tonemapping, splats));
            if is_hdr {
                studio.app.world_mut().entity_mut(camera).insert(Hdr);
            }
            image
        });
        let before: Vec<_> = targets.iter().map(|image| studio.shoot_on(image)).collect();
        // Before the box, through its face, over its edges and beside it.
        let ball = |x: f32, z: f32| Ball {
            mean: Vec3::new(x, 0.7 * x, z),
            scale: 0.4,
            opacity: 0.9,
            color: [1.0; 3],
        };
        let scene = [ball(0.0, 1.0), ball(1.0, 0.0), ball(-2.0, 0.2), ball(2.0, -2.0), ball(-3.2, 0.0)];
        studio.splats(balls(&scene), Transform::default());
        for ((image, before), mode) in targets.iter().zip(&before).zip(&modes) {
            let after = studio.shoot_on(image);
            let darker = before.as_flattened().iter().zip(after.as_flattened()).map(|(b, a)| b - a);
            let darkest = darker.fold(0.0, f32::max);
            // Two steps of 8 bits, and one of the noise that hides bands.
            assert!(darkest <= 3.0 / 255.0, "{msaa:?}, {mode:?}: {darkest} darker");
        }
        // White of a screen is brighter than a white that is tonemapped: they are drawn.
        let drawn = pixel(&studio.shoot_on(&targets[3]), 32, 32)[1] - pixel(&before[3], 32, 32)[1];
        assert!(drawn > 0.02, "{msaa:?}: {drawn} brighter");
    }
}

/// Colors that every curve can show. In the middle of opaque balls: where splats fade, an HDR camera blends
/// before its tonemapping, and others after.
#[test]
fn hdr_changes_no_color_under_any_tonemapping() {
    let Some(mut studio) = Studio::new() else { return };
    let hdr = render_target(&mut studio.app, SIZE);
    let cameras = [
        studio.camera(EYE, Msaa::Off),
        studio.camera_on(&hdr, EYE, (Msaa::Off, Hdr, SplatTonemapping::Invert)),
    ];
    let colors = [[0.55, 0.45, 0.4], [0.5, 0.5, 0.5], [0.35, 0.42, 0.5]];
    let ball = |i: usize| Ball {
        mean: Vec3::X * (2.9 * i as f32 - 2.9),
        scale: 0.8,
        opacity: 0.99,
        color: colors[i],
    };
    studio.splats(balls(&[0, 1, 2].map(ball)), Transform::default());
    let curves = [
        (Tonemapping::None, 0.012),
        (Tonemapping::Reinhard, 0.012),
        (Tonemapping::ReinhardLuminance, 0.012),
        // Curves without an inverse are undone by a table.
        (Tonemapping::AcesFitted, 0.04),
        (Tonemapping::AgX, 0.04),
        (Tonemapping::SomewhatBoringDisplayTransform, 0.04),
        (Tonemapping::TonyMcMapface, 0.04),
        (Tonemapping::BlenderFilmic, 0.04),
        (Tonemapping::KhronosPbrNeutral, 0.04),
    ];
    for (tonemapping, tolerance) in curves {
        for camera in cameras {
            *studio.app.world_mut().get_mut::<Tonemapping>(camera).unwrap() = tonemapping;
        }
        let (plain, hdr) = (studio.shoot(), studio.shoot_on(&hdr));
        // 7.57 pixels to a unit.
        for (x, color) in [10, 32, 54].into_iter().zip(colors) {
            for (what, found) in [("without", pixel(&plain, x, 32)), ("with", pixel(&hdr, x, 32))] {
                let error = (0..3).map(|i| (found[i] - color[i]).abs()).fold(0.0, f32::max);
                assert!(error < tolerance, "{tonemapping:?} {what} HDR: found {found:?}, expected {color:?}");
            }
        }
    }
}
