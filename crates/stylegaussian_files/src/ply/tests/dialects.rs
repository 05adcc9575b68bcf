//! Files of other trainers and tools, which say the same in other words, or something else in the same ones.

use glam::DVec3;
use half::f16;

use super::*;

/// Two Gaussians with other values or properties. A property that is there already is replaced.
fn with(changes: &[Property]) -> Vec<Property> {
    let mut all = properties();
    for change in changes {
        match all.iter_mut().find(|property| property.1 == change.1) {
            Some(property) => *property = *change,
            None => all.push(*change),
        }
    }
    all
}

fn without(names: &[&str]) -> Vec<Property> {
    properties().into_iter().filter(|property| !names.contains(&property.1)).collect()
}

/// A file of `n` Gaussians, each value given by a function of the property's name and the row.
fn many(n: usize, kind: &str, value: impl Fn(&str, usize) -> f64) -> Vec<u8> {
    let names: Vec<&str> = properties().iter().map(|property| property.1).collect();
    many_of(&names, n, kind, value)
}

/// As [`many`], of these properties.
fn many_of(names: &[&str], n: usize, kind: &str, value: impl Fn(&str, usize) -> f64) -> Vec<u8> {
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\nelement vertex {n}\n").into_bytes();
    names.iter().for_each(|name| bytes.extend(format!("property {kind} {name}\n").bytes()));
    bytes.extend(b"end_header\n");
    for row in 0..n {
        names.iter().for_each(|name| push(value(name, row), kind, Format::Little, &mut bytes));
    }
    bytes
}

/// A trained scene's values: places within 1, small Gaussians, opacities of all kinds.
fn trained(name: &str, row: usize) -> f64 {
    let wave = (row as f64 * 0.7 + name.len() as f64 + f64::from(name.as_bytes()[name.len() - 1])).sin();
    match name {
        "opacity" => 1.0 + 3.0 * wave,
        _ if name.starts_with("scale") => -3.0 + 0.5 * wave,
        "rot_0" => 1.0,
        _ => wave,
    }
}

#[test]
fn bytes_after_the_last_row_are_counted() {
    // A row in which three bytes of color stand for the one that the header has.
    for (n, part) in [
        (1, "found 1 byte after the last row, expected the end of the file after 2 vertex"),
        (4, "found 4 bytes after the last row, 2 for each of 2 vertices, whose properties"),
        (57, "found 57 bytes after the last row, expected"),
    ] {
        for format in [Format::Little, Format::Big] {
            refused(&file(&properties(), format, ["", ""], [b"", &vec![0; n]], "\n"), part);
        }
    }
    // White space in between is part of it.
    refused(&file(&properties(), Format::Little, ["", ""], [b"", b"\n\n1 \n"], "\n"), "found 5 bytes");
    let behind = "element face 1\nproperty list uchar uchar i\n";
    refused(&file(&properties(), Format::Little, ["", behind], [b"", b"\x02abxyz"], "\n"), "found 3 bytes");
    refused(&file(&properties(), Format::Ascii, ["", ""], [b"", b" 7 8\n"], "\n"), "found 3 bytes");
    for white in [&b"\n"[..], b"\r\n", b" \n \t"] {
        for format in ALL {
            check_two(&file(&properties(), format, ["", ""], [b"", white], "\n"));
        }
        check_two(&file(
            &properties(),
            Format::Little,
            ["", behind],
            [b"", &[b"\x02ab", white].concat()],
            "\n",
        ));
    }
}

#[test]
fn two_scales_are_flat() {
    for format in ALL {
        let bytes = plain(&without(&["scale_2"]), format);
        let Loaded { scene, warnings, .. } = read(bytes).unwrap();
        assert!(scene.scales[0].abs_diff_eq(Vec3::new(1.0, 2.0, 0.0), 1e-6), "{:?}", scene.scales);
        assert_eq!((scene.scales[1], scene.len()), (Vec3::new(1.0, 1.0, 0.0), 2));
        assert_eq!(scene.rotations, [Quat::IDENTITY, Quat::from_xyzw(0.0, 0.0, -1.0, 0.0)]);
        assert!(warnings.len() == 1 && warnings[0].contains("flat (2DGS)"), "{warnings:?}");
    }
    refused(&plain(&without(&["scale_1", "scale_2"]), Format::Little), "without scale_1 scale_2 (it has");
    refused(&plain(&without(&["scale_1"]), Format::Little), "without scale_1 (it has");
    refused(&plain(&without(&["rot_0", "scale_2", "opacity"]), Format::Little), "opacity scale_2 rot_0 (it");
}

