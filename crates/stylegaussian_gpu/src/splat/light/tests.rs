//! Lit records against `stylegaussian::light::Lit`, from the records of the same view without light.

use glam::{Affine3A, Mat4, Quat, UVec4, Vec3};
use half::f16;
use stylegaussian::{
    layers::{Region, Shape},
    light::{Air, Curve, Display, Lit, ShadowCascade, Sun, TintVolume, in_shadow, tint_at},
    strokes::StrokeKnobs,
};

use super::*;
use crate::{
    colors::GaussianColors,
    device::HeadlessDevice,
    splat::{
        CloudColors, GpuScene, SplatPass, SplatSettings, SplatView, ToneCurve,
        strokes::tests::{before_scene, random_scene, random_strokes},
        testing::{gpu, randoms, read},
    },
};

const N: usize = 600;

/// Two clouds of random colors, the second one painted, and a pass that draws them.
struct Stage {
    gpu: HeadlessDevice,
    pass: SplatPass,
    scene: GpuScene,
    means: Vec<Vec3>,
    colors: GaussianColors,
    strokes: crate::strokes::GaussianStrokes,
    places: [Affine3A; 2],
}

/// The color of a record, and the gains of its strokes as bytes; `None` if it is not visible.
type Shown = Option<(Vec3, [u32; 2])>;

impl Stage {
    fn new(seed: u64) -> Option<Self> {
        let gpu = gpu()?;
        let mut random = randoms(seed);
        let scene = random_scene(N, &mut random);
        let painting = random_strokes(&scene, &mut random);
        // Styled colors go beyond what a display shows.
        let colors: Vec<[f32; 3]> = (0..N).map(|_| [(); 3].map(|()| 1.5 * random() - 0.2)).collect();
        let pass = SplatPass::new(&gpu.device);
        let strokes = pass.store().upload(&gpu.device, &gpu.queue, &painting).unwrap();
        let colors = GaussianColors::from_rgb(&gpu.device, &gpu.queue, &colors).unwrap();
        let turned = Affine3A::from_scale_rotation_translation(
            Vec3::new(1.5, 0.7, -1.0),
            Quat::from_rotation_x(0.8),
            Vec3::new(0.2, 0.1, -30.0),
        );
        let places = [Affine3A::from_translation(Vec3::new(0.3, 0.0, 0.2)), turned];
        let (means, scene) = (scene.means.clone(), GpuScene::in_chunks(&gpu.device, &scene, 250));
        Some(Self { gpu, pass, scene, means, colors, strokes, places })
    }

    /// All records of a frame.
    fn shown(&self, view: &mut SplatView, camera: &Camera) -> Vec<Shown> {
        let HeadlessDevice { device, queue, .. } = &self.gpu;
        let plain = CloudColors::Rgb(&self.colors);
        let painted = plain.with_strokes(&self.strokes, StrokeKnobs::DEFAULT);
        let cloud = |colors, place: usize| Cloud {
            scene: &self.scene,
            colors,
            world_from_scene: self.places[place],
            visibility: None,
        };
        // Between the two, one that cannot be drawn and takes no records.
        let flat = Cloud { world_from_scene: Affine3A::ZERO, ..cloud(plain, 0) };
        let clouds = [cloud(plain, 0), flat, cloud(painted, 1)];
        let settings = SplatSettings::default();
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.pass
            .project_and_sort(&mut self.gpu.encoding(&mut encoder), view, camera, &clouds, &settings)
            .unwrap();
        self.pass.light_in_atmosphere(device, &mut encoder, view);
        queue.submit([encoder.finish()]);
        self.records(view)
    }

