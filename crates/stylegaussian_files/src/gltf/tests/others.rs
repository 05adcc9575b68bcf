//! What other programs put into a glTF: instances, sparse rows, compression, nodes far from the origin.

use glam::{DAffine3, DVec3, Quat, Vec3};
use serde_json::{Value, json};

use super::{
    super::{document::Document, instances},
    *,
};
use crate::files::Files;

/// The example with a second buffer of these bytes, whose parts `views` (start and length) are buffer views
/// from 5 on.
fn with_buffer(bytes: &[u8], views: &[(usize, usize)], change: impl FnOnce(&mut Value)) -> Vec<u8> {
    changed(|json| {
        let uri = format!("data:;base64,{}", base64::encode(bytes));
        json["buffers"].as_array_mut().unwrap().push(json!({ "byteLength": bytes.len(), "uri": uri }));
        for (start, length) in views {
            let view = json!({ "buffer": 1, "byteOffset": start, "byteLength": length });
            json["bufferViews"].as_array_mut().unwrap().push(view);
        }
        change(json);
    })
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn attributes(json: &mut Value) -> &mut Value {
    &mut json["meshes"][0]["primitives"][0]["attributes"]
}

/// Instances with these attributes, each an accessor from 5 on: its type and component.
fn instanced(json: &mut Value, count: usize, rows: &[(&str, &str, u32)]) {
    for (i, (name, kind, component)) in rows.iter().enumerate() {
        let accessor = json!({ "bufferView": 5 + i, "componentType": component, "count": count, "type": kind,
            "normalized": *component != 5126 });
        json["accessors"].as_array_mut().unwrap().push(accessor);
        json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"][*name] = (5 + i).into();
    }
}

#[test]
fn instances_are_copies_in_their_places() {
    let mut bytes = floats(&[0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 20.0, 0.0]);
    // Half turns about y, in which the second instance turns, as normalized bytes.
    bytes.extend([0, 0, 0, 127, 0, 127, 0, 0, 0, 0, 0, 127]);
    bytes.extend(floats(&[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 3.0, 3.0, 3.0]));
    let rows = [("TRANSLATION", "VEC3", 5126), ("ROTATION", "VEC4", 5120), ("SCALE", "VEC3", 5126)];
    let views = [(0, 36), (36, 12), (48, 36)];
    let of = |change: &dyn Fn(&mut Value)| {
        with_buffer(&bytes, &views, |json| {
            instanced(json, 3, &rows);
            change(json);
        })
    };
    let loaded = load(&of(&|json| json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"])));
    assert_eq!(loaded.warnings, [""; 0]);
    let scene = loaded.scene;
    assert_eq!((scene.len(), scene.n_source, &scene.order[..]), (6, 6, &[0, 1, 2, 3, 4, 5][..]));
    // (1, 2, 3) as it is; turned and moved to (9, 2, -3); three times as large at (3, 26, 9). Read, y and z
    // point against theirs.
    let expected = [Vec3::new(1.0, -2.0, -3.0), Vec3::new(9.0, -2.0, 3.0), Vec3::new(3.0, -26.0, -9.0)];
    for (found, expected) in [0, 2, 4].into_iter().zip(expected) {
        assert!(scene.means[found].abs_diff_eq(expected, 1e-5), "{}", scene.means[found]);
    }
    assert_eq!(scene.scales[4], 3.0 * scene.scales[0]);
    assert!(scene.rotations[2].dot(Quat::from_xyzw(0.0, -1.0, 0.0, 0.0)).abs() > 1.0 - 1e-6);
    assert_eq!(scene.sh.unwrap().coefficients[12..15], [1.0, 0.0, -1.0]);
    // The node moves all of them.
    let moved = load(&of(&|json| json["nodes"][0]["translation"] = json!([0, 0, 100]))).scene;
    assert!(moved.means[2].abs_diff_eq(Vec3::new(9.0, -2.0, -97.0), 1e-4), "{}", moved.means[2]);
    // Without translations they lie in one place.
    let extension = "EXT_mesh_gpu_instancing";
    let turned =
        load(&of(&|json| json["nodes"][0]["extensions"][extension]["attributes"] = json!({ "ROTATION": 6 })));
    assert!(turned.scene.means[2].abs_diff_eq(Vec3::new(-1.0, -2.0, 3.0), 1e-5));
    // An attribute of another program's says nothing.
    let other =
        load(&of(&|json| json["nodes"][0]["extensions"][extension]["attributes"] = json!({ "_ID": 5 })));
    assert_eq!(other.scene.len(), 2);
}

#[test]
fn instances_that_contradict_themselves_are_named() {
    let of = |values: &[f32], change: &dyn Fn(&mut Value)| {
        let bytes = floats(values);
        let views = [(0, 24), (24, 24)];
        with_buffer(&bytes, &views, |json| {
            instanced(json, 2, &[("TRANSLATION", "VEC3", 5126), ("SCALE", "VEC3", 5126)]);
            change(json);
        })
    };
    let plain = [0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0];
    // The second is hidden, as some programs do by a scale of 0.
    let hidden = load(&of(&plain, &|_| {}));
    assert_eq!(hidden.scene.means[1], Vec3::new(4.0, -5.0, -6.0));
    assert_eq!(hidden.scene.len(), 2);
    assert!(hidden.warnings[0].starts_with("left out 1 of 2 instances"), "{:?}", hidden.warnings);
    let refuse = |bytes: Vec<u8>, part: &str| {
        let message = refused(scene_from_bytes(&bytes, "a.gltf"));
        assert!(message.contains(part), "{message}");
    };
    refuse(of(&plain, &|json| json["accessors"][6]["count"] = 1.into()), "1 and 2 rows");
    refuse(of(&plain, &|json| json["accessors"][5]["count"] = 9.into()), "TRANSLATION: 9 rows");
    let mut broken = plain;
    broken[4] = f32::NAN;
    refuse(of(&broken, &|_| {}), "instance 1");
    let mut hidden = plain;
    hidden[6..9].fill(0.0);
    refuse(of(&hidden, &|_| {}), "no Gaussian");
}

#[test]
fn instances_that_are_too_many_are_counted() {
    let bytes = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 3.0, 0.0, 0.0]);
    let text = with_buffer(&bytes, &[(0, 48)], |json| instanced(json, 4, &[("TRANSLATION", "VEC3", 5126)]));
    let mut files = Files::new(text, "gltf".into());
    let document = Document::open(&mut files).unwrap();
    let part = full_scene();
    // Gaussians of degree 2 take 48 + 4 * 27 bytes each. There is room for two of them, and for lists.
    let mut memory_left = 2 * 20 * (48 + 108) + 3000;
    let mut warnings = Vec::new();
    let places = instances::places(
        &document,
        &json!({ "TRANSLATION": 5 }),
        DAffine3::IDENTITY,
        &part,
        &mut memory_left,
        &mut warnings,
    )
    .unwrap();
    assert_eq!(places.iter().map(|place| place.translation.x).collect::<Vec<_>>(), [0.0, 1.0, 2.0]);
    assert_eq!(warnings.len(), 1);
    assert!(warnings[0].starts_with("left out 1 of 4 instances of a mesh (EXT_mesh_gpu"), "{warnings:?}");
    assert!(memory_left < 3000, "{memory_left}");
}

#[test]
fn sparse_rows_take_the_place_of_others() {
    // Index 1 as a byte, a short and a word; a row of (7, 8, 9).
    let mut bytes = vec![1, 0, 0, 0, 1, 0, 0, 0];
    bytes.extend(floats(&[7.0, 8.0, 9.0]));
    for (component, start) in [(5121, 0), (5123, 0), (5125, 4)] {
        let sparse = json!({ "count": 1, "indices": { "bufferView": 5, "byteOffset": start,
            "componentType": component }, "values": { "bufferView": 6 } });
        let of = |change: &dyn Fn(&mut Value)| {
            with_buffer(&bytes, &[(0, 8), (8, 12)], |json| {
                json["accessors"][0]["sparse"] = sparse.clone();
                change(json);
            })
        };
        let loaded = load(&of(&|_| {}));
        assert_eq!(loaded.warnings, [""; 0]);
        assert_eq!(loaded.scene.means, [Vec3::new(1.0, -2.0, -3.0), Vec3::new(7.0, -8.0, -9.0)]);
        // Without a view, all others are 0.
        let view =
            |json: &mut Value| drop(json["accessors"][0].as_object_mut().unwrap().remove("bufferView"));
        let zeros = load(&of(&view)).scene;
        assert_eq!(zeros.means, [Vec3::ZERO, Vec3::new(7.0, -8.0, -9.0)]);
        let refuse = |change: &dyn Fn(&mut Value), part: &str| {
            let message = refused(scene_from_bytes(&of(change), "a.gltf"));
            assert!(message.contains(part), "{message}");
        };
        let change = |key: &'static str, value: usize| {
            move |json: &mut Value| json["accessors"][0]["sparse"][key] = value.into()
        };
        refuse(&change("count", 9), "9 sparse indices that do not lie inside of their bufferView");
        refuse(&change("count", usize::MAX), "sparse");
        refuse(&change("indices", 1), "sparse indices of a type");
        let base = |json: &mut Value| {
            view(json);
            json["accessors"][0]["count"] = (1_u64 << 40).into();
        };
        refuse(&base, "rows of 0");
    }
    // Two indices that do not ascend, and one beyond the rows.
    for indices in [[1_u8, 1], [1, 0], [0, 2]] {
        let bytes = [&indices[..], &[0, 0], &floats(&[0.0; 6])].concat();
        let file = with_buffer(&bytes, &[(0, 2), (4, 24)], |json| {
            json["accessors"][0]["sparse"] = json!({ "count": 2, "values": { "bufferView": 6 },
                "indices": { "bufferView": 5, "componentType": 5121 } });
        });
        let message = refused(scene_from_bytes(&file, "a.gltf"));
        assert!(message.contains("POSITION: sparse indices that do not ascend below 2"), "{message}");
    }
}