#[test]
fn the_prefix_of_cloudcompare_is_taken_off() {
    let renamed = |prefix: &str, names: &[&str]| {
        let mut text = String::from_utf8(ascii_sample()).unwrap();
        names
            .iter()
            .for_each(|name| text = text.replace(&format!(" {name}\n"), &format!(" {prefix}{name}\n")));
        text
    };
    let all = ["f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1"];
    let told = |n: usize| {
        [format!("names of properties are read without CloudCompare's prefix `scalar_` ({n} of them)")]
    };
    assert_eq!(warnings_of_two(renamed("scalar_", &all).as_bytes()), told(9));
    let twice = renamed("scalar_scalar_", &["opacity", "rot_3", "f_dc_1"]);
    assert_eq!(warnings_of_two(twice.as_bytes()), told(3));
    // Colors for display do not count beside those of the capture.
    let colored = renamed("scalar_", &all).replace("end_header", "property uchar red\nend_header");
    let colored = colored.replace(" \n", " 9 \n");
    assert!(read(colored.clone().into_bytes()).is_ok(), "{colored}");
    // A name that is there already stays, and the other is another property.
    let twice = renamed("", &[]).replace("float rot_1", "float scalar_rot_2");
    refused(twice.as_bytes(), "without rot_1 (it has: ");
    refused(renamed("scalar_", &["x", "y"]).replace("scalar_y", "scalar_x").as_bytes(), "without y");
}

/// s'^2 = s^2 + f^2, and the opacity falls with the volume.
#[test]
fn the_filter_of_mip_splatting_widens_gaussians() {
    let filtered = |widths: [f64; 2]| read(plain(&with(&[("float", "filter_3D", widths)]), Format::Little));
    let scene = filtered([0.75, 0.0]).unwrap().scene;
    let sizes = [1.0, 2.0, 1.0].map(|scale: f64| (scale * scale + 0.5625).sqrt());
    assert!(scene.scales[0].as_dvec3().abs_diff_eq(DVec3::from(sizes), 1e-6), "{:?}", scene.scales);
    // 2 of 1.25 * sqrt(4.5625) * 1.25, and sigmoid(0).
    let kept = 2.0 / sizes.iter().product::<f64>();
    assert!((f64::from(scene.opacities[0]) - 0.5 * kept).abs() < 1e-6, "{:?}", scene.opacities);
    assert_eq!((scene.scales[1], scene.opacities[1]), (Vec3::ONE, 0.5));
    // A width belongs to its row, also after others that were dropped.
    let dropped = filtered([f64::NAN, 0.75]).unwrap();
    assert_eq!(dropped.scene.order, [1]);
    assert!((dropped.scene.scales[0] - 1.25).abs().max_element() < 1e-6);
    let [filter, dropped] = &dropped.warnings[..] else { panic!("{:?}", dropped.warnings) };
    assert_eq!(filter, "each Gaussian is widened, and its opacity lowered, by its filter_3D (mip-splatting)");
    assert_eq!(dropped, "dropped 1 of 2 Gaussians: 1 with a filter_3D that is not finite");
    // Of flat Gaussians, which have no volume, a filter leaves nothing.
    let flat =
        plain(&[without(&["scale_2"]), vec![("float", "filter_3D", [0.75, 0.0])]].concat(), Format::Ascii);
    let flat = read(flat).unwrap().scene;
    assert_eq!((flat.scales[0].z, &flat.opacities[..]), (0.75, &[0.0, 0.5][..]));
}

#[test]
fn motion_is_left_out_with_a_word() {
    let warnings = |changes: &[Property]| read(plain(&with(changes), Format::Little)).unwrap().warnings;
    let spacetime = warnings(&[
        ("float", "motion_0", [0.1; 2]),
        ("float", "motion_8", [0.1; 2]),
        ("float", "trbf_center", [0.0, 1.0]),
    ]);
    assert_eq!(spacetime.len(), 1, "{spacetime:?}");
    assert!(spacetime[0].contains("motion of a 4D scene (3 properties, motion_0 .. trbf_center)"));
    assert!(warnings(&[("float", "t", [0.1; 2])])[0].contains("(1 property, t)"));
    assert!(warnings(&[("float", "velocity_0", [0.1; 2])])[0].contains("stand still"));
    assert!(warnings(&[("float", "tx", [0.1; 2]), ("float", "timestamp", [0.1; 2])]).is_empty());
}

