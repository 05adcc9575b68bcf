use glam::Vec3;

use super::*;

/// Three nodes of two levels. The second has one level alone.
fn world() -> World {
    let node = |x: f32, levels: [Option<(usize, Range<usize>)>; 2]| Node {
        bounds: [Vec3::new(x, -1.5, 0.1), Vec3::new(x + 1.0, 2.0, 1e-3 + 0.1)],
        levels: levels.map(|run| run.map(|(file, range)| Run { file, range })).into(),
    };
    World {
        n_levels: 2,
        files: ["0_0/meta.json", "1_0/meta.json"].map(String::from).into(),
        environment: Some("env/meta.json".into()),
        nodes: vec![
            node(0.0, [Some((0, 0..100)), Some((1, 0..25))]),
            node(1.0, [Some((0, 100..103)), None]),
            node(2.5, [Some((0, 103..203)), Some((1, 25..50))]),
        ],
    }
}

#[test]
fn a_written_world_is_read_equal() {
    let world = world();
    let bytes = world.write();
    assert_eq!(World::read(&bytes).unwrap(), world);
    assert_eq!(bytes, world.write());
    assert_eq!([0, 1, 2].map(|level| world.count(level)), [203, 50, 0]);
    let json: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
    assert_eq!((&json["version"], &json["lodLevels"], &json["count"]), (&1.into(), &2.into(), &253.into()));
    assert_eq!(json["counts"], serde_json::json!([203, 50]));
    // The root's box holds those of its leaves.
    assert_eq!(json["tree"]["bound"]["min"][0], 0.0);
    assert_eq!(json["tree"]["bound"]["max"][0], 3.5);
    assert_eq!(json["tree"]["children"][0]["lods"]["1"]["count"], 25);
    // Neither one node nor no environment changes the shape.
    let one = World { nodes: world.nodes[..1].to_vec(), environment: None, ..world };
    assert_eq!(World::read(&one.write()).unwrap(), one);
    assert!(!String::from_utf8(one.write()).unwrap().contains("environment"));
}

#[test]
fn contradictions_are_refused() {
    let text = String::from_utf8(world().write()).unwrap();
    let refused = |from: &str, to: &str, expected: &str| {
        assert!(text.contains(from), "{from} in {text}");
        let error = World::read(text.replacen(from, to, 1).as_bytes()).unwrap_err().to_string();
        assert!(error.contains(expected) && !error.contains('\n'), "{error}");
    };
    refused("\"version\":1", "\"version\":2", "version 2");
    refused("\"lodLevels\":2", "\"lodLevels\":1", "level 1");
    refused("\"lodLevels\":2", "\"lodLevels\":4294967295", "at most 32");
    refused("\"count\":253", "\"count\":254", "count 254");
    refused("\"counts\":[203", "\"counts\":[204", "counts [204, 50]");
    refused("\"counts\":[203", "\"counts\":[1,203", "counts [1, 203, 50]");
    refused("\"offset\":100", "\"offset\":99", "share Gaussians of `0_0/meta.json`");
    refused("\"offset\":100", "\"offset\":4294967295", "an end below 2^32");
    refused("\"offset\":100", "\"offset\":-1", "JSON");
    refused("\"file\":1", "\"file\":2", "file 2");
    refused("0_0/meta.json", "../meta.json", "../meta.json");
    refused("env/meta.json", "env\\\\meta.json", "file path");
    refused("\"max\":[1.0,2.0", "\"max\":[1.0,-2.0", "node 0 with a box");
    refused("\"max\":[1.0,2.0", "\"max\":[1e39,2.0", "inf");
    refused("\"max\":[1.0,2.0", "\"max\":[2.0", "JSON");
    let bound = &text[text.rfind("\"bound\"").unwrap()..text.rfind(",\"lods\"").unwrap()];
    refused(bound, "\"bound\":{}", "node 2 with a box from [NaN, NaN, NaN]");
    let nested = "{\"bound\":{},\"children\":[".repeat(100_000);
    refused("\"tree\":", &format!("\"tree\":{nested}"), "recursion");
    let empty = World { nodes: Vec::new(), ..world() };
    assert!(World::read(&empty.write()).unwrap_err().to_string().contains("without Gaussians"));
}

