//! Records against a twin in f64 that shares no formula with the shader: full covariance matrices, and the
//! projection's derivative by differences. Unlike the CPU rasterizer, it handles transforms of clouds and any
//! projection matrix.

use glam::{Affine3A, DAffine3, DMat3, DMat4, DVec2, DVec3, DVec4, Mat4, Quat, UVec4, Vec3};
use stylegaussian::{
    Scene,
    mask::{MaskUse, Visibility},
    scene::ScreenFilter,
    sh,
};
use stylegaussian_shaders::splat::SplatCounts;

use crate::{
    colors::GaussianColors,
    device::HeadlessDevice,
    mask::GaussianMask,
    splat::{
        Camera, Cloud, CloudColors, CloudVisibility, GpuScene, SortKey, SplatPass, SplatSettings, SplatView,
        camera::in_f64,
        testing::{gpu, random_scene, randoms, read},
        view::Change,
    },
};

mod fading;

/// A projected Gaussian.
struct Twin {
    center: DVec2,
    /// Variances along x and y and the covariance, in px^2.
    covariance: [f64; 3],
    opacity: f64,
    depth: f64,
    distance: f64,
    color: Vec3,
    /// Distance inside of all culling bounds, in pixels and other units: positive if the Gaussian is drawn,
    /// negative if it is culled, near 0 if rounding decides.
    margin: f64,
}

/// Pixel and depth of a point of view space.
fn pixel(camera: &Camera, clip_from_view: DMat4, p: DVec3) -> (DVec2, f64) {
    let clip = clip_from_view * DVec4::from((p, 1.0));
    let ndc = clip.truncate() / clip.w;
    let (corner, size) = (camera.viewport.as_dvec4(), camera.viewport.as_dvec4());
    let x = corner.x + (ndc.x + 1.0) / 2.0 * size.z;
    let y = corner.y + (1.0 - ndc.y) / 2.0 * size.w;
    (DVec2::new(x, y), ndc.z)
}

fn twin(camera: &Camera, world_from_scene: &Affine3A, scene: &Scene, i: usize) -> Twin {
    let view_from_scene = in_f64(&camera.world_from_view).inverse() * in_f64(world_from_scene);
    let clip_from_view = camera.clip_from_view.as_dmat4();
    let gaussian = DMat3::from_quat(scene.rotations[i].normalize().as_dquat())
        * DMat3::from_diagonal(scene.scales[i].as_dvec3());
    let axes = view_from_scene.matrix3 * gaussian;
    let covariance = axes * axes.transpose();

    let p = view_from_scene.transform_point3(scene.means[i].as_dvec3());
    let is_perspective = clip_from_view.w_axis.w == 0.0;
    // Linearized within 1.3 half pictures of the axis.
    let limit = 1.3 * -p.z / DVec2::new(clip_from_view.x_axis.x, clip_from_view.y_axis.y);
    let at = match is_perspective {
        true => p.truncate().clamp(-limit.abs(), limit.abs()).extend(p.z),
        false => p,
    };
    let step = 1e-4 * (1.0 + p.z.abs());
    let derivative = |axis: DVec3| {
        let ahead = pixel(camera, clip_from_view, at + step * axis).0;
        (ahead - pixel(camera, clip_from_view, at - step * axis).0) / (2.0 * step)
    };
    let j = [derivative(DVec3::X), derivative(DVec3::Y), derivative(DVec3::Z)];
    let row = |get: fn(DVec2) -> f64| DVec3::new(get(j[0]), get(j[1]), get(j[2]));
    let (x, y) = (row(|v| v.x), row(|v| v.y));
    let variance_x = x.dot(covariance * x) + 0.3;
    let variance_y = y.dot(covariance * y) + 0.3;

    let (center, depth) = pixel(camera, clip_from_view, p);
    let covariance = [variance_x, variance_y, x.dot(covariance * y)];
    let opacity = f64::from(scene.opacities[i])
        * match scene.filter {
            ScreenFilter::Classic => 1.0,
            ScreenFilter::Antialiased => {
                let det = |added: f64| {
                    (covariance[0] - 0.3 + added) * (covariance[1] - 0.3 + added) - covariance[2].powi(2)
                };
                (det(0.0).max(0.0) / det(0.3)).sqrt()
            }
        };
    let reach = (2.0 * (255.0 * opacity).ln()).max(0.0).sqrt();
    let viewport = camera.viewport.as_dvec4();
    let half = DVec2::new(viewport.z, viewport.w) / 2.0;
    let outside = (center - DVec2::new(viewport.x, viewport.y) - half).abs() - half;
    let reaches_in = reach * DVec2::new(variance_x.sqrt(), variance_y.sqrt()) - outside;
    let near = if is_perspective { -p.z - 0.2 } else { f64::INFINITY };
    let margins = [reaches_in.min_element(), near, depth, 1.0 - depth, 255.0 * opacity - 1.0];
    Twin {
        center,
        covariance,
        opacity,
        depth,
        distance: -p.z,
        color: color(camera, world_from_scene, is_perspective, scene, i),
        margin: margins.into_iter().fold(f64::INFINITY, f64::min),
    }
}

