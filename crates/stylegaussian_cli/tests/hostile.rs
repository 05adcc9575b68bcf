//! Files and arguments that once ended in a panic, an abort, or success without a result.

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

use std::{fs, path::Path};

use glam::Vec3;
use stylegaussian::{Scene, scene::Sh};
use stylegaussian_files::{read_style, write_scene, write_style};
use support::{Bench, stylegaussian};

/// A PNG file of one pixel whose palette has 4 bytes, over which the decoder panics.
const PALETTE: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\0\x01\0\0\0\x01\x08\x03\0\0\0\x28\xcb\x34\xbb\
    \0\0\0\x04PLTE\0\0\0\0\xb4\xa3\xae\x7a\0\0\0\x0aIDAT\x78\x9c\x63\x60\0\0\0\x02\0\x01\x48\xaf\xa4\x71\
    \0\0\0\0IEND\xae\x42\x60\x82";

/// A scene of one Gaussian.
fn one(mean: Vec3, scale: f32, opacity: f32) -> Scene {
    let scene = Scene {
        means: vec![mean],
        rotations: vec![glam::Quat::IDENTITY],
        scales: vec![Vec3::splat(scale)],
        opacities: vec![opacity],
        order: vec![0],
        n_source: 1,
        ..Scene::default()
    };
    Scene { sh: Some(Sh { degree: 0, coefficients: vec![0.0; 3] }), ..scene }
}

/// [`one`] beside a copy at the origin.
fn two(mean: Vec3, scale: f32) -> Scene {
    let mut scene = one(mean, scale, 0.9);
    scene.means.push(Vec3::ZERO);
    scene.rotations.push(glam::Quat::IDENTITY);
    scene.scales.push(Vec3::splat(scale));
    scene.opacities.push(0.9);
    scene.order.push(1);
    scene.n_source = 2;
    scene.sh = Some(Sh { degree: 0, coefficients: vec![0.0; 6] });
    scene
}

fn write(bench: &Bench, name: &str, scene: &Scene) -> String {
    let path = bench.path(name);
    write_scene(path.as_ref(), scene).unwrap();
    path
}