#[test]
fn sparse_colors_are_there_when_memory_is_given_back() {
    // A file of its own buffer: harmonics are read first, and what lies behind is given back.
    let (mut json, mut buffer) = example();
    let start = buffer.len();
    buffer.extend([1, 0, 0, 0]);
    buffer.extend(floats(&[0.5]));
    let views = json["bufferViews"].as_array_mut().unwrap();
    views.push(json!({ "buffer": 0, "byteOffset": start, "byteLength": 4 }));
    views.push(json!({ "buffer": 0, "byteOffset": start + 4, "byteLength": 4 }));
    json["accessors"][3]["sparse"] = json!({ "count": 1, "values": { "bufferView": 6 },
        "indices": { "bufferView": 5, "componentType": 5121 } });
    json["buffers"][0]["byteLength"] = buffer.len().into();
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let word = |n: usize| (n as u32).to_le_bytes();
    let total = word(12 + 8 + text.len() + 8 + buffer.len());
    let parts: [&[u8]; 9] = [
        b"glTF",
        &[2, 0, 0, 0],
        &total,
        &word(text.len()),
        b"JSON",
        &text,
        &word(buffer.len()),
        b"BIN\0",
        &buffer,
    ];
    let scene = scene_from_bytes(&parts.concat(), "a.glb").unwrap().scene;
    assert_eq!(scene.opacities, [0.75, 0.5]);
}

