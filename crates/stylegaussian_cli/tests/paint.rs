//! Strokes on the command line: on scenes without features, by paintings' files, and in looks.

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

#[path = "support/embedded.rs"]
#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod embedded;

use embedded::board;
use stylegaussian::{Mask, StoredMask};
use stylegaussian_files::{write_mask, write_scene};
use support::{Bench, Run, stylegaussian};

/// A bench with the plain scene `a.ply` and the painting `p.png`, of dabs in two colors.
fn bench() -> Bench {
    let bench = Bench::new();
    write_scene(bench.path("a.ply").as_ref(), &board()).unwrap();
    let dabs = |x: u32, y: u32| {
        let is_light = ((x + 2 * y) / 9).is_multiple_of(2);
        image::Rgb(if is_light { [230, 200, 80] } else { [30, 60, (90 + x / 2) as u8] })
    };
    image::RgbImage::from_fn(200, 160, dabs).save(bench.path("p.png")).unwrap();
    bench
}

fn render(bench: &Bench, scene: &str, output: &str, more: &[&str]) -> Run {
    let (scene, output) = (bench.path(scene), bench.path(output));
    let fixed =
        ["render", &scene, "--size", "96x80", "--background", "808080", "--backend", "cpu", "-o", &output];
    stylegaussian(&[&fixed, more].concat())
}

/// The bytes of the pixels of one view.
fn picture(bench: &Bench, scene: &str, more: &[&str]) -> Vec<u8> {
    render(bench, scene, "out.png", more).expect_success();
    image::open(bench.path("out.png")).unwrap().into_rgb8().into_raw()
}

/// Mean difference, in steps of a byte.
fn apart(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64
}

#[test]
fn a_scene_without_features_is_painted() {
    let bench = bench();
    let painting = bench.path("p.png");
    let run = render(&bench, "a.ply", "out.png", &["--style", &painting, "--json"]).expect_success();
    let json = run.json();
    assert_eq!(
        (&json["painted"], &json["decoder"], &json["backend"]),
        (&true.into(), &().into(), &"cpu".into())
    );
    assert_eq!(json["pictures"].as_array().unwrap().len(), 1);
    let painted = picture(&bench, "a.ply", &["--style", &painting]);
    assert!(apart(&painted, &picture(&bench, "a.ply", &[])) > 5.0);
    // The painting's file has the same paint, whatever its statistics.
    let style = bench.path("p.style.safetensors");
    stylegaussian(&["style", &painting, "-o", &style]).expect_success();
    assert!(std::fs::metadata(&style).unwrap().len() < 1_000_000);
    assert!(picture(&bench, "a.ply", &["--style", &style]) == painted);
    // The decoder needs features, and statistics alone are for the decoder.
    render(&bench, "a.ply", "out.png", &["--style", &painting, "--decoder-only"])
        .expect_error("stylegaussian embed");
    stylegaussian(&["style", &painting, "--no-paint", "-o", &style]).expect_success();
    render(&bench, "a.ply", "out.png", &["--style", &style]).expect_error("stylegaussian embed");
}

#[test]
fn options_change_the_strokes() {
    let bench = bench();
    let painting = bench.path("p.png");
    let with = |more: &[&str]| picture(&bench, "a.ply", &[&["--style", &painting], more].concat());
    let painted = with(&[]);
    assert!(with(&["--stroke-scale", "1", "--paint-amount", "1", "--protection", "1"]) == painted);
    let bare = with(&["--paint-amount", "0"]);
    for option in [["--stroke-scale", "2"], ["--paint-amount", "0.5"]] {
        let changed = with(&option);
        assert!(changed != painted && changed != bare, "{option:?}");
    }
    let half = apart(&with(&["--paint-amount", "0.5"]), &bare) / apart(&painted, &bare);
    assert!((half - 0.5).abs() < 0.1, "{half}");
    // Content takes strokes away as well.
    let kept = apart(&with(&["--content", "1"]), &picture(&bench, "a.ply", &[]));
    assert!(kept < 1.0, "{kept}");
}

