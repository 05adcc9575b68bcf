//! SOG scenes that are made here, by the formulas of the format's page turned around.

use std::collections::BTreeMap;

use glam::{Quat, Vec3};
use image_webp::{ColorType, WebPEncoder};
use serde_json::{Value, json};

use super::*;
use crate::{
    FileError, Reading, SceneReader,
    archive::tests::{Packing, archive},
};

mod written;
mod zoo;

/// Files by their names.
type Folder = BTreeMap<String, Vec<u8>>;

/// The width of planes. Palettes have their own.
const WIDTH: usize = 13;

/// Entries of the palette: more than a row of 64 holds.
const N_ENTRIES: usize = 70;

/// Pseudo-random numbers in 0..1 (a linear congruential generator).
fn randoms(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1u64 << 24) as f64
    }
}

/// A lossless image of these texels, padded with junk.
fn webp(mut texels: Vec<[u8; 4]>, width: usize) -> Vec<u8> {
    texels.resize(texels.len().next_multiple_of(width), [77; 4]);
    let mut bytes = Vec::new();
    let height = (texels.len() / width) as u32;
    let encoder = WebPEncoder::new(&mut bytes);
    encoder.encode(texels.as_flattened(), width as u32, height, ColorType::Rgba8).unwrap();
    bytes
}

/// A codebook of version 2, ascending from `min` to `max`.
fn codebook(min: f64, max: f64) -> Vec<f64> {
    (0..256).map(|i| min + (max - min) * (f64::from(i) / 255.0).powi(2)).collect()
}

/// The code of a quaternion: the largest component of w, x, y, z is left out.
fn quaternion_code(q: Quat) -> [u8; 4] {
    let wxyz = [q.w, q.x, q.y, q.z];
    let largest = (0..4).max_by(|&a, &b| wxyz[a].abs().total_cmp(&wxyz[b].abs())).unwrap();
    let sign = wxyz[largest].signum();
    let mut code = [0, 0, 0, 252 + largest as u8];
    for (slot, i) in (0..4).filter(|&i| i != largest).enumerate() {
        code[slot] = ((wxyz[i] * sign * 2f32.sqrt() + 1.0) / 2.0 * 255.0).round() as u8;
    }
    code
}