#[test]
fn values_after_the_activations_get_a_hint() {
    let warnings = |of: &dyn Fn(&str, usize) -> f64| read(many(40, "float", of)).unwrap().warnings;
    assert_eq!(warnings(&trained), [""; 0]);
    let is_scale = |name: &str| name.starts_with("scale");
    let sizes = warnings(&|name, row| {
        let value = trained(name, row);
        if is_scale(name) { value.exp() } else { value }
    });
    assert!(sizes.len() == 1 && sizes[0].contains("look like sizes"), "{sizes:?}");
    let opacities = warnings(&|name, row| {
        let value = trained(name, row);
        if name == "opacity" { 1.0 / (1.0 + (-value).exp()) } else { value }
    });
    assert!(opacities.len() == 1 && opacities[0].contains("look like opacities"), "{opacities:?}");
    let bytes = warnings(&|name, row| match trained(name, row) {
        value if name == "opacity" => (255.0 / (1.0 + (-value).exp())).round(),
        value => value,
    });
    assert!(bytes.len() == 1 && bytes[0].contains("0 to 255: they look like opacities"), "{bytes:?}");
    // A pruned scene has no faint Gaussians, and a few that are opaque.
    let pruned = |name: &str, row: usize| match trained(name, row) {
        value if name == "opacity" => {
            if row.is_multiple_of(4) {
                20.0
            } else {
                value.abs()
            }
        }
        value => value,
    };
    assert_eq!(warnings(&pruned), [""; 0]);
    // Millimeters: places and sizes are a thousand times as large.
    let large = warnings(&|name, row| match trained(name, row) {
        value if is_scale(name) => value + 1000.0_f64.ln(),
        value if ["x", "y", "z"].contains(&name) => 1000.0 * value,
        value => value,
    });
    assert_eq!(large, [""; 0]);
    // The same opacity everywhere is no sign.
    assert_eq!(warnings(&|name, row| if name == "opacity" { 0.5 } else { trained(name, row) }), [""; 0]);
}

#[test]
fn half_floats_in_words_are_decoded() {
    let expected = read(many(40, "float", |name, row| f64::from(f16::from_f64(trained(name, row)).to_f32())));
    let expected = expected.unwrap().scene;
    let bits = |name: &str, row: usize| f64::from(f16::from_f64(trained(name, row)).to_bits());
    let Loaded { scene, warnings, .. } = read(many(40, "ushort", bits)).unwrap();
    assert_eq!(scene.means, expected.means);
    assert_eq!((&scene.scales, &scene.opacities), (&expected.scales, &expected.opacities));
    assert_eq!(scene.sh.unwrap().coefficients, expected.sh.unwrap().coefficients);
    let names = "(x y z opacity rot_0 rot_1 rot_2 rot_3 scale_0 scale_1 scale_2 f_dc_0 f_dc_1 f_dc_2)";
    assert_eq!(warnings, [format!("properties of 16 bits {names} are read as half floats")]);
    // Words that are no half floats: of all of them, one in 32 is no number.
    let noise = |name: &str, row: usize| f64::from((row * 40_503 + 977 * name.len()) as u16);
    refused(&many(400, "ushort", noise), "whole numbers of 16 bits in x y z opacity");
    // Of opacities, words that are numbers by luck.
    let geometry = properties();
    let kind = |name: &str| if name == "opacity" { "ushort" } else { "float" };
    let mut lucky = b"ply\nformat binary_little_endian 1.0\nelement vertex 40\n".to_vec();
    geometry
        .iter()
        .for_each(|(_, name, _)| lucky.extend(format!("property {} {name}\n", kind(name)).bytes()));
    lucky.extend(b"end_header\n");
    for row in 0..40 {
        for (_, name, _) in &geometry {
            // Every exponent but the one of numbers that are none.
            let value = if *name == "opacity" { ((row % 31) << 10) as f64 } else { trained(name, row) };
            push(value, kind(name), Format::Little, &mut lucky);
        }
    }
    refused(&lucky, "whole numbers of 16 bits in opacity, whose bits are no half floats");
    // Whole coordinates stay whole.
    let mut whole = with(&[("ushort", "x", [1.0, 4.0])]);
    let Loaded { scene, warnings, .. } = read(plain(&whole, Format::Little)).unwrap();
    assert_eq!((scene.means[0].x, scene.means[1].x), (1.0, 4.0));
    assert!(warnings.len() == 1 && warnings[0].contains("(x) are read as whole numbers"), "{warnings:?}");
    // In text, a number is what it says.
    whole[0].2 = [1.5, -4.0];
    let Loaded { scene, warnings, .. } = read(plain(&whole, Format::Ascii)).unwrap();
    assert_eq!((scene.means[0].x, warnings.len()), (1.5, 0));
}

