//! Shadow maps against the CPU twin's, and against depths worked out by hand; what is kept while nothing moves.

use glam::{Affine3A, Mat4, Quat, UVec2, Vec3};
use stylegaussian::{
    Scene,
    mask::{MaskUse, Visibility},
    scene::ScreenFilter,
    splat::cast,
};

use super::*;
use crate::{
    colors::GaussianColors,
    device::HeadlessDevice,
    mask::GaussianMask,
    splat::{
        Camera, CloudColors, CloudVisibility, GpuScene, SplatPass,
        testing::{drawn_depths, gpu, random_splats, randoms},
    },
};

const SIZE: UVec2 = UVec2::new(77, 53);

/// Splats of all shapes and opacities, some of them before the light.
fn random_scene(n: usize) -> Scene {
    random_splats(n, Vec3::new(-2.0, -2.0, -0.5), Vec3::new(4.0, 4.0, 5.0), 0.3)
}

fn cloud(scene: &GpuScene) -> Cloud<'_> {
    let world_from_scene = Affine3A::IDENTITY;
    Cloud { scene, colors: CloudColors::Captured, world_from_scene, visibility: None }
}

/// Projects casters, in commands of their own.
fn project(gpu: &HeadlessDevice, pass: &SplatPass, view: &mut CastView, camera: &Camera, casters: &[Caster]) {
    let HeadlessDevice { device, queue, .. } = gpu;
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let light = (camera, SplatSettings::default().near);
    pass.project_casters(&mut gpu.encoding(&mut encoder), view, light, casters).unwrap();
    queue.submit([encoder.finish()]);
}

/// The depths in a shadow map of [`SIZE`] that was cleared to `wall`, with the casters of `view` in it.
fn drawn(gpu: &HeadlessDevice, pass: &SplatPass, view: &CastView, wall: f32) -> Vec<f32> {
    drawn_depths(gpu, (SIZE, 1), wall, |render| pass.cast(render, view))
}

/// Scenes with both filters, in one chunk and in several, in one batch and in several, without a mask and with
/// one, faded or not; a wall hides what is behind it.
#[test]
fn gpu_matches_cpu() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let (eye, at) = (Vec3::new(0.3, -0.2, -1.5), Vec3::new(0.0, 0.1, 2.0));
    let pinhole = stylegaussian::Camera::look_at(eye, at, Vec3::NEG_Y, 1.0, SIZE);
    let camera = Camera::pinhole(&pinhole);
    // The camera's depths are `near` over distances.
    let near = camera.clip_from_view.w_axis.z;
    let mut random = randoms(9);
    for (n, threshold, filter, faded, batch) in [
        (600, 0.5, ScreenFilter::Classic, 0.0, BATCH),
        (600, 0.2, ScreenFilter::Antialiased, 0.4, 128),
        (500, 0.6, ScreenFilter::Classic, 0.0, 256),
    ] {
        let (pass, mut view) = (SplatPass::new(device), CastView::new());
        pass.cast.set(Cast::in_batches(device, &pass.project.absent, batch)).unwrap();
        let scene = Scene { filter, ..random_scene(n) };
        let on_gpu = GpuScene::in_chunks(device, &scene, 250);
        let opacities = scene.opacities.iter().map(|opacity| opacity * (1.0 - faded)).collect();
        let scene = Scene { opacities, ..scene };
        let weights: Vec<_> = (0..n).map(|_| [0, 0, (255.0 * random()) as u8, 0]).collect();
        let mask = GaussianMask::new(device, queue, &weights).unwrap();
        for is in [None, Some(MaskUse::Hide), Some(MaskUse::Crop)] {
            let visibility = is.map(|is| CloudVisibility { mask: &mask, channel: 2, is });
            let caster = Caster { cloud: Cloud { visibility, ..cloud(&on_gpu) }, threshold, faded };
            project(&gpu, &pass, &mut view, &camera, &[caster]);
            let wall = 2.5;
            let found = drawn(&gpu, &pass, &view, near / wall);
            let visibility = is.map(|is| Visibility { weights: &weights, channel: 2, is });
            let expected = cast(&scene, &pinhole, threshold, visibility.as_ref());
            // Rounding may decide at the edges of cores.
            let is_wrong = |(found, expected): (&f32, &f32)| (near / found - expected.min(wall)).abs() > 1e-3;
            let n_wrong = found.iter().zip(&expected).filter(|&pair| is_wrong(pair)).count();
            let n_cast = expected.iter().filter(|&&depth| depth < wall).count();
            eprintln!("{n} splats, {threshold}, {is:?}: {n_wrong} of {n_cast} wrong");
            assert!(n_cast > 20, "{n} splats, {threshold}, {is:?}: {n_cast} pixels in shadow");
            assert!(n_wrong < 10, "{n} splats, {threshold}, {is:?}: {n_wrong} pixels are wrong");
        }
    }
}

