//! Photos of distorted lenses, made by inverting the lens step by step, and what is left of them.

use glam::DVec2;
use image::{Luma, imageops::FilterType};
use stylegaussian::Scene;

use super::*;
use crate::embed::TrainingView;

const SIZE: UVec2 = UVec2::new(192, 144);
const FOCAL: DVec2 = DVec2::new(150.0, 144.0);
const CENTER: DVec2 = DVec2::new(98.0, 70.0);

fn lens(radial: [f64; 4], rational: [f64; 3], tangential: [f64; 2]) -> Distortion {
    Distortion { focal: FOCAL, center: CENTER, size: SIZE, radial, rational, tangential }
}

/// The place that the lens shows at `seen`, both on the plane at z = 1.
fn without(lens: &Distortion, seen: DVec2) -> DVec2 {
    (0..200).fold(seen, |at, _| at + 0.7 * (seen - lens.distorted(at)))
}

/// A round mark of 5 pixels' deviation at `mark`, a pixel of the picture without distortion.
fn photo(lens: &Distortion, mark: DVec2) -> image::GrayImage {
    image::GrayImage::from_fn(SIZE.x, SIZE.y, |x, y| {
        let seen = (DVec2::new(f64::from(x), f64::from(y)) + 0.5 - CENTER) / FOCAL;
        let from_mark = FOCAL * without(lens, seen) + CENTER - mark;
        Luma([(255.0 * (-from_mark.length_squared() / 50.0).exp()).round() as u8])
    })
}

/// The middle of a mark, in pixels.
fn middle(image: &stylegaussian_encoder::Image) -> Vec2 {
    let (mut sum, mut mass) = (Vec2::ZERO, 0.0);
    for (i, pixel) in (0..).zip(image.rgb.chunks_exact(3)) {
        sum += pixel[0] * (UVec2::new(i % image.width, i / image.width).as_vec2() + 0.5);
        mass += pixel[0];
    }
    sum / mass
}

#[test]
fn a_lens_by_hand() {
    // r^2 = 5, d = 1.5, t = (0.04 + 0.02 (5 + 2), 0.01 (5 + 8) + 0.08).
    let one = lens([0.1, 0.0, 0.0, 0.0], [0.0; 3], [0.01, 0.02]);
    assert!(one.distorted(DVec2::new(1.0, 2.0)).abs_diff_eq(DVec2::new(1.68, 3.21), 1e-12));
    // r^2 = 2: (1 + 0.2 + 0.8 + 0.8 + 1.6) / (1 + 0.2 + 0.8 + 0.2) = 2.
    let all = lens([0.1, 0.2, 0.1, 0.1], [0.1, 0.2, 0.025], [0.0; 2]);
    assert!(all.distorted(DVec2::ONE).abs_diff_eq(DVec2::splat(2.0), 1e-12));
}

/// A square of 90 degrees with k1 = -0.1: a side x = 1 is seen at d (1, y) with d = 0.9 - 0.1 y^2, and the area
/// is twice the integral of d^2 over y from -1 to 1, 3.008 of 4.
#[test]
fn the_edge_that_is_lost_by_hand() {
    let (size, middle) = (UVec2::splat(1000), DVec2::splat(500.0));
    let square =
        Distortion { focal: middle, center: middle, size, ..lens([-0.1, 0.0, 0.0, 0.0], [0.0; 3], [0.0; 2]) };
    assert_eq!(square.filled(), Some((UVec2::ZERO, size)));
    assert!((square.lost(UVec2::ZERO, size) - 0.248).abs() < 1e-3);
    // A pincushion: the corner (x, x) is seen at (1, 1) where x (1 + 0.2 x^2) = 1, at x = 0.8688. The edges
    // between are seen further in, at x (1 + 0.1 x^2) = 0.934.
    let pincushion = Distortion { radial: [0.1, 0.0, 0.0, 0.0], ..square };
    let (corner, size) = pincushion.filled().unwrap();
    assert!(corner.as_dvec2().abs_diff_eq(DVec2::splat(0.5 * (1.0 - 0.8688) * 1000.0), 1.5), "{corner}");
    assert_eq!(size, UVec2::splat(1000) - 2 * corner);
    let lost = pincushion.lost(corner, size);
    assert!((0.0..0.13).contains(&lost) && lost > 0.02, "{lost}");
}

