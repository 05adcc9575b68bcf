//! Hand-made files, the conformance files of the zoo, and round trips.

use std::{f32::consts::FRAC_1_SQRT_2, fs};

use glam::{Quat, Vec3};
use serde_json::{Value, json};
use stylegaussian::{
    axes::Axes,
    scene::{Scene, ScreenFilter},
    sh,
};

use super::base64;
use crate::{
    Loaded, ReadOptions, Reading, SceneReader, WriteOptions,
    check::check_scene,
    read_scene, scene_from_bytes,
    tests::{dir, full_scene, refused, shared_data},
    write_scene, write_scene_with,
};

mod others;

/// A glTF of one primitive of two Gaussians at (1, 2, 3) and (4, 5, 6), f32, and its buffer.
fn example() -> (Value, Vec<u8>) {
    let mut buffer = Vec::new();
    let mut views = Vec::new();
    let mut add = |values: &[f32]| {
        views.push(json!({ "buffer": 0, "byteOffset": buffer.len(), "byteLength": 4 * values.len() }));
        buffer.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    };
    add(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    add(&[0.0, 0.0, 0.0, 1.0, 0.6, 0.0, 0.0, 0.8]);
    add(&[0.5, 0.25, 2.0, 1.0, 1.0, 1.0]);
    add(&[0.75, 1.0]);
    add(&[1.0, 0.0, -1.0, 0.5, 0.5, 0.5]);
    let accessor = |view: usize, kind: &str| -> Value {
        json!({ "bufferView": view, "componentType": 5126, "count": 2, "type": kind })
    };
    let json = json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{
            "mode": 0,
            "attributes": {
                "POSITION": 0,
                "KHR_gaussian_splatting:ROTATION": 1,
                "KHR_gaussian_splatting:SCALE": 2,
                "KHR_gaussian_splatting:OPACITY": 3,
                "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0": 4,
            },
            "extensions": {
                "KHR_gaussian_splatting": { "kernel": "ellipse", "colorSpace": "srgb_rec709_display" },
            },
        }] }],
        "accessors": [
            accessor(0, "VEC3"), accessor(1, "VEC4"), accessor(2, "VEC3"),
            accessor(3, "SCALAR"), accessor(4, "VEC3"),
        ],
        "bufferViews": views,
        "buffers": [{ "byteLength": buffer.len() }],
    });
    (json, buffer)
}

/// The example with its buffer inside, after a change of its JSON.
fn changed(change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let (mut json, buffer) = example();
    json["buffers"][0]["uri"] =
        format!("data:application/octet-stream;base64,{}", base64::encode(&buffer)).into();
    change(&mut json);
    json.to_string().into_bytes()
}

fn load(bytes: &[u8]) -> Loaded {
    let loaded = scene_from_bytes(bytes, "a.gltf").unwrap();
    check_scene(&loaded.scene).unwrap();
    loaded
}

fn expect_refusal(change: impl FnOnce(&mut Value), part: &str) {
    let message = refused(scene_from_bytes(&changed(change), "a.gltf"));
    assert!(message.contains(part) && message.starts_with("a.gltf"), "{message}");
}

#[test]
fn values_by_hand_turned_to_the_axes_of_ply() {
    let Loaded { scene, warnings, axes, axes_because, format } = load(&changed(|_| {}));
    assert_eq!(warnings, [""; 0]);
    assert_eq!((axes, format), (Axes::RUB, "glTF with KHR_gaussian_splatting"));
    assert!(axes_because.contains("y-up"));
    assert_eq!(scene.means, [Vec3::new(1.0, -2.0, -3.0), Vec3::new(4.0, -5.0, -6.0)]);
    assert_eq!(scene.rotations, [Quat::IDENTITY, Quat::from_xyzw(0.6, 0.0, 0.0, 0.8)]);
    assert_eq!(scene.scales, [Vec3::new(0.5, 0.25, 2.0), Vec3::ONE]);
    assert_eq!(scene.opacities, [0.75, 1.0]);
    let sh = scene.sh.unwrap();
    assert_eq!((sh.degree, &sh.coefficients[..]), (0, &[1.0, 0.0, -1.0, 0.5, 0.5, 0.5][..]));
    let mut reader = SceneReader::new(
        changed(|_| {}),
        "a.gltf",
        ReadOptions { axes: Some(Axes::RDF), ..ReadOptions::default() },
    );
    let Reading::Scene(loaded) = reader.read().unwrap() else { panic!("all of it is there") };
    assert_eq!(loaded.scene.means[0], Vec3::new(1.0, 2.0, 3.0));
    // The same with the buffer beside it.
    let text = changed(|json| json["buffers"][0]["uri"] = "more%20data/a.bin".into());
    reader = SceneReader::new(text, "a.gltf", ReadOptions::default());
    let Reading::Needs(names) = reader.read().unwrap() else { panic!("a file is missing") };
    assert_eq!(names, ["more data/a.bin"]);
    reader.add(names[0].clone(), example().1);
    let Reading::Scene(loaded) = reader.read().unwrap() else { panic!("all of it is there") };
    assert_eq!(loaded.scene.means, scene.means);
}