    /// All records that a view has on the GPU.
    fn records(&self, view: &SplatView) -> Vec<Shown> {
        let (geometry, colors) = view.records().unwrap();
        let geometry: Vec<[f32; 4]> = read(&self.gpu, geometry);
        let colors: Vec<[u32; 4]> = read(&self.gpu, colors);
        let strokes: Vec<[u32; 4]> = read(&self.gpu, &view.strokes().unwrap().records);
        let half = |word: u32, shift: u32| f16::from_bits((word >> shift) as u16).to_f32();
        (0..2 * N)
            .map(|i| {
                let [_, _, rg, b] = colors[i];
                let gains = [strokes[i][3] & 0xff, (strokes[i][3] >> 8) & 0xff];
                (geometry[i][3] > 0.0).then(|| (Vec3::new(half(rg, 0), half(rg, 16), half(b, 0)), gains))
            })
            .collect()
    }

    /// The ray from the eye to the mean of a record, in world space.
    fn ray(&self, camera: &Camera, record: usize) -> Vec3 {
        let at = self.places[record / N].transform_point3(self.means[record % N]);
        at - Vec3::from(camera.world_from_view.translation)
    }
}

fn fogs() -> [Fog; 4] {
    let sun = |x: f32, glow: Vec3| Sun { direction: Vec3::new(x, 0.3, -0.8).normalize(), glow };
    let fog = |falloff| Fog {
        color: Vec3::new(0.4, 0.5, 0.7),
        strength: 0.9,
        falloff,
        suns: vec![sun(0.1, Vec3::new(0.6, 0.4, 0.1)), sun(-3.0, Vec3::new(0.1, 0.2, 0.3))],
        exponent: 6.0,
    };
    [
        fog(Falloff::Linear { start: 2.0, end: 40.0 }),
        fog(Falloff::Exponential { density: 0.05 }),
        fog(Falloff::ExponentialSquared { density: 0.04 }),
        fog(Falloff::Atmospheric {
            extinction: Vec3::new(0.02, 0.05, 0.1),
            inscattering: Vec3::new(0.01, 0.08, 0.2),
        }),
    ]
}

#[test]
fn lit_records_match_for_every_projection_fog_and_curve() {
    let Some(stage) = Stage::new(71) else { return };
    let tint = Tint { color: Vec3::new(1.2, 0.7, 0.4), exposure: 0.6, saturation: 0.5 };
    let mut off_axis = before_scene().clip_from_view;
    off_axis.z_axis.x = 0.6;
    let turn = Affine3A::from_rotation_y(0.2) * Affine3A::from_translation(Vec3::new(0.2, 0.1, 5.0));
    let orthographic = Mat4::orthographic_rh(-3.0, 3.0, -2.0, 2.0, 60.0, 0.1);
    let cameras = [
        before_scene(),
        Camera { world_from_view: turn, clip_from_view: off_axis, viewport: UVec4::new(7, 3, 80, 60) },
        Camera { clip_from_view: orthographic, ..before_scene() },
        before_scene(),
    ];
    let curves = [
        (Tonemapping::None, Curve::Linear, 0.5),
        (Tonemapping::Reinhard, Curve::Reinhard, 1.0),
        (Tonemapping::ReinhardLuminance, Curve::ReinhardLuminance, -0.5),
        (Tonemapping::None, Curve::Linear, 0.0),
    ];
    for ((camera, fog), (tonemapping, curve, exposure)) in cameras.iter().zip(fogs()).zip(curves) {
        let mut view = SplatView::new();
        let before = stage.shown(&mut view, camera);
        // The second of three clouds is not drawn.
        let tints = vec![Tint::IDENTITY, Tint { exposure: 9.0, ..tint }, tint];
        let what = format!("{:?}, {curve:?}", fog.falloff);
        let light =
            ViewLight { fog: Some(fog.clone()), tints, tonemapping, exposure, ..ViewLight::default() };
        view.set_light(Some(light));
        let after = stage.shown(&mut view, camera);
        let (mut n, mut n_strokes) = (0, 0);
        for (i, (before, after)) in before.iter().zip(&after).enumerate() {
            assert_eq!(before.is_some(), after.is_some());
            let (Some((color, gains)), Some((found, found_gains))) = (before, after) else { continue };
            let tint = if i < N { Mat3::IDENTITY } else { tint.matrix().unwrap() };
            let air = fog.along(stage.ray(camera, i));
            let lit = Lit { tint, shade: 1.0, air, display: Display { curve, exposure } };
            let expected = lit.color(*color);
            // Records are f16, and whites of the inverse are steep.
            let error = (*found - expected).abs().max_element();
            assert!(error < 3e-3, "{what}: {i} is {found}, expected {expected}");
            n += 1;
            n_strokes += usize::from(gains[0] > 0);
            for (gain, found) in gains.iter().zip(found_gains) {
                let expected = (*gain as f32 * lit.contrast(*color)).min(255.0);
                assert!((expected - *found as f32).abs() < 2.0, "{what}: {i}: {found}, expected {expected}");
            }
        }
        assert!(n > 300 && n_strokes > 50, "{what}: {n} and {n_strokes}");
    }
}

