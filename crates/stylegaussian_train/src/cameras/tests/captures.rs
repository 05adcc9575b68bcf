//! One capture of three marks by four cameras, as many programs write it: `data`, made for these tests.
//!
//! Each camera must see the marks at the same pixels, to 0.01 of a pixel.

use super::*;

const TRANSFORMS: &str = include_str!("data/transforms.json");
const CAMERAS_JSON: &str = include_str!("data/cameras.json");
const CAMERAS_TXT: &str = include_str!("data/cameras.txt");
const IMAGES_TXT: &str = include_str!("data/images.txt");
/// Pixels `[camera, mark, 2]`, for focal lengths of 500 and 480 pixels and the principal point (250, 300).
const EXPECTED: &str = include_str!("data/expected.json");

const MARKS: [Vec3; 3] = [Vec3::new(0.4, 0.1, 0.2), Vec3::new(-0.5, 0.3, -0.1), Vec3::new(0.1, -0.4, 0.5)];

/// Checks a set whose lenses may have another focal length and principal point.
#[track_caller]
fn check_lens(set: &CameraSet, focal: Vec2, center: Vec2) {
    let expected: Vec<[[f32; 2]; 3]> = serde_json::from_str(EXPECTED).unwrap();
    assert_eq!(set.cameras.len(), expected.len());
    for (posed, expected) in set.cameras.iter().zip(&expected) {
        assert_eq!(posed.camera.size, UVec2::new(640, 480));
        for (mark, expected) in MARKS.iter().zip(expected) {
            let direction = (Vec2::from(*expected) - Vec2::new(250.0, 300.0)) / Vec2::new(500.0, 480.0);
            let (found, expected) = (pixel(&posed.camera, *mark), focal * direction + center);
            assert!((found - expected).length() < 0.01, "{}: {found}, expected {expected}", posed.name);
        }
    }
}

#[track_caller]
fn check(set: &CameraSet) {
    check_lens(set, Vec2::new(500.0, 480.0), Vec2::new(250.0, 300.0));
}

#[track_caller]
fn check_folder(files: &[(&str, &[u8])]) -> CameraSet {
    let set = read_cameras(folder(files).path()).unwrap();
    check(&set);
    set
}

/// Points of an image, which its program left out.
fn without_blank_lines(text: &str) -> String {
    text.lines().filter(|line| !line.trim().is_empty()).map(|line| format!("{line}\n")).collect()
}

fn utf16(text: &str, bytes: fn(u16) -> [u8; 2]) -> Vec<u8> {
    std::iter::once(0xFEFF).chain(text.encode_utf16()).flat_map(bytes).collect()
}

#[test]
fn byte_order_marks_are_no_content() {
    let marked = |text: &str| [&b"\xEF\xBB\xBF"[..], text.as_bytes()].concat();
    check_folder(&[("transforms.json", TRANSFORMS.as_bytes())]);
    check_folder(&[("transforms.json", &marked(TRANSFORMS))]);
    check_folder(&[("transforms.json", &utf16(TRANSFORMS, u16::to_le_bytes))]);
    check_folder(&[("transforms.json", &utf16(TRANSFORMS, u16::to_be_bytes))]);
    check_folder(&[("cameras.txt", &marked(CAMERAS_TXT)), ("images.txt", &marked(IMAGES_TXT))]);
    let set = read_cameras(folder(&[("cameras.json", &marked(CAMERAS_JSON))]).path()).unwrap();
    check_lens(&set, Vec2::new(500.0, 480.0), Vec2::new(320.0, 240.0));
}

#[test]
fn a_folder_of_transforms_for_training() {
    let other = transforms(LENS, "");
    check_folder(&[
        ("transforms_test.json", other.as_bytes()),
        ("transforms_train.json", TRANSFORMS.as_bytes()),
    ]);
    // All cameras together are better than a part of them.
    check_folder(&[("transforms.json", TRANSFORMS.as_bytes()), ("transforms_train.json", other.as_bytes())]);
}

/// The format has no principal point, and its sizes are floats here.
#[test]
fn sizes_may_be_written_as_floats() {
    assert!(CAMERAS_JSON.contains("640.0"));
    for text in [CAMERAS_JSON.to_owned(), CAMERAS_JSON.replace("640.0", "640").replace("480.0,", "480,")] {
        let set = read_cameras(folder(&[("cameras.json", text.as_bytes())]).path()).unwrap();
        check_lens(&set, Vec2::new(500.0, 480.0), Vec2::new(320.0, 240.0));
    }
    let half = CAMERAS_JSON.replace("640.0", "640.5");
    check_error(folder(&[("cameras.json", half.as_bytes())]).path(), &["size 640.5 x 480", "whole numbers"]);
    let floats = CAMERAS_TXT.replace("640 480", "640.0 480.0");
    assert_ne!(floats, CAMERAS_TXT);
    check_folder(&[("cameras.txt", floats.as_bytes()), ("images.txt", IMAGES_TXT.as_bytes())]);
    let half = CAMERAS_TXT.replace("640 480", "640.5 480");
    check_error(
        folder(&[("cameras.txt", half.as_bytes()), ("images.txt", IMAGES_TXT.as_bytes())]).path(),
        &["cameras.txt", "`640.5`", "width"],
    );
}

