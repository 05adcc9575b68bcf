//! Records against `StrokeRecord`, with the gradients of the projection found by differences in f64.

use std::sync::Arc;

use glam::{Affine3A, DMat4, DVec2, DVec3, DVec4, Mat4, Quat, UVec4, Vec2, Vec3};
use half::f16;
use stylegaussian::{
    Scene,
    strokes::{
        FINE_SIDE, MAX_GAIN, PERIOD, PlainSeed, StrokeMotion as Motion, StrokeRecord, StrokeTexture,
        StrokeWord, Strokes, WIDE_SIDE,
    },
};

use super::*;
use crate::{
    device::HeadlessDevice,
    splat::{
        Camera, Cloud, CloudColors, GpuScene, SplatPass, SplatSettings, SplatView,
        camera::in_f64,
        testing::{gpu, randoms, read},
    },
};

mod changes;

/// Gaussians around the origin, in numbers that the GPU stores unrounded.
pub(in crate::splat) fn random_scene(n: usize, random: &mut impl FnMut() -> f32) -> Scene {
    let mut three = || Vec3::from_array([(); 3].map(|()| random() - 0.5));
    let mut scene =
        Scene { n_source: n, opacities: vec![0.8; n], order: (0..n as u32).collect(), ..Scene::default() };
    for _ in 0..n {
        scene.means.push(4.0 * three());
        let turn = Quat::from_axis_angle(three().normalize(), 6.0 * three().x);
        scene.rotations.push(Quat::from_array(turn.to_array().map(|x| (x * 32767.0).round() / 32767.0)));
        let scales = 0.01 + 0.3 * (three() + 0.5).powf(3.0);
        scene.scales.push(scales.map(|scale| f16::from_f32(scale).to_f32()));
    }
    scene
}

pub(in crate::splat) fn random_strokes(scene: &Scene, random: &mut impl FnMut() -> f32) -> Strokes {
    let mut seeds = Vec::new();
    for mean in scene.means.iter().step_by(3) {
        let mut three = || Vec3::from_array([(); 3].map(|()| random() - 0.5));
        let turn = Quat::from_axis_angle(three().normalize(), 6.0 * three().x);
        let seed = PlainSeed {
            at: *mean + 0.1 * three(),
            right: turn * Vec3::X,
            down: turn * Vec3::Y,
            pitch: 200.0 * (0.6 + three().truncate()),
            place: PERIOD * (three().truncate() + 0.5),
            fine: MAX_GAIN * (three().x + 0.5),
            wide: MAX_GAIN * (three().x + 0.5),
            texture: (2.0 * (three().x + 0.5)) as u8,
        };
        seeds.push(seed.packed().with_direction(three().truncate()));
    }
    let word = |i: usize| StrokeWord {
        seed: i as u32 / 3,
        protection: random(),
        share: (1.2 * random() - 0.2).max(0.0),
    };
    let words = (0..scene.len()).map(word).map(StrokeWord::packed).collect();
    let zeros = |side: usize| vec![Vec3::ZERO; side * side];
    let textures = [(); 2].map(|()| Arc::new(StrokeTexture::new(zeros(FINE_SIDE), zeros(WIDE_SIDE))));
    Strokes { seeds, words, textures: textures.into() }
}

/// The position on screen of a point of the scene, in pixels.
fn pixel(camera: &Camera, world_from_scene: &Affine3A, point: DVec3) -> DVec2 {
    let view_from_scene = in_f64(&camera.world_from_view).inverse() * in_f64(world_from_scene);
    let clip_from_view: DMat4 = camera.clip_from_view.as_dmat4();
    let clip = clip_from_view * DVec4::from((view_from_scene.transform_point3(point), 1.0));
    let half = camera.viewport.as_dvec4() / 2.0;
    DVec2::new(half.z, -half.w) * DVec2::new(clip.x, clip.y) / clip.w
}

/// The gradients of that position, x and y.
fn gradients(camera: &Camera, world_from_scene: &Affine3A, point: DVec3) -> (Vec3, Vec3) {
    let step = 1e-5;
    let along = |axis: DVec3| {
        let at = |sign: f64| pixel(camera, world_from_scene, point + sign * step * axis);
        (at(1.0) - at(-1.0)) / (2.0 * step)
    };
    let [x, y, z] = DVec3::AXES.map(along);
    (DVec3::new(x.x, y.x, z.x).as_vec3(), DVec3::new(x.y, y.y, z.y).as_vec3())
}