/// A light with parallel rays along -z, 6 units deep. What lies before its near plane is in that plane, and
/// what lies beyond its far plane is in no shadow map. A light at a point does not see what is behind it.
#[test]
fn what_is_before_a_sun_s_map_casts_its_shadow_into_it() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, .. } = &gpu;
    let mut scene = Scene::default();
    for (x, z) in [(-1.0, -3.0), (0.0, 10.0), (1.0, -7.0)] {
        scene.means.push(Vec3::new(x, 0.0, z));
        scene.scales.push(Vec3::splat(0.3));
        scene.rotations.push(Quat::IDENTITY);
        scene.opacities.push(0.9);
        scene.order.push(scene.order.len() as u32);
    }
    let on_gpu = GpuScene::new(device, &scene).unwrap();
    let (pass, mut view) = (SplatPass::new(device), CastView::new());
    let mut depths = |clip_from_view: Mat4| {
        let viewport = UVec4::new(0, 0, SIZE.x, SIZE.y);
        let camera = Camera { world_from_view: Affine3A::IDENTITY, clip_from_view, viewport };
        let caster = Caster { cloud: cloud(&on_gpu), threshold: 0.5, faded: 0.0 };
        project(&gpu, &pass, &mut view, &camera, &[caster]);
        let map = drawn(&gpu, &pass, &view, 0.0);
        // The middle row, at x = -1, 0 and 1 of -2..2.
        [SIZE.x / 4, SIZE.x / 2, 3 * SIZE.x / 4].map(|x| map[(SIZE.y / 2 * SIZE.x + x) as usize])
    };
    // Near and far change geometry: reverse z.
    let found = depths(Mat4::orthographic_rh(-2.0, 2.0, -2.0, 2.0, 6.0, 0.0));
    // The core ends 3 + sqrt(2 ln 1.8) 0.3 = 3.325 below.
    assert!((found[0] - (1.0 - 3.325 / 6.0)).abs() < 1e-3 && found[1..] == [1.0, 0.0], "{found:?}");
    let found = depths(Mat4::perspective_infinite_reverse_rh(1.5, 1.0, 0.1));
    assert_eq!(found[1], 0.0, "{found:?}");
}

/// Pieces follow one another in batches that they fit into.
#[test]
fn batches_hold_as_many_pieces_as_fit() {
    let Some(gpu) = gpu() else { return };
    let scene = GpuScene::in_chunks(&gpu.device, &random_scene(70), 40);
    let caster = Caster { cloud: cloud(&scene), threshold: 0.5, faded: 0.0 };
    let key = CastKey::new(16, (&sun(), 0.2), &[caster]);
    let pieces = key.pieces.iter().map(|piece| (piece.first, piece.uniforms.first_gaussian));
    // Chunks of 40 and 30.
    assert_eq!(pieces.collect::<Vec<_>>(), [(0, 0), (16, 16), (32, 32), (0, 40), (16, 56)]);
    assert_eq!(batches(&key.pieces, 16), [(0..1, 16), (1..2, 16), (2..3, 8), (3..4, 16), (4..5, 14)]);
    assert_eq!(batches(&key.pieces, 40), [(0..3, 40), (3..5, 30)]);
}