#[test]
fn a_node_may_show_the_same_run_at_two_levels() {
    let mut world = world();
    world.nodes[1].levels[1] = world.nodes[1].levels[0].clone();
    assert_eq!(World::read(&world.write()).unwrap(), world);
}

#[test]
fn runs_skip_gaussians_that_were_dropped() {
    let world = world();
    let mut chunk =
        Scene { order: (0..203).filter(|i| i % 50 != 10).collect(), n_source: 203, ..Scene::default() };
    // 10, 60 and 110, 160 are missing.
    let runs: Vec<_> = world.nodes.iter().map(|node| node.levels[0].as_ref().unwrap().of(&chunk)).collect();
    assert_eq!(runs, [0..98, 98..101, 101..199]);
    world.check_chunk(0, &chunk).unwrap();
    chunk.n_source = 202;
    let error = world.check_chunk(0, &chunk).unwrap_err().to_string();
    assert!(error.contains("a chunk of 202 Gaussians, expected at least 203"), "{error}");
}

/// The levels of a real world, each of which is one chunk, read by their budgets and alone.
#[test]
fn each_level_of_a_capture_is_its_chunk() {
    let Some(folder) = crate::tests::shared_data("splats/playbot") else { return };
    let world = World::read(&std::fs::read(folder.join(FILE)).unwrap()).unwrap();
    assert_eq!((world.n_levels, world.nodes.len(), world.count(0)), (7, 2, 500_000));
    // The finer ones take longer.
    for level in 3..7 {
        let count = world.count(level) as usize;
        let options = crate::ReadOptions { budget: Some(count), ..Default::default() };
        let read = crate::read_scene_with(&folder.join(FILE), options).unwrap().scene;
        let file = world.nodes[0].levels[level].as_ref().unwrap().file;
        let chunk = crate::read_scene(&folder.join(&world.files[file])).unwrap().scene;
        world.check_chunk(file, &chunk).unwrap();
        assert_eq!(read.len(), count, "{level}");
        let all = |scene: Scene| {
            (scene.means, scene.rotations, scene.scales, scene.opacities, scene.sh.unwrap().coefficients)
        };
        assert!(all(read) == all(chunk), "{level}");
    }
}

#[test]
fn looks_are_named_by_their_chunks() {
    assert_eq!(look_of("0_0/meta.json"), "0_0.look.safetensors");
    assert_eq!(look_of("far/1.5_2/meta.json"), "far/1.5_2.look.safetensors");
    assert_eq!(look_of("a.b/c.sog"), "a.b/c.look.safetensors");
    assert_eq!(look_of("meta.json"), "meta.look.safetensors");
}

#[test]
fn a_world_of_one_level_for_each_node_is_one() {
    let world = world();
    let coarse = world.only(&[Some(1); 3]);
    assert_eq!((coarse.nodes.len(), coarse.count(0), coarse.count(1)), (2, 0, 50));
    let mixed = world.only(&[Some(0), None, Some(1)]);
    assert_eq!(mixed.nodes.iter().map(|node| node.bounds[0].x).collect::<Vec<_>>(), [0.0, 2.5]);
    assert_eq!((mixed.count(0), mixed.count(1), &mixed.files), (100, 25, &world.files));
    assert_eq!(World::read(&mixed.write()).unwrap(), mixed);
    // Levels that are not there are none.
    assert!(world.only(&[Some(2), Some(usize::MAX)]).nodes.is_empty());
    assert_eq!(world.bounds(), Some([Vec3::new(0.0, -1.5, 0.1), Vec3::new(3.5, 2.0, 1e-3 + 0.1)]));
}

#[test]
fn a_manifest_is_found_by_its_folder_and_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(manifest_at(folder.path()), None);
    let file = folder.path().join(FILE);
    assert_eq!(manifest_at(&file), None);
    std::fs::write(&file, world().write()).unwrap();
    assert_eq!(manifest_at(folder.path()), Some(file.clone()));
    assert_eq!(manifest_at(&file), Some(file.clone()));
    assert_eq!(World::open(&file).unwrap(), world());
    let other = folder.path().join("meta.json");
    std::fs::copy(&file, &other).unwrap();
    assert_eq!(manifest_at(&other), None);
    std::fs::write(&file, b"{}").unwrap();
    assert!(World::open(&file).unwrap_err().to_string().contains(FILE));
}
