//! Dialects of .ply, written here line by line, and real files.

use std::{f32::consts::LN_2, fmt::Write as _, time::Instant};

use glam::{Quat, Vec3};
use stylegaussian::{scene::ScreenFilter, sh::n_coefficients, work::Work};

use super::*;
use crate::{read_scene, tests::shared_data};

mod dialects;
mod packed;

/// Reads a scene that somebody waits for.
fn read(bytes: Vec<u8>) -> Result<Loaded, Mismatch> {
    super::read(bytes, &Work::default())
}

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Ascii,
    Little,
    Big,
}

/// A property: its type, its name and its value in each row.
type Property = (&'static str, &'static str, [f64; 2]);

/// Two Gaussians of SH degree 0.
fn properties() -> Vec<Property> {
    vec![
        ("float", "x", [1.0, -4.0]),
        ("float", "y", [2.0, -5.0]),
        ("float", "z", [3.0, -6.0]),
        ("float", "f_dc_0", [0.5, -1.0]),
        ("float", "f_dc_1", [0.25, -2.0]),
        ("float", "f_dc_2", [0.125, -3.0]),
        ("float", "opacity", [0.0, 0.0]),
        ("float", "scale_0", [0.0, 0.0]),
        ("float", "scale_1", [f64::from(LN_2), 0.0]),
        ("float", "scale_2", [0.0, 0.0]),
        ("float", "rot_0", [2.0, 0.0]),
        ("float", "rot_1", [0.0, 0.0]),
        ("float", "rot_2", [0.0, 0.0]),
        ("float", "rot_3", [0.0, -0.5]),
    ]
}

fn push(value: f64, kind: &str, format: Format, bytes: &mut Vec<u8>) {
    let mut number = match kind {
        _ if format == Format::Ascii => format!("{value} ").into_bytes(),
        "float" | "float32" => (value as f32).to_le_bytes().into(),
        "double" | "float64" => value.to_le_bytes().into(),
        "uchar" | "uint8" => vec![value as u8],
        "ushort" => (value as u16).to_le_bytes().into(),
        "int" => (value as i32).to_le_bytes().into(),
        other => panic!("{other}"),
    };
    if format == Format::Big {
        number.reverse();
    }
    bytes.extend(number);
}

/// A file of these vertices. `elements` are header lines before and after them, `payload` their data, and `end`
/// the line end.
fn file(
    properties: &[Property],
    format: Format,
    elements: [&str; 2],
    payload: [&[u8]; 2],
    end: &str,
) -> Vec<u8> {
    let name = match format {
        Format::Ascii => "ascii",
        Format::Little => "binary_little_endian",
        Format::Big => "binary_big_endian",
    };
    let mut header = format!("ply\nformat {name} 1.0\ncomment caf\u{e9}\n{}element vertex 2\n", elements[0]);
    for (kind, name, _) in properties {
        writeln!(header, "property {kind} {name}").unwrap();
    }
    writeln!(header, "{}end_header", elements[1]).unwrap();
    let mut bytes = header.replace('\n', end).into_bytes();
    bytes.extend(payload[0]);
    for row in 0..2 {
        for (kind, _, values) in properties {
            push(values[row], kind, format, &mut bytes);
        }
        if format == Format::Ascii {
            bytes.extend(end.bytes());
        }
    }
    bytes.extend(payload[1]);
    bytes
}

fn plain(properties: &[Property], format: Format) -> Vec<u8> {
    file(properties, format, ["", ""], [b"", b""], "\n")
}

/// For tests of all formats together.
pub(crate) fn ascii_sample() -> Vec<u8> {
    plain(&properties(), Format::Ascii)
}

fn check_two(bytes: &[u8]) {
    assert_eq!(warnings_of_two(bytes), [""; 0]);
}

