//! Every file of the zoo: scenes of other programs, whole and deliberately broken.

use std::{
    fs,
    path::{Path, PathBuf},
};

use stylegaussian::Scene;
use stylegaussian_files::{ReadOptions, read_scene, read_scene_with, readable_extensions};

/// The fate of a file.
#[derive(Clone, Copy)]
enum Fate {
    /// It has this many Gaussians.
    Reads(usize),
    /// It has this many Gaussians at most, since it was asked for no more.
    AtMost(usize),
    /// A message that holds this.
    Refused(&'static str),
}
use Fate::{AtMost, Reads, Refused};

/// All files that somebody might open as a scene, by folder. Files of one scene that others name are not among
/// them.
const FILES: &[(&str, &[(&str, Fate)])] = &[
    (
        "equivalence",
        &[
            ("equiv-degree1-offgrid-binary-le.ply", Reads(3)),
            ("equiv-degree1-offgrid-v2.spz", Reads(3)),
            ("equiv-degree1-offgrid.sog", Reads(3)),
            ("equiv-degree3-exact-binary-le.ply", Reads(4)),
            ("equiv-degree3-exact-v2.spz", Reads(4)),
            ("equiv-degree3-exact-v3.spz", Reads(4)),
            ("equiv-degree3-exact.sog", Reads(4)),
        ],
    ),
    (
        "fixtures-usd3dgs/ply",
        &[
            ("degree-1-sh.ply", Reads(1)),
            ("degree-2-sh.ply", Reads(1)),
            ("degree-3-sh.ply", Reads(1)),
            ("degree-4-sh.ply", Reads(1)),
            ("duplicate-sh-index.ply", Refused("3 properties f_rest_*")),
            ("empty-vertex.ply", Refused("no Gaussian")),
            ("invalid-sh-name.ply", Refused("3 properties f_rest_*")),
            ("list-property.ply", Refused("a list")),
            ("mesh-not-gaussian.ply", Refused("without opacity scale_0")),
            ("missing-opacity.ply", Refused("without opacity")),
            ("nan-opacity-binary-le.ply", Refused("no usable Gaussian among 1")),
            ("non-contiguous-sh.ply", Refused("3 properties f_rest_*")),
            ("one-gaussian-ascii.ply", Reads(1)),
            ("one-gaussian-binary-le.ply", Reads(1)),
            ("out-of-range-double.ply", Refused("no usable Gaussian among 1")),
            ("overflow-scale.ply", Refused("no usable Gaussian among 1")),
            ("reordered-properties.ply", Reads(1)),
            ("sh-count-not-rgb.ply", Refused("2 properties f_rest_*")),
            ("sh-invalid-degree.ply", Refused("6 properties f_rest_*")),
            ("three-gaussian-binary-le.ply", Reads(3)),
            ("truncated-binary-le.ply", Refused("bytes after the header")),
        ],
    ),
    (
        "fixtures-usd3dgs/sog",
        &[
            ("bad-bands.sog", Refused("4 bands")),
            // No tag of its quaternion: no rotation.
            ("bad-quat-tag.sog", Reads(1)),
            ("bad-zip.sog", Refused("zip archive")),
            ("corrupt-plane.sog", Refused("image")),
            ("count-exceeds-plane.sog", Refused("4096")),
            ("decode-degree1.sog", Reads(2)),
            ("device-plane-name.sog", Refused("NUL.webp")),
            ("empty-count.sog", Refused("no Gaussian")),
            ("escaping-plane-name.sog", Refused("../scales.webp")),
            ("huge-bands.sog", Refused("1e")),
            ("huge-count.sog", Refused("1e")),
            ("huge-palette-count.sog", Refused("1e")),
            ("huge-version.sog", Refused("1e")),
            ("kit-multi-degree3-deflated.sog", Reads(3)),
            ("kit-multi-degree3.sog", Reads(3)),
            ("kit-one-degree0.sog", Reads(1)),
            ("labels-out-of-range.sog", Refused("label")),
            ("lossy-plane.sog", Refused("lossy")),
            ("malformed-meta.sog", Refused("JSON")),
            ("missing-plane.sog", Refused("without `")),
            ("no-meta.sog", Refused("meta.json")),
            ("not-sog.json", Refused("JSON")),
            ("not-sog.sog", Refused("")),
            ("short-codebook.sog", Refused("256")),
            ("unbundled-kit-multi-degree3/meta.json", Reads(3)),
            ("unbundled-missing-plane/meta.json", Refused(".webp")),
            ("version-1.sog", Refused("version")),
            ("version-3.sog", Refused("version 3")),
        ],
    ),
    (
        "fixtures-usd3dgs/spz",
        &[
            ("bad-crc-v2.spz", Refused("gzip")),
            ("bad-fhcrc-v2.spz", Refused("gzip")),
            ("bad-isize-v2.spz", Refused("gzip")),
            ("corrupt-deflate.spz", Refused("gzip")),
            ("count-exceeds-stream-v2.spz", Refused("the end of the data")),
            ("decode-degree1-v2.spz", Reads(2)),
            ("decode-degree3-v2.spz", Reads(2)),
            ("decode-degree4-v2.spz", Reads(1)),
            ("decode-nonfinite-v1.spz", Refused("no usable Gaussian among 1")),
            ("decode-v1.spz", Reads(1)),
            ("decode-v3.spz", Reads(1)),
            ("degree3-v2.spz", Reads(1)),
            ("degree4-v2.spz", Reads(1)),
            ("empty-points-v2.spz", Refused("no Gaussian")),
            ("extensions-v2.spz", Reads(1)),
            ("gzip-not-spz.spz", Refused("starts with")),
            ("header-fields-v2.spz", Reads(1)),
            ("huge-count-v2.spz", Refused("2147483648")),
            ("long-fname-v2.spz", Reads(1)),
            ("minimal-v1.spz", Reads(1)),
            ("minimal-v2.spz", Reads(1)),
            ("minimal-v3.spz", Reads(1)),
            ("not-spz.spz", Refused("starts with")),
            ("plaintext-v2.spz", Reads(1)),
            ("plaintext-v4.spz", Refused("SPZ")),
            ("sh-degree-5-v2.spz", Refused("degree 5")),
            ("short-stream.spz", Refused("the end of the data")),
            ("three-points-degree1-v2.spz", Reads(3)),
            ("trailing-after-member-v2.spz", Refused("8 bytes after")),
            ("trailing-decompressed-v2.spz", Refused("after the last array")),
            ("truncated-deflate-v2.spz", Refused("gzip")),
            ("truncated-gzip-header.spz", Refused("gzip")),
            ("truncated-payload-v2.spz", Refused("the end of the data")),
            ("version-0.spz", Refused("version 0")),
            ("version-5.spz", Refused("version 5")),
        ],
    ),
    (
        "gltf",
        &[
            ("bgs-khr_conformance_matrix.glb", Reads(15)),
            ("bgs-khr_conformance_matrix.gltf", Reads(15)),
            ("bgs-khr_extensible_fallback.gltf", Reads(1)),
        ],
    ),
    ("ksplat", &[("splat-transform-minimal.ksplat", Reads(4))]),
    (
        "ply",
        &[
            ("gsplat-rs-minimal_ascii.ply", Reads(3)),
            ("gsplat-rs-minimal_binary.ply", Reads(3)),
            ("jsplat-unitCube-ascii.ply", Reads(20)),
            ("leica-sofort-top8192.ply", Reads(8192)),
            ("metalsplatter-3points-train.ply", Reads(3)),
            ("ply2splat-test.ply", Reads(100)),
            ("wgpu-3dgs-model.ply", Reads(9)),
        ],
    ),
    (
        "ply-not-splats",
        &[
            ("beetle.ascii.ply", Refused("without")),
            ("beetle.binary.ply", Refused("without")),
            ("brush-init.ply", Refused("without")),
            ("cube_att.ply", Refused("without")),
        ],
    ),
    ("sog", &[("leica-sofort-top8192.sog", Reads(8192))]),
    (
        "splat",
        &[
            ("broche-rose-gold.splat", Reads(129_929)),
            ("metalsplatter-3points-train.splat", Reads(3)),
            ("splat-transform-minimal.splat", Reads(4)),
        ],
    ),
    (
        "spz",
        &[
            ("gsplat-rs-minimal_v4_degree0.spz", Reads(8)),
            ("leica-sofort-top8192.spz", Reads(8192)),
            ("metalsplatter-3points-train.spz", Reads(3)),
            ("splat-transform-minimal-raw.spz", Reads(4)),
            ("splat-transform-minimal-v2.spz", Reads(4)),
            ("splat-transform-minimal-v3.spz", Reads(4)),
            ("splat-transform-minimal-v4.spz", Reads(4)),
            ("wgpu-3dgs-model.spz", Reads(9)),
        ],
    ),
    (
        "ssog/playbot",
        &[
            ("0_0/meta.json", Reads(500_000)),
            ("1_0/meta.json", Reads(250_000)),
            ("2_0/meta.json", Reads(125_000)),
            ("3_0/meta.json", Reads(31_000)),
            ("4_0/meta.json", Reads(8406)),
            ("5_0/meta.json", Reads(3000)),
            ("6_0/meta.json", Reads(1873)),
            ("lod-meta.json", AtMost(BUDGET)),
        ],
    ),
];

/// The most Gaussians of a scene that has several levels: one between two levels of `ssog/playbot`.
const BUDGET: usize = 2500;

/// Files that are no scenes of their own.
const OTHERS: [&str; 5] = ["md", "txt", "usda", "webp", ""];

/// The same Gaussians in two files, and the largest difference of a coordinate: half a step of what is stored
/// (`equivalence/EQUIVALENCE.md`), or nothing.
const TWINS: &[(&str, &str, f32)] = &[
    ("ply/gsplat-rs-minimal_binary.ply", "ply/gsplat-rs-minimal_ascii.ply", 1e-6),
    ("splat/metalsplatter-3points-train.splat", "ply/metalsplatter-3points-train.ply", 1e-6),
    ("ksplat/splat-transform-minimal.ksplat", "splat/splat-transform-minimal.splat", 0.0),
    ("fixtures-usd3dgs/ply/reordered-properties.ply", "fixtures-usd3dgs/ply/degree-1-sh.ply", 0.0),
    ("spz/metalsplatter-3points-train.spz", "ply/metalsplatter-3points-train.ply", SPZ_STEP),
    ("equivalence/equiv-degree1-offgrid-v2.spz", "equivalence/equiv-degree1-offgrid-binary-le.ply", SPZ_STEP),
    ("equivalence/equiv-degree3-exact-v2.spz", "equivalence/equiv-degree3-exact-binary-le.ply", 1e-5),
    ("equivalence/equiv-degree3-exact-v3.spz", "equivalence/equiv-degree3-exact-binary-le.ply", 1e-5),
    // (|p| + 1) times the span of logarithms, 1.096 and 5.488, over 131,070; |p| is 2 and 1000.5 at most.
    ("equivalence/equiv-degree3-exact.sog", "equivalence/equiv-degree3-exact-binary-le.ply", 3e-5),
    ("equivalence/equiv-degree1-offgrid.sog", "equivalence/equiv-degree1-offgrid-binary-le.ply", 4.2e-2),
    // A whole step and not half of one: its writer rounds down. 17.3 times a span of 5.6, over 65,535.
    ("sog/leica-sofort-top8192.sog", "ply/leica-sofort-top8192.ply", 1.6e-3),
];

/// Half of 2^-12, and some rounding.
const SPZ_STEP: f32 = 1.01 / 8192.0;

/// The zoo, or `None` with a notice if it is absent.
fn zoo() -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("STYLEGAUSSIAN_DATA").map_or_else(beside, PathBuf::from).join("zoo");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no zoo at {}; set STYLEGAUSSIAN_DATA", folder.display());
    None
}