/// `n` Gaussians and their folder in version 2, with spherical harmonics of degree 2 by a palette.
fn made(n: usize, seed: u64) -> (Scene, Folder) {
    let mut random = randoms(seed);
    let mut scene = Scene { sh: Some(Sh { degree: 2, coefficients: Vec::new() }), ..Scene::default() };
    let (scale_book, dc_book, sh_book) = (codebook(-7.0, 1.0), codebook(-2.0, 3.0), codebook(-0.5, 0.5));
    let mut code = || (random() * 256.0) as u8;
    let palette: Vec<[u8; 4]> = (0..N_ENTRIES * 8).map(|_| [code(), code(), code(), 255]).collect();
    let [mut scales, mut colors, mut labels, mut quats] = [const { Vec::new() }; 4];
    let log = |x: f32| f64::from(x.abs()).ln_1p().copysign(f64::from(x));
    for i in 0..n {
        let of = |book: &[f64], code: u8| book[usize::from(code)] as f32;
        let c = [code(), code(), code(), 255];
        scales.push(c);
        scene
            .scales
            .push(Vec3::new(of(&scale_book, c[0]), of(&scale_book, c[1]), of(&scale_book, c[2])).exp());
        let c = [code(), code(), code(), code()];
        colors.push(c);
        scene.opacities.push(f32::from(c[3]) / 255.0);
        // The last entry is used too.
        let label = if i == 0 { N_ENTRIES - 1 } else { usize::from(code()) * N_ENTRIES / 256 };
        labels.push([label as u8, (label >> 8) as u8, 9, 255]);
        let coefficients = &mut scene.sh.as_mut().unwrap().coefficients;
        coefficients.extend(c[..3].iter().map(|&c| of(&dc_book, c)));
        for texel in &palette[label * 8..label * 8 + 8] {
            coefficients.extend(texel[..3].iter().map(|&c| of(&sh_book, c)));
        }
        let axis = Vec3::new(f32::from(code()), f32::from(code()), f32::from(code())) - 127.3;
        let rotation = Quat::from_axis_angle(axis.normalize(), f32::from(code()));
        scene.rotations.push(rotation);
        quats.push(quaternion_code(rotation));
    }
    scene.means =
        (0..n).map(|_| Vec3::from_array([0, 1, 2].map(|_| ((random() - 0.5) * 8.0).sinh() as f32))).collect();
    let logs: Vec<[f64; 3]> = scene.means.iter().map(|mean| mean.to_array().map(log)).collect();
    let end = |best: fn(f64, f64) -> f64| [0, 1, 2].map(|a| logs.iter().map(|l| l[a]).reduce(best).unwrap());
    let (mins, maxs) = (end(f64::min), end(f64::max));
    let bytes = |shift: u32| -> Vec<[u8; 4]> {
        let code = |l: &[f64; 3], a: usize| ((l[a] - mins[a]) / (maxs[a] - mins[a]) * 65535.0).round() as u32;
        logs.iter()
            .map(|l| [code(l, 0), code(l, 1), code(l, 2), 255 << shift].map(|c| (c >> shift) as u8))
            .collect()
    };
    let meta = json!({
        "version": 2, "count": n, "antialias": true,
        "means": {"mins": mins, "maxs": maxs, "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": scale_book, "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": dc_book, "files": ["sh0.webp"]},
        "shN": {"count": N_ENTRIES, "bands": 2, "codebook": sh_book,
                "files": ["centroids.webp", "labels.webp"]},
    });
    let files = [
        ("means_l.webp", webp(bytes(0), WIDTH)),
        ("means_u.webp", webp(bytes(8), WIDTH)),
        ("quats.webp", webp(quats, WIDTH)),
        ("scales.webp", webp(scales, WIDTH)),
        ("sh0.webp", webp(colors, WIDTH)),
        ("centroids.webp", webp(palette, 64 * 8)),
        ("labels.webp", webp(labels, WIDTH)),
        (META, meta.to_string().into_bytes()),
    ];
    (scene, files.into_iter().map(|(name, bytes)| (name.into(), bytes)).collect())
}

/// A zip archive of a folder.
fn bundle(folder: &Folder, packing: Packing) -> Vec<u8> {
    let entries: Vec<_> = folder.iter().map(|(name, bytes)| (&name[..], bytes.clone())).collect();
    archive(&entries, packing)
}

/// Reads the scene that `main` names, whose other files are in `folder`.
fn read_folder(folder: &Folder, main: &str, options: ReadOptions) -> Result<Loaded, FileError> {
    let mut reader = SceneReader::new(folder[main].clone(), main, options);
    loop {
        match reader.read()? {
            Reading::Scene(loaded) => return Ok(*loaded),
            Reading::Needs(names) => {
                for name in names {
                    let bytes = folder.get(&name).unwrap_or_else(|| panic!("asked for {name}")).clone();
                    reader.add(name, bytes);
                }
            }
        }
    }
}

fn read_bundle(bytes: &[u8]) -> Result<Loaded, FileError> {
    crate::scene_from_bytes(bytes, "scene.sog")
}

/// The message of an expected error. It is one line.
fn refused(result: Result<Loaded, FileError>) -> String {
    let Err(error) = result else { panic!("no error") };
    let message = error.to_string();
    assert!(!message.contains('\n'), "{message}");
    message
}

/// Compares a scene with what was encoded. Half a step of a mean's code is widened by exp, as the logarithm is
/// undone; a rotation's by the component that is left out, at least 1/2.
fn assert_near(found: &Scene, expected: &Scene, log_span: f64) {
    assert_eq!(found.len(), expected.len());
    let sh = |scene: &Scene| scene.sh.clone().unwrap().coefficients;
    for (a, b) in sh(found).into_iter().zip(sh(expected)) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    for i in 0..found.len() {
        let step = (expected.means[i].abs().as_dvec3() + 1.0) * log_span / 131_070.0;
        let off = (found.means[i] - expected.means[i]).abs().as_dvec3();
        assert!(off.cmple(step * 1.01 + 1e-6).all(), "{i}: {} {}", found.means[i], expected.means[i]);
        assert!((found.scales[i] / expected.scales[i] - 1.0).abs().max_element() < 1e-5);
        assert_eq!(found.opacities[i], expected.opacities[i]);
        // Three components of half a step, 1 / 255 / sqrt(2), and the fourth: at most 3 * 0.0028 / 1.
        assert!(found.rotations[i].dot(expected.rotations[i]).abs() > 1.0 - 8e-5, "{i}");
    }
}

