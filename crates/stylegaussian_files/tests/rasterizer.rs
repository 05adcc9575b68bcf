//! The rasterizer against reference renders made in float64, and against photographs of a captured scene.

use std::{fs, path::PathBuf};

use glam::{DAffine3, DMat4, UVec2, Vec2};
use safetensors::SafeTensors;
use serde_json::Value;
use stylegaussian::{
    Camera, Scene,
    splat::{Colors, RenderedImage, render},
};
use stylegaussian_files::read_scene;

/// The folder of test data, or `None` with a notice if it is absent.
fn data() -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("STYLEGAUSSIAN_DATA").map_or_else(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no test data in {}; set STYLEGAUSSIAN_DATA", folder.display());
    None
}

fn scene(data: &std::path::Path, name: &str) -> Scene {
    read_scene(&data.join("splats").join(name)).unwrap_or_else(|error| panic!("{error}")).scene
}

/// A camera of a transforms.json. `intrinsics` holds fl_x and the like, `frame` the pose.
fn camera(intrinsics: &Value, frame: &Value) -> Camera {
    let number = |name: &str| intrinsics[name].as_f64().unwrap();
    let rows: Vec<f64> = frame["transform_matrix"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|row| row.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()))
        .collect();
    // The file is row-major and glam column-major.
    let pose = DMat4::from_cols_slice(&rows).transpose();
    Camera::from_opengl(
        DAffine3::from_mat4(pose),
        Vec2::new(number("fl_x") as f32, number("fl_y") as f32),
        Vec2::new(number("cx") as f32, number("cy") as f32),
        UVec2::new(number("w") as u32, number("h") as u32),
    )
}

fn json(path: PathBuf) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Peak signal-to-noise ratio in decibels, for a peak of 1.
fn psnr(pairs: impl Iterator<Item = (f32, f32)>) -> f64 {
    let (mut sum, mut n) = (0.0, 0usize);
    for (a, b) in pairs {
        sum += f64::from(a - b).powi(2);
        n += 1;
    }
    -10.0 * (sum / n as f64).log10()
}

#[test]
fn matches_the_float64_reference_renders() {
    let Some(data) = data() else { return };
    let bytes = fs::read(data.join("reference/renders.safetensors")).unwrap();
    let renders = SafeTensors::deserialize(&bytes).unwrap();
    let halves = |name: String| -> Vec<f32> {
        let pairs = renders.tensor(&name).unwrap().data().chunks_exact(2);
        pairs.map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32()).collect()
    };
    for frame in json(data.join("reference/cameras.json"))["frames"].as_array().unwrap() {
        let name = frame["name"].as_str().unwrap();
        let scene = scene(&data, frame["scene"].as_str().unwrap());
        let view = render(&scene, Colors::Captured, &camera(frame, frame));

        let expected = halves(format!("{name}.color"));
        let color = psnr(view.color.as_flattened().iter().copied().zip(expected));
        let alpha = psnr(view.alpha.iter().copied().zip(halves(format!("{name}.alpha"))));
        println!("{name}: color {color:.1} dB, alpha {alpha:.1} dB");
        assert!(color >= 45.0 && alpha >= 45.0, "{name}: color {color} dB, alpha {alpha} dB");

        if let Ok(depth) = renders.tensor(&format!("{name}.depth")) {
            let expected = depth.data().chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap()));
            let depth = psnr(view.depth.iter().copied().zip(expected));
            println!("{name}: depth {depth:.1} dB");
            assert!(depth >= 45.0, "{name}: depth {depth} dB");
        }
    }
}

/// Peak signal-to-noise ratio of `view` (premultiplied as it is) against the photo, over the pixels that it
/// covers by more than 95%, and the share of these pixels.
fn photo_psnr(view: &RenderedImage, photo: &image::RgbImage) -> (f64, f64) {
    let covered: Vec<usize> = (0..view.alpha.len()).filter(|&p| view.alpha[p] > 0.95).collect();
    let pairs = covered.iter().flat_map(|&p| {
        let photo = photo.as_raw()[3 * p..3 * p + 3].iter().map(|&byte| f32::from(byte) / 255.0);
        view.color[p].iter().map(|c| c.clamp(0.0, 1.0)).zip(photo)
    });
    (psnr(pairs), covered.len() as f64 / view.alpha.len() as f64)
}

#[test]
fn matches_the_photographs() {
    let Some(data) = data() else { return };
    let folder = data.join("photos/bonsai");
    let transforms = json(folder.join("transforms.json"));
    let scene = scene(&data, "bonsai_271k.ply");
    for (index, expected, expected_share) in
        [(0, 18.87, 0.29), (60, 20.04, 0.23), (120, 20.47, 0.30), (200, 17.97, 0.31)]
    {
        let frame = &transforms["frames"][index];
        let view = render(&scene, Colors::Captured, &camera(&transforms, frame));
        let photo = image::open(folder.join(frame["file_path"].as_str().unwrap())).unwrap().to_rgb8();
        let (found, share) = photo_psnr(&view, &photo);
        println!("frame {index}: {found:.3} dB on {:.1}% of the pixels", 100.0 * share);
        assert!((found - expected).abs() < 0.1, "frame {index}: {found} dB, expected {expected}");
        assert!((share - expected_share).abs() < 0.006, "frame {index}: {share}, expected {expected_share}");
    }
}