/// Checks the two Gaussians, and returns the warnings.
fn warnings_of_two(bytes: &[u8]) -> Vec<String> {
    let Loaded { scene, warnings, .. } = read(bytes.into()).unwrap();
    assert_eq!(scene.means, [Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.0, -5.0, -6.0)]);
    assert_eq!(scene.opacities, [0.5, 0.5]);
    assert!(scene.scales[0].abs_diff_eq(Vec3::new(1.0, 2.0, 1.0), 1e-6));
    assert_eq!(scene.rotations, [Quat::IDENTITY, Quat::from_xyzw(0.0, 0.0, -1.0, 0.0)]);
    assert_eq!((&scene.order[..], scene.n_source), (&[0, 1][..], 2));
    let sh = scene.sh.as_ref().unwrap();
    assert_eq!((sh.degree, &sh.coefficients[..]), (0, &[0.5, 0.25, 0.125, -1.0, -2.0, -3.0][..]));
    warnings
}

const ALL: [Format; 3] = [Format::Ascii, Format::Little, Format::Big];

#[test]
fn all_encodings_and_line_ends() {
    for format in ALL {
        check_two(&plain(&properties(), format));
        check_two(&file(&properties(), format, ["", ""], [b"", b""], "\r\n"));
    }
}

/// Of a program that took the file for text.
#[test]
fn a_byte_order_mark_is_no_content() {
    for format in ALL {
        let marked = [&b"\xEF\xBB\xBF"[..], &plain(&properties(), format)[..]].concat();
        check_two(&marked);
        assert_eq!(crate::scene_from_bytes(&marked, "marked").unwrap().format, FORMAT.name);
        assert_eq!(rows(&marked).is_some(), format != Format::Ascii);
    }
}

#[test]
fn any_order_types_and_additional_properties() {
    for format in ALL {
        let mut shuffled = properties();
        shuffled.reverse();
        shuffled.swap(2, 9);
        check_two(&plain(&shuffled, format));
        let mut typed = properties();
        typed[0].0 = "double";
        typed[7].0 = "float64";
        typed[2].0 = "int";
        typed.insert(3, ("float", "nx", [9.0, 9.0]));
        typed.insert(0, ("uchar", "label", [200.0, 255.0]));
        typed.push(("ushort", "transform", [1.0, 2.0]));
        check_two(&plain(&typed, format));
    }
}

#[test]
fn elements_and_lists_around_the_vertices() {
    let before = "element camera 1\nproperty float f\nelement face 2\nproperty list uchar int vertex_indices\n\
                  element nothing 1000000000000000000\n";
    let behind = "obj_info made by hand\nelement edge 1\nproperty double length\n";
    let little = [&1_f32.to_le_bytes()[..], &[2, 1, 0, 0, 0, 2, 0, 0, 0], &[0]].concat();
    check_two(&file(&properties(), Format::Little, [before, behind], [&little, &[0; 8]], "\n"));
    let big = [&1_f32.to_be_bytes()[..], &[2, 0, 0, 0, 1, 0, 0, 0, 2], &[0]].concat();
    check_two(&file(&properties(), Format::Big, [before, behind], [&big, &[0; 8]], "\n"));
    check_two(&file(&properties(), Format::Ascii, [before, behind], [b"1.5\n2 1 2\n0\n", b"3\n"], "\n"));
}

#[test]
fn ascii_numbers_of_all_spellings() {
    let text = String::from_utf8(ascii_sample()).unwrap();
    check_two(text.replace("1 2 3 0.5 ", "+1 2.  .3E1\t5e-1 ").as_bytes());
    let loaded = read(text.replace("1 2 3 0.5 ", "NaN 2 3 inf ").into_bytes()).unwrap();
    assert_eq!(loaded.scene.order, [1]);
    assert_eq!(loaded.scene.n_source, 2);
    assert!(loaded.warnings[0].contains("dropped 1 of 2"), "{:?}", loaded.warnings);
}