fn color(camera: &Camera, place: &Affine3A, is_perspective: bool, scene: &Scene, i: usize) -> Vec3 {
    let scene_from_world: DAffine3 = in_f64(place).inverse();
    let camera = in_f64(&camera.world_from_view);
    let mean = scene.means[i].as_dvec3();
    let ray = match is_perspective {
        true => mean - scene_from_world.transform_point3(camera.translation),
        false => scene_from_world.transform_vector3(-camera.matrix3.z_axis),
    };
    let sh = scene.sh.as_ref().unwrap();
    let n = 3 * sh::n_coefficients(sh.degree);
    sh::evaluate(sh.degree, &sh.coefficients[i * n..(i + 1) * n], ray.normalize().as_vec3())
}

/// Indices of the visible records in order, and all records.
fn records(gpu: &HeadlessDevice, camera: &Camera, clouds: &[(Scene, Affine3A)]) -> (Vec<u32>, Vec<Record>) {
    let HeadlessDevice { device, .. } = gpu;
    // Chunks far smaller than any limit requires.
    let scenes: Vec<_> = clouds.iter().map(|(scene, _)| GpuScene::in_chunks(device, scene, 300)).collect();
    let clouds: Vec<_> = clouds
        .iter()
        .zip(&scenes)
        .map(|(&(_, world_from_scene), scene)| Cloud {
            scene,
            colors: CloudColors::Captured,
            world_from_scene,
            visibility: None,
        })
        .collect();
    drawn(gpu, camera, &clouds)
}

/// Indices of the visible records in order, and all records.
fn drawn(gpu: &HeadlessDevice, camera: &Camera, clouds: &[Cloud]) -> (Vec<u32>, Vec<Record>) {
    drawn_in(gpu, &mut SplatView::new(), camera, clouds)
}

/// The same in a view.
fn drawn_in(
    gpu: &HeadlessDevice,
    view: &mut SplatView,
    camera: &Camera,
    clouds: &[Cloud],
) -> (Vec<u32>, Vec<Record>) {
    let HeadlessDevice { device, queue, .. } = gpu;
    let pass = SplatPass::new(device);
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    pass.project_and_sort(&mut gpu.encoding(&mut encoder), view, camera, clouds, &SplatSettings::default())
        .unwrap();
    queue.submit([encoder.finish()]);
    let sort = view.sort().unwrap();
    let n_visible = read::<SplatCounts>(gpu, &sort.counts)[0].n_visible as usize;
    let mut sorted: Vec<u32> = read(gpu, &sort.record_indices);
    sorted.truncate(n_visible);
    let (geometry, colors) = view.records().unwrap();
    let geometry: Vec<[f32; 4]> = read(gpu, geometry);
    let colors: Vec<[u32; 4]> = read(gpu, colors);
    (
        sorted,
        geometry.into_iter().zip(colors).map(|(geometry, color)| Record::unpacked(geometry, color)).collect(),
    )
}

/// A record as the draw reads it.
struct Record {
    center: DVec2,
    covariance: [f64; 3],
    depth: f32,
    color: Vec3,
    opacity: f32,
}

impl Record {
    fn unpacked([x, y, slope, row_precision]: [f32; 4], color: [u32; 4]) -> Self {
        let half = |word: u32, high: u32| half::f16::from_bits((word >> (16 * high)) as u16).to_f32();
        let c = 1.0 / f64::from(f32::from_bits(color[0]));
        let b = f64::from(slope) * c;
        let a = 1.0 / f64::from(row_precision) + b * b / c;
        Self {
            center: DVec2::new(x.into(), y.into()),
            covariance: [a, c, b],
            depth: f32::from_bits(color[1]),
            color: Vec3::new(half(color[2], 0), half(color[2], 1), half(color[3], 0)),
            opacity: half(color[3], 1),
        }
    }
}

