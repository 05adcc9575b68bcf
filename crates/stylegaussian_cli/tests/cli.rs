//! The binary from its users' side: exit codes, messages, and files left on the disk.

mod support;

use std::fs;

use stylegaussian::paint::Paint;
use stylegaussian_files::{Precision, read_style, write_decoder, write_painted_style};
use support::{Bench, Run, data, stylegaussian};

#[test]
fn usage_errors_exit_with_2() {
    let usage: [&[&str]; 22] = [
        &[],
        &["no-such-command"],
        &["info"],
        &["info", "a.ply", "b.ply"],
        &["convert", "a.ply"],
        &["style", "a.png"],
        &["stylize", "a.sgs", "-o", "b.ply"],
        &["stylize", "a.sgs", "--style", "s.png:-1", "-o", "b.ply"],
        &["stylize", "a.sgs", "--style", "s.png:0", "t.png:0", "-o", "b.ply"],
        &["stylize", "a.sgs", "--style", "s.png", "-o", "b.png"],
        &["style", "a.png", "-o", "b.sgs"],
        &["stylize", "a.sgs", "--style", "s.png", "--backend", "tpu", "-o", "b.ply"],
        &["render", "a.sgs", "--orbit", "0", "-o", "d"],
        &["render", "a.sgs", "--orbit", "4", "--cameras", "c.json", "-o", "d"],
        &["render", "a.sgs", "--frame", "0,0,1", "-o", "d"],
        &["render", "a.sgs", "--frame", "0,0,0,1", "--cameras", "c.json", "-o", "d"],
        &["render", "a.sgs", "--size", "640", "-o", "d"],
        &["render", "a.sgs", "--background", "blue", "-o", "d"],
        &["render", "a.sgs", "--content", "0.5", "-o", "d"],
        &["train", "a.sgs", "--styles", "d", "-o", "b", "-k", "0"],
        &["train", "a.sgs", "--styles", "d", "-o", "b", "--noise", "1000000000000"],
        &["train", "a.sgs", "--styles", "d", "-o", "b", "--size", "0"],
    ];
    for arguments in usage {
        let run = stylegaussian(arguments);
        assert_eq!(run.code, Some(2), "{arguments:?}: {}", run.stderr);
        assert!(run.stderr.contains("--help"), "{arguments:?}: {}", run.stderr);
    }
}

#[test]
fn content_is_a_number_from_0_to_1() {
    for content in ["-0.1", "1.5", "nan", "inf", "half"] {
        let run =
            stylegaussian(&["stylize", "a.sgs", "--style", "s.png", "--content", content, "-o", "b.ply"]);
        assert_eq!(run.code, Some(2), "{content}: {}", run.stderr);
        assert!(run.stderr.contains("from 0 to 1"), "{content}: {}", run.stderr);
    }
}

#[test]
fn help_and_version_succeed() {
    for arguments in [&["--help"][..], &["--version"], &["render", "--help"], &["stylize", "-h"]] {
        let run = stylegaussian(arguments);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        assert!(!run.stdout.is_empty());
    }
    let help = stylegaussian(&["style", "--help"]).expect_success().stdout;
    let formats = stylegaussian_encoder::image::format_names();
    assert!(help.contains(&format!("The painting: {formats}")), "{help}");
}

#[test]
fn a_missing_file_is_named() {
    let bench = Bench::new();
    let missing = bench.path("missing.ply");
    for arguments in [&["info", &missing][..], &["convert", &missing, &bench.path("out.sgs")]] {
        stylegaussian(arguments).expect_error("missing.ply");
    }
    bench.expect_files(&[]);
}

#[test]
#[cfg(target_os = "linux")]
fn the_gpu_backend_never_falls_back() {
    let bench = Bench::new();
    let scene = bench.embedded_scene("a.sgs");
    let style = bench.style("s.style.safetensors");
    let out = bench.path("b.ply");
    let stylize = ["stylize", &scene, "--style", &style, "-o", &out, "--json", "--backend"];
    let with = |backend| support::stylegaussian_without_gpu(&[&stylize[..], &[backend]].concat());
    with("gpu").expect_error("found no GPU adapter");
    bench.expect_files(&["a.sgs", "s.style.safetensors"]);
    assert_eq!(with("auto").expect_success().json()["backend"], "cpu");
}