#[test]
fn compression_is_named_where_it_is_in_the_way() {
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let compressed = |has_fallback: bool, source: usize| {
            changed(|json| {
                json["extensionsRequired"] = json!([name, "KHR_mesh_quantization"]);
                let mut buffer = json!({ "byteLength": 24 });
                if has_fallback {
                    let bytes = floats(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
                    buffer["uri"] = format!("data:;base64,{}", base64::encode(&bytes)).into();
                }
                buffer["extensions"][name]["fallback"] = true.into();
                json["buffers"].as_array_mut().unwrap().push(buffer);
                let packed = json!({ "buffer": 0, "byteLength": 9, "byteStride": 12, "count": 2,
                    "mode": "ATTRIBUTES" });
                json["bufferViews"][0] =
                    json!({ "buffer": source, "byteLength": 24, "extensions": { name: packed } });
            })
        };
        for source in [0, 1] {
            let message = refused(scene_from_bytes(&compressed(false, source), "a.gltf"));
            assert!(message.contains(&format!("bufferViews[0] compressed by {name}")), "{message}");
        }
        let loaded = load(&compressed(true, 1));
        assert_eq!((loaded.scene.means[1], loaded.warnings), (Vec3::new(4.0, -5.0, -6.0), Vec::new()));
    }
}

