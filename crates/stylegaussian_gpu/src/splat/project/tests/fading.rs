//! Clouds that fade.

use super::*;

/// Records of a cloud that fades are those of fainter Gaussians. The cloud beside it, and both without a fade,
/// are as they were to the last bit.
#[test]
fn fading_records_are_those_of_fainter_gaussians() {
    let Some(gpu) = gpu() else { return };
    let scenes = [random_scene(1000, 1, 54), random_scene(700, 1, 55)];
    let faint = |factor: f32| {
        let opacities = scenes[1].opacities.iter().map(|opacity| factor * opacity).collect();
        Scene { opacities, ..scenes[1].clone() }
    };
    let on_gpu = |scene: &Scene| GpuScene::in_chunks(&gpu.device, scene, 300);
    let camera = Camera {
        world_from_view: pose(),
        clip_from_view: Mat4::perspective_infinite_reverse_rh(0.9, 1.0, 0.1),
        viewport: UVec4::new(0, 0, 64, 64),
    };
    let whole = scenes.each_ref().map(on_gpu);
    // A cloud without a volume is not drawn, and does not shift the shares of those after it.
    let flat = Cloud { world_from_scene: Affine3A::ZERO, ..cloud(&whole[0]) };
    let clouds = [cloud(&whole[0]), flat, cloud(&whole[1])];
    let plain = drawn(&gpu, &camera, &clouds);
    // 0.6 is 39321 of 65535; what lies outside of 0..1 is taken for the end.
    for (shares, factor) in [(vec![0.0, 1.0, 0.6], 0.4), (vec![-1.0, 1.0, 2.0], 0.0), (vec![], 1.0)] {
        let mut view = SplatView::new();
        view.set_faded(shares.clone());
        let found = drawn_in(&gpu, &mut view, &camera, &clouds);
        let fainter = on_gpu(&faint(factor));
        let expected = drawn(&gpu, &camera, &[cloud(&whole[0]), cloud(&fainter)]);
        assert_eq!(found.0, expected.0, "{shares:?}");
        for &i in &found.0 {
            let [found, expected, plain] =
                [&found, &expected, &plain].map(|(_, records)| &records[i as usize]);
            assert!((found.opacity - expected.opacity).abs() < 1e-3, "{shares:?}, record {i}");
            assert_eq!((found.center, found.depth, found.color), (plain.center, plain.depth, plain.color));
            assert!(found.opacity == plain.opacity || (i >= 1000 && factor < 1.0), "{shares:?}, record {i}");
        }
    }
}
