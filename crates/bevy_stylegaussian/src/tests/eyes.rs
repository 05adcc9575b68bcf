//! Two cameras as the eyes of one head, and cameras that leave splats out.

use bevy::prelude::*;

use crate::{SplatCuts, SplatEyes};

use super::{
    pictures::{EYE, SIZE, Studio, check_picture, reference, translucent},
    world::{rendering::*, *},
};

/// Either eye sees what a camera at its place sees, whichever camera names the other and whichever draws first.
/// An eye that is alone again, too.
#[test]
fn each_eye_sees_its_own_picture() {
    let Some(mut studio) = Studio::new() else { return };
    let scene = balls(&translucent(80, 21));
    let places = [EYE - 0.2 * Vec3::X, EYE + 0.2 * Vec3::X];
    let other = render_target(&mut studio.app, SIZE);
    let last = Camera { clear_color: Color::BLACK.into(), order: 1, ..default() };
    let eyes =
        [studio.camera(places[0], (Msaa::Off, last)), studio.camera_on(&other, places[1], Msaa::Sample4)];
    studio.splats(scene.clone(), Transform::default());
    let check = |studio: &mut Studio, what: &str| {
        check_picture(&format!("first, {what}"), &studio.shoot(), &reference(&scene, places[0]));
        check_picture(&format!("second, {what}"), &studio.shoot_on(&other), &reference(&scene, places[1]));
    };
    check(&mut studio, "by itself");
    for names in [[true, false], [false, true], [true, true]] {
        for i in [0, 1] {
            let mut eye = studio.app.world_mut().entity_mut(eyes[i]);
            if names[i] {
                eye.insert(SplatEyes(eyes[1 - i]));
            } else {
                eye.remove::<SplatEyes>();
            }
        }
        check(&mut studio, &format!("names the other: {names:?}"));
    }
    studio.app.world_mut().despawn(eyes[0]);
    check_picture("alone again", &studio.shoot_on(&other), &reference(&scene, places[1]));
    // Nor does a camera that names itself take harm.
    studio.app.world_mut().entity_mut(eyes[1]).insert(SplatEyes(eyes[1]));
    check_picture("its own other", &studio.shoot_on(&other), &reference(&scene, places[1]));
}

/// A camera that leaves faint splats out shows the others, and another camera shows all.
#[test]
fn cuts_are_each_camera_s_own() {
    let Some(mut studio) = Studio::new() else { return };
    let all = translucent(80, 22);
    let strong: Vec<Ball> = all.iter().filter(|ball| ball.opacity >= 0.7).copied().collect();
    assert!((10..70).contains(&strong.len()), "{} strong", strong.len());
    let other = render_target(&mut studio.app, SIZE);
    studio.camera(EYE, (Msaa::Off, SplatCuts { least_opacity: 0.7, ..default() }));
    studio.camera_on(&other, -EYE, Msaa::Off);
    studio.splats(balls(&all), Transform::default());
    check_picture("with cuts", &studio.shoot(), &reference(&balls(&strong), EYE));
    check_picture("without", &studio.shoot_on(&other), &reference(&balls(&all), -EYE));
}