#[track_caller]
fn check(gpu: &HeadlessDevice, camera: &Camera, clouds: &[(Scene, Affine3A)]) {
    let (sorted, records) = records(gpu, camera, clouds);
    let mut is_visible = vec![false; records.len()];
    sorted.iter().for_each(|&i| is_visible[i as usize] = true);
    assert!(sorted.len() > records.len() / 20, "only {} visible", sorted.len());

    let twins: Vec<Twin> = clouds
        .iter()
        .flat_map(|(scene, place)| (0..scene.len()).map(|i| twin(camera, place, scene, i)))
        .collect();
    for (i, (twin, record)) in twins.iter().zip(&records).enumerate() {
        // Rounding may decide up to a hundredth of a pixel.
        if twin.margin.abs() > 0.01 {
            assert_eq!(is_visible[i], twin.margin > 0.0, "record {i}: margin {}", twin.margin);
        }
        if !is_visible[i] {
            continue;
        }
        let size: f64 = twin.covariance[0] + twin.covariance[1];
        let moved = record.center.distance(twin.center);
        assert!(moved <= 1e-3 + 1e-6 * twin.center.length(), "record {i}: moved by {moved} px");
        for (found, expected) in record.covariance.iter().zip(twin.covariance) {
            assert!((found - expected).abs() < 2e-3 * size, "record {i}: {found} for {expected} px^2");
        }
        assert!((f64::from(record.depth) - twin.depth).abs() < 1e-5, "record {i}: depth {}", record.depth);
        let off = (f64::from(record.opacity) - twin.opacity).abs();
        assert!(off < 1e-3, "record {i}: opacity {} for {}", record.opacity, twin.opacity);
        let wrong = (record.color - twin.color).abs().max_element();
        assert!(wrong < 5e-3, "record {i}: color {} for {}", record.color, twin.color);
    }
    for pair in sorted.windows(2) {
        let [near, far] = [pair[0], pair[1]].map(|i| twins[i as usize].distance);
        assert!(near <= far + 1e-5 * (1.0 + far.abs()), "{near} drawn over {far}");
    }
}

/// Three clouds: one in place, one turned and stretched, one sheared and mirrored.
fn clouds(degree: u8) -> Vec<(Scene, Affine3A)> {
    let stretched = Affine3A::from_scale_rotation_translation(
        Vec3::new(0.5, 2.0, 1.2),
        Quat::from_rotation_y(0.8),
        Vec3::new(0.5, -0.4, 1.0),
    );
    let mut sheared = Affine3A::from_scale(Vec3::new(-1.0, 1.0, 0.7));
    sheared.matrix3.y_axis.x = 0.6;
    let place = [Affine3A::IDENTITY, stretched, sheared];
    [0, 1, 2].map(|i| (random_scene(700, degree, 20 + i as u64), place[i])).into()
}

fn pose() -> Affine3A {
    Affine3A::look_at_rh(Vec3::new(1.0, 2.0, 5.0), Vec3::new(0.0, 0.3, 0.0), Vec3::Y).inverse()
}

#[test]
fn gpu_matches_cpu() {
    let Some(gpu) = gpu() else { return };
    let viewport = UVec4::new(13, 7, 160, 120);
    let aspect = 160.0 / 120.0;
    let perspective = Mat4::perspective_infinite_reverse_rh(0.9, aspect, 0.1);
    let mut off_axis = perspective;
    (off_axis.z_axis.x, off_axis.z_axis.y) = (0.7, -0.4);
    // Near and far change geometry: reverse z.
    let finite = Mat4::perspective_rh(1.2, aspect, 6.0, 1.0);
    let orthographic = Mat4::orthographic_rh(-3.0, 2.0, -2.0, 1.5, 6.0, 0.0);
    for (degree, clip_from_view) in [perspective, off_axis, finite, orthographic].into_iter().enumerate() {
        let camera = Camera { world_from_view: pose(), clip_from_view, viewport };
        let mut clouds = clouds(degree as u8);
        check(&gpu, &camera, &clouds);
        // Of clouds with both filters, each is drawn with its own.
        clouds[1].0.filter = ScreenFilter::Antialiased;
        clouds[2].0.filter = ScreenFilter::Antialiased;
        check(&gpu, &camera, &clouds);
    }
}

