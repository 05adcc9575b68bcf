//! Cameras of scenes far from the origin of their files.

use glam::DVec3;

use super::*;

/// In meters of a national grid, where the steps of f32 are half a meter wide.
const OFFSET: DVec3 = DVec3::new(651_234.25, 4_649_776.5, 123.125);

/// The place of the fixture's camera in the file.
const PLACE: DVec3 = DVec3::new(651_235.25, 4_649_778.5, 126.125);

/// Checks the fixture's camera, of which `files` tell a far one.
#[track_caller]
fn check(files: &[(&str, &[u8])], center: Vec2) {
    let folder = folder(files);
    let options = CameraOptions { offset: OFFSET, ..CameraOptions::default() };
    let set = read_cameras_with(folder.path(), options).unwrap();
    check_fixture(&set.cameras[0].camera, center);
    // Without the offset, they stay in the file's world.
    let far = &read_cameras(folder.path()).unwrap().cameras[0].camera;
    assert!(far.position().distance(PLACE.as_vec3()) < 1.0, "{}", far.position());
}

#[test]
fn cameras_count_from_the_origin_of_a_far_scene() {
    let DVec3 { x, y, z } = PLACE;
    let pose = format!("[[0, 0, -1, {x}], [-1, 0, 0, {y}], [0, 1, 0, {z}], [0, 0, 0, 1]]");
    let json = transforms(LENS, "").replace(OPENGL_POSE, &pose);
    check(&[("transforms.json", json.as_bytes())], Vec2::new(21.0, 14.0));

    let json = format!(
        r#"[{{"id": 0, "img_name": "a", "width": 40, "height": 30, "position": [{x}, {y}, {z}],
        "rotation": [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], "fy": 10, "fx": 20}}]"#
    );
    check(&[("cameras.json", json.as_bytes())], Vec2::new(20.0, 15.0));

    // The translation is -R position, of the rows right, down and forward.
    let images = format!("7 0.5 0.5 -0.5 0.5 {y} {z} {} 3 a.jpg\n\n", -x);
    let model = [("cameras.txt", CAMERAS_TXT.as_bytes()), ("images.txt", images.as_bytes())];
    check(&model, Vec2::new(21.0, 14.0));
    let model = [("sparse/0/cameras.txt", model[0].1), ("sparse/0/images.txt", model[1].1)];
    check(&model, Vec2::new(21.0, 14.0));
}