/// Unless they make no sense as half floats.
#[test]
fn colors_beside_half_floats_are_half_floats() {
    let rgb = ["red", "green", "blue"];
    let geometry = without(&["f_dc_0", "f_dc_1", "f_dc_2"]);
    let names: Vec<&str> = geometry.iter().map(|property| property.1).chain(rgb).collect();
    // 0 to 39 fortieths, other ones in each channel.
    let share = |channel: usize, row: usize| ((7 * row + 3 * channel) % 40) as f64 / 40.0;
    let read_with = |color: &dyn Fn(f64) -> f64| {
        let value = |name: &str, row: usize| match rgb.iter().position(|&other| other == name) {
            Some(channel) => color(share(channel, row)),
            None => f64::from(f16::from_f64(trained(name, row)).to_bits()),
        };
        let Loaded { scene, warnings, .. } = read(many_of(&names, 40, "ushort", value)).unwrap();
        for (row, color) in scene.base_colors().into_iter().enumerate() {
            let expected = Vec3::from_array([0, 1, 2].map(|channel| share(channel, row) as f32));
            assert!(Vec3::from(color).abs_diff_eq(expected, 2e-3), "{color:?} instead of {expected}");
        }
        warnings
    };
    let halves = |names: &str| {
        let geometry = "x y z opacity rot_0 rot_1 rot_2 rot_3 scale_0 scale_1 scale_2";
        format!("properties of 16 bits ({geometry}{names}) are read as half floats")
    };
    let to_255 = "colors (red green blue) are read as 0 to 255, by their values".to_owned();
    let half = |value: f64| f64::from(f16::from_f64(value).to_bits());
    assert_eq!(read_with(&half), [halves(" red green blue")]);
    assert_eq!(read_with(&|share| half(255.0 * share)), [halves(" red green blue"), to_255.clone()]);
    assert_eq!(read_with(&|share| (65_535.0 * share).round()), [halves("")]);
    assert_eq!(read_with(&|share| (255.0 * share).round()), [halves(""), to_255]);
}

/// Beside numbers of 32 bits, too.
#[test]
fn colors_alone_are_half_floats_if_they_would_be_dark_and_flat() {
    let share = |i: usize| 0.1 + 0.4 * i as f64;
    let colors = |word: &dyn Fn(f64) -> f64| {
        let mut colored = without(&["f_dc_0", "f_dc_1", "f_dc_2"]);
        for (i, name) in ["red", "green", "blue"].into_iter().enumerate() {
            colored.push(("ushort", name, [word(share(i)), word(share(2 - i))]));
        }
        let Loaded { scene, warnings, .. } = read(plain(&colored, Format::Little)).unwrap();
        let color = Vec3::from(scene.base_colors()[0]);
        assert!(color.abs_diff_eq(Vec3::new(0.1, 0.5, 0.9), 2e-3), "{color}");
        warnings
    };
    let halves = colors(&|share| f64::from(f16::from_f64(share).to_bits()));
    assert_eq!(halves, ["properties of 16 bits (red green blue) are read as half floats"]);
    assert_eq!(colors(&|share| (65_535.0 * share).round()), [""; 0]);
}

#[test]
fn numbers_in_the_other_byte_order_are_told() {
    for (format, order, other) in [(Format::Big, "big", "little"), (Format::Little, "little", "big")] {
        let bytes = plain(&properties(), format);
        let (said, lie) = (format!("binary_{order}"), format!("binary_{other}"));
        let at = bytes.windows(said.len()).position(|part| part == said.as_bytes()).unwrap();
        let lying = [&bytes[..at], lie.as_bytes(), &bytes[at + said.len()..]].concat();
        refused(&lying, &format!("that make sense in {order} endian alone, expected {other} endian"));
    }
}