/// Far from the world's origin, f32 places a cloud to a sixteenth of a unit. The picture of a camera beside it
/// does not change for that.
#[test]
fn far_from_the_origin_nothing_changes() {
    let Some(gpu) = gpu() else { return };
    let away = Vec3::new(262_144.0, -524_288.0, 131_072.0);
    let clip_from_view = Mat4::perspective_infinite_reverse_rh(0.9, 1.0, 0.1);
    let viewport = UVec4::new(0, 0, 64, 64);
    let record = |away: Vec3| {
        let camera = Camera {
            world_from_view: Affine3A::from_translation(away + Vec3::new(0.0, 0.0, 5.0)),
            clip_from_view,
            viewport,
        };
        let clouds = [(random_scene(200, 0, 30), Affine3A::from_translation(away))];
        records(&gpu, &camera, &clouds).1
    };
    for (far, near) in record(away).iter().zip(&record(Vec3::ZERO)) {
        assert_eq!(far.center, near.center);
    }
}

/// The second frame of an unchanged view, and of one that sees less, makes no buffer and no bindings.
#[test]
fn nothing_is_allocated_if_nothing_changed() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scenes =
        [random_scene(500, 1, 40), random_scene(900, 1, 41)].map(|s| GpuScene::new(device, &s).unwrap());
    let cloud = |i: usize| Cloud {
        scene: &scenes[i],
        colors: CloudColors::Captured,
        world_from_scene: Affine3A::IDENTITY,
        visibility: None,
    };
    let (pass, mut view) = (SplatPass::new(device), SplatView::new());
    let mut camera = Camera {
        world_from_view: pose(),
        clip_from_view: Mat4::perspective_infinite_reverse_rh(0.9, 1.0, 0.1),
        viewport: UVec4::new(0, 0, 64, 64),
    };
    let mut frame = |camera: &Camera, clouds: &[Cloud]| {
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let settings = SplatSettings { sort_key: SortKey::Distance, ..SplatSettings::default() };
        pass.project_and_sort(&mut gpu.encoding(&mut encoder), &mut view, camera, clouds, &settings).unwrap();
        queue.submit([encoder.finish()]);
        view.resources()
    };
    let (buffers, groups) = frame(&camera, &[cloud(0), cloud(1)]);
    camera.world_from_view.translation.x += 0.1;
    assert_eq!(frame(&camera, &[cloud(0), cloud(1)]), (buffers.clone(), groups.clone()));
    assert_eq!(frame(&camera, &[cloud(1), cloud(0)]), (buffers.clone(), groups.clone()));
    let (still, fewer) = frame(&camera, &[cloud(1)]);
    assert_eq!(still, buffers);
    assert!(fewer.is_subset(&groups) && fewer.len() == 1);
}

/// A frame repeats nothing if nothing changed, and does not sort if only colors changed.
#[test]
fn only_what_changed_is_done_again() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scenes =
        [random_scene(50, 1, 42), random_scene(50, 1, 43)].map(|s| GpuScene::new(device, &s).unwrap());
    let colors = [(); 2].map(|()| GaussianColors::from_rgb(device, queue, &[[0.5; 3]; 50]).unwrap());
    let place = Affine3A::IDENTITY;
    let plain =
        Cloud { scene: &scenes[0], colors: CloudColors::Captured, world_from_scene: place, visibility: None };
    let (pass, mut view) = (SplatPass::new(device), SplatView::new());
    let camera = Camera {
        world_from_view: pose(),
        clip_from_view: Mat4::perspective_infinite_reverse_rh(0.9, 1.0, 0.1),
        viewport: UVec4::new(0, 0, 64, 64),
    };
    let mut change = |camera: &Camera, cloud: &Cloud| {
        view.clear();
        view.reserve(device, &pass.sort, &pass.draw.layout, 50).unwrap();
        pass.project.write(device, queue, &mut view, (camera, None), &[cloud], &SplatSettings::default())
    };
    assert_eq!(change(&camera, &plain), Change::Order);
    assert_eq!(change(&camera, &plain), Change::Nothing);
    for colors in [CloudColors::Rgb(&colors[0]), CloudColors::Rgb(&colors[1])] {
        assert_eq!(change(&camera, &Cloud { colors, ..plain }), Change::Colors);
        assert_eq!(change(&camera, &Cloud { colors, ..plain }), Change::Nothing);
    }
    colors[1].write(queue, &[[0.1; 3]; 50]);
    assert_eq!(change(&camera, &Cloud { colors: CloudColors::Rgb(&colors[1]), ..plain }), Change::Colors);
    assert_eq!(change(&camera, &Cloud { scene: &scenes[1], ..plain }), Change::Order);
    let moved = Cloud { world_from_scene: Affine3A::from_translation(Vec3::X), ..plain };
    assert_eq!(change(&camera, &moved), Change::Order);
    let wider = Camera { viewport: UVec4::new(0, 0, 65, 64), ..camera };
    assert_eq!(change(&wider, &moved), Change::Order);
    view.clear();
    view.forget_all();
    assert!(view.resources().1.is_empty());
}