#[test]
fn images_without_lines_for_points() {
    let dense = without_blank_lines(IMAGES_TXT);
    // Points of the first image alone, of the last alone, and names that look like numbers.
    let line = dense.lines().nth(2).unwrap();
    let first = dense.replacen(line, &format!("{line}\n1.5 2.5 -1 3 4 9"), 1);
    let last = format!("{dense}1 2 -1 3 4 9 5 6 7 8 9 10\n");
    let numbered = dense.replace(".png", "");
    for text in [IMAGES_TXT.to_owned(), dense, first, last, numbered] {
        check_folder(&[("cameras.txt", CAMERAS_TXT.as_bytes()), ("images.txt", text.as_bytes())]);
    }
}

#[test]
fn the_model_with_most_images_is_taken() {
    let small: String = IMAGES_TXT.lines().take(4).map(|line| format!("{line}\n")).collect();
    let model = |number: usize, images: &str| {
        let name = |file: &str| format!("sparse/{number}/{file}");
        [(name("cameras.txt"), CAMERAS_TXT.to_owned()), (name("images.txt"), images.to_owned())]
    };
    let read = |models: &[(usize, &str)], prefix: &str| {
        let files: Vec<(String, String)> = models.iter().flat_map(|(n, images)| model(*n, images)).collect();
        let files: Vec<(String, &[u8])> =
            files.iter().map(|(name, text)| (format!("{prefix}{name}"), text.as_bytes())).collect();
        let files: Vec<(&str, &[u8])> = files.iter().map(|(name, text)| (name.as_str(), *text)).collect();
        let folder = folder(&files);
        let set = read_cameras(folder.path()).unwrap();
        // The folder of the models shows the same.
        assert_eq!(read_cameras(&folder.path().join(format!("{prefix}sparse"))).unwrap(), set);
        set
    };
    for prefix in ["", "colmap/"] {
        for models in [&[(0, small.as_str()), (1, IMAGES_TXT)], &[(2, small.as_str()), (10, IMAGES_TXT)]] {
            let set = read(models, prefix);
            check(&set);
            let part = format!("took {}, which has the most images: 4 of 5", models[1].0);
            assert!(set.warnings.len() == 1 && set.warnings[0].contains(&part), "{:?}", set.warnings);
        }
        // Of equals, the first.
        let set = read(&[(1, IMAGES_TXT), (2, IMAGES_TXT)], prefix);
        check(&set);
        let part = "took 1, the first of those with the most images: 4 of 8";
        assert!(set.warnings.len() == 1 && set.warnings[0].contains(part), "{:?}", set.warnings);
        // A model that cannot be read is none.
        let set = read(&[(0, "1 1 0 0"), (1, IMAGES_TXT)], prefix);
        check(&set);
        let set = read(&[(0, IMAGES_TXT)], prefix);
        check(&set);
        assert_eq!(set.warnings, [""; 0]);
    }
}

/// The folder of a capture, of nerfstudio and of COLMAP's automatic reconstruction.
#[test]
fn models_in_the_folders_colmap_and_dense() {
    for (model, photo) in [
        ("colmap/sparse/0", "images/000.png"),
        ("colmap/sparse", "images/000.png"),
        ("dense/sparse", "dense/images/000.png"),
        ("dense/0/sparse", "dense/0/images/000.png"),
    ] {
        let (cameras, images) = (format!("{model}/cameras.txt"), format!("{model}/images.txt"));
        let folder = folder(&[
            (cameras.as_str(), CAMERAS_TXT.as_bytes()),
            (images.as_str(), IMAGES_TXT.as_bytes()),
            (photo, b""),
        ]);
        let set = read_cameras(folder.path()).unwrap();
        check(&set);
        let found = set.cameras[0].require_photo().unwrap().canonicalize().unwrap();
        assert_eq!(found, folder.path().canonicalize().unwrap().join(photo));
    }
}

#[test]
fn cameras_with_an_angle_alone_take_a_given_size() {
    // tan(angle / 2) = 0.4, so that half of 640 pixels is 0.4 of the focal length: 800.
    let angle = 2.0 * 0.4_f64.atan();
    let start = TRANSFORMS.find("\"frames\"").unwrap();
    let text = format!("{{\"camera_angle_x\": {angle}, {}", &TRANSFORMS[start..]);
    let folder = folder(&[("transforms.json", text.as_bytes())]);
    check_error(folder.path(), &["size", "images/000.png"]);
    let set = read_cameras_with(folder.path(), of_size(640, 480)).unwrap();
    check_lens(&set, Vec2::splat(800.0), Vec2::new(320.0, 240.0));
    let part = "4 cameras have neither w and h nor a photo, their pictures are taken as 640x480";
    assert!(set.warnings.len() == 1 && set.warnings[0].contains(part), "{:?}", set.warnings);
    // A photo's size goes before.
    fs::create_dir(folder.path().join("images")).unwrap();
    image::RgbImage::new(64, 48).save(folder.path().join("images/000.png")).unwrap();
    let set = read_cameras_with(folder.path(), of_size(640, 480)).unwrap();
    assert_eq!(set.cameras[0].camera.size, UVec2::new(64, 48));
    assert_eq!(set.cameras[1].camera.size, UVec2::new(640, 480));
    // A size in the file is not replaced.
    check(&read_cameras_with(folder_of(TRANSFORMS).path(), of_size(8, 8)).unwrap());
}

fn of_size(width: u32, height: u32) -> CameraOptions {
    CameraOptions { size: Some(UVec2::new(width, height)), ..CameraOptions::default() }
}

fn folder_of(transforms: &str) -> TempDir {
    folder(&[("transforms.json", transforms.as_bytes())])
}
