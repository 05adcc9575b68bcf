//! Two cameras as the eyes of one head, and cameras that leave splats out.

use bevy::{
    camera::Hdr,
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    prelude::*,
    render::RenderApp,
};

use crate::splats::{Held, SplatCuts, SplatDepth, SplatEyes, SplatSortKey, SplatTonemapping};

use super::{
    pictures::{EYE, SIZE, Studio, check_picture, reference, translucent},
    world::{rendering::*, *},
};

/// Either eye sees what a camera at its place sees, whichever camera names the other and whichever draws first.
/// An eye that is alone again, too.
#[test]
fn each_eye_sees_its_own_picture() {
    let Some(mut studio) = Studio::new() else { return };
    // Three pixels apart.
    let places = [EYE - 0.2 * Vec3::X, EYE + 0.2 * Vec3::X];
    let other = render_target(&mut studio.app, SIZE);
    let last = Camera { clear_color: Color::BLACK.into(), order: 1, ..default() };
    // The order that two eyes share is by distance.
    let by = SplatSortKey::Distance;
    let eyes = [
        studio.camera(places[0], (Msaa::Off, by, last)),
        studio.camera_on(&other, places[1], (Msaa::Sample4, by)),
    ];
    studio.splats(balls(&translucent(80, 21)), Transform::default());
    let alone = [studio.shoot(), studio.shoot_on(&other)];
    let likeness = |found: &[[f32; 3]], expected: &[[f32; 3]]| {
        psnr(found, expected, |i| expected[i].iter().any(|&channel| channel > 0.02))
    };
    let apart = likeness(&alone[0], &alone[1]);
    // In the order of the middle, translucent splats of nearly the same distance may change their places.
    let same = |what: &str, found: &[[f32; 3]], expected: &[[f32; 3]]| {
        let likeness = likeness(found, expected);
        assert!(likeness >= 33.0 && likeness > apart + 6.0, "{what}: {likeness:.1} dB, apart {apart:.1}");
    };
    for names in [[true, false], [false, true], [true, true]] {
        for i in [0, 1] {
            let mut eye = studio.app.world_mut().entity_mut(eyes[i]);
            if names[i] {
                eye.insert(SplatEyes(eyes[1 - i]));
            } else {
                eye.remove::<SplatEyes>();
            }
        }
        same(&format!("first, names the other: {names:?}"), &studio.shoot(), &alone[0]);
        same(&format!("second, names the other: {names:?}"), &studio.shoot_on(&other), &alone[1]);
    }
    studio.app.world_mut().despawn(eyes[0]);
    same("alone again", &studio.shoot_on(&other), &alone[1]);
    // Nor does a camera that names itself take harm.
    studio.app.world_mut().entity_mut(eyes[1]).insert(SplatEyes(eyes[1]));
    same("its own other", &studio.shoot_on(&other), &alone[1]);
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

/// A camera that draws at half the size shows nearly what it shows at the whole, among meshes, with and without
/// MSAA and before and after tonemapping, and the whole again without. Cameras without it have nothing of it.
#[test]
fn half_the_size_is_nearly_the_whole() {
    let Some(mut studio) = Studio::new() else { return };
    let camera = studio.camera(EYE, Msaa::Off);
    studio.splats(balls(&translucent(80, 23)), Transform::default());
    studio.cuboid(Vec3::new(2.0, 2.0, 0.5), Vec3::new(-1.0, 0.5, 1.0), [0.1, 0.2, 0.9], 1.0);
    let held = |studio: &mut Studio| Held::of(studio.app.sub_app_mut(RenderApp).world_mut());
    for msaa in [Msaa::Off, Msaa::Sample4] {
        studio.app.world_mut().entity_mut(camera).insert((msaa, SplatCuts::default()));
        let whole = studio.shoot();
        let before = held(&mut studio);
        studio.app.world_mut().entity_mut(camera).insert(SplatCuts { half_size: true, ..default() });
        let half = studio.shoot();
        let likeness = psnr(&half, &whole, |i| whole[i].iter().any(|&channel| channel > 0.02));
        println!("{msaa:?}: {likeness:.1} dB");
        assert!(likeness > 26.0 && half != whole, "{msaa:?}: {likeness:.1} dB");
        assert_ne!(held(&mut studio).layers, before.layers);
        studio.app.world_mut().entity_mut(camera).remove::<SplatCuts>();
        assert!(studio.shoot() == whole, "{msaa:?}: something is left");
    }
    // Depth of splats, and what is drawn after tonemapping, are at home in the whole picture.
    let late = (Hdr, Tonemapping::TonyMcMapface, SplatTonemapping::Bypass, DebandDither::Disabled);
    studio.app.world_mut().entity_mut(camera).insert((Msaa::Off, SplatDepth::default(), late));
    for _ in 0..20 {
        studio.app.update();
    }
    let whole = studio.shoot();
    studio.app.world_mut().entity_mut(camera).insert(SplatCuts { half_size: true, ..default() });
    let likeness = psnr(&studio.shoot(), &whole, |i| whole[i].iter().any(|&channel| channel > 0.02));
    assert!(likeness > 26.0, "after tonemapping: {likeness:.1} dB");
}