#[test]
fn strokes_move_from_frame_to_frame() {
    let bench = bench();
    let painting = bench.path("p.png");
    let frames = |output: &str, more: &[&str]| -> Vec<Vec<u8>> {
        let fixed = ["--style", &painting, "--orbit", "1", "--frames", "6", "--fps", "12"];
        render(&bench, "a.ply", output, &[&fixed, more].concat()).expect_success();
        let file = |i: usize| format!("{}/{i:06}.png", bench.path(output));
        (0..6).map(|i| image::open(file(i)).unwrap().into_rgb8().into_raw()).collect()
    };
    let still = frames("still", &[]);
    assert!(still.iter().all(|frame| *frame == still[0]));
    assert!(still[0] == picture(&bench, "a.ply", &["--style", &painting]));
    // Redrawn after three pictures each, and the same film again.
    let boil = frames("boil", &["--boil", "4"]);
    assert!(boil[0] == boil[1] && boil[1] == boil[2] && boil[3] == boil[4] && boil[4] == boil[5]);
    assert!(boil[0] != boil[3] && boil[0] != still[0]);
    assert!(frames("again", &["--boil", "4"]) == boil);
    // A run of half a second: the pictures begin anew.
    let flow = frames("flow", &["--flow", "4", "--flow-toward", "-1,0.5,0"]);
    assert!(flow[0] != flow[1] && flow[0] == flow[3]);
    // Without the fixed view, once around.
    let around = render(&bench, "a.ply", "around", &["--frames", "3", "--json"]).expect_success();
    assert_eq!(around.json()["pictures"].as_array().unwrap().len(), 3);
    for wrong in [&["--boil", "8"][..], &["--style", &painting, "--boil", "8", "--flow", "1"]] {
        assert_eq!(render(&bench, "a.ply", "out.png", wrong).code, Some(2), "{wrong:?}");
    }
}

#[test]
fn paint_is_lit_and_keeps_its_size() {
    let bench = bench();
    let painting = bench.path("p.png");
    let with = |more: &[&str]| picture(&bench, "a.ply", &[&["--style", &painting], more].concat());
    let painted = with(&[]);
    assert!(with(&["--relief", "0"]) == painted);
    let lit = with(&["--relief", "1.5", "--light", "1,1,0"]);
    assert!(lit != painted && lit != with(&["--relief", "1.5", "--light", "-1,1,0"]));
    assert!(with(&["--screen-stable"]) != painted);
    for wrong in [&["--light", "1,0,0"][..], &["--relief", "1", "--light", "0,0,0"], &["--relief", "-1"]] {
        let wrong = [&["--style", &painting], wrong].concat();
        assert_eq!(render(&bench, "a.ply", "out.png", &wrong).code, Some(2), "{wrong:?}");
    }
}

#[test]
fn looks_keep_strokes_and_scenes_their_mean() {
    let bench = bench();
    let (scene, painting) = (bench.path("a.ply"), bench.path("p.png"));
    let stylize = |output: &str| {
        let run = ["stylize", &scene, "--style", &painting, "--json", "-o", &bench.path(output)];
        stylegaussian(&run).expect_success()
    };
    let run = stylize("a.look.safetensors");
    assert_eq!(run.json()["warnings"], serde_json::json!([]));
    for output in ["b.ply", "b.spz", "b.glb", "b.safetensors"] {
        let run = stylize(output);
        let lost = run.stderr.lines().filter(|line| line.contains("their mean per Gaussian")).count();
        assert_eq!(
            (lost, run.json()["warnings"].as_array().unwrap().len()),
            (1, 1),
            "{output}: {}",
            run.stderr
        );
    }
    let painted = picture(&bench, "a.ply", &["--style", &painting]);
    let bare = picture(&bench, "a.ply", &["--style", &painting, "--paint-amount", "0"]);
    let look = bench.path("a.look.safetensors");
    let shown = apart(&picture(&bench, "a.ply", &["--look", &look]), &painted);
    // A byte of color, and a texture in steps.
    assert!(shown < 1.5, "{shown}");
    let flat = picture(&bench, "b.ply", &[]);
    assert!(apart(&flat, &painted) > 2.0 * shown && apart(&flat, &painted) < 60.0);
    assert!(apart(&flat, &bare) > 0.0);
    // Half of a look without strokes: they fade, and so does the color.
    let plain = bench.path("plain.look.safetensors");
    stylegaussian(&["stylize", &scene, "--look", &look, "--paint-amount", "0", "-o", &plain])
        .expect_success();
    let mix = picture(&bench, "a.ply", &["--look", &format!("{look}:1"), &format!("{plain}:1")]);
    assert!(mix != bare && mix != painted);
}