fn extension(name: &str) -> &str {
    Path::new(name).extension().and_then(|extension| extension.to_str()).unwrap_or_default()
}

/// Whether a format of this extension is read.
fn is_read(name: &str) -> bool {
    readable_extensions().contains(&extension(name))
}

fn files() -> impl Iterator<Item = (String, Fate)> {
    let in_folder = |&(folder, files): &(&str, &'static [(&str, Fate)])| {
        let folder = folder.to_owned();
        files.iter().map(move |&(name, fate)| (format!("{folder}/{name}"), fate))
    };
    FILES.iter().flat_map(in_folder)
}

#[test]
fn good_files_have_their_gaussians_and_broken_ones_a_line() {
    let Some(zoo) = zoo() else { return };
    for (name, fate) in files().filter(|(name, _)| is_read(name)) {
        let options = ReadOptions { budget: Some(BUDGET), ..ReadOptions::default() };
        match (fate, read_scene_with(&zoo.join(&name), options)) {
            (Reads(n), Ok(loaded)) => {
                assert_eq!(loaded.scene.len(), n, "{name}: {:?}", loaded.warnings);
                loaded.scene.validate().unwrap();
                assert!(!loaded.axes_because.is_empty() && !loaded.format.is_empty());
            }
            (AtMost(n), Ok(loaded)) => assert!(loaded.scene.len() <= n, "{name}: {}", loaded.scene.len()),
            (Refused(part), Err(error)) => {
                let line = error.to_string();
                assert!(line.contains(part), "{line}\nlacks `{part}`");
                assert!(!line.contains('\n') && line.len() < 500, "{line}");
                let file = Path::new(&name).file_stem().unwrap().to_str().unwrap();
                // A file that others name is named itself.
                assert!(line.contains(file) || line.contains(".webp"), "{line}");
                // The operating system has its own words for a file that is not there.
                assert!(
                    line.contains(": found ") && line.contains(", expected ") || line.contains("os error")
                );
            }
            (Reads(_) | AtMost(_), Err(error)) => panic!("{error}"),
            (Refused(part), Ok(_)) => panic!("{name} reads, expected a message with `{part}`"),
        }
    }
}

