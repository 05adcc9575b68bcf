//! The records of two eyes against those of views of their own.

use std::collections::BTreeSet;

use glam::{Affine3A, DVec3, EulerRot, Mat4, Quat, UVec4, Vec3};
use stylegaussian::{Scene, mask::MaskUse, splat::MIN_ALPHA};
use stylegaussian_shaders::splat::SplatCounts;

use super::{eye_between, middle};
use crate::{
    device::HeadlessDevice,
    mask::GaussianMask,
    splat::{
        Camera, Cloud, CloudColors, CloudVisibility, GpuScene, SortKey, SplatPass, SplatSettings, SplatView,
        camera::in_f64,
        testing::{gpu, random_scene, read},
    },
};

/// The order of a view, and both halves of its records.
struct Records {
    sorted: Vec<u32>,
    geometry: Vec<[u32; 4]>,
    color: Vec<[u32; 4]>,
}

fn records(gpu: &HeadlessDevice, view: &SplatView) -> Records {
    let sort = view.sort().unwrap();
    let n_visible = read::<SplatCounts>(gpu, &sort.counts)[0].n_visible as usize;
    let mut sorted: Vec<u32> = read(gpu, &sort.record_indices);
    sorted.truncate(n_visible);
    let (geometry, color) = view.records().unwrap();
    Records { sorted, geometry: read(gpu, geometry), color: read(gpu, color) }
}

fn settings() -> SplatSettings {
    SplatSettings { sort_key: SortKey::Distance, ..SplatSettings::default() }
}

fn by_itself(
    gpu: &HeadlessDevice,
    pass: &SplatPass,
    view: &mut SplatView,
    camera: &Camera,
    clouds: &[Cloud],
) -> Records {
    let HeadlessDevice { device, queue, .. } = gpu;
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    pass.project_and_sort(&mut gpu.encoding(&mut encoder), view, camera, clouds, &settings()).unwrap();
    queue.submit([encoder.finish()]);
    records(gpu, view)
}

fn of_eyes(
    gpu: &HeadlessDevice,
    pass: &SplatPass,
    views: &mut [SplatView; 2],
    cameras: &[Camera; 2],
    clouds: &[Cloud],
) -> [Records; 2] {
    submit_eyes(gpu, pass, views, cameras, clouds);
    views.each_ref().map(|view| records(gpu, view))
}

fn submit_eyes(
    gpu: &HeadlessDevice,
    pass: &SplatPass,
    [first, second]: &mut [SplatView; 2],
    cameras: &[Camera; 2],
    clouds: &[Cloud],
) {
    let HeadlessDevice { device, queue, .. } = gpu;
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    pass.project_and_sort_eyes(
        &mut gpu.encoding(&mut encoder),
        [first, second],
        cameras.each_ref(),
        clouds,
        &settings(),
    )
    .unwrap();
    queue.submit([encoder.finish()]);
}

/// Checks that records are `sorted` by their distance from the middle of two eyes.
fn check_order(scene: &Scene, place: &Affine3A, cameras: &[Camera; 2], sorted: &[u32]) {
    let middle = middle(cameras.each_ref());
    let distance =
        |i: u32| in_f64(place).transform_point3(scene.means[i as usize].as_dvec3()).distance(middle);
    for pair in sorted.windows(2) {
        let [near, far] = [distance(pair[0]), distance(pair[1])];
        assert!(near <= far + 1e-5 * (1.0 + far), "{near} drawn over {far}");
    }
}

/// Two eyes a unit apart, with off-axis projections, each with its part of the target, of a head that looks at
/// `target`.
fn cameras(at: Vec3, target: Vec3) -> [Camera; 2] {
    let head = Affine3A::look_at_rh(at, target, Vec3::Y).inverse();
    [-1.0, 1.0].map(|side: f32| {
        let mut clip_from_view = Mat4::perspective_infinite_reverse_rh(0.9, 160.0 / 120.0, 0.1);
        clip_from_view.z_axis.x = -0.2 * side;
        let left = if side < 0.0 { 0 } else { 160 };
        Camera {
            world_from_view: head * Affine3A::from_translation(0.5 * side * Vec3::X),
            clip_from_view,
            viewport: UVec4::new(left, 0, 160, 120),
        }
    })
}