/// Volumes of all shapes, over a cloud with a tint of its own and one without.
#[test]
fn volumes_tint_the_records_within() {
    let Some(stage) = Stage::new(75) else { return };
    let camera = Camera {
        world_from_view: Affine3A::from_rotation_y(0.3) * before_scene().world_from_view,
        ..before_scene()
    };
    let own = Tint { color: Vec3::new(0.9, 0.7, 0.8), ..Tint::IDENTITY };
    let tint = |exposure: f32| Tint { color: Vec3::new(1.0, 0.6, 0.3), exposure, saturation: 0.4 };
    let place = Affine3A::from_rotation_translation(Quat::from_rotation_z(0.4), Vec3::new(0.3, 0.1, 0.2));
    let region = |shape| Region { shape, shape_from_scene: place.inverse(), softness: 0.8 };
    let volume = |shape, exposure| TintVolume { region: region(shape), tint: tint(exposure) };
    let volumes = vec![
        volume(Shape::Ellipsoid { radii: Vec3::new(0.9, 0.5, 1.2) }, -1.0),
        volume(Shape::Cuboid { half_size: Vec3::new(0.5, 2.0, 0.5) }, 0.3),
        // Neither counts.
        volume(Shape::Cuboid { half_size: Vec3::NAN }, 3.0),
        TintVolume { region: region(Shape::Everything), tint: Tint::IDENTITY },
        volume(Shape::HalfSpace, -0.5),
        volume(Shape::Torus { major_radius: 1.0, minor_radius: 0.3 }, 0.5),
        TintVolume { region: Region { softness: 0.0, ..region(Shape::Everything) }, tint: tint(-0.2) },
    ];
    let mut view = SplatView::new();
    let before = stage.shown(&mut view, &camera);
    let light = ViewLight {
        tints: vec![own],
        volumes: vec![volumes.clone(), Vec::new(), volumes[..1].to_vec()],
        ..ViewLight::default()
    };
    view.set_light(Some(light.clone()));
    let after = stage.shown(&mut view, &camera);
    let (mut n, mut n_changed) = (0, 0);
    for (i, (before, after)) in before.iter().zip(&after).enumerate() {
        let (Some((color, _)), Some((found, _))) = (before, after) else { continue };
        let at = stage.ray(&camera, i) + Vec3::from(camera.world_from_view.translation);
        let tint = match i < N {
            true => tint_at(own.matrix().unwrap(), &volumes, at),
            false => tint_at(Mat3::IDENTITY, &volumes[..1], at),
        };
        let display = Display { curve: Curve::Linear, exposure: 0.0 };
        let expected = Lit { tint, shade: 1.0, air: Air::CLEAR, display }.color(*color);
        let error = (*found - expected).abs().max_element();
        assert!(error < 4e-3, "{i}: {found}, expected {expected}");
        n += 1;
        n_changed += usize::from(tint != own.matrix().unwrap() && tint != Mat3::IDENTITY);
    }
    assert!(n > 300 && n_changed > 100, "{n_changed} of {n} changed");
    // Volumes that move change colors, and those that are gone leave nothing.
    let moved = TintVolume { region: Region { softness: 0.1, ..volumes[0].region }, ..volumes[0] };
    view.set_light(Some(ViewLight { volumes: vec![vec![moved]], ..light }));
    assert!(stage.shown(&mut view, &camera) != after);
    view.set_light(None);
    assert!(stage.shown(&mut view, &camera) == before);
}