/// Formats that are not read are known by name, at least by that of their bytes.
#[test]
fn other_files_are_refused() {
    let Some(zoo) = zoo() else { return };
    for name in ["MANIFEST.md", "fixtures-usd3dgs/LICENSE", "ssog/playbot/6_0/sh0.webp"] {
        let line = read_scene(&zoo.join(name)).map(|_| ()).unwrap_err().to_string();
        assert!(line.contains(name) && line.contains(", expected 3DGS .ply, "), "{line}");
    }
}

#[test]
fn no_file_is_forgotten() {
    let Some(zoo) = zoo() else { return };
    let mut found = Vec::new();
    let mut folders = vec![zoo.clone()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => folders.push(path),
                false => found.push(path.strip_prefix(&zoo).unwrap().to_str().unwrap().replace('\\', "/")),
            }
        }
    }
    found.retain(|name| !OTHERS.contains(&extension(name)));
    found.sort();
    let mut expected: Vec<String> = files().map(|(name, _)| name).collect();
    expected.sort();
    assert_eq!(found, expected);
}

#[test]
fn twins_have_the_same_bounds() {
    let Some(zoo) = zoo() else { return };
    let bounds = |name: &str| {
        let scene: Scene = read_scene(&zoo.join(name)).unwrap_or_else(|error| panic!("{error}")).scene;
        scene.bounds().unwrap()
    };
    for (a, b, tolerance) in TWINS.iter().filter(|(a, b, _)| is_read(a) && is_read(b)) {
        let ((a_min, a_max), (b_min, b_max)) = (bounds(a), bounds(b));
        let off = (a_min - b_min).abs().max((a_max - b_max).abs()).max_element();
        assert!(off <= *tolerance, "{a} and {b}: {off}, expected at most {tolerance}");
    }
}