/// Checks the records of two eyes against those of views by themselves.
fn check(gpu: &HeadlessDevice, scene: &Scene, place: Affine3A, mask: Option<&GaussianMask>) {
    let device = &gpu.device;
    let on_gpu = GpuScene::in_chunks(device, scene, 300);
    let visibility = mask.map(|mask| CloudVisibility { mask, channel: 0, is: MaskUse::Crop });
    let clouds =
        [Cloud { scene: &on_gpu, colors: CloudColors::Captured, world_from_scene: place, visibility }];
    let cameras = cameras(Vec3::new(1.0, 1.0, 5.0), Vec3::ZERO);
    let pass = SplatPass::new(device);
    let mut views = [SplatView::new(), SplatView::new()];
    // A view that was one of its own before, and one that will be afterwards.
    by_itself(gpu, &pass, &mut views[1], &cameras[1], &clouds);
    let eyes = of_eyes(gpu, &pass, &mut views, &cameras, &clouds);
    let own = cameras.each_ref().map(|camera| by_itself(gpu, &pass, &mut SplatView::new(), camera, &clouds));
    let between = Camera {
        world_from_view: cameras[0].world_from_view * Affine3A::from_translation(0.5 * Vec3::X),
        ..cameras[0].clone()
    };
    let from_middle = by_itself(gpu, &pass, &mut SplatView::new(), &between, &clouds);

    let seen = own.each_ref().map(|records| records.sorted.iter().copied().collect::<BTreeSet<u32>>());
    let either: BTreeSet<u32> = seen[0].union(&seen[1]).copied().collect();
    let alone = either.len() - seen[0].intersection(&seen[1]).count();
    assert!(either.len() > 50 && alone > 5, "{} seen, {alone} by one eye", either.len());
    assert_eq!(eyes[0].sorted, eyes[1].sorted);
    assert_eq!(eyes[0].sorted.iter().copied().collect::<BTreeSet<u32>>(), either);

    let opacity = |color: &[u32; 4]| half::f16::from_bits((color[3] >> 16) as u16).to_f32();
    let rgb = |color: &[u32; 4]| [color[2], color[3] & 0xffff];
    for &i in &either {
        let at = i as usize;
        assert_eq!(rgb(&eyes[0].color[at]), rgb(&eyes[1].color[at]), "record {i}: colors differ");
        for ((eye, own), seen) in eyes.iter().zip(&own).zip(&seen) {
            if !seen.contains(&i) {
                assert!(opacity(&eye.color[at]) < MIN_ALPHA, "record {i} is not seen by this eye");
                continue;
            }
            assert_eq!(eye.geometry[at], own.geometry[at], "record {i}");
            assert_eq!(eye.color[at][..2], own.color[at][..2], "record {i}");
            assert_eq!(opacity(&eye.color[at]), opacity(&own.color[at]), "record {i}");
        }
        if from_middle.sorted.contains(&i) {
            let numbers = |color: &[u32; 4]| {
                let half = |bits: u32| half::f16::from_bits(bits as u16).to_f32();
                Vec3::new(half(color[2]), half(color[2] >> 16), half(color[3]))
            };
            let off = (numbers(&eyes[0].color[at]) - numbers(&from_middle.color[at])).abs().max_element();
            assert!(off < 2e-3, "record {i}: a color is off by {off}");
        }
    }
    check_order(scene, &place, &cameras, &eyes[0].sorted);

    // The same views by themselves again.
    for ((view, camera), own) in views.iter_mut().zip(&cameras).zip(&own) {
        let again = by_itself(gpu, &pass, view, camera, &clouds);
        assert_eq!(again.sorted, own.sorted);
        for &i in &own.sorted {
            assert_eq!(again.color[i as usize], own.color[i as usize]);
        }
    }
}

/// Footprints are those of either camera, to the bit; colors and the order are those of the middle.
#[test]
fn eyes_have_their_own_footprints_and_one_order() {
    let Some(gpu) = gpu() else { return };
    let scene = random_scene(700, 1, 3);
    check(&gpu, &scene, Affine3A::IDENTITY, None);
    let stretched = Affine3A::from_scale_rotation_translation(
        Vec3::new(0.5, 2.0, 1.2),
        Quat::from_rotation_y(0.8),
        Vec3::new(0.5, -0.4, 1.0),
    );
    check(&gpu, &scene, stretched, None);
}

/// A mask hides from both eyes what it hides.
#[test]
fn eyes_see_through_masks() {
    let Some(gpu) = gpu() else { return };
    let scene = random_scene(700, 1, 4);
    let weights: Vec<[u8; 4]> =
        (0..scene.len()).map(|i| if i % 3 == 0 { [0; 4] } else { [255; 4] }).collect();
    let mask = GaussianMask::new(&gpu.device, &gpu.queue, &weights).unwrap();
    check(&gpu, &scene, Affine3A::IDENTITY, Some(&mask));
}

