//! A hand-written fixture for each format: one camera, and a known point that must land on a known pixel.

use std::{fs, path::Path};

use glam::{UVec2, Vec2, Vec3};
use tempfile::TempDir;

use super::*;

mod captures;
mod distant;
mod distortion;
mod photos;

/// A folder with these files.
fn folder(files: &[(&str, &[u8])]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    folder
}

/// The position of a point of the world in the picture of `camera`, in pixels.
fn pixel(camera: &Camera, world: Vec3) -> Vec2 {
    let view = camera.view_from_world.transform_point3(world);
    assert!(view.z > 0.0, "{world} is behind the camera: {view}");
    camera.focal * view.truncate() / view.z + camera.center
}

/// The camera of all fixtures: at (1, 2, 3), looking along world +x, with world +z up; so its right is world
/// -y. 40 x 30 pixels, focal lengths 20 and 10, principal point (21, 14).
#[track_caller]
fn check_fixture(camera: &Camera, center: Vec2) {
    assert!((camera.position() - Vec3::new(1.0, 2.0, 3.0)).length() < 1e-5, "{}", camera.position());
    assert_eq!(
        (camera.focal, camera.center, camera.size),
        (Vec2::new(20.0, 10.0), center, UVec2::new(40, 30))
    );
    // 4 ahead, 1 to the right, 2 up.
    let found = pixel(camera, Vec3::new(5.0, 1.0, 5.0));
    assert!((found - (center + Vec2::new(5.0, -5.0))).length() < 1e-4, "{found}");
}

/// Columns right (0, -1, 0), up (0, 0, 1), backward (-1, 0, 0), position.
const OPENGL_POSE: &str = "[[0, 0, -1, 1], [-1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 0, 1]]";

fn transforms(lens: &str, frame: &str) -> String {
    let pose = OPENGL_POSE;
    format!(
        r#"{{ {lens} "frames": [{{ "file_path": "images/a.png", {frame} "transform_matrix": {pose} }}] }}"#
    )
}

const LENS: &str = r#""w": 40, "h": 30.0, "fl_x": 20, "fl_y": 10, "cx": 21, "cy": 14, "#;