#[test]
fn nodes_move_their_gaussians() {
    // Twice as large, a quarter turn about y (z to x), then moved: (1, 2, 3) becomes (6, 4, -2) + (0, 0, 10).
    let scene = load(&changed(|json| {
        json["nodes"] = json!([
            { "children": [1], "translation": [0, 0, 10] },
            { "mesh": 0, "scale": [2, 2, 2], "rotation": [0, FRAC_1_SQRT_2, 0, FRAC_1_SQRT_2] },
        ]);
    }))
    .scene;
    assert!(scene.means[0].abs_diff_eq(Vec3::new(6.0, -4.0, -8.0), 1e-5), "{}", scene.means[0]);
    assert!(scene.scales[0].abs_diff_eq(Vec3::new(1.0, 0.5, 4.0), 1e-6));
    // The same as a matrix, column by column.
    let by_matrix = load(&changed(|json| {
        json["nodes"][0]["matrix"] = json!([0, 0, -2, 0, 0, 2, 0, 0, 2, 0, 0, 0, 0, 0, 10, 1]);
    }))
    .scene;
    assert!(scene.means[1].abs_diff_eq(by_matrix.means[1], 1e-5));
    assert!(scene.rotations[1].abs_diff_eq(by_matrix.rotations[1], 1e-6));
    // Two nodes show one mesh.
    let twice = load(&changed(|json| {
        json["nodes"] = json!([{ "mesh": 0, "children": [1] }, { "mesh": 0, "translation": [10, 0, 0] }]);
    }))
    .scene;
    assert_eq!(twice.order, [0, 1, 2, 3]);
    assert_eq!(twice.means[2], Vec3::new(11.0, -2.0, -3.0));
    expect_refusal(|json| json["nodes"][0]["children"] = json!([0]), "node 0 in two places");
    expect_refusal(|json| json["nodes"][0]["scale"] = json!([1, 0, 1]), "scales by 0e0 to");
    expect_refusal(|json| json["nodes"][0]["matrix"] = json!([1, 2]), "wrong matrix");
    expect_refusal(|json| json["nodes"][0]["mesh"] = 7.into(), "meshes[7]");
}

#[test]
fn quantized_components_by_hand() {
    // Two rotations of i8, scales of u16 not normalized, opacities of u8, each row aligned to 4 bytes.
    let mut bytes = vec![127_u8, 0, 0, 0, 0, 0x81, 0, 0];
    bytes.extend([3_u16, 1, 2, 0, 9, 9, 9, 0].iter().flat_map(|value| value.to_le_bytes()));
    bytes.extend([255, 0, 0, 0, 51, 0, 0, 0]);
    let scene = load(&changed(|json| {
        let uri = format!("data:;base64,{}", base64::encode(&bytes));
        json["buffers"].as_array_mut().unwrap().push(json!({ "byteLength": bytes.len(), "uri": uri }));
        let views = [(0, 8, 4), (8, 16, 8), (24, 8, 4)];
        for (i, (offset, length, stride)) in views.into_iter().enumerate() {
            json["bufferViews"][i + 1] =
                json!({ "buffer": 1, "byteOffset": offset, "byteLength": length, "byteStride": stride });
            json["accessors"][i + 1]["componentType"] = [5120, 5123, 5121][i].into();
            json["accessors"][i + 1]["normalized"] = (i != 1).into();
        }
    }))
    .scene;
    assert_eq!(scene.rotations, [Quat::from_xyzw(1.0, 0.0, 0.0, 0.0), Quat::from_xyzw(0.0, 1.0, 0.0, 0.0)]);
    assert_eq!(scene.scales, [Vec3::new(3.0, 1.0, 2.0), Vec3::splat(9.0)]);
    assert_eq!(scene.opacities, [1.0, 0.2]);
}

