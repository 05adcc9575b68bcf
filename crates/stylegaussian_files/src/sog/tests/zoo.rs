//! SOG scenes of others.

use std::path::PathBuf;

use super::*;
use crate::{read_scene, read_scene_with, tests::shared_data};

fn zoo(name: &str) -> Option<PathBuf> {
    shared_data(&format!("zoo/{name}"))
}

/// The same Gaussians as `.ply` and as `.sog`. EQUIVALENCE.md derives the tolerances.
#[test]
fn twins_are_equal() {
    let Some(folder) = zoo("equivalence") else { return };
    for (sog, ply, log_span) in [
        ("equiv-degree1-offgrid.sog", "equiv-degree1-offgrid-binary-le.ply", 5.488),
        ("equiv-degree3-exact.sog", "equiv-degree3-exact-binary-le.ply", 1.096),
    ] {
        let found = read_scene(&folder.join(sog)).unwrap();
        assert!(found.warnings.is_empty(), "{:?}", found.warnings);
        let (found, expected) = (found.scene, read_scene(&folder.join(ply)).unwrap().scene);
        assert_eq!(found.len(), expected.len());
        for i in 0..found.len() {
            let off = (found.means[i] - expected.means[i]).abs().as_dvec3();
            let step = (expected.means[i].abs().as_dvec3() + 1.0) * log_span / 131_070.0;
            assert!(off.cmple(step + 1e-6).all(), "{sog} {i}: {off}");
            assert!((found.scales[i] / expected.scales[i] - 1.0).abs().max_element() < 2e-6, "{sog} {i}");
            assert!((found.opacities[i] - expected.opacities[i]).abs() <= 1.0 / 510.0 + 1e-6);
            let (a, b) = (found.rotations[i], expected.rotations[i]);
            let (a, b) = (a.to_array(), (if a.dot(b) < 0.0 { -b } else { b }).to_array());
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 8e-3), "{sog} {i}: {a:?} {b:?}");
        }
        let (found, expected) = (found.sh.unwrap(), expected.sh.unwrap());
        assert_eq!(found.degree, expected.degree);
        let mut sh = found.coefficients.iter().zip(&expected.coefficients);
        assert!(sh.all(|(a, b)| (a - b).abs() < 2e-6), "{sog}: {:?}", found.coefficients);
    }
}

