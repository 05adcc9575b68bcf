//! The formats of scenes on the command line: names of outputs, options, and what the commands tell.

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

use std::fs;

use support::{Bench, stylegaussian};

#[test]
fn a_wrong_extension_is_a_usage_error_everywhere() {
    let bench = Bench::new();
    let (scene, style) = (bench.embedded_scene("a.sgs"), bench.style("s.style.safetensors"));
    let out = bench.path("out.txt");
    for arguments in [
        &["convert", &scene, &out][..],
        &["stylize", &scene, "--style", &style, "-o", &out],
        &["embed", &scene, "-o", &out],
        &["bake", &scene, "--style", "p.png", "-o", &out],
        &["style", "p.png", "-o", &out],
    ] {
        let run = stylegaussian(arguments);
        assert_eq!(run.code, Some(2), "{arguments:?}: {}", run.stderr);
        let message = &run.stderr;
        assert!(message.contains("out.txt: ") && message.contains("extension"), "{message}");
    }
    let list = stylegaussian(&["convert", &scene, &out]).stderr;
    for extension in [".ply", ".sgs", ".splat", ".decoder.safetensors"] {
        assert!(list.contains(extension), "{list}");
    }
    bench.expect_files(&["a.sgs", "s.style.safetensors"]);
}

/// Bad files of a format: their names besides the extension, and their bytes.
fn bad_files(bench: &Bench, extension: &str) -> Vec<(&'static str, Vec<u8>)> {
    let text = |text: &str| text.as_bytes().to_vec();
    let mut files = match extension {
        "sog" => vec![
            ("zip", text("PK\x03\x04 and no more")),
            ("json", text(r#"{"version":2,"count":1,"means":"#)),
        ],
        "json" => vec![
            ("other", text(r#"{"frames":[{}]}"#)),
            (
                "levels",
                text(
                    r#"{"lodLevels":1,"filenames":["0/meta.json"],
                    "tree":{"lods":{"0":{"file":0,"offset":0,"count":1}}}}"#,
                ),
            ),
            (
                "planes",
                text(
                    r#"{"means":{"shape":[1,3],"mins":[0,0,0],"maxs":[1,1,1],"files":["l.webp","u.webp"]},
                    "scales":{"mins":[0,0,0],"maxs":[1,1,1],"files":["s.webp"]},"quats":{"files":["q.webp"]},
                    "sh0":{"mins":[0,0,0,0],"maxs":[1,1,1,1],"files":["c.webp"]}}"#,
                ),
            ),
        ],
        "gltf" => vec![
            ("none", text(r#"{"asset":{"version":"2.0"}}"#)),
            ("beside", text(r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"no.bin","byteLength":8}]}"#)),
            ("above", text(r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"../no.bin","byteLength":8}]}"#)),
        ],
        "pth" => vec![("zip", text("PK\x03\x04 and no more")), ("pickle", text("\u{80}\x02}q\0."))],
        "ksplat" => vec![("zeros", vec![0; 5000]), ("version", [&[9, 9][..], &[1; 5000]].concat())],
        // What can be written is cut, a byte off any row.
        written => {
            let whole = fs::read(bench.plain_scene(&format!("whole.{written}"))).unwrap();
            fs::remove_file(bench.path(&format!("whole.{written}"))).unwrap();
            let cut = |kept: usize| whole[..kept].to_vec();
            vec![("half", cut((whole.len() / 2) | 1)), ("last", cut(whole.len() - 1)), ("start", cut(9))]
        }
    };
    files.push(("empty", Vec::new()));
    files.push(("noise", (0..4097_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect()));
    files
}

#[test]
fn bad_files_of_every_format_are_refused_and_nothing_is_written() {
    let bench = Bench::new();
    let style = bench.style("s.style.safetensors");
    for extension in stylegaussian_files::readable_extensions() {
        for (what, bytes) in bad_files(&bench, extension) {
            let name = format!("{what}.{extension}");
            let path = bench.path(&name);
            fs::write(&path, bytes).unwrap();
            let [ply, spz, pictures] = ["out.ply", "out.spz", "out"].map(|out| bench.path(out));
            for arguments in [
                &["info", &path][..],
                &["convert", &path, &ply],
                &["convert", &path, &spz, "--axes", "rdf"],
                &["stylize", &path, "--style", &style, "-o", &ply],
                &["render", &path, "-o", &pictures],
            ] {
                let run = stylegaussian(arguments);
                // The file that is missing is named if it is another.
                let missing = [("levels", "0/meta.json"), ("planes", "l.webp"), ("beside", "no.bin")];
                let named = missing.into_iter().find(|(of, _)| *of == what).map_or(&*name, |(_, file)| file);
                run.expect_error(named);
                assert!(run.stdout.is_empty(), "{arguments:?}: {}", run.stdout);
                let mut expected = [&*name, "s.style.safetensors"];
                expected.sort_unstable();
                bench.expect_files(&expected);
            }
            fs::remove_file(&path).unwrap();
        }
    }
    // Options are checked before any file is opened.
    for wrong in [["--axes", "up"], ["--sh-degree", "4"], ["--spz-version", "2"]] {
        let run = stylegaussian(&[&["convert", "no.ply", &bench.path("out.spz")][..], &wrong].concat());
        assert_eq!(run.code, Some(2), "{wrong:?}: {}", run.stderr);
    }
    bench.expect_files(&["s.style.safetensors"]);
}

#[test]
fn a_conversion_tells_sizes_and_losses() {
    let bench = Bench::new();
    let (scene, splat) = (bench.embedded_scene("a.sgs"), bench.path("b.splat"));
    let run = stylegaussian(&["convert", &scene, &splat]).expect_success();
    for part in ["40 Gaussians, 1280 bytes (32.0 each", "% of ", ", pictures at "] {
        assert!(run.stdout.contains(part), "{part}: {}", run.stdout);
    }
    for part in ["a .splat keeps no features", "a .splat keeps no spherical harmonics beyond degree 0"] {
        assert!(run.stderr.contains(part), "{part}: {}", run.stderr);
    }
    let psnr = |arguments: &[&str]| {
        let json = stylegaussian(&[arguments, &["--json"]].concat()).expect_success().json();
        assert_eq!(json["output_bytes"], fs::metadata(arguments[2]).unwrap().len());
        json["psnr_db"].as_f64()
    };
    // Base colors alone are rounded to bytes: half a step is 54 dB. Opacities and rotations add to it.
    let plain = bench.path("plain.sgs");
    stylegaussian(&["convert", &scene, &plain, "--sh-degree", "0"]).expect_success();
    let found = psnr(&["convert", &plain, &splat]).expect("some pixel");
    assert!((35.0..70.0).contains(&found), "{found} dB");
    let ply = bench.path("c.ply");
    assert_eq!(psnr(&["convert", &scene, &ply]), None);
    // Fewer colors are as asked for, and measured.
    let run = stylegaussian(&["convert", &scene, &ply, "--sh-degree", "0"]).expect_success();
    assert!(run.stdout.contains("dB") && !run.stderr.contains("degree"), "{run:?}");
    assert_eq!(bench.scene("c.ply").sh.unwrap().degree, 0);
}

#[test]
fn a_compressed_ply_is_written_by_its_name_and_a_full_one_on_request() {
    let bench = Bench::new();
    let (scene, packed, full) =
        (bench.plain_scene("a.ply"), bench.path("b.compressed.ply"), bench.path("c.ply"));
    let run = stylegaussian(&["convert", &scene, &packed]).expect_success();
    assert!(run.stdout.contains(", pictures at "), "{}", run.stdout);
    assert!(fs::read(&packed).unwrap().windows(15).any(|bytes| bytes == b"packed_position"));
    assert_eq!(bench.scene("b.compressed.ply").len(), bench.scene("a.ply").len());
    let run = stylegaussian(&["convert", &scene, &full, "--sh-degree", "3"]).expect_success();
    assert_eq!((bench.scene("c.ply").sh.unwrap().degree, &*run.stderr), (3, ""));
    // Others are not filled up, and say so.
    for other in [&packed, &bench.path("d.sog")] {
        let run = stylegaussian(&["convert", &scene, other, "--sh-degree", "3"]).expect_success();
        assert!(run.stderr.contains("have degree 1, as in the scene: only a 3DGS .ply"), "{}", run.stderr);
        let run = stylegaussian(&["convert", &scene, other, "--sh-degree", "1"]).expect_success();
        assert!(!run.stderr.contains("degree"), "{}", run.stderr);
    }
}

#[test]
fn axes_are_told_and_overridden() {
    let bench = Bench::new();
    let (scene, turned) = (bench.plain_scene("a.ply"), bench.path("b.ply"));
    let text = stylegaussian(&["info", &scene]).expect_success().stdout;
    for part in ["format      3DGS .ply", "axes        RDF, because the format keeps"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let json = stylegaussian(&["info", &scene, "--axes", "rub", "--json"]).expect_success().json();
    assert_eq!((&json["axes"], &json["filter"]), (&"RUB".into(), &"classic".into()));
    assert_eq!(json["axes_because"], "they were asked for");
    stylegaussian(&["convert", &scene, &turned, "--axes", "rub"]).expect_success();
    for (a, b) in bench.scene("a.ply").means.iter().zip(bench.scene("b.ply").means) {
        assert_eq!(*a * glam::Vec3::new(1.0, -1.0, -1.0), b);
    }
    let run = stylegaussian(&["info", &scene, "--axes", "xyz"]);
    assert_eq!(run.code, Some(2));
    assert!(run.stderr.contains("three letters"), "{}", run.stderr);
}

#[test]
fn a_styled_scene_is_written_in_every_format() {
    let bench = Bench::new();
    let (scene, style) = (bench.embedded_scene("a.sgs"), bench.style("s.style.safetensors"));
    let stylize = |out: &str| {
        let out = bench.path(out);
        stylegaussian(&["stylize", &scene, "--style", &style, "-o", &out]).expect_success();
    };
    stylize("exact.ply");
    let exact = bench.scene("exact.ply");
    for extension in stylegaussian_files::writable_extensions() {
        let name = format!("b.{extension}");
        stylize(&name);
        let written = bench.scene(&name);
        assert_eq!(written.len(), 40);
        for (mean, color) in written.means.iter().zip(written.base_colors()) {
            let distance = |i: &usize| exact.means[*i].distance_squared(*mean);
            let i = (0..40).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
            let expected = exact.base_colors()[i];
            // A byte of SPZ stands for 1/38.25 of a coefficient, 0.0074 of a color; others are finer.
            for (found, expected) in color.into_iter().zip(expected) {
                // `.splat` ends at 0 and 1. SPZ ends at coefficients of 1/0.3, times 0.2821 from mid-gray.
                let (least, most) = match extension {
                    "splat" => (0.0, 1.0),
                    "spz" => (-0.4403, 1.4403),
                    _ => (f32::MIN, f32::MAX),
                };
                let error = (found - expected.clamp(least, most)).abs();
                // SOG has 256 numbers for all colors, which span 5 here: half of a step.
                let most = if extension == "sog" { 1e-2 } else { 4e-3 };
                assert!(error < most, "{name}: {found}, expected {expected}");
            }
        }
    }
}

/// The names of files are bytes on Unix.
#[test]
#[cfg(target_os = "linux")]
fn a_name_that_is_no_text_is_written_as_json_all_the_same() {
    use std::{ffi::OsStr, os::unix::ffi::OsStrExt, process::Command};
    let bench = Bench::new();
    let scene = bench.plain_scene("a.ply");
    let out = bench.dir().join(OsStr::from_bytes(b"caf\xe9.sgs"));
    let program = || Command::new(env!("CARGO_BIN_EXE_stylegaussian"));
    let run = program().arg("convert").arg(&scene).arg(&out).arg("--json").output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let json: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    assert!(json["output"].as_str().unwrap().ends_with("caf\u{fffd}.sgs"));
    let run = program().arg("info").arg(&out).arg("--json").output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}