#[test]
fn bundled_stored_or_deflated_or_as_a_folder() {
    let (expected, folder) = made(300, 1);
    let stored = read_bundle(&bundle(&folder, Packing::Stored)).unwrap();
    let deflated = read_bundle(&bundle(&folder, Packing::Deflated)).unwrap();
    let unbundled = read_folder(&folder, META, ReadOptions::default()).unwrap();
    for loaded in [stored, deflated, unbundled] {
        assert_eq!((loaded.format, loaded.axes, loaded.warnings.len()), ("SOG", Axes::RDF, 0));
        assert_near(&loaded.scene, &expected, 2.0 * 55f64.ln_1p());
        assert_eq!(loaded.scene.filter, ScreenFilter::Antialiased);
        loaded.scene.validate().unwrap();
    }
    let rub = ReadOptions { axes: Some(Axes::RUB), ..ReadOptions::default() };
    let turned = read_folder(&folder, META, rub).unwrap();
    assert!((turned.scene.means[7] * Vec3::new(1.0, -1.0, -1.0) - expected.means[7]).length() < 0.02);
    assert_eq!(turned.axes, Axes::RUB);
}

/// Changes the metadata of a folder.
fn with_meta(folder: &Folder, change: impl FnOnce(&mut Value)) -> Folder {
    let mut folder = folder.clone();
    let mut meta = serde_json::from_slice(&folder[META]).unwrap();
    change(&mut meta);
    folder.insert(META.into(), meta.to_string().into_bytes());
    folder
}

#[test]
fn version_1_has_ranges_in_place_of_codebooks() {
    let (expected, folder) = made(40, 2);
    let folder = with_meta(&folder, |meta| {
        let means = json!({"shape": [40, 3], "mins": meta["means"]["mins"], "maxs": meta["means"]["maxs"],
            "files": meta["means"]["files"]});
        *meta = json!({
            "means": means,
            "scales": {"shape": [40, 3], "mins": [-7, -6, -5], "maxs": [1, 2, 3], "files": ["scales.webp"]},
            "quats": {"shape": [40, 4], "encoding": "quaternion_packed", "files": ["quats.webp"]},
            "sh0": {"mins": [-2, -1, 0, -6], "maxs": [2, 2, 2, 9], "files": ["sh0.webp"]},
            "shN": {"mins": -0.5, "maxs": 1.5, "files": ["centroids.webp", "labels.webp"]},
        });
    });
    let Loaded { scene, warnings, .. } = read_folder(&folder, META, ReadOptions::default()).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    assert_eq!(scene.filter, ScreenFilter::Classic);
    let (sh, of_codes) = (scene.sh.as_ref().unwrap(), expected.sh.as_ref().unwrap());
    assert_eq!(sh.degree, 2);
    for i in 0..40 {
        assert!((scene.means[i] - expected.means[i]).length() < 0.02);
        // The opacity of version 2 is the code itself.
        let logit = -6.0 + 15.0 * expected.opacities[i];
        assert!((scene.opacities[i] - 1.0 / (1.0 + (-logit).exp())).abs() < 1e-5);
        // Codes back from the quadratic codebooks.
        let share = |value: f32, min: f32, max: f32| ((value - min) / (max - min)).max(0.0).sqrt();
        let y = -6.0 + 8.0 * share(expected.scales[i].y.ln(), -7.0, 1.0);
        assert!((scene.scales[i].y.ln() - y).abs() < 1e-4);
        let blue = 2.0 * share(of_codes.coefficients[27 * i + 2], -2.0, 3.0);
        assert!((sh.coefficients[27 * i + 2] - blue).abs() < 1e-4);
        let last = -0.5 + 2.0 * share(of_codes.coefficients[27 * i + 26], -0.5, 0.5);
        assert!((sh.coefficients[27 * i + 26] - last).abs() < 1e-3);
    }
}