/// Each kind of file that can tell a distorted lens: marks are where the camera sees them.
#[test]
fn photos_are_taken_without_their_distortion() {
    let pose = "[[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]";
    let ngp = |k: &str| {
        let frame = format!(r#"{{"file_path": "images/a.png", "transform_matrix": {pose}}}"#);
        let lens = r#""w": 192, "h": 144, "fl_x": 150, "fl_y": 144, "cx": 98, "cy": 70"#;
        vec![("transforms.json", format!("{{ {lens}, {k}, \"frames\": [{frame}] }}"))]
    };
    let colmap = |model: &str, k: &str| {
        vec![
            ("sparse/0/cameras.txt", format!("1 {model} 192 144 150 144 98 70 {k}\n")),
            ("sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n".to_owned()),
        ]
    };
    let opencv = lens([-0.2, 0.05, 0.0, 0.0], [0.0; 3], [0.004, -0.003]);
    let pincushion = lens([0.15, 0.02, 0.01, 0.005], [0.0; 3], [0.0, 0.002]);
    let full = lens([0.1, -0.05, 0.02, 0.0], [0.3, 0.05, 0.01], [-0.002, 0.001]);
    for (what, lens, files) in [
        ("instant-ngp", opencv, ngp(r#""k1": -0.2, "k2": 0.05, "p1": 0.004, "p2": -0.003"#)),
        (
            "nerfstudio",
            pincushion,
            ngp(r#""camera_model": "OPENCV", "k1": 0.15, "k2": 0.02, "k3": 0.01, "k4": 0.005, "p2": 0.002"#),
        ),
        ("OPENCV", opencv, colmap("OPENCV", "-0.2 0.05 0.004 -0.003")),
        ("FULL_OPENCV", full, colmap("FULL_OPENCV", "0.1 -0.05 -0.002 0.001 0.02 0.3 0.05 0.01")),
    ] {
        let files: Vec<(&str, &[u8])> = files.iter().map(|(name, text)| (*name, text.as_bytes())).collect();
        let folder = folder(&files);
        fs::create_dir(folder.path().join("images")).unwrap();
        let options = CameraOptions { undistorts: true, ..CameraOptions::default() };
        let set = read_cameras_with(folder.path(), options).unwrap();
        let [warning] = &set.warnings[..] else { panic!("{what}: {:?}", set.warnings) };
        assert!(warning.contains("1 photos are taken without their lens distortion"), "{what}: {warning}");
        let posed = &set.cameras[0];
        // At the fourth of the picture, near a corner, and from a photo of half the size.
        for (mark, scale) in [(DVec2::new(50.0, 40.0), 1), (DVec2::new(150.0, 110.0), 1), (CENTER, 2)] {
            let photo = photo(&lens, mark);
            let photo = image::imageops::resize(&photo, 192 / scale, 144 / scale, FilterType::Triangle);
            photo.save(folder.path().join("images/a.png")).unwrap();
            let view = TrainingView::photo(
                posed.require_photo().unwrap().into(),
                &posed.camera,
                posed.distortion,
                192,
            );
            let found = middle(&view.load(&Scene::default()).unwrap().image);
            let direction = ((mark - CENTER) / FOCAL).extend(1.0).as_vec3();
            let expected = pixel(&view.camera, direction);
            let within = if scale == 1 { 0.01 } else { 0.05 };
            assert!((found - expected).length() < within, "{what}: {found}, expected {expected}");
        }
        // Nothing is cut from cameras that see no photo, and the pinhole is the same.
        let plain = read_cameras(folder.path()).unwrap();
        assert_eq!(plain.cameras[0].camera.size, SIZE);
        assert!(
            plain.warnings[0].contains("distortion of 1 cameras is ignored"),
            "{what}: {:?}",
            plain.warnings
        );
        let seen = |camera: &Camera| (pixel(camera, Vec3::Z) - camera.center).length();
        assert!(seen(&plain.cameras[0].camera) < 1e-5 && seen(&posed.camera) < 1e-5);
        assert_eq!(plain.cameras[0].camera.focal, posed.camera.focal);
    }
}

/// Coefficients 0 are no distortion, and those that fold the picture or are no numbers are no lens.
#[test]
fn lenses_that_leave_nothing_are_refused() {
    assert_eq!(lens([0.0; 4], [0.0; 3], [0.0; 2]).filled(), Some((UVec2::ZERO, SIZE)));
    assert!(!lens([0.0; 4], [0.0; 3], [0.0; 2]).is_any());
    for radial in [[-5.0, 0.0, 0.0, 0.0], [1e9, 0.0, 0.0, 0.0], [f64::NAN; 4], [0.0, -1e300, 0.0, 1e300]] {
        let lens = lens(radial, [0.0; 3], [0.0; 2]);
        assert_eq!(lens.filled(), None, "{radial:?}");
    }
    let lying = Distortion { size: UVec2::MAX, ..lens([-5.0; 4], [0.0; 3], [0.0; 2]) };
    assert_eq!(lying.filled(), None);
    let folder = folder(&[("transforms.json", transforms(&format!(r#"{LENS} "k1": -9, "#), "").as_bytes())]);
    let options = CameraOptions { undistorts: true, ..CameraOptions::default() };
    let message = read_cameras_with(folder.path(), options).unwrap_err().to_string();
    assert!(message.contains("images/a.png") && message.contains("a distortion of k1 -9"), "{message}");
    assert!(read_cameras(folder.path()).is_ok());
}