#[test]
fn unknown_and_linear_colors() {
    let name = "KHR_gaussian_splatting";
    let primitive = |json: &mut Value, key: &str, value: &str| {
        json["meshes"][0]["primitives"][0]["extensions"][name][key] = value.into();
    };
    let linear = load(&changed(|json| primitive(json, "colorSpace", "lin_rec709_display")));
    assert!(linear.warnings[0].contains("linear colors"), "{:?}", linear.warnings);
    // 0.5 is 0.7354 on a display.
    assert!((linear.scene.base_colors()[0][1] - 0.735_357).abs() < 1e-5);
    let other = load(&changed(|json| {
        primitive(json, "kernel", "cube");
        primitive(json, "colorSpace", "custom");
    }));
    assert_eq!(other.warnings.len(), 2, "{:?}", other.warnings);
    assert!(other.warnings[0].contains("unknown kernel `cube`: taken for ellipse"));
    // Half of degree 1.
    expect_refusal(
        |json| {
            json["meshes"][0]["primitives"][0]["attributes"][format!("{name}:SH_DEGREE_1_COEF_1")] = 4.into()
        },
        "SH_DEGREE_1_COEF_0",
    );
}

#[test]
fn what_is_not_there_or_contradicts_itself_is_named() {
    expect_refusal(
        |json| json["meshes"][0]["primitives"][0]["extensions"] = json!({}),
        "a glTF without KHR_gaussian_splatting (1 other primitives)",
    );
    expect_refusal(|json| json["accessors"][2]["sparse"] = json!({}), "sparse rows without a count");
    expect_refusal(|json| json["accessors"][1]["count"] = 1.into(), "1 rows of ROTATION, expected 2");
    expect_refusal(
        |json| json["accessors"][0]["count"] = 3.into(),
        "rows inside of the buffer view's 24 bytes",
    );
    expect_refusal(|json| json["accessors"][0]["count"] = u64::MAX.into(), "rows");
    expect_refusal(|json| json["accessors"][0]["type"] = "VEC4".into(), "POSITION of type `VEC4`");
    expect_refusal(|json| json["accessors"][0]["componentType"] = 5125.into(), "componentType 5125");
    expect_refusal(|json| json["bufferViews"][0]["byteStride"] = 4.into(), "rows of 12 bytes, 4 apart");
    expect_refusal(|json| json["bufferViews"][0]["byteOffset"] = u64::MAX.into(), "outside of its buffer");
    expect_refusal(|json| json["buffers"][0]["byteLength"] = 9999.into(), "its byteLength 9999");
    expect_refusal(|json| json["buffers"][0]["uri"] = "../a.bin".into(), "..");
    expect_refusal(|json| json["buffers"][0]["uri"] = "http://a/b".into(), "http:");
    expect_refusal(|json| json["asset"] = json!({}), "without asset.version");
    expect_refusal(|json| json["asset"]["version"] = "1.0".into(), "glTF version `1.0`");
    // A file of some kilobytes must not become gigabytes.
    expect_refusal(
        |json| {
            // 40 primitives of two Gaussians, which 1,000 nodes of 10 bytes show.
            let primitive = json["meshes"][0]["primitives"][0].clone();
            json["meshes"][0]["primitives"] = vec![primitive; 40].into();
            json["nodes"] = vec![json!({ "mesh": 0 }); 1000].into();
            json["scenes"][0]["nodes"] = (0..1000).collect::<Vec<_>>().into();
        },
        "64 bytes of Gaussians for a byte of the file",
    );
    let message = refused(scene_from_bytes(b"glTF\x02\0\0\0\xff\0\0\0", "a.glb"));
    assert!(message.contains("found 12 bytes, expected the 255 that the GLB states"), "{message}");
}

