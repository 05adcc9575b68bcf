//! Looks on the command line.

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

use std::fs;

use stylegaussian::{Look, look::MadeFrom};
use stylegaussian_files::{write_look, write_scene};
use support::{Bench, stylegaussian};

/// Writes a look of the scene in `of`, each Gaussian in the color that `color` gives for its source index.
fn look(bench: &Bench, name: &str, of: &str, color: impl Fn(u32) -> [f32; 3]) -> String {
    let scene = bench.scene(of);
    let colors: Vec<_> = scene.order.iter().map(|&index| color(index)).collect();
    let path = bench.path(name);
    write_look(path.as_ref(), &Look::new(&scene, &colors, MadeFrom::default())).unwrap();
    path
}

/// The colors that `stylize` gives, in the order of the source.
fn stylized(bench: &Bench, arguments: &[&str]) -> Vec<[f32; 3]> {
    let out = bench.path("rgb.safetensors");
    stylegaussian(&[&["stylize", "-o", &out], arguments].concat()).expect_success();
    bench.colors("rgb.safetensors")
}

#[track_caller]
fn expect_close(found: &[[f32; 3]], expected: impl Fn(usize) -> [f32; 3]) {
    assert_eq!(found.len(), 40);
    for (i, color) in found.iter().enumerate() {
        let error = color.iter().zip(expected(i)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(error < 1e-5, "Gaussian {i}: {color:?}, expected {:?}", expected(i));
    }
}

#[test]
fn a_look_alone_needs_no_features() {
    let bench = Bench::new();
    let plain = bench.plain_scene("a.ply");
    // Multiples of 1/255 of the range, which a byte holds exactly.
    let color = |i: u32| [i as f32 * 3.0 / 255.0, 1.0 - i as f32 * 3.0 / 255.0, 0.25];
    let look =
        look(&bench, "a.look.safetensors", "a.ply", |i| if i == 39 { [1.0, 0.0, 0.25] } else { color(i) });
    let expected = |i: usize| if i == 39 { [1.0, 0.0, 0.25] } else { color(i as u32) };
    expect_close(&stylized(&bench, &[&plain, "--look", &look]), expected);
    // The scene's other files have other orders.
    let sgs = bench.embedded_scene("a.sgs");
    expect_close(&stylized(&bench, &[&sgs, "--look", &look]), expected);
    let render = [
        "render",
        &plain,
        "--orbit",
        "1",
        "--size",
        "16x16",
        "--json",
        "-o",
        &bench.path("d"),
        "--look",
        &look,
    ];
    let json = stylegaussian(&render).expect_success().json();
    assert_eq!(json["looks"][0]["weight"], 1.0);
    assert!(json["decoder"].is_null());
}

#[test]
fn looks_and_styles_share_one_total() {
    let bench = Bench::new();
    let (scene, style) = (bench.embedded_scene("a.sgs"), bench.style("s.style.safetensors"));
    let [white, black] = [("w", 1.0), ("b", 0.0)]
        .map(|(name, v)| look(&bench, &format!("{name}.look.safetensors"), "a.sgs", |_| [v; 3]));
    let styled = stylized(&bench, &[&scene, "--style", &style]);
    let mix =
        [&*scene, "--style", &format!("{style}:2"), "--look", &format!("{white}:1"), &format!("{black}:5")];
    expect_close(&stylized(&bench, &mix), |i| styled[i].map(|v| 0.25 * v + 0.125));
    // A style of weight 0 is not even read.
    let alone = stylized(&bench, &[&scene, "--style", "absent.png:0", "--look", &white]);
    expect_close(&alone, |_| [1.0; 3]);

    // Content is the share of the base colors in a look.
    let base = stylized(&bench, &[&scene, "--look", &white, "--content", "1"]);
    let loaded = bench.scene("a.sgs");
    let colors = loaded.base_colors();
    let of_source = |i: usize| colors[loaded.order.iter().position(|&index| index as usize == i).unwrap()];
    expect_close(&base, of_source);
    expect_close(&stylized(&bench, &[&scene, "--look", &black, "--content", "0.5"]), |i| {
        of_source(i).map(|v| 0.5 * v)
    });
}

#[test]
fn a_look_is_written_and_described() {
    let bench = Bench::new();
    let (scene, style) = (bench.embedded_scene("a.sgs"), bench.style("s.style.safetensors"));
    let path = bench.path("a.look.safetensors");
    stylegaussian(&["stylize", &scene, "--style", &style, "-o", &path]).expect_success();
    let json = stylegaussian(&["info", &path, "--json"]).expect_success().json();
    assert_eq!(json["n_gaussians"], 40);
    assert!(json["paintings"][0]["name"].as_str().unwrap().ends_with("s.style.safetensors"));
    let of_scene = stylegaussian(&["info", &scene, "--json"]).expect_success().json();
    assert_eq!(json["fingerprint"], of_scene["fingerprint"]);
    let text = stylegaussian(&["info", &path]).expect_success().stdout;
    assert!(text.contains("s.style.safetensors (1.00)"), "{text}");
    let styled = stylized(&bench, &[&scene, "--style", &style]);
    let shown = stylized(&bench, &[&scene, "--look", &path]);
    let span = 2.0; // The colors of this decoder lie in 0..1, and a little beyond.
    let error = styled.as_flattened().iter().zip(shown.as_flattened()).map(|(a, b)| (a - b).abs());
    assert!(error.fold(0.0, f32::max) < span / 255.0);
}

#[test]
fn looks_that_do_not_fit_are_refused() {
    let bench = Bench::new();
    let scene = bench.embedded_scene("a.sgs");
    let mut other = bench.scene("a.sgs");
    other.means[7].x += 0.5;
    write_scene(bench.path("b.sgs").as_ref(), &other).unwrap();
    let of_other = look(&bench, "b.look.safetensors", "b.sgs", |_| [0.5; 3]);
    let stylize =
        |look: &str| stylegaussian(&["stylize", &scene, "--look", look, "-o", &bench.path("out.ply")]);
    let run = stylize(&of_other);
    for part in ["b.look.safetensors", "a.sgs", "found a look of another scene (40@", "expected"] {
        run.expect_error(part);
    }
    let bytes = fs::read(&of_other).unwrap();
    for kept in [0, 7, 100, bytes.len() - 1] {
        fs::write(bench.path("cut.look.safetensors"), &bytes[..kept]).unwrap();
        let cut = bench.path("cut.look.safetensors");
        stylize(&cut).expect_error("cut.look.safetensors: found");
        stylegaussian(&["info", &cut]).expect_error("cut.look.safetensors: found");
    }
    bench.expect_files(&["a.sgs", "b.look.safetensors", "b.sgs", "cut.look.safetensors"]);
}

#[test]
fn usage_errors_exit_with_2() {
    let usage: [&[&str]; 3] = [
        &["stylize", "a.sgs", "--look", "a.look.safetensors:0", "-o", "b.ply"],
        &["stylize", "a.sgs", "--look", "a.look.safetensors:-1", "-o", "b.ply"],
        &["render", "a.sgs", "--look", "a.look.safetensors", "--decoder", "d", "-o", "d"],
    ];
    for arguments in usage {
        let run = stylegaussian(arguments);
        assert_eq!(run.code, Some(2), "{arguments:?}: {}", run.stderr);
    }
}
