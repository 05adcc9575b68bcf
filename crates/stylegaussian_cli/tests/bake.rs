//! Baking on the command line: a board of a few hundred Gaussians, and a few steps.

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

#[path = "support/embedded.rs"]
#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod embedded;

use std::{
    collections::BTreeSet,
    fs,
    path::Path,
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use embedded::board;
use stylegaussian::strokes::StrokeWord;
use stylegaussian_files::{
    read_look, read_scene,
    world::{FILE, World, look_of},
    write_scene,
};
use support::{Bench, Run, stylegaussian};

/// A bench with the scene `a.sgs` and the painting `p.png`.
fn bench() -> Bench {
    let bench = Bench::new();
    write_scene(bench.path("a.sgs").as_ref(), &board()).unwrap();
    let waves = |x: u32, y: u32| {
        let wave = |step: f32| (127.0 + 120.0 * ((x * x / 40 + y) as f32 * step).sin()) as u8;
        image::Rgb([wave(0.3), wave(0.2), 60])
    };
    image::RgbImage::from_fn(72, 64, waves).save(bench.path("p.png")).unwrap();
    bench
}

fn bake(bench: &Bench, output: &str, more: &[&str]) -> Run {
    let [scene, painting, output] = ["a.sgs", "p.png", output].map(|name| bench.path(name));
    stylegaussian(&[&["bake", &scene, "--style", &painting, "-o", &output], more].concat())
}

/// Starts to bake `a.look.safetensors`, and returns when its checkpoint is written, before the first step.
fn start(bench: &Bench, steps: [&str; 2]) -> Child {
    let [scene, painting, output] = ["a.sgs", "p.png", "a.look.safetensors"].map(|name| bench.path(name));
    let arguments = ["bake", &scene, "--style", &painting, "-o", &output];
    let mut command = Command::new(env!("CARGO_BIN_EXE_stylegaussian"));
    let mut child = command.args(arguments).args(steps).stderr(Stdio::piped()).spawn().unwrap();
    let checkpoint = bench.dir().join("a.checkpoint.safetensors");
    let began = Instant::now();
    while !checkpoint.exists() {
        assert!(child.try_wait().unwrap().is_none(), "ended before its first step");
        assert!(began.elapsed() < Duration::from_secs(120));
        thread::sleep(Duration::from_millis(1));
    }
    child
}

#[test]
fn a_baked_look_is_written_described_and_shown() {
    let bench = bench();
    let sheet = bench.path("s.png");
    let run = bake(&bench, "a.look.safetensors", &["--steps", "2", "--json", "--sheet", &sheet]);
    let json = run.expect_success().json();
    assert_eq!((&json["gaussians"], &json["steps"]), (&576.into(), &2.into()));
    // The last step compared luminance; the shapes are those of the step before it.
    for loss in ["matching", "statistics", "shapes", "palette"] {
        assert!(json["losses"][loss].as_f64().unwrap() > 0.0, "{loss}: {json}");
    }
    bench.expect_files(&["a.look.safetensors", "a.sgs", "p.png", "s.png"]);
    let [scene, look] = ["a.sgs", "a.look.safetensors"].map(|name| bench.path(name));
    let info = stylegaussian(&["info", &look, "--json"]).expect_success().json();
    assert_eq!((&info["steps"], &info["paintings"][0]["name"]), (&2.into(), &"p.png".into()));
    assert_eq!(info["has_strokes"], true);
    let colors = |look: &str| {
        let out = bench.path("rgb.safetensors");
        stylegaussian(&["stylize", &scene, "--look", look, "-o", &out]).expect_success();
        bench.colors("rgb.safetensors")
    };
    // Without a step there is instant paint, and with strength 0 the recolored scene.
    bake(&bench, "s.look.safetensors", &["--steps", "0"]).expect_success();
    bake(&bench, "r.look.safetensors", &["--steps", "2", "--strength", "0"]).expect_success();
    let has_strokes = |look: &str| read_look(bench.path(look).as_ref()).unwrap().has_strokes();
    assert!(has_strokes("s.look.safetensors") && !has_strokes("r.look.safetensors"));
    let [baked, start, recolored] =
        [look, bench.path("s.look.safetensors"), bench.path("r.look.safetensors")].map(|look| colors(&look));
    let largest = |a: &[[f32; 3]], b: &[[f32; 3]]| {
        a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    let (by_steps, by_paint) = (largest(&baked, &start), largest(&start, &recolored));
    assert!(by_steps > 0.02 && by_steps < 0.5 && by_paint > 0.1, "{by_steps}, {by_paint}");
}

/// Ctrl-C keeps what is done, and the same command goes on as if nothing had happened.
#[test]
#[cfg(unix)]
fn an_interrupted_bake_goes_on() {
    const STEPS: [&str; 2] = ["--steps", "6"];
    let bench = bench();
    let child = start(&bench, STEPS);
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let ended = child.wait_with_output().unwrap();
    let message = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(1), "{message}");
    assert!(message.contains("the look so far is written"), "{message}");
    bench.expect_files(&["a.checkpoint.safetensors", "a.look.safetensors", "a.sgs", "p.png"]);

    // Other settings would make another picture from it.
    bake(&bench, "a.look.safetensors", &[&STEPS[..], &["--seed", "1"]].concat())
        .expect_error("a.checkpoint.safetensors: found a bake with another scene, painting or setting");
    let run = bake(&bench, "a.look.safetensors", &STEPS).expect_success();
    assert!(run.stderr.contains("going on after step"), "{}", run.stderr);
    bake(&bench, "b.look.safetensors", &STEPS).expect_success();
    let [resumed, whole] =
        ["a.look.safetensors", "b.look.safetensors"].map(|name| fs::read(bench.path(name)).unwrap());
    assert!(resumed == whole, "an interruption changes nothing");
    bench.expect_files(&["a.look.safetensors", "a.sgs", "b.look.safetensors", "p.png"]);
}

/// As if the disk became full: the look still comes.
#[test]
fn a_state_that_cannot_be_saved_costs_no_look() {
    let bench = bench();
    let child = start(&bench, ["--steps", "3"]);
    // No file takes the place of a folder that is not empty.
    let checkpoint = bench.dir().join("a.checkpoint.safetensors");
    fs::remove_file(&checkpoint).unwrap();
    fs::create_dir_all(checkpoint.join("full")).unwrap();
    let ended = child.wait_with_output().unwrap();
    let message = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(0), "{message}");
    assert!(message.contains("warning: ") && message.contains("not saved, going on"), "{message}");
    bench.expect_files(&["a.checkpoint.safetensors", "a.look.safetensors", "a.sgs", "p.png"]);
}

