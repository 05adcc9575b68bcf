//! Photos by names of other machines, and photos that are missing.

use super::*;

/// Cameras with these photos' names, in a folder with these files.
fn read(names: &[&str], files: &[&str]) -> (TempDir, CameraSet) {
    let frames: Vec<String> = names
        .iter()
        .map(|name| {
            let name = serde_json::Value::from(*name);
            format!(r#"{{ "file_path": {name}, "transform_matrix": {OPENGL_POSE} }}"#)
        })
        .collect();
    let text = format!(r#"{{ {LENS} "frames": [{}] }}"#, frames.join(", "));
    let files: Vec<(&str, &[u8])> =
        files.iter().map(|name| (*name, &b""[..])).chain([("transforms.json", text.as_bytes())]).collect();
    let folder = folder(&files);
    let set = read_cameras(folder.path()).unwrap();
    (folder, set)
}

/// Checks the photo of a name, relative to the folder.
#[track_caller]
fn check(name: &str, files: &[&str], expected: &str) {
    let (folder, set) = read(&[name], files);
    assert_eq!(set.cameras[0].require_photo().unwrap(), folder.path().join(expected));
}

#[test]
fn photos_are_found_by_names_of_other_machines() {
    check(r"images\000.png", &["images/000.png"], "images/000.png");
    check(r".\images\000.png", &["images/000.png"], "images/000.png");
    check(r"C:\captures\garden\images\000.png", &["images/000.png"], "images/000.png");
    check("C:/captures/garden/images/000.png", &["images/000.png"], "images/000.png");
    check(r"D:\photos\000.png", &["000.png"], "000.png");
    check(r"D:\photos\000.png", &["images/000.png"], "images/000.png");
    check(r"\\server\photos\000", &["images/000.JPG"], "images/000.JPG");
    check("/home/someone/garden/images/000.png", &["images/000.png"], "images/000.png");
    check("images/000.PNG", &["images/000.png"], "images/000.png");
    check(r"D:\photos\000.jpg", &["images/000.JPG"], "images/000.JPG");
    check("../garden/000.jpeg", &["images/000.jpeg"], "images/000.jpeg");
    // The longest end of the name goes before its last part.
    check(r"C:\a\left\000.png", &["000.png", "left/000.png"], "left/000.png");
    // A name that is right is left alone.
    check("left/000.png", &["000.png", "left/000.png"], "left/000.png");
}

#[test]
fn two_names_are_two_photos() {
    let (_folder, set) = read(&[r"left\000.png", r"right\000.png", r"left\001.png"], &["000.png", "001.png"]);
    let found: Vec<bool> = set.cameras.iter().map(|posed| posed.require_photo().is_ok()).collect();
    assert_eq!(found, [false, false, true]);
    // The second is the first camera's own.
    let (_folder, set) = read(&["000.png", "right/000.png"], &["000.png"]);
    let found: Vec<bool> = set.cameras.iter().map(|posed| posed.require_photo().is_ok()).collect();
    assert_eq!(found, [true, false]);
}

#[test]
fn missing_photos_are_left_out_and_counted() {
    let names = ["images/a.png", "images/b.png", "images/c.png", "images/d.png"];
    let kept = |set: CameraSet| set.with_photos().unwrap();
    let (_folder, set) = read(&names, &names);
    assert_eq!(kept(set.clone()), set);
    let (_folder, set) = read(&names, &names[..3]);
    let set = kept(set);
    assert_eq!(set.cameras.iter().map(|posed| posed.name.as_str()).collect::<Vec<_>>(), names[..3]);
    let [warning] = &set.warnings[..] else { panic!("{:?}", set.warnings) };
    assert!(warning.contains("1 of 4 photos") && warning.contains("images/d.png"), "{warning}");
    // A folder is no photo.
    let (folder, set) = read(&names, &["images/a.png", "images/b.png", "images/c.png", "images/d.png/e.png"]);
    let set = kept(set);
    let found = format!("{} is a folder", folder.path().join("images/d.png").display());
    assert!(
        set.warnings[0].contains("1 of 4 photos") && set.warnings[0].contains(&found),
        "{:?}",
        set.warnings
    );
    // Half is enough, less is not.
    let (_folder, set) = read(&names, &names[2..]);
    assert_eq!(kept(set).cameras.len(), 2);
    let (_folder, set) = read(&names, &names[3..]);
    let error = set.with_photos().unwrap_err().to_string();
    assert!(error.contains("3 of 4 photos are missing") && error.contains("images/a.png"), "{error}");
    assert!(!error.contains('\n'), "{error}");
}