/// A scene of two levels and an environment: chunks of 300, 100 and 20 Gaussians.
fn streamed() -> Folder {
    let mut all = Folder::new();
    for (path, n) in [("fine", 300), ("coarse/a", 100), ("env", 20)] {
        let (_, mut folder) = made(n, n as u64);
        if path == "env" {
            folder = with_meta(&folder, |meta| {
                meta.as_object_mut().unwrap().remove("shN");
            });
        }
        all.extend(folder.into_iter().map(|(name, bytes)| (format!("{path}/{name}"), bytes)));
    }
    let levels = json!({
        "version": 1, "count": 400, "counts": [300, 100], "lodLevels": 2, "environment": "env/meta.json",
        "filenames": ["fine/meta.json", "coarse/a/meta.json"],
        "tree": {"children": [
            {"lods": {"0": {"file": 0, "offset": 0, "count": 180},
                      "1": {"file": 1, "offset": 40, "count": 60}}},
            {"lods": {"0": {"file": 0, "offset": 180, "count": 120},
                      "1": {"file": 1, "offset": 0, "count": 40}}},
        ]},
    });
    all.insert("lod-meta.json".into(), levels.to_string().into_bytes());
    all
}

#[test]
fn streamed_scenes_keep_to_a_budget() {
    let folder = streamed();
    let of = |budget| {
        let options = ReadOptions { budget, ..ReadOptions::default() };
        read_folder(&folder, "lod-meta.json", options).unwrap()
    };
    let (fine, coarse, env) = (made(300, 300).0, made(100, 100).0, made(20, 20).0);
    let full = of(None).scene;
    full.validate().unwrap();
    assert_eq!(full.len(), 320);
    assert_eq!((full.scales[0], full.scales[299]), (fine.scales[0], fine.scales[299]));
    assert_eq!(full.scales[319], env.scales[19]);
    // The environment has no higher harmonics.
    assert!(full.sh.unwrap().coefficients[27 * 300 + 3..27 * 301].iter().all(|&c| c == 0.0));
    // 180 + 40 + 20, and one less: the first node stays coarse.
    assert_eq!(of(Some(240)).scene.len(), 240);
    let coarser = of(Some(239)).scene;
    assert_eq!(coarser.len(), 60 + 120 + 20);
    assert_eq!((coarser.scales[0], coarser.scales[120]), (fine.scales[180], coarse.scales[40]));
    let coarsest = of(Some(19));
    assert_eq!((coarsest.scene.len(), coarsest.warnings.len()), (100, 2), "{:?}", coarsest.warnings);
    // Parts with other tags.
    let mut mixed = folder.clone();
    let untagged =
        String::from_utf8(folder["fine/meta.json"].clone()).unwrap().replace("\"antialias\":true,", "");
    mixed.insert("fine/meta.json".into(), untagged.into_bytes());
    let loaded = read_folder(&mixed, "lod-meta.json", ReadOptions::default()).unwrap();
    assert_eq!((loaded.scene.filter, loaded.warnings.len()), (ScreenFilter::Classic, 1));
}

#[test]
fn oddities_are_mended_and_told() {
    let (expected, folder) = made(30, 3);
    let null = with_meta(&folder, |meta| {
        meta["scales"]["codebook"][0] = Value::Null;
        meta["antialias"] = json!(null);
        meta["model"] = json!("2dgs");
    });
    let Loaded { scene, warnings, .. } = read_folder(&null, META, ReadOptions::default()).unwrap();
    assert_eq!(scene.filter, ScreenFilter::Classic);
    assert!(
        warnings[0].contains("2dgs") && warnings[1].contains("`scales` begins with null"),
        "{warnings:?}"
    );
    assert_eq!(scene.len(), expected.len());
    let quats = vec![[128, 128, 128, 255], [1, 2, 3, 251], [0, 0, 0, 0]];
    let mut untagged = with_meta(&made(3, 3).1, |_| {});
    untagged.insert("quats.webp".into(), webp(quats, WIDTH));
    let Loaded { scene, warnings, .. } = read_folder(&untagged, META, ReadOptions::default()).unwrap();
    assert!(scene.rotations[0].z > 0.999);
    assert_eq!(scene.rotations[1..], [Quat::IDENTITY; 2]);
    assert!(warnings[0].starts_with("2 of 3"), "{warnings:?}");
}