/// Without light, records are what they were before there was any, and nothing was made for it.
#[test]
fn no_light_is_no_work() {
    let Some(stage) = Stage::new(72) else { return };
    let (mut view, camera) = (SplatView::new(), before_scene());
    let before = stage.shown(&mut view, &camera);
    let idle = ViewLight { tints: vec![Tint::IDENTITY; 3], ..ViewLight::default() };
    for light in [Some(idle.clone()), None] {
        view.set_light(light);
        assert!(stage.shown(&mut view, &camera) == before);
        assert!(view.lit.uniforms.is_none() && stage.pass.light.shared.get().is_none());
    }
    // What needs a table that is missing waits for it.
    let fog = fogs()[0].clone();
    view.set_light(Some(ViewLight { fog: Some(fog.clone()), tonemapping: Tonemapping::AgX, ..idle.clone() }));
    assert!(stage.shown(&mut view, &camera) == before);
    // A frame like the last one changes nothing, so nothing is lit twice; then the light goes.
    view.set_light(Some(ViewLight { fog: Some(fog.clone()), ..idle.clone() }));
    let lit = stage.shown(&mut view, &camera);
    assert!(lit != before && stage.shown(&mut view, &camera) == lit);
    view.set_light(Some(ViewLight { fog: Some(Fog { strength: f32::NAN, ..fog }), ..idle }));
    assert!(stage.shown(&mut view, &camera) == before);
}

/// A curve with a table: where there is nothing but fog, it has the color that the curve gives it. The matrices
/// of ACES keep grays, up to 1e-3.
#[test]
fn curves_with_tables_show_fog() {
    let Some(stage) = Stage::new(73) else { return };
    let HeadlessDevice { device, queue, .. } = &stage.gpu;
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let table = InverseTable::new(device, &mut encoder, &ToneCurve::AcesFitted);
    queue.submit([encoder.finish()]);
    let (mut view, camera) = (SplatView::new(), before_scene());
    let before = stage.shown(&mut view, &camera);
    let light = |strength: f32| ViewLight {
        fog: Some(Fog {
            color: Vec3::splat(0.5),
            strength,
            falloff: Falloff::Linear { start: 0.0, end: 0.0 },
            suns: Vec::new(),
            exponent: 1.0,
        }),
        tonemapping: Tonemapping::AcesFitted,
        table: Some(table.clone()),
        ..ViewLight::default()
    };
    view.set_light(Some(light(1.0)));
    let aces = |x: f32| (x * (x + 0.0245786) - 0.000_090_537) / (x * (0.983729 * x + 0.432_951) + 0.238081);
    let expected = Vec3::splat(1.055 * aces(0.5).powf(1.0 / 2.4) - 0.055);
    for (found, gains) in stage.shown(&mut view, &camera).into_iter().flatten() {
        assert!((found - expected).abs().max_element() < 4e-3, "found {found}, expected {expected}");
        assert_eq!(gains, [0; 2]);
    }
    // And hardly any fog leaves hardly any change, however bad the inverse is.
    view.set_light(Some(light(1e-3)));
    for (found, before) in stage.shown(&mut view, &camera).iter().flatten().zip(before.iter().flatten()) {
        assert!((found.0 - before.0).abs().max_element() < 2e-2, "{found:?} and {before:?}");
    }
}

mod aerial;
mod shadows;