/// The records of one cloud, and which of them are visible.
fn on_gpu(
    gpu: &HeadlessDevice,
    scene: &Scene,
    painting: &Strokes,
    knobs: StrokeKnobs,
    camera: &Camera,
    world_from_scene: Affine3A,
) -> (Vec<[u32; 4]>, Vec<bool>) {
    moving_on_gpu(gpu, scene, painting, (knobs, &[], 0.0), camera, world_from_scene)
}

/// The same, if these seeds move, at a time.
fn moving_on_gpu(
    gpu: &HeadlessDevice,
    scene: &Scene,
    painting: &Strokes,
    (knobs, motions, seconds): (StrokeKnobs, &[(Range<u32>, Motion)], f64),
    camera: &Camera,
    world_from_scene: Affine3A,
) -> (Vec<[u32; 4]>, Vec<bool>) {
    let set = |strokes: &mut GaussianStrokes| strokes.set_motions(motions.to_vec());
    let (records, visible, _) =
        set_on_gpu(gpu, scene, painting, set, (knobs, seconds), camera, world_from_scene);
    (records, visible)
}

/// The same, with something `set` of the strokes, and the light on each record.
fn set_on_gpu(
    gpu: &HeadlessDevice,
    scene: &Scene,
    painting: &Strokes,
    set: impl FnOnce(&mut GaussianStrokes),
    (knobs, seconds): (StrokeKnobs, f64),
    camera: &Camera,
    world_from_scene: Affine3A,
) -> (Vec<[u32; 4]>, Vec<bool>, Vec<[u32; 4]>) {
    let HeadlessDevice { device, queue, .. } = gpu;
    let pass = SplatPass::new(device);
    let mut strokes = pass.store().upload(device, queue, painting).unwrap();
    set(&mut strokes);
    // Far smaller chunks than any limit requires.
    let scene = GpuScene::in_chunks(device, scene, 300);
    let colors = CloudColors::Captured.with_strokes(&strokes, knobs).at(seconds);
    let cloud = Cloud { scene: &scene, colors, world_from_scene, visibility: None };
    let (mut view, settings) = (SplatView::new(), SplatSettings::default());
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    pass.project_and_sort(&mut gpu.encoding(&mut encoder), &mut view, camera, &[cloud], &settings).unwrap();
    queue.submit([encoder.finish()]);
    let geometry: Vec<[f32; 4]> = read(gpu, view.records().unwrap().0);
    let visible = geometry.iter().map(|half| half[3] > 0.0).collect();
    let of_view = view.strokes().unwrap();
    (read(gpu, &of_view.records), visible, read(gpu, &of_view.relief))
}

/// Compares a record with its twin.
fn check(what: &str, found: [u32; 4], expected: Option<StrokeRecord>) {
    let expected = expected.map_or([0; 4], |record| record.packed());
    let byte = |record: [u32; 4], shift: u32| (record[3] >> shift & 0xff) as i32;
    // Gains and the level differ by a step at most.
    for shift in [0, 8, 24] {
        let is_seen = shift < 24 || expected[3] & 0xffff != 0;
        let (a, b) = (byte(found, shift), byte(expected, shift));
        assert!(!is_seen || (a - b).abs() <= 1, "{what}: byte {shift} is {a}, expected {b}");
    }
    if expected[3] & 0xffff == 0 {
        return;
    }
    assert_eq!(byte(found, 16), byte(expected, 16), "{what}: layer");
    let (found, expected) = (StrokeRecord::unpacked(found), StrokeRecord::unpacked(expected));
    let apart = (found.texel - expected.texel).abs();
    let apart = apart.min(Vec2::splat(PERIOD) - apart);
    assert!(apart.max_element() < 0.06, "{what}: {} instead of {}", found.texel, expected.texel);
    let size = expected.step_x.length() + expected.step_y.length();
    for (found, expected) in [(found.step_x, expected.step_x), (found.step_y, expected.step_y)] {
        assert!(found.distance(expected) < 4e-3 * size, "{what}: step {found} instead of {expected}, {size}");
    }
}