#[test]
fn extensions_that_a_file_requires_are_refused_unless_they_change_no_gaussians() {
    let requiring = |json: &mut Value, name: &str| {
        json["extensionsRequired"] = json!(["KHR_mesh_quantization", name]);
    };
    for name in ["KHR_materials_unlit", "KHR_texture_basisu", "KHR_draco_mesh_compression"] {
        let loaded = load(&changed(|json| requiring(json, name)));
        assert_eq!(loaded.warnings, [format!("the file requires {name}, which is not supported")]);
    }
    expect_refusal(|json| requiring(json, "X_y"), "a glTF that requires X_y, which is not supported");
    let draco = "KHR_draco_mesh_compression";
    let compress = |json: &mut Value| {
        requiring(json, draco);
        json["meshes"][0]["primitives"][0]["extensions"][draco] = json!({ "bufferView": 0 });
    };
    expect_refusal(compress, "requires KHR_draco_mesh_compression");
}

#[test]
fn a_center_of_the_file_is_left_out_with_a_word() {
    let loaded = load(&changed(|json| {
        json["extensionsRequired"] = json!(["CESIUM_RTC"]);
        json["extensions"]["CESIUM_RTC"] = json!({ "center": [1.5, -2.0, 3.0] });
    }));
    let told = "left out CESIUM_RTC: positions count from its center [1.5,-2.0,3.0]";
    let required = "the file requires CESIUM_RTC, which is not supported";
    assert_eq!(loaded.warnings, [required, told]);
    assert_eq!(loaded.scene.means[0], Vec3::new(1.0, -2.0, -3.0));
}

#[test]
fn every_draft_with_an_spz_inside_is_read() {
    let mut source = full_scene();
    source.up = None;
    let spz = crate::scene_to_bytes("a.spz", &source).unwrap();
    let expected = scene_from_bytes(&spz, "a.spz").unwrap().scene;
    let of = |spz: &[u8], extensions: Value| {
        changed(|json| {
            let uri = format!("data:;base64,{}", base64::encode(spz));
            json["buffers"] = json!([{ "byteLength": spz.len(), "uri": uri }]);
            json["bufferViews"] = json!([{ "buffer": 0, "byteLength": spz.len() }]);
            json["accessors"] = json!([{ "componentType": 5126, "count": 20, "type": "VEC3" }]);
            *attributes(json) = json!({ "POSITION": 0 });
            let name = extensions.as_object().unwrap().keys().next().unwrap().clone();
            json["extensionsRequired"] = json!([name]);
            json["meshes"][0]["primitives"][0]["extensions"] = extensions;
        })
    };
    let alone = "KHR_spz_gaussian_splats_compression";
    for name in ["KHR_gaussian_splatting_compression_spz_2", "KHR_gaussian_splatting_compression_spz", alone]
    {
        let view = json!({ "bufferView": 0 });
        for extensions in
            [json!({ name: view }), json!({ "KHR_gaussian_splatting": { "extensions": { name: view } } })]
        {
            let loaded = load(&of(&spz, extensions));
            assert_eq!(loaded.warnings, [""; 0]);
            // Both count in the axes RUB.
            assert_eq!(loaded.scene.means, expected.means);
        }
    }
    let message = refused(scene_from_bytes(&of(&spz[..9], json!({ alone: { "bufferView": 0 } })), "a.gltf"));
    assert!(message.contains(&format!(" in {alone}, expected ")), "{message}");
}

#[test]
fn a_byte_order_mark_is_no_part_of_the_json() {
    let mut text = b"\xef\xbb\xbf".to_vec();
    text.extend(changed(|_| {}));
    assert_eq!(load(&text).scene.len(), 2);
}

