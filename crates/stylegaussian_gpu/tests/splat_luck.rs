//! The splat pass with bad input and bad luck: no panic, no validation error, and nothing drawn that should not
//! be.

mod pictures;
mod target;

use glam::{Affine3A, Mat3, Mat4, Quat, UVec2, UVec4, Vec3};
use pictures::{camera, draw, draw_both_ways, random_scene, scene};
use stylegaussian::{Scene, splat::Colors};
use stylegaussian_gpu::{
    buffers::TooLarge,
    colors::GaussianColors,
    device::HeadlessDevice,
    splat::{
        Camera, Cloud, CloudColors, GpuScene, Headless, HeadlessError, SplatError, SplatSettings, SplatView,
    },
};
use target::{gpu, gpu_with_limits};

const SIZE: UVec2 = UVec2::new(32, 24);

fn default_camera() -> Camera {
    Camera::pinhole(&camera(SIZE))
}

/// Coverage of a picture, summed over its pixels. Fails on numbers that are not finite.
fn coverage(gpu: &HeadlessDevice, camera: &Camera, clouds: &[(&Scene, Affine3A)]) -> f32 {
    let clouds: Vec<_> = clouds.iter().map(|&(scene, place)| (scene, Colors::Captured, place)).collect();
    let pictures = draw_both_ways(gpu, camera, &clouds, &SplatSettings::default());
    assert!(pictures.iter().all(|picture| picture.rgba.as_flattened().iter().all(|x| x.is_finite())));
    let [picture, by_quads] = pictures.map(|picture| picture.rgba.iter().map(|pixel| pixel[3]).sum::<f32>());
    assert_eq!(picture > 0.0, by_quads > 0.0, "{picture} and by quads {by_quads}");
    picture
}

#[test]
fn empty_scenes_show_nothing() {
    let Some(gpu) = gpu() else { return };
    let empty = Scene::default();
    assert_eq!(coverage(&gpu, &default_camera(), &[]), 0.0);
    assert_eq!(coverage(&gpu, &default_camera(), &[(&empty, Affine3A::IDENTITY)]), 0.0);
    let one = scene(&[(Vec3::new(0.0, 0.1, 2.0), Vec3::splat(0.2), 0.8)]);
    let alone = coverage(&gpu, &default_camera(), &[(&one, Affine3A::IDENTITY)]);
    assert!(alone > 1.0);
    let with_empty = [(&empty, Affine3A::IDENTITY), (&one, Affine3A::IDENTITY)];
    assert_eq!(coverage(&gpu, &default_camera(), &with_empty), alone);
}

#[test]
fn degenerate_transforms_show_nothing() {
    let Some(gpu) = gpu() else { return };
    let scene = random_scene(300, 1, 1);
    let flat = Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.0));
    let nan = Affine3A::from_translation(Vec3::new(0.0, f32::NAN, 0.0));
    let infinite = Affine3A::from_scale(Vec3::splat(f32::INFINITY));
    let overflowing = Affine3A::from_scale(Vec3::splat(1e20));
    for place in [Affine3A::from_scale(Vec3::ZERO), flat, nan, infinite, overflowing] {
        assert_eq!(coverage(&gpu, &default_camera(), &[(&scene, place)]), 0.0, "{place:?}");
    }
}

#[test]
fn extreme_transforms_are_survived() {
    let Some(gpu) = gpu() else { return };
    let scene = random_scene(300, 1, 2);
    let away = Vec3::new(0.0, 0.0, 2.0);
    for scale in [1e-12, 1e-3, 1e5, 1e10] {
        let place = Affine3A::from_scale_rotation_translation(Vec3::splat(scale), Quat::IDENTITY, away);
        coverage(&gpu, &default_camera(), &[(&scene, place)]);
        let thin = Affine3A::from_scale(Vec3::new(1.0, 1.0 / scale, 1.0));
        coverage(&gpu, &default_camera(), &[(&scene, thin)]);
    }
    let mirrored = Affine3A::from_mat3(Mat3::from_diagonal(Vec3::new(-1.0, 1.0, 1.0)));
    assert!(coverage(&gpu, &default_camera(), &[(&scene, mirrored)]) > 1.0);
}

#[test]
fn gaussians_that_are_not_finite_show_nothing() {
    let Some(gpu) = gpu() else { return };
    let visible = (Vec3::new(0.0, 0.1, 2.0), Vec3::splat(0.2), 0.8);
    let expected = coverage(&gpu, &default_camera(), &[(&scene(&[visible]), Affine3A::IDENTITY)]);
    let mut broken = scene(&[visible; 6]);
    broken.means[0].x = f32::NAN;
    broken.scales[1].y = f32::INFINITY;
    broken.rotations[2] = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    broken.opacities[3] = f32::NAN;
    broken.opacities[4] = 1.0 / 256.0;
    assert_eq!(coverage(&gpu, &default_camera(), &[(&broken, Affine3A::IDENTITY)]), expected);
}

/// Cameras inside the scene, and inside one Gaussian that is larger than the scene.
#[test]
fn cameras_stand_inside_gaussians() {
    let Some(gpu) = gpu() else { return };
    let mut scene = random_scene(500, 0, 3);
    scene.scales[0] = Vec3::splat(1e6);
    scene.opacities[0] = 1.0;
    for i in 0..20 {
        let mut camera = default_camera();
        camera.world_from_view = Affine3A::from_rotation_translation(
            Quat::from_rotation_y(i as f32),
            scene.means[i] + Vec3::new(0.0, 0.0, 1e-3),
        );
        assert!(coverage(&gpu, &camera, &[(&scene, Affine3A::IDENTITY)]) > 0.0);
    }
}

