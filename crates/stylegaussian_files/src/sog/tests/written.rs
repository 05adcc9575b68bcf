//! Bundles of our own, read back.

use super::*;
use crate::scene_to_bytes;

#[test]
fn a_bundle_is_read_back() {
    let (made, _) = made(300, 7);
    // Parts of one Gaussian, out of order: they are written in the source's.
    let order: Vec<u32> = (0..300).rev().collect();
    let scene = Scene { n_source: 300, order, filter: ScreenFilter::Antialiased, ..made };
    let scene = scene.with_sh_degree_at_most(0).into_owned();
    let bytes = scene_to_bytes("a.sog", &scene).unwrap();
    assert_eq!(bytes, scene_to_bytes("a.sog", &scene).unwrap());
    let loaded = read_bundle(&bytes).unwrap();
    assert_eq!((loaded.format, loaded.axes, loaded.warnings.len()), ("SOG", Axes::RDF, 0));
    let found = loaded.scene;
    found.validate().unwrap();
    assert_eq!((found.len(), found.filter), (300, ScreenFilter::Antialiased));
    let dc = |scene: &Scene, i: usize| scene.sh.as_ref().unwrap().coefficients[3 * i..][..3].to_vec();
    for i in 0..300 {
        let j = 299 - i;
        // Means are within 55 units: see `made`.
        let step = (scene.means[j].abs().as_dvec3() + 1.0) * 2.0 * 55f64.ln_1p() / 131_070.0;
        let off = (found.means[i] - scene.means[j]).abs().as_dvec3();
        assert!(off.cmple(step * 1.01 + 1e-6).all(), "{} {}", found.means[i], scene.means[j]);
        assert!(found.rotations[i].dot(scene.rotations[j]).abs() > 1.0 - 8e-5);
        assert!((found.opacities[i] - scene.opacities[j]).abs() < 0.5 / 255.0 + 1e-6);
        // 256 numbers from e^-7 to e and from -2 to 3, which move by a step at most toward what is near.
        assert!((found.scales[i] / scene.scales[j]).map(f32::ln).abs().max_element() < 1.5 * 8.0 / 255.0);
        for (a, b) in dc(&found, i).iter().zip(dc(&scene, j)) {
            assert!((a - b).abs() < 1.5 * 5.0 / 255.0, "{a} {b}");
        }
    }
}

#[test]
fn spherical_harmonics_are_read_back() {
    let mut random = randoms(3);
    for degree in 1..=3 {
        let width = 3 * sh::n_coefficients(degree);
        let coefficients: Vec<f32> = (0..300 * width).map(|_| random() as f32 - 0.5).collect();
        let order: Vec<u32> = (0..300).rev().collect();
        let sh = Some(Sh { degree, coefficients: coefficients.clone() });
        let scene = Scene { n_source: 300, order, sh, ..made(300, 7).0 };
        let loaded = read_bundle(&scene_to_bytes("a.sog", &scene).unwrap()).unwrap();
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        let found = loaded.scene.sh.unwrap();
        assert_eq!((found.degree, found.coefficients.len()), (degree, coefficients.len()));
        // Each Gaussian has an entry of its own. 256 numbers from -0.5 to 0.5 move by a step at most toward
        // what is near.
        let rows = found.coefficients.chunks(width).zip(coefficients.chunks(width).rev());
        for (a, b) in rows.flat_map(|(found, expected)| found.iter().zip(expected)) {
            assert!((a - b).abs() < 1.5 / 255.0, "degree {degree}: {a} {b}");
        }
    }
    // All alike: a palette of one entry, which the reader's limits on planes let pass.
    let even = Scene { sh: Some(Sh { degree: 3, coefficients: vec![0.0; 48 * 300] }), ..made(300, 7).0 };
    let even = Scene { n_source: 300, order: (0..300).collect(), ..even };
    let found = read_bundle(&scene_to_bytes("a.sog", &even).unwrap()).unwrap().scene.sh.unwrap();
    assert_eq!((found.degree, found.coefficients), (3, vec![0.0; 48 * 300]));
}

#[test]
fn one_gaussian_without_colors_or_thickness() {
    let scene = Scene {
        means: vec![Vec3::new(-3.0, 0.0, 1e6)],
        rotations: vec![Quat::from_xyzw(0.5, -0.5, 0.5, -0.5)],
        scales: vec![Vec3::new(0.25, 2.0, 0.0)],
        opacities: vec![1.0],
        order: vec![0],
        n_source: 1,
        ..Scene::default()
    };
    let found = read_bundle(&scene_to_bytes("a.sog", &scene).unwrap()).unwrap().scene;
    assert!((found.means[0] - scene.means[0]).abs().max_element() < 0.1, "{}", found.means[0]);
    assert!((found.scales[0] - scene.scales[0]).abs().max_element() < 0.01, "{}", found.scales[0]);
    assert!(found.rotations[0].dot(scene.rotations[0]).abs() > 0.9999);
    assert_eq!((found.base_colors(), found.opacities), (vec![[0.5; 3]], vec![1.0]));
}
