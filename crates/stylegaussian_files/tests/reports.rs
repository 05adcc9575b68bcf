//! Scenes that people could not see: with surroundings, and in small and large units.

use std::{
    fs,
    path::{Path, PathBuf},
};

use glam::{DAffine3, DMat4, UVec2, Vec2, Vec3};
use serde_json::Value;
use stylegaussian::{
    Camera, Scene,
    splat::{Colors, render},
    views::{framing, orbit},
};
use stylegaussian_files::read_scene;

/// The folder of reports, or `None` with a notice if it is absent.
fn reports() -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("STYLEGAUSSIAN_DATA").map_or_else(beside, PathBuf::from).join("reports");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no reports in {}; set STYLEGAUSSIAN_DATA", folder.display());
    None
}

fn scene(path: &Path) -> Scene {
    read_scene(path).unwrap_or_else(|error| panic!("{error}")).scene
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// The mean share of an orbit's pictures that the Gaussians within `radius` of the origin fill.
fn filled(scene: &Scene, radius: f32) -> f32 {
    let is_thing = |mean: &Vec3| [f32::from(u8::from(mean.length() < radius)); 3];
    let colors: Vec<[f32; 3]> = scene.means.iter().map(is_thing).collect();
    let cameras = orbit(scene, 3, UVec2::splat(96));
    let filled = |camera: &Camera| {
        let picture = render(scene, Colors::Rgb(&colors), camera);
        picture.color.iter().map(|color| color[0]).sum::<f32>() / picture.color.len() as f32
    };
    cameras.iter().map(filled).sum::<f32>() / cameras.len() as f32
}

/// A statue of two units, with floaters out to 200, and in a garden with a background out to 100.
#[test]
fn surroundings_do_not_shrink_the_thing() {
    let Some(reports) = reports() else { return };
    for (name, radius) in [("F03_floaters_3.ply", 3.0), ("F04_outdoor_05.ply", 1.2)] {
        let all = scene(&reports.join(name));
        let indices: Vec<u32> =
            (0..all.len() as u32).filter(|&i| all.means[i as usize].length() < radius).collect();
        let alone = all.subset(&indices);
        let (found, expected) = (filled(&all, radius), filled(&alone, radius));
        assert!(expected > 0.1 && found > 0.5 * expected, "{name}: {found}, alone {expected}");
        assert!(framing(&all).unwrap().n_left_out > 0, "{name}");
    }
}

/// Three marks, whose pixels are worked out beside the rasterizer, in units of 0.0001 to 10,000.
#[test]
fn marks_are_in_their_pixels_in_every_unit() {
    let Some(reports) = reports() else { return };
    let expected = json(&reports.join("C00_expected.json"));
    for scale in ["0.0001", "0.001", "0.01", "100", "10000"] {
        let folder = reports.join("C16_worlds");
        let scene = scene(&folder.join(format!("marks_{scale}.ply")));
        let transforms = json(&folder.join(scale).join("transforms.json"));
        let number = |name: &str| transforms[name].as_f64().unwrap() as f32;
        for (i, frame) in transforms["frames"].as_array().unwrap().iter().enumerate() {
            let rows: Vec<f64> = frame["transform_matrix"]
                .as_array()
                .unwrap()
                .iter()
                .flat_map(|row| row.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()))
                .collect();
            let camera = Camera::from_opengl(
                DAffine3::from_mat4(DMat4::from_cols_slice(&rows).transpose()),
                Vec2::new(number("fl_x"), number("fl_y")),
                Vec2::new(number("cx"), number("cy")),
                UVec2::new(number("w") as u32, number("h") as u32),
            )
            .near_among(&scene.means);
            for mark in 0..3 {
                let colors: Vec<[f32; 3]> =
                    (0..3).map(|gaussian| [f32::from(u8::from(gaussian == mark)); 3]).collect();
                let picture = render(&scene, Colors::Rgb(&colors), &camera);
                // The middle of what shows the mark.
                let (mut sum, mut middle) = (0.0, Vec2::ZERO);
                for (pixel, color) in picture.color.iter().enumerate() {
                    let (x, y) = (pixel % picture.size.x as usize, pixel / picture.size.x as usize);
                    sum += color[0];
                    middle += color[0] * (Vec2::new(x as f32, y as f32) + 0.5);
                }
                let at = |axis: usize| expected[i][scene.order[mark] as usize][axis].as_f64().unwrap() as f32;
                let (found, expected) = (middle / sum, Vec2::new(at(0), at(1)));
                assert!(sum > 10.0, "scale {scale}, camera {i}: mark {mark} is not seen");
                assert!(found.distance(expected) < 0.5, "scale {scale}, camera {i}: {found}, not {expected}");
            }
        }
    }
}