#[track_caller]
fn check_error(path: &Path, parts: &[&str]) {
    let message = read_cameras(path).expect_err("must be refused").to_string();
    for part in parts {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
}

#[test]
fn transforms_json_by_file_and_by_folder() {
    let folder = folder(&[("transforms.json", transforms(LENS, "").as_bytes())]);
    for path in [folder.path().to_owned(), folder.path().join("transforms.json")] {
        let set = read_cameras(&path).unwrap();
        check_fixture(&set.cameras[0].camera, Vec2::new(21.0, 14.0));
        assert_eq!(set.cameras[0].name, "images/a.png");
        assert_eq!(set.cameras[0].photo, Some(folder.path().join("images/a.png")));
        assert_eq!(set.warnings, [""; 0]);
    }
}

#[test]
fn a_frame_has_its_own_intrinsics() {
    let global = r#""w": 7, "h": 30, "fl_x": 99, "fl_y": 10, "cx": 21, "cy": 14, "#;
    let folder = folder(&[("transforms.json", transforms(global, r#""w": 40, "fl_x": 20,"#).as_bytes())]);
    let set = read_cameras(folder.path()).unwrap();
    check_fixture(&set.cameras[0].camera, Vec2::new(21.0, 14.0));
}

/// tan(angle / 2) = 1: half the width is the focal length. The size comes from the photo, the extension too.
#[test]
fn angles_of_view_take_the_size_from_the_photo() {
    let json = transforms(r#""camera_angle_x": 1.5707963267948966, "#, "").replace("a.png", "a");
    let folder = folder(&[("transforms.json", json.as_bytes())]);
    check_error(folder.path(), &["images/a", "size"]);
    fs::create_dir(folder.path().join("images")).unwrap();
    image::RgbImage::new(40, 30).save(folder.path().join("images/a.png")).unwrap();
    let camera = &read_cameras(folder.path()).unwrap().cameras[0];
    assert_eq!(camera.camera.size, UVec2::new(40, 30));
    assert!((camera.camera.focal - Vec2::splat(20.0)).length() < 1e-4, "{}", camera.camera.focal);
    assert_eq!(camera.camera.center, Vec2::new(20.0, 15.0));
    assert_eq!(camera.require_photo().unwrap(), folder.path().join("images/a.png"));
}

#[test]
fn what_transforms_json_must_not_say() {
    let good = transforms(LENS, "");
    for (from, to, parts) in [
        (
            OPENGL_POSE,
            "[[0, 0, -2, 1], [-1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 0, 1]]",
            &["frame 0", "rotation"][..],
        ),
        (OPENGL_POSE, "[[0, 0, 1, 1], [-1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 0, 1]]", &["frame 0", "rotation"]),
        (OPENGL_POSE, "[[0, 0, -1, 1], [-1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 1, 1]]", &["last row"]),
        (OPENGL_POSE, "[[0, 0, -1, 1], [-1, 0, 2]]", &["4 rows"]),
        (OPENGL_POSE, "[[NaN, 0, -1, 1]]", &["line 1"]),
        (OPENGL_POSE, "[[0, 0, -1, 1e999], [-1, 0, 0, 2], [0, 1, 0, 3]]", &["line 1"]),
        (r#""fl_x": 20,"#, "", &["no focal length", "fl_x"]),
        (r#""fl_x": 20,"#, r#""fl_x": -20,"#, &["focal lengths above 0"]),
        (r#""w": 40"#, r#""w": 0"#, &["size above 0"]),
        (r#""w": 40"#, r#""w": 1e12"#, &["whole numbers"]),
        (r#""w": 40"#, r#""camera_model": "OPENCV_FISHEYE", "w": 40"#, &["OPENCV_FISHEYE", "pinhole"]),
        (r#""w": 40"#, r#""is_fisheye": true, "w": 40"#, &["frame 0", "is_fisheye", "pinhole", "undistort"]),
        (r#""w": 40"#, r#""is_fisheye": true, "k1": 0, "k2": 0, "w": 40"#, &["is_fisheye", "pinhole"]),
        (r#""w": 40"#, r#""is_fisheye": 1, "w": 40"#, &["is_fisheye", "pinhole"]),
        (r#""transform"#, r#""is_fisheye": true, "transform"#, &["is_fisheye", "pinhole"]),
        (r#""w": 40"#, r#""ftheta_p0": 0, "w": 40"#, &["ftheta_p0", "pinhole"]),
        (r#""w": 40"#, r#""latlong": true, "w": 40"#, &["latlong", "pinhole"]),
        (r#""w": 40"#, r#""equirectangular": true, "w": 40"#, &["equirectangular", "pinhole"]),
        (r#""w": 40"#, r#""w": "40""#, &["frame 0 (images/a.png)", "w \"40\"", "a number"]),
        (r#""cx": 21"#, r#""cx": [21]"#, &["frame 0", "cx [21]", "a number"]),
        (r#""transform"#, r#""k1": "0", "transform"#, &["frame 0", "k1 \"0\"", "a number"]),
        (r#""w": 40"#, r#""camera_model": 4, "w": 40"#, &["camera model 4", "pinhole"]),
        (OPENGL_POSE, "[[null, 0, -1, 1], [-1, 0, 0, 2], [0, 1, 0, 3]]", &["frame 0", "[[null,0,", "4 rows"]),
        (OPENGL_POSE, "[[NaN, 0, -1, 1]]", &["has no NaN"]),
        ("frames", "phrames", &["frames: found none"]),
        ("[{", "[{}, {", &["frame 0 (0)", "no transform_matrix"]),
    ] {
        assert!(good.contains(from), "{from}");
        let folder = folder(&[("transforms.json", good.replacen(from, to, 1).as_bytes())]);
        check_error(folder.path(), &[&["transforms.json"], parts].concat());
    }
    let folder = folder(&[("transforms.json", br#"{"frames": []}"#)]);
    check_error(folder.path(), &["none", "at least one"]);
}

#[test]
fn angles_of_view_are_radians() {
    for (key, angle) in [("x", "65.2"), ("y", "65.2"), ("x", "3.1416"), ("x", "0"), ("y", "-1")] {
        let length = format!(r#""fl_{key}": {},"#, if key == "x" { 20 } else { 10 });
        let lens = LENS.replace(&length, &format!(r#""camera_angle_{key}": {angle}, "#));
        assert_ne!(lens, LENS);
        let folder = folder(&[("transforms.json", transforms(&lens, "").as_bytes())]);
        let found = format!("camera_angle_{key} {angle}");
        check_error(folder.path(), &["transforms.json", "frame 0", &found, "radians, above 0 and below pi"]);
    }
    // It does not matter beside a focal length.
    let lens = format!(r#"{LENS} "camera_angle_x": 65.2, "#);
    let folder = folder(&[("transforms.json", transforms(&lens, "").as_bytes())]);
    check_fixture(&read_cameras(folder.path()).unwrap().cameras[0].camera, Vec2::new(21.0, 14.0));
}

/// instant-ngp's converter writes the key for every lens.
#[test]
fn a_lens_that_is_no_fisheye_is_a_pinhole() {
    for key in [r#""is_fisheye": false,"#, r#""is_fisheye": 0,"#, r#""is_fisheye": null,"#] {
        let folder = folder(&[("transforms.json", transforms(&format!("{key} {LENS}"), "").as_bytes())]);
        check_fixture(&read_cameras(folder.path()).unwrap().cameras[0].camera, Vec2::new(21.0, 14.0));
    }
}

#[test]
fn distortion_is_a_warning() {
    let json = transforms(&format!(r#"{LENS} "k1": 0.1, "#), r#""camera_model": "OPENCV", "#);
    let folder = folder(&[("transforms.json", json.as_bytes())]);
    let set = read_cameras(folder.path()).unwrap();
    assert!(set.warnings[0].contains("distortion of 1 cameras"), "{:?}", set.warnings);
}

#[test]
fn photos_are_missed_only_when_demanded() {
    let folder = folder(&[("transforms.json", transforms(LENS, "").as_bytes())]);
    let camera = &read_cameras(folder.path()).unwrap().cameras[0];
    let message = camera.require_photo().unwrap_err().to_string();
    assert!(message.contains("images/a.png"), "{message}");
}

/// The same pose in OpenCV axes: columns right, down (0, 0, -1), forward (1, 0, 0).
#[test]
fn cameras_json_of_3dgs_trainers() {
    let json = br#"[{"id": 0, "img_name": "a", "width": 40, "height": 30, "position": [1, 2, 3],
        "rotation": [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], "fy": 10, "fx": 20}]"#;
    let folder = folder(&[("cameras.json", json), ("images/a.JPG", b"")]);
    let set = read_cameras(folder.path()).unwrap();
    check_fixture(&set.cameras[0].camera, Vec2::new(20.0, 15.0));
    assert_eq!(set.cameras[0].require_photo().unwrap(), folder.path().join("images/a.JPG"));
    let broken = String::from_utf8_lossy(json).replace("fx", "f");
    fs::write(folder.path().join("cameras.json"), broken).unwrap();
    check_error(folder.path(), &["cameras.json", "camera 0", "missing field `fx`"]);
}

/// View from world of the fixture: rows right (0, -1, 0), down (0, 0, -1), forward (1, 0, 0), that is the
/// quaternion w, x, y, z = (0.5, 0.5, -0.5, 0.5); translation -R position = (2, 3, -1).
const COLMAP_POSE: [f64; 7] = [0.5, 0.5, -0.5, 0.5, 2.0, 3.0, -1.0];

const CAMERAS_TXT: &str = "# cameras\n\n3 PINHOLE 40 30 20 10 21 14\n";

fn images_txt() -> String {
    let [qw, qx, qy, qz, tx, ty, tz] = COLMAP_POSE;
    format!(
        "# images\n# more\n7 {qw} {qx} {qy} {qz} {tx} {ty} {tz} 3 b c.jpg\n1.5 2.5 -1 3 4 9\n\
         2 {qw} {qx} {qy} {qz} {tx} {ty} {tz} 3 a.jpg\n\n"
    )
}

#[test]
fn colmap_text() {
    let files =
        [("sparse/0/cameras.txt", CAMERAS_TXT.as_bytes()), ("sparse/0/images.txt", images_txt().as_bytes())]
            .map(|(name, bytes)| (name, bytes.to_owned()));
    let files = files.each_ref().map(|(name, bytes)| (*name, bytes.as_slice()));
    let folder = folder(&files);
    fs::create_dir(folder.path().join("images")).unwrap();
    fs::write(folder.path().join("images/a.jpg"), b"").unwrap();
    for path in ["", "sparse", "sparse/0", "sparse/0/images.txt"] {
        let set = read_cameras(&folder.path().join(path)).unwrap();
        assert_eq!(set.cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["a.jpg", "b c.jpg"]);
        check_fixture(&set.cameras[0].camera, Vec2::new(21.0, 14.0));
        check_fixture(&set.cameras[1].camera, Vec2::new(21.0, 14.0));
        assert!(set.cameras[0].require_photo().is_ok());
        assert!(set.cameras[1].require_photo().unwrap_err().to_string().contains("b c.jpg"));
    }
    check_error(&folder.path().join("images"), &["images", "found no cameras", "COLMAP"]);
}

#[test]
fn what_colmap_text_must_not_say() {
    let (good_cameras, good_images) = (CAMERAS_TXT.to_owned(), images_txt());
    for (from, to, parts) in [
        ("PINHOLE", "OPENCV_FISHEYE", &["4 parameters", "OPENCV_FISHEYE"][..]),
        ("PINHOLE 40 30 20 10 21 14", "FOV 40 30 20 10 21 14 0.1", &["FOV", "pinhole"]),
        ("PINHOLE", "HOLE", &["cameras.txt", "line 3", "HOLE"]),
        ("40", "-40", &["line 3", "`-40`", "width"]),
        ("21 14", "21", &["3 parameters"]),
        ("3 PINHOLE", "4 PINHOLE", &["images.txt", "a.jpg", "camera 3"]),
        ("0.5", "zero", &["images.txt", "line 3", "`zero`"]),
        ("0.5 0.5 -0.5 0.5", "0 0 0 0", &["b c.jpg", "quaternion"]),
        ("0.5 0.5", "nan 0.5", &["b c.jpg", "quaternion"]),
        ("3 b c.jpg", "3", &["line 3", "name"]),
    ] {
        assert!(good_cameras.contains(from) || good_images.contains(from), "{from}");
        let cameras = good_cameras.replacen(from, to, 1);
        let images =
            if cameras == good_cameras { good_images.replacen(from, to, 1) } else { good_images.clone() };
        let folder = folder(&[("cameras.txt", cameras.as_bytes()), ("images.txt", images.as_bytes())]);
        check_error(folder.path(), parts);
    }
}

/// cameras.bin and images.bin with one camera of model number `model` and one image with two points.
fn binaries(model: i32, parameters: &[f64]) -> (Vec<u8>, Vec<u8>) {
    let mut cameras = 1u64.to_le_bytes().to_vec();
    cameras.extend(3u32.to_le_bytes());
    cameras.extend(model.to_le_bytes());
    cameras.extend([40u64, 30].into_iter().flat_map(u64::to_le_bytes));
    cameras.extend(parameters.iter().flat_map(|x| x.to_le_bytes()));
    let mut images = 1u64.to_le_bytes().to_vec();
    images.extend(9u32.to_le_bytes());
    images.extend(COLMAP_POSE.iter().flat_map(|x| x.to_le_bytes()));
    images.extend(3u32.to_le_bytes());
    images.extend(b"a.jpg\0");
    images.extend(2u64.to_le_bytes());
    images.extend([0; 48]);
    (cameras, images)
}

#[test]
fn colmap_binary() {
    let (cameras, images) = binaries(1, &[20.0, 10.0, 21.0, 14.0]);
    let folder = folder(&[("cameras.bin", &cameras), ("images.bin", &images)]);
    let set = read_cameras(folder.path()).unwrap();
    check_fixture(&set.cameras[0].camera, Vec2::new(21.0, 14.0));
    assert_eq!(set.cameras[0].name, "a.jpg");
}

#[test]
fn distorted_colmap_lenses_are_taken_as_pinholes_with_a_warning() {
    for (model, parameters, n_warnings) in [
        (0, &[20.0, 21.0, 14.0][..], 0),
        (2, &[20.0, 21.0, 14.0, 0.01], 1),
        (3, &[20.0, 21.0, 14.0, 0.0, 0.0], 0),
        (4, &[20.0, 10.0, 21.0, 14.0, 0.0, 0.0, 0.0, 0.1], 1),
    ] {
        let (cameras, images) = binaries(model, parameters);
        let folder = folder(&[("cameras.bin", &cameras), ("images.bin", &images)]);
        let set = read_cameras(folder.path()).unwrap();
        assert_eq!(set.warnings.len(), n_warnings, "{:?}", set.warnings);
        assert_eq!(set.cameras[0].camera.focal.x, 20.0);
        assert_eq!(set.cameras[0].camera.center, Vec2::new(21.0, 14.0));
    }
}

#[test]
fn truncated_and_lying_colmap_binaries() {
    let (cameras, images) = binaries(1, &[20.0, 10.0, 21.0, 14.0]);
    for n in 0..cameras.len() {
        let folder = folder(&[("cameras.bin", &cameras[..n]), ("images.bin", &images)]);
        check_error(folder.path(), &["cameras.bin", "cut off"]);
    }
    for n in 0..images.len() {
        let folder = folder(&[("cameras.bin", &cameras), ("images.bin", &images[..n])]);
        check_error(folder.path(), &["images.bin", "cut off"]);
    }
    // Counts that no file could hold.
    let mut lying = images.clone();
    lying[..8].fill(0xff);
    check_error(
        folder(&[("cameras.bin", &cameras), ("images.bin", &lying)]).path(),
        &["images.bin", "cut off"],
    );
    let mut lying = images.clone();
    let points = images.len() - 56;
    lying[points..points + 8].fill(0xff);
    check_error(
        folder(&[("cameras.bin", &cameras), ("images.bin", &lying)]).path(),
        &["images.bin", "cut off"],
    );
    let (fisheye, _) = binaries(8, &[20.0, 21.0, 14.0, 0.0]);
    let folder = folder(&[("cameras.bin", &fisheye), ("images.bin", &images)]);
    check_error(folder.path(), &["SIMPLE_RADIAL_FISHEYE", "pinhole"]);
}

#[test]
fn neither_a_capture_nor_a_file() {
    check_error(folder(&[("notes.txt", b"")]).path(), &["found no cameras", "transforms.json"]);
    check_error(&folder(&[("notes.txt", b"")]).path().join("notes.txt"), &["notes.txt", "found no cameras"]);
    check_error(Path::new("/no/such/place"), &["/no/such/place"]);
}