/// A light with parallel rays along -z.
fn sun() -> Camera {
    let viewport = UVec4::new(0, 0, SIZE.x, SIZE.y);
    let clip_from_view = Mat4::orthographic_rh(-2.0, 2.0, -2.0, 2.0, 6.0, 0.0);
    Camera { world_from_view: Affine3A::from_translation(5.0 * Vec3::Z), clip_from_view, viewport }
}

/// Nothing is made before there is a caster. Then each change projects once, and nothing else does.
#[test]
fn casters_are_projected_once_per_change() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = GpuScene::in_chunks(device, &random_scene(100), 60);
    let colors = GaussianColors::new(device, 100).unwrap();
    let mask = GaussianMask::new(device, queue, &[[0; 4]; 100]).unwrap();
    mask.write_range(queue, 0, &[[255; 4]; 40]);
    let (pass, mut view) = (SplatPass::new(device), CastView::new());
    assert!(pass.cast.get().is_none());
    let mut n = 0;
    let mut last: Vec<f32> = Vec::new();
    let mut check = |what: &str, light: &Camera, caster: &Caster, changes: bool| {
        n += u64::from(changes);
        for _ in 0..2 {
            project(&gpu, &pass, &mut view, light, &[*caster]);
            assert_eq!(view.n_projections(), n, "{what}");
        }
        let map = drawn(&gpu, &pass, &view, 0.0);
        assert!(map.iter().any(|&depth| depth > 0.0), "{what}: no shadow");
        assert_eq!(map != last, changes, "{what}");
        last = map;
    };
    let mut light = sun();
    let mut caster = Caster { cloud: cloud(&scene), threshold: 0.5, faded: 0.0 };
    check("the first frame", &light, &caster, true);
    check("a still frame", &light, &caster, false);
    light.world_from_view.translation.x += 0.3;
    check("a light that moves", &light, &caster, true);
    caster.cloud.world_from_scene = Affine3A::from_translation(Vec3::new(0.4, 0.2, 0.0));
    check("a cloud that moves", &light, &caster, true);
    caster.threshold = 0.3;
    check("another threshold", &light, &caster, true);
    caster.faded = 0.2;
    check("a fade", &light, &caster, true);
    caster.cloud.colors = CloudColors::Rgb(&colors);
    check("other colors", &light, &caster, false);
    let is_compiled = || pass.cast.get().is_some_and(|cast| cast.kernels[1].get().is_some());
    assert!(!is_compiled(), "a kernel for masks without a mask");
    caster.cloud.visibility = Some(CloudVisibility { mask: &mask, channel: 0, is: MaskUse::Hide });
    check("a mask", &light, &caster, true);
    mask.write_range(queue, 40, &[[255; 4]; 20]);
    check("a mask that is painted", &light, &caster, true);
    assert!(is_compiled());

    let made = (view.groups.clone(), view.uniforms.clone());
    light.world_from_view.translation.y += 0.3;
    project(&gpu, &pass, &mut view, &light, &[caster]);
    assert!((view.groups.clone(), view.uniforms.clone()) == made, "a light that moves changes numbers alone");
    project(&gpu, &pass, &mut view, &light, &[]);
    assert!(view.depths.is_none() && view.groups.is_empty(), "what is gone holds memory");
    assert!(drawn(&gpu, &pass, &view, 0.0).iter().all(|&depth| depth == 0.0), "what is gone casts a shadow");
}

/// Bindings are made of what came alone, whatever its place among the others.
#[test]
fn bindings_stay_while_other_casters_come_and_go() {
    let Some(gpu) = gpu() else { return };
    let scenes = [40, 50, 60].map(|n| GpuScene::new(&gpu.device, &random_scene(n)).unwrap());
    let [a, b, c] = scenes.each_ref().map(|scene| Caster { cloud: cloud(scene), threshold: 0.5, faded: 0.0 });
    let (pass, mut view) = (SplatPass::new(&gpu.device), CastView::new());
    project(&gpu, &pass, &mut view, &sun(), &[a, b]);
    let before = view.groups.clone();
    project(&gpu, &pass, &mut view, &sun(), &[b, c, a]);
    assert!(view.groups.len() == 3 && view.groups[0] == before[1] && view.groups[2] == before[0]);
    assert!(!before.contains(&view.groups[1]));
}