#[test]
fn nodes_far_from_the_origin_keep_their_gaussians_apart() {
    let center = [1_216_389.123, -4_736_345.456, 4_081_406.789];
    let place = DVec3::from_array(center);
    let of = |node: Value| load(&changed(|json| json["nodes"] = json!([node])));
    let near = load(&changed(|_| {})).scene;
    let Loaded { scene, warnings, .. } = of(json!({ "mesh": 0, "translation": center }));
    // Positions of the mesh to the bit, and its place in axes of which y and z point against those of glTF.
    assert_eq!((&scene.means, warnings), (&near.means, Vec::new()));
    assert_eq!(scene.offset, place * DVec3::new(1.0, -1.0, -1.0));
    // Turned, as most: x east and z up on the ground become Earth-centered axes.
    let turn = glam::DQuat::from_xyzw(0.36, 0.48, -0.48, 0.64);
    let turned = of(json!({ "mesh": 0, "translation": center, "rotation": turn.to_array() })).scene;
    for (found, local) in turned.means.iter().zip([DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)]) {
        let expected = (place + turn * local) * DVec3::new(1.0, -1.0, -1.0);
        assert!((turned.offset + found.as_dvec3()).abs_diff_eq(expected, 1e-6));
    }
    // Parts in several places have one offset.
    let several = load(&changed(|json| {
        let other = [center[0] + 50.0, center[1], center[2]];
        json["scenes"][0]["nodes"] = json!([0, 1]);
        json["nodes"] = json!([{ "mesh": 0, "translation": center }, { "mesh": 0, "translation": other }]);
    }))
    .scene;
    assert_eq!(several.offset.fract(), DVec3::ZERO);
    let apart = several.means[2].as_dvec3() - several.means[0].as_dvec3();
    assert!(apart.abs_diff_eq(50.0 * DVec3::X, 1e-4), "{apart}");
    let found = several.offset + several.means[0].as_dvec3();
    let expected = (place + DVec3::new(1.0, 2.0, 3.0)) * DVec3::new(1.0, -1.0, -1.0);
    assert!(found.abs_diff_eq(expected, 1e-4), "{found}");
    let moved = of(json!({ "mesh": 0, "translation": [100, 0, 0] })).scene;
    assert_eq!((moved.offset, moved.means[0]), (DVec3::ZERO, Vec3::new(101.0, -2.0, -3.0)));
}

#[test]
fn files_of_other_programs_as_reported() {
    let Some(folder) = shared_data("reports") else { return };
    let read = |name: &str| read_scene(&folder.join(name));
    for (name, n) in [("G02_quantized", 60), ("G04_sparse_opacity", 60), ("G07_gpu_instancing", 180)] {
        let loaded = read(&format!("{name}.glb")).unwrap();
        assert_eq!((loaded.scene.len(), &loaded.warnings[..]), (n, &[][..] as &[String]), "{name}");
    }
    let quantized = read("G05_cesium_spz.glb").unwrap();
    assert_eq!((quantized.scene.len(), quantized.warnings), (60, Vec::new()));
    let (min, max) = quantized.scene.bounds().unwrap();
    // The bounds of the accessor, turned, to half a step of SPZ.
    assert!(min.abs_diff_eq(Vec3::new(-0.973_016, -0.977_742, -0.859_102), 1e-3), "{min}");
    assert!(max.abs_diff_eq(Vec3::new(0.994_095, 0.977_103, 0.999_916), 1e-3), "{max}");
    assert!(refused(read("G03_meshopt.glb")).contains("EXT_meshopt_compression"));
    for name in ["G08_ecef_node.glb", "R15_utm_double.ply"] {
        let Loaded { scene, warnings, .. } = read(name).unwrap();
        let mut places: Vec<[i64; 3]> = scene
            .means
            .iter()
            .map(|mean| (1e3 * (scene.offset + mean.as_dvec3())).round().as_i64vec3().to_array())
            .collect();
        places.sort_unstable();
        places.dedup();
        assert_eq!((places.len(), warnings), (100, Vec::new()), "{name}");
    }
    for name in ["O01b_in_subfolder.sog", "O06_folder"] {
        let loaded = read(name).unwrap();
        assert_eq!((loaded.format, loaded.scene.len(), loaded.warnings), ("SOG", 60, Vec::new()), "{name}");
    }
}