/// Runs with `--backend gpu`, or returns `None`, loudly, if there is no GPU.
fn on_gpu(arguments: &[&str]) -> Option<Run> {
    let run = stylegaussian(&[arguments, &["--backend", "gpu"]].concat());
    if run.stderr.contains("no GPU adapter") {
        eprintln!("SKIPPED: no GPU adapter");
        return None;
    }
    Some(run.expect_success())
}

/// Colors agree to 2e-3 in display-referred units, which the documentation promises.
#[test]
fn stylizing_on_the_gpu_matches_the_cpu() {
    let bench = Bench::new();
    let (scene, style) = (bench.embedded_scene("a.sgs"), bench.style("s.style.safetensors"));
    let (a, b) = (bench.path("a.safetensors"), bench.path("b.safetensors"));
    let stylize = ["stylize", &scene, "--style", &style, "--content", "0.2", "--json", "-o"];
    let Some(run) = on_gpu(&[&stylize[..], &[&a]].concat()) else { return };
    assert_eq!(run.json()["backend"], "gpu");
    assert!(run.json()["adapter"].is_string());
    let run = stylegaussian(&[&stylize[..], &[&b, "--backend", "cpu"]].concat()).expect_success();
    assert_eq!(run.json()["backend"], "cpu");
    let (gpu, cpu) = (bench.colors("a.safetensors"), bench.colors("b.safetensors"));
    assert_eq!(gpu.len(), cpu.len());
    for (gpu, cpu) in gpu.as_flattened().iter().zip(cpu.as_flattened()) {
        assert!((gpu - cpu).abs() < 2e-3, "{gpu} on the GPU, {cpu} on the CPU");
    }
}

/// The GPU blends in f16 and the CPU in f32: 48 dB is a deviation of one step of a byte.
#[test]
fn rendering_on_the_gpu_matches_the_cpu() {
    let bench = Bench::new();
    let (scene, style) = (bench.embedded_scene("a.sgs"), bench.style("s.style.safetensors"));
    let (a, b) = (bench.path("a"), bench.path("b"));
    let common =
        ["render", &scene, "--size", "48x40", "--orbit", "2", "--background", "203040", "--json", "-o"];
    for style in [&[][..], &["--style", &style]] {
        let Some(run) = on_gpu(&[&common[..], &[&a], style].concat()) else { return };
        assert_eq!(run.json()["drawn_by"], "gpu");
        stylegaussian(&[&common[..], &[&b, "--backend", "cpu"], style].concat()).expect_success();
        let pixels = |name| image::open(bench.dir().join(name)).unwrap().into_rgba8().into_raw();
        let (gpu, cpu) = (pixels("a/000001.png"), pixels("b/000001.png"));
        let squares = gpu.iter().zip(&cpu).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
        let psnr = 10.0 * (255.0_f64.powi(2) * gpu.len() as f64 / squares.sum::<f64>()).log10();
        eprintln!("{psnr:.1} dB");
        assert!(psnr > 48.0, "{psnr} dB, styled: {}", !style.is_empty());
    }
}