#[test]
fn contradictions_are_one_line() {
    let (_, folder) = made(300, 4);
    let check = |change: fn(&mut Value), expected: &str| {
        let folder = with_meta(&folder, change);
        let message = refused(read_folder(&folder, META, ReadOptions::default()));
        assert!(message.contains(expected), "{message}");
        let message = refused(read_bundle(&bundle(&folder, Packing::Deflated)));
        assert!(message.starts_with("scene.sog: found ") && message.contains(expected), "{message}");
    };
    check(|meta| meta["version"] = json!(3), "SOG version 3");
    check(|meta| meta["version"] = json!(1e300), "SOG version 1e+300");
    check(|meta| meta["count"] = json!(1e300), "expected u32");
    check(|meta| meta["count"] = json!(4_294_967_295u32), "4294967295 Gaussians");
    check(|meta| meta["count"] = json!(313), "one for each of 313 Gaussians");
    check(|meta| meta["shN"]["bands"] = json!(4), "4 bands");
    check(|meta| meta["shN"]["bands"] = json!(3), "expected 960");
    check(|meta| meta["shN"]["count"] = json!(129), "at most 128");
    check(|meta| meta["shN"]["count"] = json!(69), "label 69");
    check(|meta| meta["scales"]["codebook"][7] = Value::Null, "no finite number at 7");
    check(|meta| meta["sh0"]["codebook"][7] = json!(1e300), "no finite number at 7");
    check(|meta| meta["sh0"]["codebook"] = json!([1.0]), "with 1 numbers, expected 256");
    check(|meta| meta["means"]["mins"] = json!([1, 2]), "3 values");
    check(|meta| meta["quats"]["files"] = json!(["../quats.webp"]), "../quats.webp");
    check(|meta| meta["quats"]["files"] = json!(["nul.webp"]), "nul.webp");
    // A coordinate beyond f32 is no reason to refuse the others.
    let far = with_meta(&folder, |meta| meta["means"]["maxs"][1] = json!(1e300));
    let Loaded { scene, warnings, .. } = read_folder(&far, META, ReadOptions::default()).unwrap();
    assert!(scene.len() < 300 && warnings[0].starts_with("dropped"), "{} {warnings:?}", scene.len());
    let missing = refused(read_bundle(&bundle(
        &with_meta(&folder, |meta| meta["quats"]["files"] = json!(["q.webp"])),
        Packing::Stored,
    )));
    assert!(missing.contains("without `q.webp` (it has: "), "{missing}");
    // An image of one color takes few bytes whatever its size.
    let mut wide = with_meta(&folder, |meta| meta["count"] = json!(4_000_000));
    for (name, bytes) in &mut wide {
        if name.ends_with("webp") && name != "centroids.webp" {
            *bytes = webp(vec![[1, 2, 3, 255]; 4_000_000], 2000);
        }
    }
    let message = refused(read_folder(&wide, META, ReadOptions::default()));
    assert!(message.contains("2000 x 2000 pixels, expected at most"), "{message}");
    let mut bomb = folder.clone();
    bomb.insert("quats.webp".into(), vec![0; 20 << 20]);
    let message = refused(read_bundle(&bundle(&bomb, Packing::Deflated)));
    assert!(message.contains("unpacks to more at `quats.webp`"), "{message}");
}

#[test]
fn archives_are_told_apart_by_their_content() {
    let (_, folder) = made(20, 5);
    let sog = bundle(&folder, Packing::Stored);
    assert_eq!(crate::scene_from_bytes(&sog, "scene.zip").unwrap().format, "SOG");
    let other = bundle(&Folder::from([("readme.txt".into(), vec![1; 9])]), Packing::Stored);
    let message = refused(crate::scene_from_bytes(&other, "scene.zip"));
    assert!(message.contains("neither `meta.json` (SOG) nor `data.pkl`"), "{message}");
    assert!(refused(read_bundle(&other)).contains("without `meta.json` (it has: readme.txt)"));
    assert!(refused(read_bundle(&sog[..sog.len() / 2])).contains("no end record (truncated?)"));
    for json in ["{}", "{\"version\": 2, \"kind\": \"something else\"}", "[]", "{\"means\": "] {
        assert!(!recognizes(json.as_bytes(), "gltf"), "{json}");
    }
}

