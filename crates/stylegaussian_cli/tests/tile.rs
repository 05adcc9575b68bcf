//! `stylegaussian tile`.

use std::fs;

use stylegaussian_files::{read_scene, world::World};

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

use support::{Bench, stylegaussian};

#[test]
fn a_world_is_made_once_and_opens_everywhere() {
    let bench = Bench::new();
    let scene = bench.plain_scene("a.ply");
    let output = bench.path("world");
    let arguments = ["tile", &scene, &scene, "-o", &output, "--levels", "3", "--chunk", "64", "--json"];
    let json = stylegaussian(&arguments).expect_success().json();
    let n = read_scene(scene.as_ref()).unwrap().scene.len() as u64;
    let world = World::read(&fs::read(format!("{output}/lod-meta.json")).unwrap()).unwrap();
    assert_eq!(json["n_gaussians"][0], 2 * n);
    assert_eq!((world.count(0), world.n_levels), (2 * n, 3));
    let told = stylegaussian(&["info", &output, "--json"]).expect_success().json();
    assert_eq!(told["n_gaussians"], 2 * n);
    let coarse = world.count(2).to_string();
    let told = stylegaussian(&["info", &output, "--budget", &coarse, "--json"]).expect_success().json();
    assert_eq!(told["n_gaussians"], world.count(2));
    stylegaussian(&arguments).expect_error("a complete world");
    // The scene's spherical harmonics are kept, unless fewer are asked for.
    let degree = |world: &str| read_scene(world.as_ref()).unwrap().scene.sh.unwrap().degree;
    let plain = bench.path("plain");
    stylegaussian(&["tile", &scene, "-o", &plain, "--chunk", "64", "--sh-degree", "0"]).expect_success();
    assert_eq!((degree(&output), degree(&plain)), (1, 0));
    let none = bench.path("none.ply");
    stylegaussian(&["tile", &none, "-o", &bench.path("other")]).expect_error("none.ply");
    assert!(!fs::exists(bench.path("other")).unwrap());
    for wrong in [["--cell", "0"], ["--sh-degree", "4"]] {
        let usage = stylegaussian(&[&["tile", &scene, "-o", &bench.path("other")][..], &wrong].concat());
        assert_eq!(usage.code, Some(2), "{usage:?}");
    }
}