/// The scene in its captured colors, whole and in its own place.
fn cloud(scene: &GpuScene) -> Cloud<'_> {
    let (colors, world_from_scene) = (CloudColors::Captured, Affine3A::IDENTITY);
    Cloud { scene, colors, world_from_scene, visibility: None }
}

/// Records of a cloud behind a mask are those of Gaussians that are as faint as the mask makes them, in any
/// chunk. A cloud beside it is as it was.
#[test]
fn masked_records_are_those_of_fainter_gaussians() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let mut random = randoms(50);
    let scenes = [random_scene(1000, 1, 51), random_scene(700, 1, 52)];
    let weights: Vec<[u8; 4]> = (0..1000).map(|_| [(); 4].map(|()| (256.0 * random()) as u8)).collect();
    let mask = GaussianMask::new(device, queue, &weights).unwrap();
    let on_gpu = |scene: &Scene| GpuScene::in_chunks(device, scene, 300);
    let camera = Camera {
        world_from_view: pose(),
        clip_from_view: Mat4::perspective_infinite_reverse_rh(0.9, 1.0, 0.1),
        viewport: UVec4::new(0, 0, 64, 64),
    };
    for is in [MaskUse::Hide, MaskUse::Crop] {
        let mut faint = scenes[0].clone();
        for (i, opacity) in faint.opacities.iter_mut().enumerate() {
            *opacity *= Visibility { weights: &weights, channel: 2, is }.share(i);
        }
        let [whole, beside, faint] = [on_gpu(&scenes[0]), on_gpu(&scenes[1]), on_gpu(&faint)];
        let masked = CloudVisibility { mask: &mask, channel: 2, is };
        let found =
            drawn(&gpu, &camera, &[Cloud { visibility: Some(masked), ..cloud(&whole) }, cloud(&beside)]);
        let expected = drawn(&gpu, &camera, &[cloud(&faint), cloud(&beside)]);
        assert_eq!(found.0, expected.0, "{is:?}");
        assert!(found.0.len() > 100);
        for &i in &found.0 {
            let [found, expected] = [&found, &expected].map(|(_, records)| &records[i as usize]);
            // A factor more may be rounded otherwise; records hold f16.
            assert!((found.opacity - expected.opacity).abs() < 1e-3, "{is:?}, record {i}");
            assert_eq!(
                (found.center, found.depth, found.color),
                (expected.center, expected.depth, expected.color)
            );
        }
    }
}

/// Frames without a mask compile and bind nothing for masks. A change of weights, and that alone, is another
/// order.
#[test]
fn masks_cost_nothing_where_there_are_none() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = GpuScene::new(device, &random_scene(50, 1, 53)).unwrap();
    let mask = GaussianMask::new(device, queue, &[[0; 4]; 50]).unwrap();
    let plain = cloud(&scene);
    let of = |channel, is| Cloud { visibility: Some(CloudVisibility { mask: &mask, channel, is }), ..plain };
    let (pass, mut view) = (SplatPass::new(device), SplatView::new());
    let camera = Camera {
        world_from_view: pose(),
        clip_from_view: Mat4::perspective_infinite_reverse_rh(0.9, 1.0, 0.1),
        viewport: UVec4::new(0, 0, 64, 64),
    };
    let mut change = |cloud: &Cloud| {
        view.clear();
        view.reserve(device, &pass.sort, &pass.draw.layout, 50).unwrap();
        pass.project.write(device, queue, &mut view, (&camera, None), &[cloud], &SplatSettings::default())
    };
    assert_eq!([change(&plain), change(&plain)], [Change::Order, Change::Nothing]);
    mask.write_range(queue, 3, &[[255; 4]; 2]);
    assert_eq!(change(&of(4, MaskUse::Hide)), Change::Nothing, "no such channel");
    assert!(pass.project.masked.get().is_none());
    assert_eq!(
        [change(&of(0, MaskUse::Hide)), change(&of(0, MaskUse::Hide))],
        [Change::Order, Change::Nothing]
    );
    assert!(pass.project.masked.get().is_some());
    mask.write_range(queue, 3, &[[9; 4]; 2]);
    for (channel, is) in [(0, MaskUse::Hide), (1, MaskUse::Hide), (1, MaskUse::Crop)] {
        assert_eq!([change(&of(channel, is)), change(&of(channel, is))], [Change::Order, Change::Nothing]);
    }
    assert_eq!([change(&plain), change(&plain)], [Change::Order, Change::Nothing]);
}