#[test]
fn damage_is_an_error_or_another_scene() {
    let (_, folder) = made(20, 6);
    let sog = bundle(&folder, Packing::Stored);
    for at in (0..sog.len()).step_by(7) {
        let mut damaged = sog.clone();
        damaged[at] ^= 0x41;
        drop(read_bundle(&damaged));
        drop(read_bundle(&sog[..at]));
    }
    // Without checksums in the way.
    for (name, bytes) in folder.iter().filter(|(name, _)| *name != META) {
        for (at, byte) in bytes.iter().enumerate().take(150) {
            for change in [0, 0xff, byte ^ 1, byte ^ 0x80] {
                let mut damaged = folder.clone();
                damaged.get_mut(name).unwrap()[at] = change;
                drop(read_folder(&damaged, META, ReadOptions::default()));
            }
        }
    }
}

#[test]
fn an_archive_of_a_folder_is_the_folder() {
    let (expected, folder) = made(60, 11);
    let packed = |prefix: &str, packing| {
        let names: Vec<String> = folder.keys().map(|name| format!("{prefix}{name}")).collect();
        let mut entries: Vec<_> =
            names.iter().zip(folder.values()).map(|(name, bytes)| (&name[..], bytes.clone())).collect();
        entries.push(("__MACOSX/._meta.json", Vec::new()));
        entries.push(("readme.txt", b"hello".to_vec()));
        archive(&entries, packing)
    };
    for prefix in ["canapes/", "a/b c/", "canapes\\", ""] {
        for name in ["a.sog", "a.zip"] {
            let loaded = crate::scene_from_bytes(&packed(prefix, Packing::Deflated), name).unwrap();
            assert_eq!((loaded.format, loaded.warnings), ("SOG", Vec::new()), "{prefix}");
            assert_near(&loaded.scene, &expected, 2.0 * 55f64.ln_1p());
        }
    }
    // The one above is meant, and of two side by side neither is.
    let two = |other: &str| {
        let other = format!("{other}meta.json");
        let mut entries: Vec<_> =
            folder.iter().map(|(name, bytes)| (format!("a/{name}"), bytes.clone())).collect();
        entries.push((other, b"{}".to_vec()));
        let entries: Vec<_> = entries.iter().map(|(name, bytes)| (&name[..], bytes.clone())).collect();
        read_bundle(&archive(&entries, Packing::Stored))
    };
    assert_eq!(two("a/old/").unwrap().scene.len(), 60);
    let message = refused(two("b/"));
    assert!(message.contains("with `a/meta.json` and `b/meta.json`, expected the files of one"), "{message}");
}

#[test]
fn a_folder_is_read_by_its_metadata_with_or_without_a_byte_order_mark() {
    let (expected, folder) = made(60, 12);
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes) in &folder {
        let mark: &[u8] = if name == META { b"\xef\xbb\xbf" } else { b"" };
        std::fs::write(dir.path().join(name), [mark, bytes].concat()).unwrap();
    }
    for path in [dir.path().to_owned(), dir.path().join(META)] {
        let loaded = crate::read_scene(&path).unwrap();
        assert_near(&loaded.scene, &expected, 2.0 * 55f64.ln_1p());
    }
    std::fs::remove_file(dir.path().join("sh0.webp")).unwrap();
    assert!(refused(crate::read_scene(dir.path())).contains("sh0.webp"));
    std::fs::remove_file(dir.path().join(META)).unwrap();
    let message = refused(crate::read_scene(dir.path()));
    assert!(message.contains("a folder without meta.json and lod-meta.json"), "{message}");
    // Levels of detail come before one of their chunks.
    std::fs::write(dir.path().join(META), "{}").unwrap();
    std::fs::write(dir.path().join(LEVELS), "\u{feff}{\"lodLevels\": 1, \"filenames\": 3}").unwrap();
    let message = refused(crate::read_scene(dir.path()));
    assert!(message.contains("lod-meta.json") && message.contains("levels of detail"), "{message}");
}
