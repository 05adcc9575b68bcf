//! Masks in the splat pass against the CPU twin, `stylegaussian::splat::render_visible`.

mod pictures;
mod target;

use glam::{Affine3A, UVec2};
use pictures::{camera, psnr, random_scene, randoms, rgba};
use stylegaussian::{
    mask::{MaskUse, Visibility},
    splat::{Colors, render, render_visible},
};
use stylegaussian_gpu::{
    device::HeadlessDevice,
    mask::GaussianMask,
    splat::{
        self, Cloud, CloudColors, CloudVisibility, GpuScene, Headless, HeadlessError, SplatError,
        SplatSettings,
    },
};
use target::{gpu, gpu_with_limits};

#[test]
fn hidden_and_cropped_pictures_match() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let (n, mut random) = (2000, randoms(21));
    let (scene, camera) = (random_scene(n, 1, 20), camera(UVec2::new(160, 120)));
    // A third of the Gaussians none, a third all, the rest in part.
    let weight = |random: f32| (255.0 * (3.0 * random - 1.0).clamp(0.0, 1.0)) as u8;
    let weights: Vec<[u8; 4]> = (0..n).map(|_| [(); 4].map(|()| weight(random()))).collect();
    let mask = GaussianMask::new(device, queue, &weights).unwrap();
    let on_gpu = GpuScene::new(device, &scene).unwrap();
    let (mut headless, on_screen) = (Headless::new(device), splat::Camera::pinhole(&camera));
    let whole = rgba(&render(&scene, Colors::Captured, &camera));
    // One view, so that each picture replaces another one.
    for (channel, is) in [(0, MaskUse::Hide), (3, MaskUse::Hide), (3, MaskUse::Crop), (7, MaskUse::Hide)] {
        let cloud = Cloud {
            scene: &on_gpu,
            colors: CloudColors::Captured,
            world_from_scene: Affine3A::IDENTITY,
            visibility: Some(CloudVisibility { mask: &mask, channel, is }),
        };
        let found = headless.render(device, queue, &on_screen, &[cloud], &SplatSettings::default()).unwrap();
        let visibility = Visibility { weights: &weights, channel, is };
        let expected = rgba(&render_visible(&scene, Colors::Captured, &camera, Some(&visibility)));
        let agreement = psnr(&found.rgba, &expected);
        assert!(agreement >= 45.0, "channel {channel}, {is:?}: {agreement:.1} dB");
        // A channel that does not exist hides nothing, and the others hide much.
        let from_whole = psnr(&expected, &whole);
        assert!((from_whole < 30.0) == (channel < 4), "channel {channel}, {is:?}: {from_whole:.1} dB");
    }
}

/// WebGPU guarantees eight storage buffers, all of which the kernel takes.
#[test]
fn masks_keep_to_the_default_limits() {
    let Some(gpu) = gpu_with_limits(|_| wgpu::Limits::default()) else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = GpuScene::new(device, &random_scene(200, 3, 23)).unwrap();
    let mask = GaussianMask::new(device, queue, &[[255; 4]; 200]).unwrap();
    let camera = splat::Camera::pinhole(&camera(UVec2::new(16, 12)));
    let alpha = |visibility| -> f32 {
        let colors = CloudColors::Captured;
        let cloud = Cloud { scene: &scene, colors, world_from_scene: Affine3A::IDENTITY, visibility };
        let picture = Headless::by_quads(device)
            .render(device, queue, &camera, &[cloud], &SplatSettings::default())
            .unwrap();
        picture.rgba.iter().map(|pixel| pixel[3]).sum()
    };
    assert!(alpha(None) > 1.0);
    assert_eq!(alpha(Some(CloudVisibility { mask: &mask, channel: 1, is: MaskUse::Hide })), 0.0);
}

#[test]
fn a_mask_of_another_scene_is_an_error() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = GpuScene::new(device, &random_scene(20, 0, 22)).unwrap();
    let mask = GaussianMask::new(device, queue, &[[0; 4]; 19]).unwrap();
    let cloud = Cloud {
        scene: &scene,
        colors: CloudColors::Captured,
        world_from_scene: Affine3A::IDENTITY,
        visibility: Some(CloudVisibility { mask: &mask, channel: 0, is: MaskUse::Hide }),
    };
    let camera = splat::Camera::pinhole(&camera(UVec2::new(16, 12)));
    let found = Headless::new(device).render(device, queue, &camera, &[cloud], &SplatSettings::default());
    let expected = SplatError::Mask { cloud: 0, found: 19, expected: 20 };
    assert!(matches!(found, Err(HeadlessError::Splat(error)) if error == expected));
}