#[test]
fn strokes_are_taken_along_in_the_colors_of_split_gaussians() {
    let bench = bench();
    let (scene, painting) = (bench.path("a.ply"), bench.path("p.png"));
    let n = bench.scene("a.ply").len();
    let stylize = |output: &str, more: &[&str]| {
        let run = ["stylize", &scene, "--style", &painting, "--json", "-o", &bench.path(output)];
        stylegaussian(&[&run, more].concat())
    };
    stylize("flat.ply", &[]).expect_success();
    let painted = picture(&bench, "a.ply", &["--style", &painting]);
    let flat = apart(&picture(&bench, "flat.ply", &[]), &painted);
    for output in ["s.ply", "s.sog"] {
        let json = stylize(output, &["--split-paint", "3"]).expect_success().json();
        assert!(json["n_split"].as_u64().unwrap() > 0 && json["warnings"] == serde_json::json!([]), "{json}");
        let read = bench.scene(output);
        assert_eq!(json["n_gaussians"], read.len());
        assert!(read.len() > n && read.len() <= 3 * n, "{} of {n}", read.len());
        let split = apart(&picture(&bench, output, &[]), &painted);
        // As near as without, and the strokes are seen: their likeness is for the tests of the model.
        assert!(split < 1.2 * flat, "{output}: {split}, {flat} without");
    }
    for (output, more) in [("s.look.safetensors", "--split-paint=2"), ("s.ply", "--split-paint=17")] {
        assert_eq!(stylize(output, &[more]).code, Some(2), "{output} {more}");
    }
}

#[test]
fn strokes_stay_within_a_mask() {
    let bench = bench();
    let (scene, painting) = (bench.scene("a.ply"), bench.path("p.png"));
    let mut mask = Mask::new(scene.len());
    for (weights, mean) in mask.weights.iter_mut().zip(&scene.means) {
        *weights = [if mean.x < 0.0 { 255 } else { 0 }, 0, 255, 0];
    }
    let path = bench.path("a.mask.safetensors");
    write_mask(path.as_ref(), &StoredMask::new(&scene, &mask)).unwrap();
    let with =
        |channel| picture(&bench, "a.ply", &["--style", &painting, "--mask", &path, "--styled-in", channel]);
    let (captured, painted) =
        (picture(&bench, "a.ply", &[]), picture(&bench, "a.ply", &["--style", &painting]));
    assert!(with("1") == captured);
    assert!(apart(&with("2"), &painted) < 0.1);
    let half = with("0");
    assert!(apart(&half, &captured) > 1.0 && apart(&half, &painted) > 1.0);
    // The amount of paint alone.
    let with = |options: &[&str]| {
        picture(&bench, "a.ply", &[&["--style", &painting, "--mask", &path], options].concat())
    };
    let bare = picture(&bench, "a.ply", &["--style", &painting, "--paint-amount", "0"]);
    assert!(with(&["--paint-in", "1"]) == bare && with(&["--paint-in", "2"]) == painted);
    let half = with(&["--paint-in", "0"]);
    assert!(apart(&half, &bare) > 0.1 && apart(&half, &painted) > 0.1);
}

#[test]
fn one_picture_is_of_one_view() {
    let bench = bench();
    render(&bench, "a.ply", "out.png", &["--orbit", "2"]).expect_error("found 2 views, expected one");
    render(&bench, "a.ply", "out.png", &["--orbit", "1"]).expect_success();
    bench.expect_files(&["a.ply", "out.png", "p.png"]);
    for wrong in [["--paint-amount", "-1"], ["--protection", "nan"], ["--stroke-scale", "0"]] {
        assert_eq!(render(&bench, "a.ply", "out.png", &wrong).code, Some(2), "{wrong:?}");
    }
}
