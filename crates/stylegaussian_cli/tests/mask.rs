//! Masks on the command line.

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

use std::fs;

use stylegaussian::{Look, Mask, Scene, StoredMask, look::MadeFrom};
use stylegaussian_files::{read_mask, write_look, write_mask, write_scene};
use support::{Bench, Run, stylegaussian};

/// Writes a mask of the scene in `of`: the first half of its Gaussians in channel 1, none in channel 0, all in
/// channel 2.
fn mask(bench: &Bench, name: &str, of: &str) -> String {
    let scene = bench.scene(of);
    let mut mask = Mask::new(scene.len());
    for (weights, &index) in mask.weights.iter_mut().zip(&scene.order) {
        *weights = [0, if index < 20 { 255 } else { 0 }, 255, 0];
    }
    mask.names[1] = "ink".into();
    let path = bench.path(name);
    write_mask(path.as_ref(), &StoredMask::new(&scene, &mask)).unwrap();
    path
}

fn render(bench: &Bench, scene: &str, more: &[&str]) -> Run {
    let folder = bench.path("out");
    let fixed = ["render", scene, "--orbit", "1", "--size", "32x32", "--backend", "cpu", "-o", &folder];
    stylegaussian(&[&fixed, more].concat())
}

/// The bytes of the one picture.
fn picture(bench: &Bench, scene: &str, more: &[&str]) -> Vec<u8> {
    render(bench, scene, more).expect_success();
    fs::read(bench.dir().join("out/000000.png")).unwrap()
}

#[test]
fn a_mask_limits_styles_and_hides() {
    let bench = Bench::new();
    let (scene, mask) = (bench.plain_scene("a.ply"), mask(&bench, "a.mask.safetensors", "a.ply"));
    let read = bench.scene("a.ply");
    let look = bench.path("a.look.safetensors");
    write_look(look.as_ref(), &Look::new(&read, &[[1.0, 0.0, 0.5]; 40], MadeFrom::default())).unwrap();
    let with = |more: &[&str]| picture(&bench, &scene, &[&["--mask", &mask], more].concat());
    let captured = picture(&bench, &scene, &[]);
    let styled = picture(&bench, &scene, &["--look", &look]);
    assert_ne!(captured, styled);
    assert_eq!(with(&["--look", &look, "--styled-in", "0"]), captured);
    assert_eq!(with(&["--look", &look, "--styled-in", "2"]), styled);
    let half = with(&["--look", &look, "--styled-in", "1"]);
    assert!(half != captured && half != styled);
    // The same mask in the scene's own file.
    let stored = read_mask(mask.as_ref()).unwrap();
    let masked = Scene { mask: Some(stored.mask_for(&read).unwrap()), ..read };
    let sgs = bench.path("a.sgs");
    write_scene(sgs.as_ref(), &masked).unwrap();
    let sgs_half = picture(&bench, &sgs, &["--look", &look, "--styled-in", "1"]);
    assert_eq!(sgs_half, picture(&bench, &sgs, &["--mask", &mask, "--look", &look, "--styled-in", "1"]));

    assert_eq!(with(&["--hide", "0"]), captured);
    assert_eq!(with(&["--crop", "2"]), captured);
    let (hidden, cropped) = (with(&["--hide", "1"]), with(&["--crop", "1"]));
    assert!(hidden != captured && cropped != captured && hidden != cropped);
    let nothing = render(&bench, &scene, &["--mask", &mask, "--hide", "2"]).expect_success();
    assert!(nothing.stderr.contains("1 of 1 pictures show nothing"), "{}", nothing.stderr);
}

#[test]
fn masks_are_described_and_refused() {
    let bench = Bench::new();
    let (scene, mask) = (bench.plain_scene("a.ply"), mask(&bench, "a.mask.safetensors", "a.ply"));
    let info = stylegaussian(&["info", &mask]).expect_success();
    assert!(info.stdout.contains("channel 1 `ink` on 20, channel 2 on 40"), "{}", info.stdout);
    let json = stylegaussian(&["info", "--json", &mask]).expect_success().json();
    assert_eq!((&json["channels"][0]["index"], &json["channels"][0]["n_painted"]), (&1.into(), &20.into()));
    // A mask of other Gaussians, none at all, and a mask without a use.
    let other = bench.path("b.ply");
    write_scene(other.as_ref(), &bench.scene("a.ply").subset(&[0, 1, 2])).unwrap();
    render(&bench, &other, &["--mask", &mask, "--hide", "1"])
        .expect_error("found a mask of another scene (40@");
    render(&bench, &scene, &["--hide", "1"]).expect_error("found no mask in the scene");
    fs::write(&mask, &fs::read(&mask).unwrap()[..200]).unwrap();
    render(&bench, &scene, &["--mask", &mask, "--hide", "1"]).expect_error("broken header");
    for wrong in
        [&["--mask", &mask][..], &["--hide", "4"], &["--styled-in", "1"], &["--hide", "1", "--crop", "2"]]
    {
        assert_eq!(render(&bench, &scene, wrong).code, Some(2), "{wrong:?}");
    }
}