#[test]
fn rest_coefficients_are_channel_major() {
    for degree in 1..=3 {
        let n_rest = n_coefficients(degree) - 1;
        let names: Vec<&'static str> = (0..3 * n_rest).map(|i| &*format!("f_rest_{i}").leak()).collect();
        let mut all = properties();
        all.extend(names.iter().enumerate().map(|(i, name)| ("float", *name, [i as f64, -(i as f64)])));
        let sh = read(plain(&all, Format::Little)).unwrap().scene.sh.unwrap();
        assert_eq!(sh.degree, degree);
        // Coefficient 1 of red, green, blue; and the last of blue in the second row.
        let n = n_rest as f32;
        assert_eq!(sh.coefficients[3..6], [0.0, n, 2.0 * n]);
        assert_eq!(sh.coefficients.last(), Some(&(1.0 - 3.0 * n)));
        all.pop();
        let error = read(plain(&all, Format::Little)).unwrap_err();
        assert_eq!(error.found, format!("{} properties f_rest_*", 3 * n_rest - 1));
        assert_eq!(error.expected, "0, 9, 24, 45 or 72 (SH degree 0 to 4)");
    }
}

#[test]
fn a_fourth_degree_is_left_out() {
    let names: Vec<&'static str> = (0..72).map(|i| &*format!("f_rest_{i}").leak()).collect();
    let mut all = properties();
    all.extend(names.iter().enumerate().map(|(i, name)| ("float", *name, [i as f64, 0.0])));
    let Loaded { scene, warnings, .. } = read(plain(&all, Format::Little)).unwrap();
    assert_eq!(warnings, ["dropped spherical harmonics beyond degree 3"]);
    let sh = scene.sh.unwrap();
    assert_eq!((sh.degree, sh.coefficients.len()), (3, 96));
    // 24 numbers for each channel.
    assert_eq!(
        (&sh.coefficients[3..6], &sh.coefficients[45..48]),
        (&[0.0, 24.0, 48.0][..], &[14.0, 38.0, 62.0][..])
    );
}

#[test]
fn comments_tell_the_filter_and_the_vertical() {
    let good = String::from_utf8(ascii_sample()).unwrap();
    let with = |comments: &str| {
        let loaded = read(good.replacen("element", &format!("{comments}element"), 1).into_bytes()).unwrap();
        (loaded.scene.filter, loaded.scene.up, loaded.warnings)
    };
    let filter = |comment: &str| with(&format!("comment {comment}\n")).0;
    for mip in ["SplatRenderMode: mip", "splatrendermode:  MIP", "antialiased 1"] {
        assert_eq!(filter(mip), ScreenFilter::Antialiased, "{mip}");
    }
    for plain in ["SplatRenderMode: default", "antialiased 0", "about mip", "SplatRenderMode:"] {
        assert_eq!(filter(plain), ScreenFilter::Classic, "{plain}");
    }
    let (filter, _, warnings) = with("comment SplatRenderMode: 2dgs\n");
    assert_eq!(filter, ScreenFilter::Classic);
    assert!(warnings[0].contains("unknown render mode `2dgs`"), "{warnings:?}");
    let up = |comment: &str| with(&format!("comment Exported from Brush\ncomment {comment}\n")).1;
    assert_eq!(up("Vertical axis: y"), Some(Vec3::NEG_Y));
    assert_eq!(up("Vertical axis: 0 0 2"), Some(Vec3::Z));
    assert_eq!(up("up 0 -3 4"), Some(Vec3::new(0.0, -0.6, 0.8)));
    for nothing in ["Vertical axis: ?", "up 0 0 0", "up 1 2", "Vertical axis:"] {
        assert_eq!(up(nothing), None, "{nothing}");
    }
}

#[test]
fn rgb_and_missing_colors() {
    let without = || properties().into_iter().filter(|p| !p.1.starts_with("f_dc")).collect::<Vec<_>>();
    for (kind, brightest) in [("uchar", 255.0), ("ushort", 65_535.0), ("float", 1.0)] {
        let mut colored = without();
        colored.push((kind, "red", [brightest, 0.0]));
        colored.push((kind, "green", [0.0, brightest]));
        colored.push((kind, "blue", [0.0, 0.0]));
        let colors = read(plain(&colored, Format::Big)).unwrap().scene.base_colors();
        assert!(Vec3::from(colors[0]).abs_diff_eq(Vec3::X, 1e-6), "{kind}: {colors:?}");
        assert!(Vec3::from(colors[1]).abs_diff_eq(Vec3::Y, 1e-6), "{kind}: {colors:?}");
    }
    let Loaded { scene, warnings, .. } = read(plain(&without(), Format::Ascii)).unwrap();
    assert!(scene.sh.is_none());
    assert!(warnings[0].contains("mid-gray"), "{warnings:?}");
}