#[test]
fn records_match_for_every_projection_and_place() {
    let Some(gpu) = gpu() else { return };
    let mut random = randoms(51);
    let scene = random_scene(1000, &mut random);
    let painting = random_strokes(&scene, &mut random);
    let knobs = StrokeKnobs { amount: 0.8, protection: 1.5, stroke_scale: 1.3, ..StrokeKnobs::DEFAULT };
    let eye = Affine3A::look_at_rh(Vec3::new(1.0, 0.7, 4.0), Vec3::ZERO, Vec3::Y).inverse();
    let perspective = Mat4::perspective_infinite_reverse_rh(0.9, 4.0 / 3.0, 0.1);
    let mut off_axis = perspective;
    off_axis.z_axis.x = 0.6;
    off_axis.z_axis.y = -0.3;
    let orthographic = Mat4::orthographic_rh(-3.0, 3.0, -2.0, 2.0, 10.0, 0.1);
    let turned = Affine3A::from_scale_rotation_translation(
        Vec3::new(1.5, 0.7, 1.0),
        Quat::from_rotation_x(0.8),
        Vec3::new(0.2, 0.1, -0.3),
    );
    let mirrored = turned * Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    for (what, clip_from_view, place) in [
        ("perspective", perspective, Affine3A::IDENTITY),
        ("off-axis", off_axis, Affine3A::IDENTITY),
        ("orthographic", orthographic, Affine3A::IDENTITY),
        ("scaled", perspective, turned),
        ("mirrored", perspective, mirrored),
        ("mirrored, orthographic", orthographic, mirrored),
    ] {
        let camera = Camera { world_from_view: eye, clip_from_view, viewport: UVec4::new(0, 0, 160, 120) };
        let (records, visible) = on_gpu(&gpu, &scene, &painting, knobs, &camera, place);
        let mut n_shown = 0;
        for i in 0..scene.len() {
            if !visible[i] {
                assert_eq!(records[i], [0; 4], "{what} {i}");
                continue;
            }
            let gaussian = (scene.means[i], scene.rotations[i].normalize(), scene.scales[i]);
            let across = gradients(&camera, &place, scene.means[i].as_dvec3());
            let expected = StrokeRecord::new(painting.words[i], &painting.seeds, gaussian, across, &knobs);
            n_shown += usize::from(expected.is_some());
            check(&format!("{what} {i}"), records[i], expected);
        }
        assert!(n_shown > 200, "{what}: {n_shown}");
    }
}

/// Strokes of one size on screen. Where a level is all but whole, rounding decides which octave is the first.
#[test]
fn records_of_strokes_of_one_size_match() {
    let Some(gpu) = gpu() else { return };
    let mut random = randoms(55);
    let scene = random_scene(900, &mut random);
    let painting = random_strokes(&scene, &mut random);
    let (camera, place) = (before_scene(), Affine3A::IDENTITY);
    let knobs = StrokeKnobs { screen_stable: true, stroke_scale: 1.3, ..StrokeKnobs::DEFAULT };
    let (records, visible) = on_gpu(&gpu, &scene, &painting, knobs, &camera, place);
    let (mut n_shown, mut n_renamed) = (0, 0);
    for i in (0..scene.len()).filter(|&i| visible[i]) {
        let gaussian = (scene.means[i], scene.rotations[i].normalize(), scene.scales[i]);
        let across = gradients(&camera, &place, scene.means[i].as_dvec3());
        let expected = StrokeRecord::new(painting.words[i], &painting.seeds, gaussian, across, &knobs);
        let Some(record) = expected else { continue };
        n_shown += 1;
        // Of all levels, those of the first octave are from two texels to four pixels.
        assert!(record.level <= -1.0 - 1.3_f32.log2() + 1e-3 && record.level > -2.5, "{i}: {}", record.level);
        match (StrokeRecord::unpacked(records[i]).level - record.level).abs() > 0.5 {
            true => n_renamed += 1,
            false => check(&format!("{i}"), records[i], expected),
        }
    }
    assert!(n_shown > 200 && n_renamed * 100 < n_shown, "{n_renamed} of {n_shown}");
}

/// A camera that sees most of a random scene.
pub(in crate::splat) fn before_scene() -> Camera {
    Camera {
        world_from_view: Affine3A::from_translation(Vec3::new(0.0, 0.0, 4.0)),
        clip_from_view: Mat4::perspective_infinite_reverse_rh(0.9, 1.0, 0.1),
        viewport: UVec4::new(0, 0, 64, 64),
    }
}

/// Seeds in ranges that boil, flow and stand still, against seeds that the CPU has moved.
#[test]
fn moving_records_match() {
    let Some(gpu) = gpu() else { return };
    let mut random = randoms(53);
    let scene = random_scene(900, &mut random);
    let painting = random_strokes(&scene, &mut random);
    let (camera, place) = (before_scene(), Affine3A::IDENTITY);
    let boil = Motion::Boil { rate: 8.0, amount: 0.7 };
    let flow = Motion::Flow { rate: 0.3, amount: 3.0, toward: Vec3::new(1.0, -2.0, 0.5) };
    let motions = [(100..200, flow), (200..250, Motion::Still), (0..80, boil)];
    let knobs = StrokeKnobs { stroke_scale: 1.3, ..StrokeKnobs::DEFAULT };
    // From the beginning, and after a week.
    for seconds in [0.0, 1.71, 604_800.33] {
        let mut expected = painting.clone();
        for (range, motion) in &motions {
            let moved = painting.moved(*motion, seconds).seeds;
            let range = range.start as usize..range.end as usize;
            expected.seeds[range.clone()].copy_from_slice(&moved[range]);
        }
        let (records, visible) =
            moving_on_gpu(&gpu, &scene, &painting, (knobs, &motions, seconds), &camera, place);
        let mut n_shown = 0;
        for i in (0..scene.len()).filter(|&i| visible[i]) {
            let gaussian = (scene.means[i], scene.rotations[i].normalize(), scene.scales[i]);
            let across = gradients(&camera, &place, scene.means[i].as_dvec3());
            let record = StrokeRecord::new(expected.words[i], &expected.seeds, gaussian, across, &knobs);
            n_shown += usize::from(record.is_some());
            check(&format!("{seconds} {i}"), records[i], record);
        }
        assert!(n_shown > 200, "{n_shown}");
    }
}