#[test]
fn files_that_are_no_checkpoint_stay_as_they_are() {
    let bench = bench();
    fs::write(bench.path("a.checkpoint.safetensors"), "mine").unwrap();
    bake(&bench, "a.look.safetensors", &["--steps", "1"])
        .expect_error("a.checkpoint.safetensors: found a broken header");
    assert_eq!(fs::read(bench.path("a.checkpoint.safetensors")).unwrap(), b"mine");
    bench.expect_files(&["a.checkpoint.safetensors", "a.sgs", "p.png"]);
}

/// One color has no strokes and no contrast. The picture is of that color, and every number is finite.
#[test]
fn a_painting_of_one_gray_paints_all_gray() {
    let bench = bench();
    image::RgbImage::from_pixel(64, 64, image::Rgb([128; 3])).save(bench.path("p.png")).unwrap();
    bake(&bench, "a.look.safetensors", &["--steps", "4"]).expect_success();
    let look = read_look(bench.path("a.look.safetensors").as_ref()).unwrap();
    let colors = look.colors_for(&board()).unwrap();
    let farthest =
        colors.as_flattened().iter().map(|value| (value - 128.0 / 255.0).abs()).fold(0.0, f32::max);
    assert!(farthest < 0.1, "{farthest}");
}

#[test]
fn a_scene_of_one_gaussian_is_baked_and_an_empty_one_is_refused() {
    let bench = bench();
    let mut one = board().subset(&[300]);
    (one.features, one.neighbors) = (None, None);
    write_scene(bench.path("a.sgs").as_ref(), &one).unwrap();
    bake(&bench, "a.look.safetensors", &["--steps", "2"]).expect_success();
    let look = read_look(bench.path("a.look.safetensors").as_ref()).unwrap();
    assert!(look.colors_for(&one).unwrap()[0].iter().all(|value| value.is_finite()));

    let ply = fs::read(bench.plain_scene("a.ply")).unwrap();
    let end = ply.windows(11).position(|bytes| bytes == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8(ply[..end].to_vec()).unwrap().replace("vertex 40", "vertex 0");
    fs::write(bench.path("a.ply"), header).unwrap();
    let [empty, painting, output] = ["a.ply", "p.png", "b.look.safetensors"].map(|name| bench.path(name));
    stylegaussian(&["bake", &empty, "--style", &painting, "-o", &output])
        .expect_error("a.ply: found no Gaussian, expected at least one");
    bench.expect_files(&["a.look.safetensors", "a.ply", "a.sgs", "p.png"]);
}

/// The board as a world of 16 nodes and more. Each chunk gets a look of its own, with what is around it.
#[test]
fn the_chunks_of_a_world_are_baked_one_by_one() {
    let bench = bench();
    let [scene, world, painting] = ["a.sgs", "world", "p.png"].map(|name| bench.path(name));
    stylegaussian(&["tile", &scene, "-o", &world, "--levels", "2", "--chunk", "128"]).expect_success();
    let levels = World::open(&Path::new(&world).join(FILE)).unwrap();
    assert!(levels.nodes.len() >= 16 && levels.files.len() >= 4, "{:?}", levels.files);
    let bake = |chunk: &str, more: &[&str]| {
        let output = bench.path(&look_of(chunk));
        let arguments = ["bake", &world, "--chunk", chunk, "--style", &painting, "-o", &output, "--json"];
        stylegaussian(&[&arguments[..], more].concat())
    };
    let scene_of = |chunk: &str| read_scene(&Path::new(&world).join(chunk)).unwrap().scene;
    for chunk in [&levels.files[0], levels.files.last().unwrap()] {
        let json = bake(chunk, &["--steps", "2"]).expect_success().json();
        let (scene, look) = (scene_of(chunk), read_look(bench.path(&look_of(chunk)).as_ref()).unwrap());
        assert_eq!(json["gaussians"], scene.len());
        assert!(look.colors_for(&scene).unwrap().as_flattened().iter().all(|value| value.is_finite()));
        // The seeds of the surroundings are left out.
        let strokes = look.strokes_for(&scene).unwrap().unwrap();
        let used: BTreeSet<u32> = strokes.words.iter().map(|word| StrokeWord::unpacked(*word).seed).collect();
        assert_eq!(used.len(), strokes.seeds.len());
    }
    // A job that was killed goes on, as long as it is the same one.
    let first = &levels.files[0];
    let checkpoint = bench.path("0_0.checkpoint.safetensors");
    let output = bench.path("0_0.look.safetensors");
    assert_eq!(look_of(first), "0_0.look.safetensors");
    let whole = fs::read(&output).unwrap();
    let arguments = ["bake", &world, "--chunk", first, "--style", &painting, "-o", &output, "--steps", "2"];
    let mut command = Command::new(env!("CARGO_BIN_EXE_stylegaussian"));
    let mut child = command.args(arguments).stderr(Stdio::null()).spawn().unwrap();
    while !Path::new(&checkpoint).exists() && child.try_wait().unwrap().is_none() {
        thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    if Path::new(&checkpoint).exists() {
        bake(first, &["--steps", "2", "--halo", "0"]).expect_error("found a bake with another scene");
    }
    bake(first, &["--steps", "2"]).expect_success();
    assert!(fs::read(&output).unwrap() == whole, "a kill changes nothing");
    bake("7_7/meta.json", &[]).expect_error("found no chunk `7_7/meta.json`");
    for wrong in [["--budget", "9"], ["--axes", "rub"], ["--halo", "-1"]] {
        assert_eq!(bake(first, &wrong).code, Some(2), "{wrong:?}");
    }
    let none = ["bake", &scene, "--chunk", first, "--style", &painting, "-o", &output];
    stylegaussian(&none).expect_error("a.sgs: found JSON with an error");
}