fn refused(bytes: &[u8], part: &str) {
    let Mismatch { found, expected } = read(bytes.into()).map(|_| ()).expect_err(part);
    let message = format!("found {found}, expected {expected}");
    assert!(message.contains(part) && !message.contains('\n'), "{message}");
}

#[test]
fn lying_and_broken_headers() {
    let good = String::from_utf8(ascii_sample()).unwrap();
    let changed = |from: &str, to: &str| good.replacen(from, to, 1).into_bytes();
    refused(&changed("vertex 2", "vertex 1000000000000000000"), "for 1000000000000000000 vertex");
    refused(&changed("vertex 2", "vertex 99999999999999999999999"), "`element name count`");
    refused(&changed("vertex 2", "vertex -1"), "`element name count`");
    refused(&changed("vertex 2", "vertex 3"), "row 2 of 3");
    refused(&changed("1.0", "999999999999999999999999.0"), "format version 1.0");
    refused(&changed("end_header", "end_heeder"), "`end_header`");
    refused(&changed("float x", "float y"), "declared twice");
    refused(
        &changed("float x", "quad x"),
        "does not parse (Line 5: Couldn't parse line. String: 'property quad x ')",
    );
    refused(&changed("property float opacity", "property float opaqueness"), "without opacity");
    refused(&changed("property float x", "property list uchar float x"), "a list");
    let rest: String = (0..8).chain([11]).map(|i| format!("property float f_rest_{i}\n")).collect();
    let with_gap = good.replace("end_header", &format!("{rest}end_header")) + &" 0".repeat(18);
    refused(with_gap.as_bytes(), "no property `f_rest_8`");
    refused(&changed("element vertex", "element point"), "no element `vertex`");
    refused(&changed("1 2 3 0.5", "1 2 x 0.5"), "`x` in row 0 of 2");
    let binary = plain(&properties(), Format::Little);
    refused(&binary[..binary.len() - 1], "at least 112 for 2 vertex");
    refused(b"ply\n", "without an end");
    let list = "element face 1\nproperty list int float weights\n";
    let negative = file(&properties(), Format::Little, [list, ""], [&(-1_i32).to_le_bytes(), b""], "\n");
    refused(&negative, "list length -1");
    let huge = file(&properties(), Format::Little, [list, ""], [&i32::MAX.to_le_bytes(), b""], "\n");
    refused(&huge, "the end of the file");
    let endless = "element face 1\nproperty list float float weights\n";
    let float = file(&properties(), Format::Little, [endless, ""], [&1_f32.to_le_bytes(), b""], "\n");
    refused(&float, "no integer");
}

#[test]
fn real_files() {
    for (name, n, degree) in [
        ("biker.compressed", 152_746, 0),
        ("train-1000", 1_000, 3),
        ("fruit_drops_minimal", 4_721, 3),
        ("playbot_31k_sh2pad3", 31_000, 3),
        ("bonsai_271k", 271_123, 0),
    ] {
        let Some(path) = shared_data(&format!("splats/{name}.ply")) else { continue };
        let start = Instant::now();
        let Loaded { scene, warnings, .. } = read_scene(&path).unwrap();
        eprintln!("{name}: {n} Gaussians in {:.3} s, {warnings:?}", start.elapsed().as_secs_f64());
        scene.validate().unwrap();
        assert_eq!((scene.n_source, scene.sh.as_ref().unwrap().degree), (n, degree), "{name}");
        assert!(scene.len() * 100 >= n * 99, "{name}: {warnings:?}");
    }
}
