//! Scenes in files that other programs open: pictures and colors after GLB and SPZ.

use std::path::Path;

use glam::UVec2;
use stylegaussian::{
    Scene, sh,
    splat::{Colors, RenderedImage, render},
    views::orbit,
};
use stylegaussian_files::{WriteOptions, read_scene, write_scene_with};

fn demo() -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/demo.sgs");
    read_scene(&path).unwrap_or_else(|error| panic!("{error}")).scene
}

/// The scene after a file of this name. Files are in the source's order, and so is the scene that they are
/// compared with.
fn after(scene: &Scene, name: &str, options: WriteOptions) -> Scene {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    write_scene_with(&path, scene, options).unwrap();
    read_scene(&path).unwrap().scene
}

/// Peak signal-to-noise ratio in decibels, for a peak of 1.
fn psnr(a: &RenderedImage, b: &RenderedImage) -> f64 {
    let pairs = a.color.as_flattened().iter().zip(b.color.as_flattened());
    let sum: f64 = pairs.map(|(a, b)| f64::from(a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0)).powi(2)).sum();
    -10.0 * (sum / (3 * a.color.len()) as f64).log10()
}

#[test]
fn pictures_of_the_demo_scene_survive() {
    let scene = demo();
    let cameras = orbit(&scene, 3, UVec2::splat(256));
    let glb = after(&scene, "a.glb", WriteOptions::default());
    let spz = [3, 4]
        .map(|spz_version| after(&scene, "a.spz", WriteOptions { spz_version, ..WriteOptions::default() }));
    for camera in &cameras {
        let picture = |scene: &Scene| render(scene, Colors::Captured, camera);
        let source = picture(&scene);
        let covered = source.alpha.iter().filter(|&&alpha| alpha > 0.5).count();
        assert!(covered > 256 * 256 / 5, "the camera sees the scene: {covered} pixels");
        let of_glb = psnr(&source, &picture(&glb));
        let of_spz = psnr(&source, &picture(&spz[0]));
        eprintln!("PSNR: GLB {of_glb:.1} dB, SPZ {of_spz:.1} dB");
        // Equal depths may sort in another order.
        assert!(of_glb >= 80.0, "{of_glb}");
        assert!(of_spz >= 45.0, "{of_spz}");
    }
    // Two ways to compress the same numbers.
    assert_eq!(spz[0].means, spz[1].means);
    assert_eq!(spz[0].base_colors(), spz[1].base_colors());
}

#[test]
fn styled_colors_survive() {
    let mut scene = demo();
    // By source index, so that the order in a file does not matter.
    let color = |i: usize| [0, 1, 2].map(|c| ((i * (c + 1)) as f32 * 0.01).sin() * 0.6 + 0.5);
    let colors: Vec<[f32; 3]> = scene.order.iter().map(|&i| color(i as usize)).collect();
    scene.set_colors(&colors);
    let glb = after(&scene, "a.glb", WriteOptions::default());
    let spz = after(&scene, "a.spz", WriteOptions::default());
    let mut order = scene.order.clone();
    order.sort_unstable();
    // Half a step of the byte that holds 0.5 + 0.15 f_dc, and rounding.
    let step = 0.5 / 255.0 / 0.15 * sh::Y_0 + 1e-6;
    let found = glb.base_colors().into_iter().zip(spz.base_colors());
    for ((of_glb, of_spz), source) in found.zip(order) {
        // A file keeps coefficients, and not the colors themselves.
        let expected = color(source as usize);
        assert_eq!(of_glb, sh::color_from_dc(sh::dc_from_color(expected)));
        assert!(
            of_spz.iter().zip(expected).all(|(a, b)| (a - b).abs() <= step),
            "{of_spz:?} for {expected:?}"
        );
    }
    // And it can be styled anew.
    let (found, expected) = (glb.features.unwrap(), scene.features.unwrap());
    assert_eq!(
        (found.n_latent, found.n_extra, found.basis),
        (expected.n_latent, expected.n_extra, expected.basis)
    );
    assert_eq!(found.encoder, expected.encoder);
    assert!(expected.n_latent > 0 && glb.order.is_sorted());
}