/// The name of the file on one line, in every command that decodes images.
#[test]
fn a_malformed_image_is_one_line() {
    let bench = Bench::new();
    let scene = bench.plain_scene("a.ply");
    let image = bench.path("palette.png");
    fs::write(&image, PALETTE).unwrap();
    let style = bench.path("o.style.safetensors");
    let look = bench.path("o.look.safetensors");
    stylegaussian(&["style", &image, "-o", &style]).expect_error("palette.png: not a readable image");
    stylegaussian(&["bake", &scene, "--style", &image, "-o", &look])
        .expect_error("palette.png: not a readable image");
    let photos = bench.path("photos");
    fs::create_dir(&photos).unwrap();
    fs::rename(&image, Path::new(&photos).join("palette.png")).unwrap();
    let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
    let frame = format!(r#"{{"file_path": "palette.png", "w": 64, "h": 64, "transform_matrix": {pose}}}"#);
    let cameras = format!(r#"{{"camera_angle_x": 0.8, "frames": [{frame}]}}"#);
    fs::write(Path::new(&photos).join("transforms.json"), cameras).unwrap();
    stylegaussian(&["embed", &scene, "--photos", &photos, "-o", &bench.path("o.sgs")])
        .expect_error("palette.png: not a readable image");
    bench.expect_files(&["a.ply", "photos"]);
}

/// A folder with photos of these names and sizes, and the cameras of four photos of 96 x 72 pixels.
fn photos(bench: &Bench, photos: &[(&str, [u32; 2])]) -> String {
    let folder = bench.path("photos");
    fs::create_dir_all(&folder).unwrap();
    for (name, [width, height]) in photos {
        image::RgbImage::new(*width, *height).save(Path::new(&folder).join(name)).unwrap();
    }
    let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
    let frame = |i: usize| format!(r#"{{"file_path": "{i}.png", "transform_matrix": {pose}}}"#);
    let frames: Vec<String> = (0..4).map(frame).collect();
    let cameras = format!(r#"{{"fl_x": 75, "w": 96, "h": 72, "frames": [{}]}}"#, frames.join(","));
    fs::write(Path::new(&folder).join("transforms.json"), cameras).unwrap();
    folder
}

#[test]
fn photos_that_are_missing_or_of_other_cameras() {
    let bench = Bench::new();
    let (scene, output) = (bench.plain_scene("a.ply"), bench.path("o.sgs"));
    let folder = photos(&bench, &[("0.png", [96, 72])]);
    let embed = ["embed", &scene, "--photos", &folder, "-o", &output];
    stylegaussian(&embed).expect_error("3 of 4 photos are missing");
    photos(&bench, &[("1.png", [48, 36]), ("2.png", [72, 72])]);
    stylegaussian(&embed).expect_error("2.png: the photo is 72x72 and its camera's picture 96x72");
    bench.expect_files(&["a.ply", "photos"]);
    photos(&bench, &[("2.png", [192, 144])]);
    let run = stylegaussian(&embed).expect_success();
    let warnings: Vec<&str> = run.stderr.lines().filter(|line| line.starts_with("warning: ")).collect();
    assert!(warnings.len() == 1 && warnings[0].contains("1 of 4 photos are missing"), "{}", run.stderr);
}

#[test]
fn cameras_of_an_angle_alone_take_the_size_of_the_pictures() {
    let bench = Bench::new();
    let (scene, cameras) = (bench.plain_scene("a.ply"), bench.path("transforms.json"));
    let out = bench.path("a.png");
    let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
    let frame = format!(r#"{{"file_path": "gone.png", "transform_matrix": {pose}}}"#);
    fs::write(&cameras, format!(r#"{{"camera_angle_x": 0.8, "frames": [{frame}]}}"#)).unwrap();
    let render = ["render", &scene, "--cameras", &cameras, "-o", &out];
    stylegaussian(&render).expect_error("--size gives it");
    let run = stylegaussian(&[&render[..], &["--size", "20x16"]].concat()).expect_success();
    assert!(run.stderr.contains("their pictures are taken as 20x16"), "{}", run.stderr);
    let picture = image::open(&out).unwrap();
    assert_eq!((picture.width(), picture.height()), (20, 16));
}

/// Everywhere the same words.
#[test]
fn a_painting_of_one_pixel_is_refused() {
    let bench = Bench::new();
    let (plain, embedded) = (bench.plain_scene("a.ply"), bench.embedded_scene("a.sgs"));
    let image = bench.path("one.png");
    image::RgbImage::new(1, 1).save(&image).unwrap();
    let outputs = ["o.style.safetensors", "o.look.safetensors", "o.ply"].map(|name| bench.path(name));
    let commands: [&[&str]; 3] = [
        &["style", &image, "-o", &outputs[0]],
        &["bake", &plain, "--style", &image, "-o", &outputs[1]],
        &["stylize", &embedded, "--style", &image, "-o", &outputs[2]],
    ];
    for command in commands {
        stylegaussian(command).expect_error("one.png: the image is 1x1, expected at least 8x8 pixels");
    }
    bench.expect_files(&["a.ply", "a.sgs", "one.png"]);
}

#[test]
fn pictures_that_no_memory_holds_are_a_usage_error() {
    let bench = Bench::new();
    let scene = bench.plain_scene("a.ply");
    let out = bench.path("d");
    let run = stylegaussian(&["render", &scene, "--size", "16384x16384", "-o", &out]);
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    assert!(run.stderr.contains("at most 67108864 together"), "{}", run.stderr);
    let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
    let cameras = bench.path("transforms.json");
    let text = format!(
        r#"{{"camera_angle_x": 0.8, "w": 16384, "h": 16384, "frames": [{{"transform_matrix": {pose}}}]}}"#
    );
    fs::write(&cameras, text).unwrap();
    let render = ["render", &scene, "--cameras", &cameras, "-o", &out];
    stylegaussian(&render).expect_error("found 16384x16384 pixels");
    stylegaussian(&[&render[..], &["--size", "16x16"]].concat()).expect_success();
}

#[test]
fn nothing_to_see_is_an_error() {
    let bench = Bench::new();
    let invisible = write(&bench, "invisible.ply", &one(Vec3::ZERO, 0.1, 0.0));
    let far = write(&bench, "far.ply", &two(Vec3::splat(1e19), 0.1));
    let huge = write(&bench, "huge.ply", &two(Vec3::X, 1e30));
    let tiny = write(&bench, "tiny.ply", &two(Vec3::splat(1e-6), 1e-7));
    let check = |scene: &str, message: &str| {
        let out = bench.path("out");
        stylegaussian(&["render", scene, "--size", "32x32", "-o", &out]).expect_error(message);
        let out = bench.path("out.sgs");
        stylegaussian(&["embed", scene, "--views", "2", "--size", "32", "-o", &out]).expect_error(message);
    };
    check(&invisible, "invisible.ply: none of its 1 Gaussians is visible");
    check(&far, "far.ply: found Gaussians 1e19 units apart");
    check(&huge, "huge.ply: found Gaussians 1e0 units apart, of at most 1e30 units");
    check(&tiny, "expected at least 1e-5 to choose cameras for: scale it up");
    bench.expect_files(&["far.ply", "huge.ply", "invisible.ply", "tiny.ply"]);
}

/// Scenes down to ten times the smallest fill their pictures.
#[test]
fn small_scenes_are_seen() {
    let bench = Bench::new();
    for size in [1e-2, 1e-3, 1e-4] {
        let scene = write(&bench, "small.ply", &two(Vec3::new(size, 0.0, 0.0), 0.5 * size));
        let out = bench.path("out");
        stylegaussian(&["render", &scene, "--orbit", "1", "--size", "64x64", "-o", &out]).expect_success();
        let picture = image::open(Path::new(&out).join("000000.png")).unwrap().into_rgba8();
        let n_covered = picture.pixels().filter(|pixel| pixel.0[3] > 127).count();
        assert!(n_covered > 64 * 64 / 8, "{size}: {n_covered} pixels");
    }
}

#[test]
fn cameras_beyond_f32_are_named() {
    let bench = Bench::new();
    let scene = bench.plain_scene("a.ply");
    for (pose, angle) in [
        ("[[1,0,0,1e39],[0,1,0,0],[0,0,1,4],[0,0,0,1]]", 0.8),
        ("[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]", 1e-40),
    ] {
        let cameras = bench.path("transforms.json");
        let frame = format!(r#"{{"file_path": "x.png", "transform_matrix": {pose}}}"#);
        let text = format!(r#"{{"camera_angle_x": {angle:e}, "w": 16, "h": 16, "frames": [{frame}]}}"#);
        fs::write(&cameras, text).unwrap();
        stylegaussian(&["render", &scene, "--cameras", &cameras, "-o", &bench.path("out")])
            .expect_error("transforms.json: ");
    }
    bench.expect_files(&["a.ply", "transforms.json"]);
}

/// Finite statistics whose transfer overflows.
#[test]
fn styles_that_overflow_are_an_error() {
    let bench = Bench::new();
    let scene = bench.embedded_scene("a.sgs");
    let style = bench.style("s.style.safetensors");
    let mut statistics = read_style(style.as_ref()).unwrap();
    statistics.mean.fill(3e38);
    statistics.std_dev.fill(3e38);
    write_style(style.as_ref(), &statistics).unwrap();
    for out in ["o.safetensors", "o.ply", "o.look.safetensors"] {
        stylegaussian(&["stylize", &scene, "--style", &style, "--backend", "cpu", "-o", &bench.path(out)])
            .expect_error("colors that are not finite");
    }
    bench.expect_files(&["a.sgs", "s.style.safetensors"]);
}

/// Found before the work and not after it: the message comes although the scene does not exist.
#[test]
fn outputs_are_checked_first() {
    let bench = Bench::new();
    fs::write(bench.path("file"), "").unwrap();
    image::RgbImage::new(9, 9).save(bench.path("a.png")).unwrap();
    let (missing, image) = (bench.path("missing.sgs"), bench.path("a.png"));
    let out = |name: &str| bench.path("no/folder/") + name;
    let commands: [&[&str]; 6] = [
        &["embed", &missing, "-o", &out("o.sgs")],
        &["train", &missing, "--styles", &missing, "-o", &out("o.decoder.safetensors")],
        &["bake", &missing, "--style", &image, "-o", &out("o.look.safetensors")],
        &["eval", &missing, "--styles", &missing, "--sheet", &out("o.png")],
        &["stylize", &missing, "--style", &image, "-o", &out("o.ply")],
        &["style", &missing, "-o", &out("o.style.safetensors")],
    ];
    for command in commands {
        stylegaussian(command).expect_error("No such file or directory");
        assert!(stylegaussian(command).stderr.contains("no/folder/o."), "{command:?}");
    }
    stylegaussian(&["render", &missing, "-o", &bench.path("file/deeper")]).expect_error("is no folder");
    bench.expect_files(&["a.png", "file"]);
}

/// A signal while a file is written leaves the folder as it was.
#[test]
#[cfg(unix)]
fn signals_leave_no_partial_file() {
    use std::{
        process::{Command, Stdio},
        time::{Duration, Instant},
    };
    const N: usize = 150_000;
    let bench = Bench::new();
    let number = |i: usize| (i as f32 * 0.618_034) % 1.0;
    let scene = Scene {
        means: (0..N).map(|i| Vec3::new(number(i), number(i + 7), number(3 * i))).collect(),
        rotations: vec![glam::Quat::IDENTITY; N],
        scales: vec![Vec3::splat(0.01); N],
        opacities: vec![0.5; N],
        sh: Some(Sh { degree: 3, coefficients: vec![0.1; 48 * N] }),
        order: (0..N as u32).collect(),
        n_source: N,
        ..Scene::default()
    };
    let (scene, out) = (write(&bench, "a.sgs", &scene), bench.path("b.ply"));
    // A file without a name is seen among the process' open ones, as "/folder/#17 (deleted)".
    let writes_into = |process: u32| {
        let open = fs::read_dir(format!("/proc/{process}/fd")).into_iter().flatten().flatten();
        let mut files = open.filter_map(|entry| fs::read_link(entry.path()).ok());
        files.any(|file| file.starts_with(bench.dir()) && !file.ends_with("a.sgs"))
    };
    let has_partial = || {
        let names = fs::read_dir(bench.dir()).unwrap().map(|entry| entry.unwrap().file_name());
        names.into_iter().any(|name| name.to_string_lossy().ends_with(".partial"))
    };
    // Without unnamed files only Ctrl-C removes what is there.
    let signals = if cfg!(target_os = "linux") { &["INT", "TERM", "KILL"][..] } else { &["INT"] };
    for signal in signals {
        let mut command = Command::new(env!("CARGO_BIN_EXE_stylegaussian"));
        let mut child = command.args(["convert", &scene, &out]).stdout(Stdio::null()).spawn().unwrap();
        let began = Instant::now();
        while !has_partial() && !writes_into(child.id()) {
            assert!(child.try_wait().unwrap().is_none(), "ended before it was seen to write");
            assert!(began.elapsed() < Duration::from_secs(120));
            std::thread::sleep(Duration::from_millis(1));
        }
        Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status().unwrap();
        let code = child.wait().unwrap().code();
        assert_eq!(code, (*signal == "INT").then_some(130), "{signal}");
        bench.expect_files(&["a.sgs"]);
    }
}
