//! `stylegaussian tile`.

use std::{fs, path::Path};

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
    let world = World::open(format!("{output}/lod-meta.json").as_ref()).unwrap();
    assert_eq!(json["n_gaussians"][0], 2 * n);
    assert_eq!((world.count(0), world.n_levels), (2 * n, 3));
    let told = stylegaussian(&["info", &output, "--json"]).expect_success().json();
    assert_eq!((&told["n_gaussians"], &told["n_nodes"]), (&(2 * n).into(), &world.nodes.len().into()));
    let level = |i: usize| &told["levels"][i];
    assert_eq!(level(0)["n_gaussians"], 2 * n);
    assert_eq!(
        (&level(2)["n_gaussians"], told["levels"].as_array().unwrap().len()),
        (&world.count(2).into(), 3)
    );
    assert_eq!(told["bounds"][1][0], world.bounds().unwrap()[1].x);
    let text = stylegaussian(&["info", &output]).expect_success().stdout;
    assert!(text.contains(&format!("level 2     {} Gaussians", world.count(2))), "{text}");
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

/// A level alone has its Gaussians, and a cut has those of the budget that the cameras see best.
#[test]
fn a_world_is_rendered_at_a_level_and_as_cameras_see_it() {
    let bench = Bench::new();
    let scene = bench.plain_scene("a.ply");
    let output = bench.path("world");
    stylegaussian(&["tile", &scene, "-o", &output, "--levels", "3", "--chunk", "32"]).expect_success();
    let world = World::open(format!("{output}/lod-meta.json").as_ref()).unwrap();
    let size = ["--size", "16x16", "--backend", "cpu", "-o"];
    let picture = bench.path("a.png");
    for level in 0..3 {
        let number = level.to_string();
        let at = ["render", &output, "--level", &number];
        let run = stylegaussian(&[&at[..], &size, &[&*picture]].concat()).expect_success();
        assert!(run.stderr.contains(&format!("{} Gaussians", world.count(level))), "{}", run.stderr);
    }
    let frame = r#"{"file_path": "x.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,9],[0,0,0,1]]}"#;
    let cameras = bench.path("transforms.json");
    fs::write(&cameras, format!(r#"{{"camera_angle_x": 1.2, "w": 16, "h": 16, "frames": [{frame}]}}"#))
        .unwrap();
    let cut = |budget: u64| {
        let budget = budget.to_string();
        let seen = ["render", &output, "--cut", "--budget", &budget, "--cameras", &cameras];
        let run = stylegaussian(&[&seen[..], &size, &[&*picture]].concat()).expect_success();
        let line = run.stderr.lines().find(|line| line.ends_with(" Gaussians of these levels")).unwrap();
        line.split(' ').next().unwrap().parse::<u64>().unwrap()
    };
    assert_eq!(cut(world.count(2)), world.count(2));
    let between = world.count(2) + 3;
    assert!(cut(between) <= between);
    // What surrounds a world counts, and comes first if the budget is small.
    let around = world.files[0].clone();
    let n_around = read_scene(&Path::new(&output).join(&around)).unwrap().scene.len() as u64;
    let surrounded = World { environment: Some(around), ..world };
    fs::write(Path::new(&output).join("lod-meta.json"), surrounded.write()).unwrap();
    let coarsest = surrounded.count(2);
    assert_eq!([0, coarsest].map(|n| cut(n_around + n)), [n_around, n_around + coarsest]);
    // What cannot be had is told.
    let at = ["render", &output, "--level", "3"];
    stylegaussian(&[&at[..], &size, &[&*picture]].concat()).expect_error("found 3 levels");
    let no_world = ["render", &scene, "--level", "0"];
    stylegaussian(&[&no_world[..], &size, &[&*picture]].concat()).expect_error("a.ply: found no world");
    let usage = stylegaussian(&["render", &output, "--cut", "-o", &picture]);
    assert_eq!(usage.code, Some(2), "{usage:?}");
}
