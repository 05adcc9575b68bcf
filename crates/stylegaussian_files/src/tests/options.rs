//! Choices of readers and writers, and the bound of a source's count.

use stylegaussian::Axes;

use super::*;

/// Rows of files of colors are counted by it: 37 kB must not make 48 GB.
#[test]
fn a_source_out_of_all_proportion_is_refused() {
    let dir = dir();
    let path = dir.path().join("scene.sgs");
    let mut scene = full_scene();
    let mut read_with = |n_source: usize, last: u32| {
        (scene.n_source, scene.order[0]) = (n_source, last);
        write_scene(&path, &scene).unwrap();
        read_scene(&path)
    };
    // A cut-out of a capture of 16.8 million.
    assert_eq!(read_with(1 << 24, 0).unwrap().scene.n_source, 1 << 24);
    let message = refused(read_with((1 << 24) + 1, 0));
    assert!(message.contains("a source of 16777217 Gaussians, of which 20 are left"), "{message}");
    assert!(refused(read_with(1 << 32, u32::MAX)).contains("expected at most 16777216"));
}

/// Later steps allocate for every channel and neighbor: 300,000 channels took all memory.
#[test]
fn channels_and_neighbors_out_of_all_proportion_are_refused() {
    let path = dir().path().join("scene.sgs");
    let mut scene = full_scene();
    let features = scene.features.as_mut().unwrap();
    features.n_latent = Features::MAX_CHANNELS + 1;
    assert!(refused(write_scene(&path, &scene)).contains("features of 4097 latent and "));
    let neighbors = Neighbors { k: Decoder::MAX_K + 1, indices: vec![0; 257 * 20] };
    let scene = Scene { neighbors: Some(neighbors), features: None, decoder: None, ..full_scene() };
    let message = refused(write_scene(&path, &scene));
    assert!(message.contains("257 neighbors of each, expected at most 256"), "{message}");
    let mut decoder = decoder(&[6, 4, 3], 2, &mut noise());
    decoder.k = Decoder::MAX_K + 1;
    assert!(refused(write_decoder(&path, &decoder, Precision::F32)).contains("K = 257"));
}

#[test]
fn higher_spherical_harmonics_are_left_out_as_asked() {
    let dir = dir();
    let whole = by_source(&full_scene()).sh.unwrap().coefficients;
    for name in ["a.sgs", "a.ply"] {
        let path = dir.path().join(name);
        for sh_degree in 0..=3 {
            write_scene_with(&path, &full_scene(), WriteOptions { sh_degree, ..Default::default() }).unwrap();
            let sh = by_source(&read_scene(&path).unwrap().scene).sh.unwrap();
            assert_eq!(sh.degree, sh_degree.min(2));
            let width = 3 * stylegaussian::sh::n_coefficients(sh.degree);
            for (row, whole) in sh.coefficients.chunks_exact(width).zip(whole.chunks_exact(27)) {
                assert_eq!(row, &whole[..width]);
            }
        }
    }
}

#[test]
fn axes_that_are_asked_for_replace_those_of_the_format() {
    let dir = dir();
    for name in ["a.sgs", "a.ply", "a.splat"] {
        let path = dir.path().join(name);
        write_scene(&path, &full_scene()).unwrap();
        let plain = read_scene(&path).unwrap();
        assert_eq!(plain.axes, Axes::RDF);
        let options = ReadOptions { axes: Some(Axes::RUB), ..Default::default() };
        let turned = read_scene_with(&path, options).unwrap();
        assert_eq!((turned.axes, &turned.axes_because[..]), (Axes::RUB, "they were asked for"));
        let mut expected = plain.scene;
        Axes::RUB.turn(&mut expected);
        assert_eq!(turned.scene.means, expected.means, "{name}");
        assert_eq!(turned.scene.sh.unwrap().coefficients, expected.sh.unwrap().coefficients);
    }
}

/// Files of earlier versions spell the key the British way.
#[test]
fn the_license_is_read_under_its_old_key() {
    let dir = dir();
    let path = dir.path().join("scene.sgs");
    write_scene(&path, &full_scene()).unwrap();
    let bytes = fs::read(&path).unwrap();
    let old = replaced(&bytes, r#""license":"CC0-1.0""#, r#""licence":"CC0-1.0""#);
    fs::write(&path, old).unwrap();
    let Loaded { scene, warnings, .. } = read_scene(&path).unwrap();
    assert_eq!(scene.license.as_deref(), Some("CC0-1.0"));
    assert!(warnings.is_empty(), "{warnings:?}");
}

/// Viewers of glTF and SPZ take y for up. Cameras and looks of the scene must fit the file all the same.
#[test]
fn scenes_of_any_up_direction_are_upright_in_files_and_come_back() {
    let dir = dir();
    let lean = Vec3::new(0.05, 0.1, -0.02);
    for (name, spz_version, tolerance) in
        [("a.glb", 3, 0.0), ("a.spz", 3, 0.5_f32.powi(12)), ("b.spz", 4, 0.5_f32.powi(12))]
    {
        let path = dir.path().join(name);
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_Y] {
            let scene = by_source(&Scene { up: Some(axis + lean), ..full_scene() });
            let write = WriteOptions { spz_version, ..Default::default() };
            write_scene_with(&path, &scene, write).unwrap();
            let read = read_scene(&path).unwrap();
            assert!(read.warnings.is_empty(), "{:?}", read.warnings);
            let off = |a: &[Vec3], b: &[Vec3]| {
                a.iter().zip(b).map(|(a, b)| (a - b).abs().max_element()).fold(0.0, f32::max)
            };
            assert!(off(&read.scene.means, &scene.means) <= tolerance, "{name}, {axis}");
            let is_turned = axis != Vec3::NEG_Y;
            assert_eq!(read.axes_because.contains("turned back"), is_turned, "{}", read.axes_because);
            if is_turned {
                assert_eq!(read.scene.up, scene.up, "{name}");
            }
            // As other programs see it: y of the file, which is up.
            let options = ReadOptions { axes: Some(Axes::RUB), ..Default::default() };
            let told = read_scene_with(&path, options).unwrap().scene;
            for (seen, mean) in told.means.iter().zip(&scene.means) {
                assert!((-seen.y - mean.dot(axis)).abs() <= tolerance, "{name}, {axis}");
            }
        }
    }
}

#[test]
fn bytes_of_a_scene_are_those_of_its_file() {
    let dir = dir();
    let scene = full_scene();
    for name in ["a.sgs", "a.glb", "a.ply"] {
        let path = dir.path().join(name);
        write_scene(&path, &scene).unwrap();
        assert_eq!(scene_to_bytes(name, &scene).unwrap(), fs::read(&path).unwrap(), "{name}");
    }
    assert!(scene_to_bytes("a.txt", &scene).unwrap_err().to_string().contains("a.txt"));
    assert!(scene_to_bytes("a.sgs", &Scene::default()).unwrap_err().to_string().contains("no Gaussian"));
}