#[test]
fn cameras_without_a_picture_show_nothing() {
    let Some(gpu) = gpu() else { return };
    let scene = random_scene(100, 0, 4);
    let check = |change: fn(&mut Camera)| {
        let mut camera = default_camera();
        change(&mut camera);
        assert_eq!(coverage(&gpu, &camera, &[(&scene, Affine3A::IDENTITY)]), 0.0, "{camera:?}");
    };
    check(|camera| camera.world_from_view.translation.x = f32::NAN);
    check(|camera| camera.clip_from_view = Mat4::from_diagonal(glam::Vec4::splat(f32::INFINITY)));
    check(|camera| camera.clip_from_view = Mat4::ZERO);
    check(|camera| camera.viewport = UVec4::new(4, 4, 0, 8));
}

/// Large splats still reach into the picture if their centers are far outside of it.
#[test]
fn nothing_pops_at_the_edge() {
    let Some(gpu) = gpu() else { return };
    let at = |x: f32| scene(&[(Vec3::new(x, 0.1, 2.0), Vec3::splat(0.5), 1.0)]);
    let coverages: Vec<f32> = (0..30)
        .map(|i| coverage(&gpu, &default_camera(), &[(&at(0.2 * i as f32), Affine3A::IDENTITY)]))
        .collect();
    assert!(coverages[0] > 50.0 && coverages[29] == 0.0, "{coverages:?}");
    for (i, pair) in coverages.windows(2).enumerate() {
        assert!(pair[0] - pair[1] < 15.0, "from {} to {} at step {i}", pair[0], pair[1]);
    }
    // Two units ahead and 3.5 from the eye, the picture ends at x = 2.9.
    assert!(coverages[16] > 10.0, "{coverages:?}");
}

#[test]
fn colors_of_another_scene_are_refused() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = GpuScene::new(device, &random_scene(10, 0, 5)).unwrap();
    let colors = GaussianColors::new(device, 9).unwrap();
    let cloud = Cloud {
        scene: &scene,
        colors: CloudColors::Rgb(&colors),
        world_from_scene: Affine3A::IDENTITY,
        visibility: None,
    };
    let error = Headless::new(device)
        .render(device, queue, &default_camera(), &[cloud], &SplatSettings::default())
        .unwrap_err();
    let expected = SplatError::Colors { cloud: 0, found: 9, expected: 10 };
    assert!(matches!(&error, HeadlessError::Splat(error) if *error == expected), "{error}");
    assert!(error.to_string().contains("found colors of 9 Gaussians, expected 10"));
}

/// A device that binds 64 KiB: 4096 records of 16 bytes. A larger scene is refused. Two scenes that fit each,
/// but not together, are refused when they are drawn. A scene that fits is drawn in several chunks.
#[test]
fn small_limits_are_kept() {
    let limits = |limits: wgpu::Limits| wgpu::Limits { max_storage_buffer_binding_size: 1 << 16, ..limits };
    let Some(gpu) = gpu_with_limits(limits) else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let error = GpuScene::new(device, &random_scene(4097, 0, 6)).unwrap_err();
    assert_eq!((error.found, error.limit), (16 * 4097, 1 << 16));

    let scene = random_scene(4096, 3, 6);
    let on_gpu = GpuScene::new(device, &scene).unwrap();
    let cloud = Cloud {
        scene: &on_gpu,
        colors: CloudColors::Captured,
        world_from_scene: Affine3A::IDENTITY,
        visibility: None,
    };
    let mut headless = Headless::new(device);
    let mut render = |clouds: &[Cloud]| {
        headless.render(device, queue, &default_camera(), clouds, &SplatSettings::default())
    };
    let found = render(&[cloud]).unwrap();
    let expected = stylegaussian::splat::render(&scene, Colors::Captured, &camera(SIZE));
    assert!(pictures::psnr(&found.rgba, &pictures::rgba(&expected)) > 45.0);

    let error = render(&[cloud, cloud]).unwrap_err();
    let found_bytes = SplatView::record_bytes(8192);
    let HeadlessError::Splat(SplatError::TooManyGaussians { n_gaussians, too_large }) = error else {
        panic!("{error}");
    };
    assert_eq!(n_gaussians, 8192);
    assert!(
        matches!(too_large, TooLarge { found, limit: 65_536, .. } if found == found_bytes),
        "{too_large}"
    );
    // The view still works afterwards.
    assert_eq!(render(&[cloud]).unwrap(), found);
}

/// Two opaque clouds in exactly the same place: the first one is in front, in both pictures.
#[test]
fn ties_go_by_order() {
    let Some(gpu) = gpu() else { return };
    let n = 3000;
    let still = random_scene(n, 0, 7);
    let (red, green) = (vec![[1.0, 0.0, 0.0]; n], vec![[0.0, 1.0, 0.0]; n]);
    let clouds =
        [(&still, Colors::Rgb(&red), Affine3A::IDENTITY), (&still, Colors::Rgb(&green), Affine3A::IDENTITY)];
    let first = draw(&gpu, &default_camera(), &clouds, &SplatSettings::default());
    let again = draw(&gpu, &default_camera(), &clouds, &SplatSettings::default());
    assert_eq!(first, again);
    // Every red splat lies over an equal green one, so no pixel is more green than red.
    assert!(first.rgba.iter().all(|pixel| pixel[0] >= pixel[1]));
}