/// The causes of a scene without a Gaussian.
#[test]
fn the_reason_is_told_if_nothing_is_left() {
    for (property, found) in [
        (("float", "rot_0", [0.0; 2]), "2 with a rotation that is zero or not finite"),
        (("float", "filter_3D", [f64::NAN; 2]), "2 with a filter_3D that is not finite"),
        (("float", "scale_1", [1e3; 2]), "2 with a size that is not finite"),
    ] {
        let mut all = with(&[property]);
        if property.1 == "rot_0" {
            all.iter_mut().filter(|other| other.1 == "rot_3").for_each(|other| other.2 = [0.0; 2]);
        }
        let error = crate::scene_from_bytes(&plain(&all, Format::Big), "none.ply").unwrap_err().to_string();
        assert!(error.contains("no usable Gaussian among 2 (") && error.contains(found), "{error}");
    }
}

#[test]
fn ranges_of_colors_are_told_by_their_values() {
    for (kind, range, expected) in [
        ("float", 1.0, [""; 0].to_vec()),
        ("float", 255.0, vec!["colors (red green blue) are read as 0 to 255, by their values"]),
        ("float64", 255.0, vec!["colors (red green blue) are read as 0 to 255, by their values"]),
        ("float", 65_535.0, vec!["colors (red green blue) are read as 0 to 65535, by their values"]),
        ("ushort", 65_535.0, vec![]),
        ("ushort", 255.0, vec!["colors (red green blue) are read as 0 to 255, by their values"]),
        ("uchar", 255.0, vec![]),
        ("int", 255.0, vec![]),
    ] {
        let mut colored = without(&["f_dc_0", "f_dc_1", "f_dc_2"]);
        colored.push((kind, "red", [0.8 * range, 0.2 * range]));
        colored.push((kind, "green", [0.0, range]));
        colored.push((kind, "blue", [0.4 * range, 0.0]));
        let Loaded { scene, warnings, .. } = read(plain(&colored, Format::Little)).unwrap();
        assert_eq!(warnings, expected, "{kind} {range}");
        let colors: Vec<Vec3> = scene.base_colors().into_iter().map(Vec3::from).collect();
        assert!(colors[0].abs_diff_eq(Vec3::new(0.8, 0.0, 0.4), 1e-6), "{kind} {range}: {colors:?}");
        assert!(colors[1].abs_diff_eq(Vec3::new(0.2, 1.0, 0.0), 1e-6), "{kind} {range}: {colors:?}");
    }
}

#[test]
fn the_reason_for_up_is_told() {
    let good = String::from_utf8(ascii_sample()).unwrap();
    let comments = "comment Generated by Nerstudio 1.1.5\ncomment Vertical Axis: z\n";
    let loaded = read(good.replacen("element", &format!("{comments}element"), 1).into_bytes()).unwrap();
    assert_eq!(loaded.scene.up, Some(Vec3::Z));
    let because = "up is +z, because the comment `Vertical Axis: z` names the axis, and nerfstudio means +z";
    assert!(loaded.axes_because.ends_with(because), "{}", loaded.axes_because);
}

/// The same files as other people have them.
#[test]
fn files_of_reports() {
    for (name, n, up, part) in [
        ("R01_2dgs_two_scales", 60, None, "flat"),
        ("R02_half_as_ushort", 60, None, "half floats"),
        ("R06_cloudcompare_scalar_names", 60, None, "scalar_"),
        ("R07c_compressed_neg_inf_realistic", 600, None, ""),
        ("R09e_gsplat_compressed_sh_without_properties", 600, None, ""),
        ("R10b_nerfstudio_red_is_up", 300, Some(Vec3::Z), ""),
        ("R12b_rgb_float_0_255", 60, None, "0 to 255"),
        ("R13_mip_splatting_filter_3D", 60, None, "filter_3D"),
        ("R14_linear_scale_and_opacity", 60, None, "look like"),
        ("R21_spacetime_motion", 60, None, "motion of a 4D scene"),
    ] {
        let Some(path) = shared_data(&format!("reports/{name}.ply")) else { continue };
        let Loaded { scene, warnings, .. } = read_scene(&path).unwrap();
        assert_eq!((scene.len(), scene.up), (n, up), "{name}: {warnings:?}");
        match part {
            "" => assert_eq!(warnings, [""; 0], "{name}"),
            part => assert!(warnings.iter().any(|warning| warning.contains(part)), "{name}: {warnings:?}"),
        }
    }
    let Some(path) = shared_data("reports/R03_colors_misaligned.ply") else { return };
    let message = read_scene(&path).map(drop).unwrap_err().to_string();
    assert!(
        message.contains("R03_colors_misaligned.ply: found 120 bytes after the last row, 2 for each of 60")
    );
}