/// However a head moves and turns, both eyes draw by one list on the GPU, which is that of the frame.
#[test]
fn the_eyes_of_a_moving_head_draw_by_one_list() {
    let Some(gpu) = gpu() else { return };
    let scene = random_scene(300, 1, 5);
    let on_gpu = GpuScene::in_chunks(&gpu.device, &scene, 128);
    let place = Affine3A::IDENTITY;
    let clouds =
        [Cloud { scene: &on_gpu, colors: CloudColors::Captured, world_from_scene: place, visibility: None }];
    let pass = SplatPass::new(&gpu.device);
    let mut views = [SplatView::new(), SplatView::new()];
    let (mut last, mut n_changes) = (Vec::new(), 0);
    for frame in 0..400 {
        // Around, through and out of the cloud. In every fourth frame the head is still.
        let t = 0.05 * (frame - frame % 4) as f32;
        let at = Vec3::new(3.0 * (0.7 * t).sin(), (1.3 * t).cos(), 6.0 * (0.4 * t).cos());
        let cameras = cameras(at, at + Vec3::new((0.9 * t).sin(), 0.3 * (2.1 * t).sin(), -1.0));
        if frame % 50 == 49 {
            // One eye is closed for a frame.
            by_itself(&gpu, &pass, &mut views[1], &cameras[1], &clouds);
        }
        submit_eyes(&gpu, &pass, &mut views, &cameras, &clouds);
        let [first, second] = views.each_ref().map(|view| view.sort().unwrap());
        assert!(first.record_indices == second.record_indices && first.counts == second.counts);
        if frame % 5 == 0 {
            let sorted = records(&gpu, &views[1]).sorted;
            check_order(&scene, &place, &cameras, &sorted);
            n_changes += usize::from(sorted != last);
            last = sorted;
        }
    }
    assert!(n_changes > 40, "the order changed {n_changes} times");
}

/// The Gaussians of a scene in the order of their `distances`.
fn sorted_by<T: PartialOrd>(distances: &[T]) -> Vec<u32> {
    let mut sorted: Vec<u32> = (0..distances.len() as u32).collect();
    let compare = |a: &u32, b: &u32| distances[*a as usize].partial_cmp(&distances[*b as usize]);
    sorted.sort_by(|a, b| compare(a, b).expect("finite distances"));
    sorted
}

/// Two minutes of a head that walks, nods and looks around, at 90 frames a second, with eyes that look outward
/// by five degrees each: by the uniforms of either eye, splats have the order of the one point between them.
/// It is the same whichever eye comes first, and distances change by no more than the head moves, however it
/// turns.
#[test]
fn ten_thousand_poses_of_a_head_order_by_one_point() {
    let scene = random_scene(48, 0, 6);
    let place = Affine3A::from_scale_rotation_translation(
        Vec3::new(0.5, 2.0, 1.2),
        Quat::from_rotation_y(0.8),
        Vec3::new(1.0, -0.4, 2.0),
    );
    // Eyes are 64 millimeters apart.
    let head_from_eyes = [-1.0, 1.0].map(|side: f32| {
        let outward = Quat::from_rotation_y((-5.0 * side).to_radians());
        Affine3A::from_rotation_translation(outward, 0.032 * side * Vec3::X)
    });
    let (mut last, mut n_apart): (Option<(DVec3, Vec<f32>)>, usize) = (None, 0);
    for frame in 0..10_000 {
        let t = frame as f32 / 90.0;
        let at = Vec3::new(2.0 * (0.4 * t).sin(), 1.6 + 0.03 * (11.0 * t).sin(), 3.0 * (0.25 * t).cos());
        let (yaw, pitch, roll) = (1.5 * (0.9 * t).sin(), 0.4 * (1.7 * t).sin(), 0.2 * (2.3 * t).cos());
        let turn = Quat::from_euler(EulerRot::YXZ, yaw, pitch, roll);
        let head = Affine3A::from_rotation_translation(turn, at);
        let cameras = head_from_eyes.map(|head_from_eye| Camera {
            world_from_view: head * head_from_eye,
            clip_from_view: Mat4::perspective_infinite_reverse_rh(1.7, 1.0, 0.1),
            viewport: UVec4::new(0, 0, 1000, 1000),
        });
        let between = middle(cameras.each_ref());
        assert_eq!(between, middle([&cameras[1], &cameras[0]]));
        let eye = eye_between(between, &place).truncate();
        // As `splat_two_eyes.wgsl` computes them, for the eye that comes first.
        let distances = cameras.each_ref().map(|camera| -> Vec<f32> {
            let view_from_scene = camera.view_from(&place);
            scene.means.iter().map(|mean| view_from_scene.transform_vector3(*mean - eye).length()).collect()
        });
        for distances in &distances {
            check_order(&scene, &place, &cameras, &sorted_by(distances));
        }
        let [now, _] = distances;
        if let Some((before, then)) = last {
            let most = before.distance(between) as f32;
            for (now, then) in now.iter().zip(&then) {
                assert!((now - then).abs() <= most + 1e-5 * (1.0 + now), "frame {frame}: {then} to {now}");
            }
        }
        last = Some((between, now));
        // Eyes by themselves would disagree.
        let [first, second] = cameras.each_ref().map(|camera| {
            let at = in_f64(&camera.world_from_view).translation;
            let place = in_f64(&place);
            let apart = |mean: &Vec3| place.transform_point3(mean.as_dvec3()).distance(at);
            sorted_by(&scene.means.iter().map(apart).collect::<Vec<f64>>())
        });
        n_apart += usize::from(first != second);
    }
    assert!(n_apart > 5000, "orders of the eyes by themselves differ in {n_apart} frames");
}