/// A capture as `.ply`, and as `.sog` in another order.
#[test]
fn a_capture_is_its_ply() {
    let (Some(sog), Some(ply)) = (zoo("sog/leica-sofort-top8192.sog"), zoo("ply/leica-sofort-top8192.ply"))
    else {
        return;
    };
    let (found, expected) = (read_scene(&sog).unwrap().scene, read_scene(&ply).unwrap().scene);
    assert_eq!((found.len(), found.sh.as_ref().unwrap().degree), (8192, 3));
    let mut used = vec![false; expected.len()];
    let (mut dots, mut opacities) = (0.0, 0.0_f32);
    for i in 0..found.len() {
        let distance = |j: &usize| found.means[i].distance_squared(expected.means[*j]);
        let nearest = (0..expected.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
        used[nearest] = true;
        dots += f64::from(found.rotations[i].dot(expected.rotations[nearest]).abs());
        opacities = opacities.max((found.opacities[i] - expected.opacities[nearest]).abs());
    }
    assert_eq!(used.iter().filter(|used| **used).count(), 8192);
    assert!(dots / 8192.0 > 0.9999, "{}", dots / 8192.0);
    // The program that wrote it rounds opacities down.
    assert!(opacities < 1.0 / 255.0, "{opacities}");
}

/// The numbers of `decode-degree1.sog.golden.usda`, which another program wrote: y and z are turned there.
#[test]
fn golden_numbers() {
    let Some(path) = zoo("fixtures-usd3dgs/sog/decode-degree1.sog") else { return };
    let scene = read_scene(&path).unwrap().scene;
    let near = |a: Vec3, b: [f32; 3]| assert!((a - Vec3::from(b)).abs().max_element() < 2e-4, "{a} {b:?}");
    near(scene.means[0], [1.0, -2.0, 0.5]);
    near(scene.means[1], [-3.0, -0.25, -4.0]);
    near(scene.scales[0], [1.0, 2.718_281_7, 0.367_879_45]);
    assert!((scene.opacities[0] - 0.8).abs() < 1e-6 && (scene.opacities[1] - 0.6).abs() < 1e-6);
    near(scene.rotations[0].xyz(), [0.002_773, 0.002_773, 0.002_773]);
    let sh = scene.sh.unwrap().coefficients;
    near(Vec3::from_slice(&sh[..3]), [0.0, 0.5, -0.5]);
    // The functions of y and z change their signs with the axes, that of x does not.
    near(Vec3::from_slice(&sh[3..6]), [-0.1, -0.2, -0.3]);
    near(Vec3::from_slice(&sh[6..9]), [0.1, 0.2, 0.3]);
    near(Vec3::from_slice(&sh[9..12]), [0.4, -0.4, 0.5]);
}

/// One scene in three packings.
#[test]
fn packings_are_equal() {
    let Some(folder) = zoo("fixtures-usd3dgs/sog") else { return };
    let [stored, deflated, unbundled] =
        ["kit-multi-degree3.sog", "kit-multi-degree3-deflated.sog", "unbundled-kit-multi-degree3/meta.json"]
            .map(|name| read_scene(&folder.join(name)).unwrap().scene);
    assert_eq!(stored.len(), 3);
    for other in [deflated, unbundled] {
        assert_eq!((&stored.means, &stored.rotations), (&other.means, &other.rotations));
        assert_eq!((&stored.scales, &stored.opacities), (&other.scales, &other.opacities));
        assert_eq!(stored.sh.as_ref().unwrap().coefficients, other.sh.unwrap().coefficients);
    }
    assert_eq!(read_scene(&folder.join("kit-one-degree0.sog")).unwrap().scene.len(), 1);
}

#[test]
fn broken_files_are_one_line() {
    let Some(folder) = zoo("fixtures-usd3dgs/sog") else { return };
    for (name, expected) in [
        ("bad-bands.sog", "4 bands"),
        ("bad-zip.sog", "no end record"),
        ("corrupt-plane.sog", "a damaged image in"),
        ("count-exceeds-plane.sog", "one for each of 4096"),
        ("device-plane-name.sog", "NUL.webp"),
        ("empty-count.sog", "no Gaussian"),
        ("escaping-plane-name.sog", "../scales.webp"),
        ("huge-bands.sog", "expected u8"),
        ("huge-count.sog", "expected u32"),
        ("huge-palette-count.sog", "expected u32"),
        ("huge-version.sog", "version 1e+300"),
        ("labels-out-of-range.sog", "label 1"),
        ("lossy-plane.sog", "a lossy image"),
        ("malformed-meta.sog", "JSON with an error"),
        ("missing-plane.sog", "without `"),
        ("no-meta.sog", "without `meta.json` (it has: readme.txt)"),
        ("not-sog.json", "JSON"),
        ("not-sog.sog", "starts with"),
        ("short-codebook.sog", "255 numbers"),
        ("unbundled-missing-plane/meta.json", "sh0.webp"),
        ("version-1.sog", "version 1"),
        ("version-3.sog", "version 3"),
    ] {
        let message = refused(read_scene(&folder.join(name)));
        println!("{message}");
        assert!(message.contains(name.split('/').next().unwrap()) && message.contains(expected), "{message}");
    }
    // Rotations without a valid tag are none, as in the reader of the format's makers.
    let warnings = read_scene(&folder.join("bad-quat-tag.sog")).unwrap().warnings;
    assert!(warnings[0].starts_with("1 of 1"), "{warnings:?}");
}

/// Two nodes of 7 levels; the MANIFEST has the counts.
#[test]
fn levels_of_detail() {
    let Some(path) = zoo("ssog/playbot/lod-meta.json") else { return };
    let read = |budget| {
        let options = ReadOptions { budget: Some(budget), ..ReadOptions::default() };
        let loaded = read_scene_with(&path, options).unwrap();
        loaded.scene.validate().unwrap();
        assert_eq!(loaded.scene.sh.as_ref().unwrap().degree, 2);
        // The box that the file's tree gives, of all that is drawn.
        let (min, max) = loaded.scene.bounds().unwrap();
        assert!(min.cmpge(Vec3::new(-1.033_5, -1.083_2, -1.039_4)).all(), "{min}");
        assert!(max.cmple(Vec3::new(1.035_1, 0.052_1, 1.042_4)).all(), "{max}");
        (loaded.scene.len(), loaded.warnings.len())
    };
    assert_eq!(read(1000), (1873, 1));
    assert_eq!(read(1873), (1873, 0));
    assert_eq!(read(2999), (2421, 0)); // 1,499 + 922: one node a level finer
    assert_eq!(read(3000), (3000, 0));
    assert_eq!(read(8406), (8406, 0));
    assert_eq!(read(31_000), (31_000, 0));
}