/// Time costs what stands still nothing: its records are the same bytes, and a frame writes nothing.
#[test]
fn records_change_when_strokes_are_redrawn_alone() {
    let Some(gpu) = gpu() else { return };
    let mut random = randoms(54);
    let scene = random_scene(300, &mut random);
    let painting = random_strokes(&scene, &mut random);
    let (camera, place, knobs) = (before_scene(), Affine3A::IDENTITY, StrokeKnobs::DEFAULT);
    let at = |motion: Motion, seconds: f64| {
        let motions = [(0..100, motion)];
        moving_on_gpu(&gpu, &scene, &painting, (knobs, &motions, seconds), &camera, place).0
    };
    let still = on_gpu(&gpu, &scene, &painting, knobs, &camera, place).0;
    assert!(at(Motion::Still, 3.3) == still);
    assert!(at(Motion::Boil { rate: f32::NAN, amount: 1.0 }, 3.3) == still);
    let boil = Motion::Boil { rate: 10.0, amount: 0.5 };
    let drawn = at(boil, 3.31);
    assert!(drawn != still && at(boil, 3.39) == drawn && at(boil, 3.41) != drawn);

    let HeadlessDevice { device, queue, .. } = &gpu;
    let pass = SplatPass::new(device);
    let strokes = pass.store().upload(device, queue, &painting).unwrap().moving(boil);
    let on_gpu = GpuScene::new(device, &scene).unwrap();
    let mut view = SplatView::new();
    // The kernel runs if the strokes' records are written anew.
    let mut is_written = |seconds: f64| {
        let colors = CloudColors::Captured.with_strokes(&strokes, knobs).at(seconds);
        let cloud = Cloud { scene: &on_gpu, colors, world_from_scene: place, visibility: None };
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let settings = SplatSettings::default();
        pass.project_and_sort(&mut gpu.encoding(&mut encoder), &mut view, &camera, &[cloud], &settings)
            .unwrap();
        queue.submit([encoder.finish()]);
        let records = &view.strokes().unwrap().records;
        let is_written = read::<[u32; 4]>(&gpu, records).iter().any(|record| *record != [0; 4]);
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.clear_buffer(records, 0, None);
        queue.submit([encoder.finish()]);
        is_written
    };
    assert_eq!([0.01, 0.09, 0.11, 0.19].map(&mut is_written), [true, false, true, false]);
}

/// Gaussians of one size, seeds of pitch 0, and knobs that are not numbers: no strokes, and no validation
/// error.
#[test]
fn degenerate_strokes_show_nothing() {
    let Some(gpu) = gpu() else { return };
    let mut random = randoms(52);
    let scene = random_scene(100, &mut random);
    let painting = random_strokes(&scene, &mut random);
    let camera = before_scene();
    let default = StrokeKnobs::default();
    let show = |scene: &Scene, painting: &Strokes, knobs| {
        let (records, visible) = on_gpu(&gpu, scene, painting, knobs, &camera, Affine3A::IDENTITY);
        assert!(visible.contains(&true));
        records.iter().any(|record| *record != [0; 4])
    };
    assert!(show(&scene, &painting, default));
    for knobs in [
        StrokeKnobs { amount: 0.0, ..default },
        StrokeKnobs { amount: f32::NAN, ..default },
        StrokeKnobs { stroke_scale: 0.0, ..default },
        StrokeKnobs { protection: f32::INFINITY, ..default },
    ] {
        assert!(!show(&scene, &painting, knobs), "{knobs:?}");
    }
    let points = Scene { scales: vec![Vec3::ZERO; scene.len()], ..scene.clone() };
    assert!(!show(&points, &painting, default));
    let bare = Strokes { seeds: Vec::new(), ..painting.clone() };
    assert!(!show(&scene, &bare, default));
}