#[test]
fn drafts_with_spz_inside_are_read() {
    let Some(path) = shared_data("zoo/spz/splat-transform-minimal-v3.spz") else { return };
    let spz = fs::read(&path).unwrap();
    let loaded = load(&changed(|json| {
        let uri = format!("data:;base64,{}", base64::encode(&spz));
        json["buffers"] = json!([{ "byteLength": spz.len(), "uri": uri }]);
        json["bufferViews"] = json!([{ "buffer": 0, "byteLength": spz.len() }]);
        json["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["extensions"] =
            json!({ "KHR_gaussian_splatting_compression_spz_2": { "bufferView": 0 } });
    }));
    // Both are read as RUB.
    assert_eq!(loaded.scene.means, read_scene(&path).unwrap().scene.means);
}

#[test]
fn conformance_files_of_the_zoo() {
    let Some(folder) = shared_data("zoo/gltf") else { return };
    let [binary, text] = ["glb", "gltf"].map(|extension| {
        read_scene(&folder.join(format!("bgs-khr_conformance_matrix.{extension}"))).unwrap()
    });
    let scene = &binary.scene;
    assert_eq!((scene.len(), scene.sh.as_ref().map(|sh| sh.degree)), (15, Some(3)));
    assert_eq!(binary.warnings.len(), 2, "{:?}", binary.warnings);
    assert_eq!(
        (&scene.means, &scene.rotations, &scene.scales),
        (&text.scene.means, &text.scene.rotations, &text.scene.scales)
    );
    assert!(scene.means.iter().all(|&mean| mean == Vec3::new(1.0, -2.0, -3.0)));
    // The first three rotations: a turn by pi about x in f32, i8 and i16.
    for rotation in &scene.rotations[..3] {
        assert_eq!(rotation.to_array(), [1.0, 0.0, 0.0, 0.0]);
    }
    // Logarithms 1, -2, 3 of i8, and 127/127, 0 and -1 of normalized i8.
    let e = std::f32::consts::E;
    let close =
        |found: Vec3, expected: Vec3| assert!((found / expected - 1.0).abs().max_element() < 1e-5, "{found}");
    close(scene.scales[3], Vec3::new(0.2, -0.1, 0.7).exp());
    close(scene.scales[4], Vec3::new(1.0, -2.0, 3.0).exp());
    close(scene.scales[5], Vec3::new(e, 1.0, 1.0 / e));
    assert!((scene.opacities[8] - 0.75).abs() < 1e-6);
    let fallback = read_scene(&folder.join("bgs-khr_extensible_fallback.gltf")).unwrap();
    assert_eq!((fallback.scene.len(), fallback.warnings.len()), (1, 3), "{:?}", fallback.warnings);
}

fn round_trip(scene: &Scene, options: WriteOptions) -> (Loaded, Vec<u8>) {
    let dir = dir();
    let path = dir.path().join("a.glb");
    write_scene_with(&path, scene, options).unwrap();
    (read_scene(&path).unwrap(), fs::read(&path).unwrap())
}

fn bits(values: &[f32]) -> Vec<u32> {
    // Adding 0 makes 0 of -0, which mirrors make of 0.
    values.iter().map(|value| (value + 0.0).to_bits()).collect()
}

#[test]
fn everything_comes_back_to_the_bit() {
    let scene = full_scene();
    let (Loaded { scene: read, warnings, axes, .. }, bytes) = round_trip(&scene, WriteOptions::default());
    let expected = scene.subset(&scene.by_source());
    assert_eq!((warnings, axes), (Vec::new(), Axes::RUB));
    let vectors = |values: &[Vec3]| bits(bytemuck::cast_slice(values));
    assert_eq!(vectors(&read.means), vectors(&expected.means));
    assert_eq!(vectors(&read.scales), vectors(&expected.scales));
    assert_eq!(bits(&read.opacities), bits(&expected.opacities));
    assert_eq!(bits(bytemuck::cast_slice(&read.rotations)), bits(bytemuck::cast_slice(&expected.rotations)));
    let (found, wanted) = (read.sh.unwrap(), expected.sh.unwrap());
    assert_eq!((found.degree, bits(&found.coefficients)), (wanted.degree, bits(&wanted.coefficients)));
    assert_eq!((read.order, read.filter), (expected.order, ScreenFilter::Antialiased));
    assert_eq!((read.up, read.source, read.license), (expected.up, expected.source, expected.license));
    let (found, wanted) = (read.features.unwrap(), expected.features.unwrap());
    assert_eq!(bits(&found.values), bits(&wanted.values));
    assert_eq!((bits(&found.basis), bits(&found.offset)), (bits(&wanted.basis), bits(&wanted.offset)));
    assert_eq!((found.n_latent, found.n_extra, bits(&found.extra)), (4, 2, bits(&wanted.extra)));
    assert_eq!(found.encoder, wanted.encoder);
    assert_eq!(read.neighbors, expected.neighbors);
    let (found, wanted) = (read.decoder.unwrap(), scene.decoder.unwrap());
    assert_eq!((found.k, found.layers.len(), found.encoder), (wanted.k, wanted.layers.len(), wanted.encoder));
    // Offsets of all views are multiples of 4.
    let json_bytes = u32::from_le_bytes(*bytes[12..].first_chunk().unwrap()) as usize;
    assert_eq!((json_bytes % 4, bytes.len() % 4), (0, 0));
    let json: Value = serde_json::from_slice(&bytes[20..20 + json_bytes]).unwrap();
    for view in json["bufferViews"].as_array().unwrap() {
        assert_eq!(view["byteOffset"].as_u64().unwrap() % 4, 0);
    }
}

#[test]
fn features_of_full_precision_and_odd_widths_come_back() {
    let mut scene = full_scene();
    let features = scene.features.as_mut().unwrap();
    features.values[7] = 0.1;
    features.n_extra = 0;
    features.extra.clear();
    scene.neighbors.as_mut().unwrap().k = 1;
    scene.neighbors.as_mut().unwrap().indices = (0..20).collect();
    scene.sh = None;
    let (Loaded { scene: read, .. }, _) =
        round_trip(&scene, WriteOptions { sh_degree: 0, ..WriteOptions::default() });
    let expected = scene.subset(&scene.by_source());
    assert_eq!(read.features.unwrap().values, expected.features.unwrap().values);
    assert_eq!(read.neighbors, expected.neighbors);
    assert_eq!(read.sh.unwrap().coefficients, [0.0; 60]);
}

#[test]
fn harmonics_are_cut_to_the_degree_that_was_asked_for() {
    let scene = full_scene();
    let by_source = scene.subset(&scene.by_source());
    let (loaded, _) = round_trip(&scene, WriteOptions { sh_degree: 1, ..WriteOptions::default() });
    let (found, wanted) = (loaded.scene.sh.unwrap(), by_source.sh.unwrap());
    assert_eq!(found.degree, 1);
    let n = 3 * sh::n_coefficients(2);
    for (found, wanted) in found.coefficients.chunks(12).zip(wanted.coefficients.chunks(n)) {
        assert_eq!(found, &wanted[..12]);
    }
}

#[test]
fn spoiled_application_data_is_left_out_with_a_warning() {
    let (_, bytes) = round_trip(&full_scene(), WriteOptions::default());
    let json_bytes = u32::from_le_bytes(*bytes[12..].first_chunk().unwrap()) as usize;
    let spoiled = |change: &dyn Fn(&mut Value)| {
        let mut json: Value = serde_json::from_slice(&bytes[20..20 + json_bytes]).unwrap();
        json["buffers"][0]["uri"] =
            format!("data:;base64,{}", base64::encode(&bytes[20 + json_bytes + 8..])).into();
        change(&mut json["meshes"][0]["primitives"][0]);
        let loaded = load(json.to_string().as_bytes());
        assert_eq!(loaded.scene.len(), 20);
        (loaded.scene.features.is_some(), loaded.warnings)
    };
    assert_eq!(spoiled(&|_| {}), (true, vec![]));
    let checks: [&dyn Fn(&mut Value); 4] = [
        &|primitive| primitive["extras"]["stylegaussian"] = "*".into(),
        &|primitive| primitive["extras"]["stylegaussian"] = "Zm9v".into(),
        &|primitive| drop(primitive["attributes"].as_object_mut().unwrap().remove("_SG_FEATURES_0")),
        &|primitive| {
            primitive["attributes"]["_SG_NEIGHBORS_0"] = primitive["attributes"]["_SG_FEATURES_0"].clone()
        },
    ];
    for change in checks {
        let (has_features, warnings) = spoiled(change);
        assert!(!has_features && warnings.len() == 1, "{warnings:?}");
        assert!(warnings[0].starts_with("ignored features, neighbors and decoder: found "), "{warnings:?}");
    }
}

#[test]
fn damaged_files_are_errors_or_scenes() {
    let mut scene = full_scene();
    scene.decoder = None;
    let (_, bytes) = round_trip(&scene, WriteOptions::default());
    let survives = |bytes: &[u8]| match scene_from_bytes(bytes, "a.glb") {
        Ok(loaded) => check_scene(&loaded.scene).unwrap_or_else(|mismatch| panic!("{mismatch:?}")),
        Err(error) => assert!(error.to_string().contains("a.glb"), "{error}"),
    };
    for at in (0..bytes.len()).step_by(1 + bytes.len() / 500) {
        survives(&bytes[..at]);
        for change in [0x00, 0xff, bytes[at] ^ 0x01, bytes[at] ^ 0x80, b'9'] {
            let mut damaged = bytes.clone();
            damaged[at] = change;
            survives(&damaged);
        }
    }
}

#[test]
fn the_files_of_a_folder_are_found() {
    let dir = dir();
    let (mut json, buffer) = example();
    json["buffers"][0]["uri"] = "a.bin".into();
    fs::write(dir.path().join("a.gltf"), json.to_string()).unwrap();
    let message = refused(read_scene(&dir.path().join("a.gltf")));
    assert!(message.contains("a.bin"), "{message}");
    fs::write(dir.path().join("a.bin"), buffer).unwrap();
    assert_eq!(read_scene(&dir.path().join("a.gltf")).unwrap().scene.len(), 2);
    let message = refused(write_scene(&dir.path().join("b.gltf"), &full_scene()));
    assert!(message.contains("extension `gltf`"), "{message}");
}
