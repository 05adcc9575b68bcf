//! Images of the demo scene, compared with those of the CPU rasterizer.

use std::path::Path;

use bevy::{camera::Hdr, core_pipeline::tonemapping::Tonemapping, prelude::*};
use stylegaussian::{Camera, Scene, splat};
use stylegaussian_files::read_scene;

use crate::{GaussianSplats, splats::SplatTonemapping, style::decoder::StyleBackend};

use super::world::{rendering::*, *};

const SIZE: UVec2 = UVec2::new(320, 240);
const FOV_Y: f32 = 0.7;
const EYE: Vec3 = Vec3::new(0.0, 3.9, 9.7);

fn demo_scene() -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/demo.sgs");
    // Nothing is styled here. Without features, no neighbors are searched.
    Scene { features: None, ..read_scene(&path).unwrap().scene }
}

/// The rasterizer's image and its coverage. The background is black and blended in linear space, as a camera
/// does.
fn reference(scene: &Scene) -> (Vec<[f32; 3]>, Vec<f32>) {
    let camera = Camera::look_at(EYE, Vec3::ZERO, Vec3::Y, FOV_Y, SIZE);
    let view = splat::render(scene, splat::Colors::Captured, &camera);
    (over_black(&view), view.alpha)
}

/// The image of a camera with these additional components.
fn picture(scene: Scene, camera: impl Bundle) -> Option<Vec<[f32; 3]>> {
    let mut app = app_with_rendering(StyleBackend::Cpu)?;
    let image = render_target(&mut app, SIZE);
    let splats = GaussianSplats(add_scene(&mut app, scene));
    app.world_mut().spawn(splats);
    app.world_mut().spawn((
        Camera3d::default(),
        bevy::camera::Camera { clear_color: Color::BLACK.into(), ..default() },
        target(&image),
        Projection::from(PerspectiveProjection { fov: FOV_Y, ..default() }),
        Transform::from_translation(EYE).looking_at(Vec3::ZERO, Vec3::Y),
        camera,
    ));
    for _ in 0..3 {
        app.update();
    }
    Some(read_back(&app, &image).iter().map(|&[r, g, b, _]| [r, g, b]).collect())
}

/// Checks that the PSNR against the reference is at least `least` dB, over pixels of which splats cover more
/// than half.
fn check(name: &str, camera: impl Bundle, least: f32) {
    let scene = demo_scene();
    let (expected, alpha) = reference(&scene);
    let Some(found) = picture(scene, camera) else { return };
    let n_covered = alpha.iter().filter(|&&alpha| alpha > 0.5).count();
    // A comparison over a few pixels would pass whatever they show.
    assert!(2 * n_covered >= alpha.len(), "{n_covered} of {} pixels are covered", alpha.len());
    let psnr = psnr(&expected, &found, |i| alpha[i] > 0.5);
    eprintln!("{name}: {psnr:.1} dB over {n_covered} pixels");
    if psnr < least {
        let dir = std::env::temp_dir();
        for (what, pixels) in [("expected", &expected), ("found", &found)] {
            let path = dir.join(format!("{name}_{what}.png"));
            let bytes: Vec<u8> = pixels.as_flattened().iter().map(|v| (v * 255.0).round() as u8).collect();
            image::save_buffer(&path, &bytes, SIZE.x, SIZE.y, image::ExtendedColorType::Rgb8).unwrap();
            eprintln!("{what}: {}", path.display());
        }
        panic!("{name}: {psnr:.1} dB, expected {least}");
    }
}

#[test]
fn ldr_with_msaa() {
    check("ldr_with_msaa", Msaa::Sample4, 38.0);
}

#[test]
fn hdr_bypassing_tonemapping() {
    check("hdr_bypassing_tonemapping", (Hdr, Msaa::Sample4, SplatTonemapping::Bypass), 38.0);
}

#[test]
fn hdr_inverting_tonemapping() {
    // Lower than the others: bright and saturated colors lie outside the range of the tonemapping.
    check("hdr_inverting_tonemapping", (Hdr, Msaa::Sample4, Tonemapping::TonyMcMapface), 28.0);
}
