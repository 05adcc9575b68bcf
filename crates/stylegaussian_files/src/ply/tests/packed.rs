//! Compressed files, as they are written here.

use stylegaussian::Scene;

use super::*;
use crate::{WriteOptions, scene_to_bytes, tests::full_scene, write_scene_with};

/// Half a step of 11, 10 and 11 bits in the box of a chunk.
fn half_steps(size: Vec3) -> Vec3 {
    0.51 * size / Vec3::new(2047.0, 1023.0, 2047.0)
}

#[test]
fn what_is_packed_comes_back_within_half_a_step() {
    let source = full_scene();
    let bytes = scene_to_bytes("Scene.Compressed.PLY", &source).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    assert!(
        text.contains("element chunk 1\n") && text.contains("packed_position") && text.contains("element sh")
    );
    let Loaded { scene, warnings, .. } = read(bytes).unwrap();
    assert_eq!((warnings, scene.filter, scene.up.is_some()), (vec![], ScreenFilter::Antialiased, true));
    let sorted = source.subset(&stylegaussian::morton::order(&source.means));
    let spread = |values: &[Vec3]| {
        let min = values.iter().copied().reduce(Vec3::min).unwrap();
        values.iter().copied().reduce(Vec3::max).unwrap() - min
    };
    let logs = |scene: &Scene| scene.scales.iter().map(|s| s.map(f32::ln)).collect::<Vec<_>>();
    let (log_a, log_b) = (logs(&sorted), logs(&scene));
    let colors =
        [&sorted, &scene].map(|scene| scene.base_colors().into_iter().map(Vec3::from).collect::<Vec<_>>());
    let of_colors = 0.51 * spread(&colors[0]) / 255.0;
    let degree = sorted.sh.as_ref().unwrap().degree;
    assert_eq!(scene.sh.as_ref().unwrap().degree, degree);
    for i in 0..sorted.len() {
        let within = |a: Vec3, b: Vec3, most: Vec3| (a - b).abs().cmple(most + 1e-6).all();
        assert!(within(scene.means[i], sorted.means[i], half_steps(spread(&sorted.means))), "{i}");
        assert!(within(log_a[i], log_b[i], half_steps(spread(&log_a))), "{i}");
        assert!(within(colors[0][i], colors[1][i], of_colors), "{i}");
        assert!((scene.opacities[i] - sorted.opacities[i]).abs() < 0.51 / 255.0);
        assert!(scene.rotations[i].dot(sorted.rotations[i]).abs() > 0.999_995, "{i}");
        let width = 3 * n_coefficients(degree);
        let rest =
            |scene: &Scene| scene.sh.as_ref().unwrap().coefficients[i * width + 3..(i + 1) * width].to_vec();
        assert!(rest(&scene).iter().zip(rest(&sorted)).all(|(a, b)| (a - b).abs() <= 4.01 / 256.0), "{i}");
    }
}

#[test]
fn several_chunks_and_values_at_the_edge() {
    let n = 600;
    let mut source = full_scene().subset(&(0..n).map(|i| i % 20).collect::<Vec<u32>>());
    source.order = (0..n).collect();
    source.n_source = n as usize;
    source.neighbors = None;
    for (i, mean) in source.means.iter_mut().enumerate() {
        *mean += Vec3::X * (i / 20) as f32;
    }
    source.scales[7] = Vec3::new(0.0, 0.5, 0.0);
    source.opacities[8] = 0.0;
    source.opacities[9] = 1.0;
    source.sh.as_mut().unwrap().coefficients[3 * 9 + 5] = 100.0;
    let dir = crate::tests::dir();
    let path = dir.path().join("a.compressed.ply");
    let warnings = write_scene_with(&path, &source, WriteOptions::default()).unwrap();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].starts_with("1 Gaussians have spherical harmonics"), "{warnings:?}");
    let Loaded { scene, warnings, .. } = read_scene(&path).unwrap();
    assert_eq!((scene.len(), warnings), (600, vec![]));
    assert_eq!(scene.bounds().unwrap().0.x, source.bounds().unwrap().0.x);
    let thin = scene.scales.iter().filter(|scales| scales.min_element() < 1e-6).count();
    assert_eq!(thin, 1, "e^-20, invisible, and of one Gaussian alone");
    // Without colors it is gray, and without higher degrees there is no element for them.
    let gray = Scene { sh: None, ..source };
    let bytes = scene_to_bytes("a.compressed.ply", &gray).unwrap();
    assert!(!String::from_utf8_lossy(&bytes).contains("element sh"));
    let colors = read(bytes).unwrap().scene.base_colors();
    assert!(colors.as_flattened().iter().all(|value| (value - 0.5).abs() < 1e-5));
}

/// Programs with a fixed size of a row want all 45 coefficients.
#[test]
fn missing_degrees_are_filled_up_where_that_is_asked_for() {
    let dir = crate::tests::dir();
    let path = dir.path().join("a.ply");
    for (captured, fills_sh, sh_degree, expected) in
        [(2, true, 3, 3), (2, false, 3, 2), (0, true, 3, 3), (2, true, 1, 1), (0, true, 2, 2)]
    {
        let source = full_scene().with_sh_degree_at_most(captured).into_owned();
        let options = WriteOptions { sh_degree, fills_sh, ..WriteOptions::default() };
        write_scene_with(&path, &source, options).unwrap();
        let sh = read_scene(&path).unwrap().scene.sh.unwrap();
        assert_eq!(sh.degree, expected, "{captured} {fills_sh} {sh_degree}");
        let sorted = source.subset(&source.by_source()).sh.unwrap();
        let widths = [sh.degree, sorted.degree].map(|degree| 3 * n_coefficients(degree));
        for (row, was) in
            sh.coefficients.chunks_exact(widths[0]).zip(sorted.coefficients.chunks_exact(widths[1]))
        {
            let n = widths[0].min(widths[1]);
            assert_eq!(row[..n], was[..n]);
            assert!(row[n..].iter().all(|&value| value == 0.0));
        }
    }
    let gray = Scene { sh: None, ..full_scene() };
    write_scene_with(&path, &gray, WriteOptions { fills_sh: true, ..WriteOptions::default() }).unwrap();
    assert_eq!(read_scene(&path).unwrap().scene.sh.unwrap().degree, 3);
}