#[test]
fn info_describes_styles_and_decoders() {
    let bench = Bench::new();
    let (bare, painted) = (bench.style("bare.style.safetensors"), bench.path("s.style.safetensors"));
    let paint = Paint { width: 3, height: 2, pixels: vec![7; 18], used: None };
    write_painted_style(painted.as_ref(), &read_style(bare.as_ref()).unwrap(), &paint).unwrap();
    let text = stylegaussian(&["info", &bare]).expect_success().stdout;
    for part in ["6 channels", "encoder test@00", "none: it is decoded"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let json = stylegaussian(&["info", &painted, "--json"]).expect_success().json();
    assert_eq!((&json["n_channels"], &json["paint"]), (&6.into(), &serde_json::json!([3, 2])));
    bench.embedded_scene("a.sgs");
    let decoder = bench.path("d.decoder.safetensors");
    let of_scene = bench.scene("a.sgs").decoder.unwrap();
    write_decoder(decoder.as_ref(), &of_scene, Precision::F32).unwrap();
    let text = stylegaussian(&["info", &decoder]).expect_success().stdout;
    assert!(text.contains("6 > 5 > 3, K = 3"), "{text}");
    let json = stylegaussian(&["info", &decoder, "--json"]).expect_success().json();
    assert_eq!(json["decoder"]["k"], 3);
    // What is cut off is an error that names the file.
    for path in [&painted, &decoder] {
        let bytes = fs::read(path).unwrap();
        fs::write(path, &bytes[..bytes.len() - 1]).unwrap();
        stylegaussian(&["info", path]).expect_error("safetensors: found");
    }
}

#[test]
fn info_describes_a_scene() {
    let bench = Bench::new();
    let scene = bench.embedded_scene("a.sgs");
    let text = stylegaussian(&["info", &scene]).expect_success().stdout;
    for part in ["40", "4 latent features of 6", "test@00", "6 > 5 > 3", "GPU memory"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let json = stylegaussian(&["info", &scene, "--json"]).expect_success().json();
    assert_eq!(json["n_gaussians"], 40);
    assert_eq!(json["sh_degree"], 1);
    assert_eq!(json["features"]["n_low"], 4);
    assert_eq!(json["features"]["n_channels"], 6);
    assert_eq!(json["decoder"]["widths"].as_array().unwrap().len(), 3);
    assert_eq!(json["neighbors"], 3);
}

#[test]
fn scenes_survive_conversion() {
    let bench = Bench::new();
    let (sgs, ply, back) = (bench.embedded_scene("a.sgs"), bench.path("b.ply"), bench.path("c.sgs"));
    let run = stylegaussian(&["convert", &sgs, &ply]).expect_success();
    assert!(run.stderr.contains("warning: a .ply keeps no features"), "{}", run.stderr);
    stylegaussian(&["convert", &ply, &back]).expect_success();
    let json = stylegaussian(&["convert", &back, &bench.path("d.ply"), "--json"]).expect_success().json();
    assert_eq!(json["n_gaussians"], 40);
    bench.check_same_scene("a.sgs", "c.sgs");

    let decoder = bench.path("e.decoder.safetensors");
    stylegaussian(&["convert", &sgs, &decoder]).expect_success();
    stylegaussian(&["convert", &back, &decoder]).expect_error("has no decoder");
    bench.expect_files(&["a.sgs", "b.ply", "c.sgs", "d.ply", "e.decoder.safetensors"]);
}

#[test]
fn stylizing_writes_every_format() {
    let bench = Bench::new();
    let (scene, style) = (bench.embedded_scene("a.sgs"), bench.style("s.style.safetensors"));
    for out in ["b.ply", "c.sgs", "d.safetensors"] {
        let out = bench.path(out);
        stylegaussian(&["stylize", &scene, "--style", &style, "-o", &out]).expect_success();
    }
    let rgb = bench.colors("d.safetensors");
    assert_eq!(rgb.len(), 40);
    // One decoder, one style: the same colors in every format, in the order of the source.
    for out in ["b.ply", "c.sgs"] {
        let written = bench.scene(out);
        for (i, color) in written.base_colors().iter().enumerate() {
            let expected = rgb[written.order[i] as usize];
            let error = color.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(error < 2e-3, "{out}, Gaussian {i}: {color:?} and {expected:?}");
        }
    }
}

#[test]
fn mixing_normalizes_weights_and_content_1_forgets_the_style() {
    let bench = Bench::new();
    let scene = bench.embedded_scene("a.sgs");
    let (s, t) = (bench.style("s.style.safetensors"), bench.other_style("t.style.safetensors"));
    let colors = |arguments: &[&str]| {
        let out = bench.path("rgb.safetensors");
        stylegaussian(&[&["stylize", &scene, "-o", &out, "--style"], arguments].concat()).expect_success();
        bench.colors("rgb.safetensors")
    };
    let mix = colors(&[&format!("{s}:0.3"), &format!("{t}:0.7")]);
    assert_eq!(mix, colors(&[&format!("{s}:3"), "--style", &format!("{t}:7")]));
    assert_ne!(mix, colors(&[&s]));
    assert_eq!(colors(&[&s]), colors(&[&format!("{s}:5"), &format!("{t}:0")]));
    assert_eq!(colors(&[&s, "--content", "1"]), colors(&[&t, "--content", "1"]));

    let out = bench.path("rgb.safetensors");
    let weighted = [format!("{s}:1"), format!("{t}:3")];
    let run = ["stylize", &scene, "--json", "-o", &out, "--style", &weighted[0], &weighted[1]];
    let json = stylegaussian(&run).expect_success().json();
    assert_eq!(json["styles"][1]["weight"], 0.75);
    assert_eq!(json["decoder"], "scene");
}

#[test]
fn encoders_must_agree() {
    let bench = Bench::new();
    let (scene, style) = (bench.embedded_scene("a.sgs"), bench.foreign_style("s.style.safetensors"));
    let out = bench.path("b.ply");
    let run = stylegaussian(&["stylize", &scene, "--style", &style, "-o", &out]);
    run.expect_error("s.style.safetensors belongs to encoder other@11");

    let unnamed = bench.unnamed_style("u.style.safetensors");
    let run = stylegaussian(&["stylize", &scene, "--style", &unnamed, "-o", &out]).expect_success();
    assert!(
        run.stderr.contains("warning: ") && run.stderr.contains("does not name its encoder"),
        "{}",
        run.stderr
    );
}

#[test]
fn a_scene_without_features_says_which_command_embeds_it() {
    let bench = Bench::new();
    let (scene, style) = (bench.plain_scene("a.ply"), bench.style("s.style.safetensors"));
    let run = stylegaussian(&["stylize", &scene, "--style", &style, "-o", &bench.path("b.ply")]);
    run.expect_error("stylegaussian embed");
    assert!(run.stderr.contains("a.ply"), "{}", run.stderr);
}

#[test]
fn an_image_is_read_by_the_default_encoder() {
    let bench = Bench::new();
    let (scene, painting) = (bench.embedded_scene("a.sgs"), bench.path("painting.png"));
    image::RgbImage::from_fn(40, 30, |x, y| image::Rgb([x as u8 * 6, y as u8 * 8, 99]))
        .save(&painting)
        .unwrap();
    let style = bench.path("s.style.safetensors");
    stylegaussian(&["style", &painting, "-o", &style]).expect_success();
    let statistics = stylegaussian_files::read_style(style.as_ref()).unwrap();
    assert_eq!(statistics.mean.len(), 256);
    assert_eq!(statistics.encoder.unwrap().name, stylegaussian_defaults::ENCODER_NAME);
    // The scene belongs to another encoder.
    let run = stylegaussian(&["stylize", &scene, "--style", &painting, "-o", &bench.path("b.ply")]);
    run.expect_error("belongs to encoder distilled_relu3_1@");
}

#[test]
fn rendering_numbers_its_pictures() {
    let bench = Bench::new();
    let (scene, style) = (bench.embedded_scene("a.sgs"), bench.style("s.style.safetensors"));
    let dir = bench.path("deep/er");
    stylegaussian(&["render", &scene, "--orbit", "2", "--size", "32x24", "-o", &dir]).expect_success();
    let json = stylegaussian(&[
        "render", &scene, "--style", &style, "--orbit", "2", "--size", "32x24", "--json", "-o", &dir,
    ])
    .expect_success()
    .json();
    assert_eq!(json["pictures"][1]["size"], serde_json::json!([32, 24]));
    for name in ["000000.png", "000001.png"] {
        let picture = image::open(bench.dir().join("deep/er").join(name)).unwrap();
        assert_eq!((picture.width(), picture.height()), (32, 24));
        assert_eq!(picture.color(), image::ColorType::Rgba8);
    }
    let opaque = ["render", &scene, "--orbit", "1", "--size", "8x8", "--background", "102030", "-o", &dir];
    stylegaussian(&opaque).expect_success();
    let picture = image::open(bench.dir().join("deep/er/000000.png")).unwrap().into_rgba8();
    assert!(picture.pixels().all(|pixel| pixel[3] == 255));
}

#[test]
fn cameras_give_the_size_and_the_order() {
    let bench = Bench::new();
    let scene = bench.plain_scene("a.ply");
    let frame = |z: f64| {
        serde_json::json!({ "file_path": format!("{z}.jpg"),
            "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, z], [0, 0, 0, 1]] })
    };
    let cameras = serde_json::json!({ "fl_x": 20.0, "fl_y": 20.0, "cx": 10.0, "cy": 8.0, "w": 20, "h": 16,
        "frames": [frame(4.0), frame(8.0)] });
    let path = bench.path("transforms.json");
    fs::write(&path, cameras.to_string()).unwrap();
    let json = stylegaussian(&["render", &scene, "--cameras", &path, "--json", "-o", &bench.path("d")]);
    assert_eq!(json.expect_success().json()["pictures"][1]["size"], serde_json::json!([20, 16]));
    let covered = |name: &str| {
        let picture = image::open(bench.dir().join("d").join(name)).unwrap().into_rgba8();
        picture.pixels().filter(|pixel| pixel[3] > 0).count()
    };
    assert!(covered("000000.png") > covered("000001.png"), "the first camera is the nearer one");
    stylegaussian(&["render", &scene, "--cameras", &scene, "-o", &bench.path("d")]).expect_error("a.ply");
    // Other proportions are told once. 15x12 and 13x10 have the same, rounded to whole pixels.
    for (size, note) in [
        ("30x30", "2 of 2 pictures are squeezed, the first from 20x16 to 30x30; --size 30x24 would keep"),
        ("15x12", ""),
        ("13x10", ""),
    ] {
        let out = bench.path("d");
        let render = ["render", &scene, "--cameras", &path, "--size", size, "-o", &out];
        let notes = stylegaussian(&render).expect_success().stderr;
        let n_squeezed = |text: &str| text.matches("squeezed").count();
        assert!(notes.contains(note) && n_squeezed(&notes) == n_squeezed(note), "{size}: {notes}");
    }
}

#[test]
fn an_output_that_cannot_be_written_is_named() {
    let bench = Bench::new();
    let (scene, style) = (bench.embedded_scene("a.sgs"), bench.style("s.style.safetensors"));
    let nowhere = bench.path("no/such/folder/b.ply");
    stylegaussian(&["stylize", &scene, "--style", &style, "-o", &nowhere]).expect_error("no/such/folder");
    stylegaussian(&["convert", &scene, &nowhere]).expect_error("no/such/folder");
    // A file stands where the folder should be.
    stylegaussian(&["render", &scene, "--orbit", "1", "-o", &style]).expect_error("s.style.safetensors");
    fs::create_dir(bench.path("folder.ply")).unwrap();
    stylegaussian(&["convert", &scene, &bench.path("folder.ply")]).expect_error("folder.ply");
    bench.expect_files(&["a.sgs", "folder.ply", "s.style.safetensors"]);
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_an_error_and_leaves_nothing() {
    let bench = Bench::new();
    let scene = bench.embedded_scene("a.sgs");
    std::os::unix::fs::symlink("/dev/full", bench.path("full.sgs")).unwrap();
    stylegaussian(&["convert", &scene, &bench.path("full.sgs")]).expect_error("full.sgs: No space left");
    // A limit on a file's size stops a writer in the middle, as a disk that fills up does.
    fs::write(bench.path("b.ply"), "what was here before").unwrap();
    let script = "trap '' XFSZ; ulimit -f 1; exec \"$@\"";
    let binary = env!("CARGO_BIN_EXE_stylegaussian");
    let run = support::run("bash", &["-c", script, "-", binary, "convert", &scene, &bench.path("b.ply")]);
    run.expect_error("b.ply");
    assert_eq!(fs::read_to_string(bench.path("b.ply")).unwrap(), "what was here before");
    bench.expect_files(&["a.sgs", "b.ply", "full.sgs"]);
}

/// The bench's files besides `name`, sorted: no output and no partial file.
fn expected(name: &str) -> Vec<&str> {
    let mut names = vec![name, "good.sgs", "good.style.safetensors"];
    names.sort_unstable();
    names
}

/// Runs every command that reads a file on a file that is not as it should be.
#[track_caller]
fn expect_all_refuse(bench: &Bench, name: &str) {
    let path = bench.path(name);
    let (scene, out) = (bench.embedded_scene("good.sgs"), bench.path("out.sgs"));
    let style = bench.style("good.style.safetensors");
    let commands: [&[&str]; 8] = [
        &["info", &path],
        &["convert", &path, &out],
        &["stylize", &path, "--style", &style, "-o", &out],
        &["render", &path, "-o", &bench.path("out")],
        &["render", &scene, "--cameras", &path, "-o", &bench.path("out")],
        &["stylize", &scene, "--style", &style, "--decoder", &path, "-o", &out],
        &["style", "painting.png", "--encoder", &path, "-o", &bench.path("out.safetensors")],
        &["stylize", &scene, "--style", &path, "--encoder", &path, "-o", &out],
    ];
    for arguments in commands {
        stylegaussian(arguments).expect_error(name);
        bench.expect_files(&expected(name));
    }
}

#[test]
fn garbage_is_refused() {
    let header =
        "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n";
    let huge_json = [&u64::MAX.to_le_bytes()[..], b"{\"means\":"].concat();
    let garbage: [(&str, &[u8]); 9] = [
        ("empty.ply", b""),
        ("empty.safetensors", b""),
        ("text.sgs", b"this is no scene"),
        ("lying.ply", header.as_bytes()),
        ("lying.safetensors", &huge_json),
        ("zip.pth", b"PK\x03\x04 and no more"),
        ("braces.json", b"{\"frames\": [{}]}"),
        ("noise.onnx", &[0xa5; 4096]),
        ("zeros.ply", &[0; 4096]),
    ];
    for (name, bytes) in garbage {
        let bench = Bench::new();
        fs::write(bench.path(name), bytes).unwrap();
        expect_all_refuse(&bench, name);
    }
}

#[test]
fn truncated_files_are_refused() {
    let bench = Bench::new();
    bench.embedded_scene("a.sgs");
    bench.plain_scene("b.ply");
    for name in ["a.sgs", "b.ply"] {
        let bytes = fs::read(bench.path(name)).unwrap();
        for kept in [1, 7, 8, 100, bytes.len() / 2, bytes.len() - 1] {
            let cut = bench.path(&format!("cut_{name}"));
            fs::write(&cut, &bytes[..kept]).unwrap();
            stylegaussian(&["info", &cut]).expect_error(&format!("cut_{name}"));
        }
    }
}

#[test]
fn real_captures() {
    let Some(splats) = data("splats") else { return };
    for (name, n_gaussians, sh_degree) in [
        ("fruit_drops_minimal.ply", 4_721, 3),
        ("train-1000.ply", 1_000, 3),
        ("playbot_31k_sh2pad3.ply", 31_000, 3),
        ("biker.compressed.ply", 152_746, 0),
        ("biker.spz", 152_746, 0),
    ] {
        let path = splats.join(name);
        let json = stylegaussian(&["info", &path.to_string_lossy(), "--json"]).expect_success().json();
        assert_eq!(json["n_source"], n_gaussians, "{name}");
        assert_eq!(json["sh_degree"], sh_degree, "{name}");
    }
}
