//! Numbers by hand, and limits that hold for every color.

use glam::Affine3A;

use super::*;

const DISPLAYS: [Display; 3] = [
    Display { curve: Curve::Linear, exposure: 0.0 },
    Display { curve: Curve::Reinhard, exposure: 1.5 },
    Display { curve: Curve::ReinhardLuminance, exposure: -1.0 },
];

const COLORS: [Vec3; 6] = [
    Vec3::ZERO,
    Vec3::new(0.2, 0.5, 0.1),
    Vec3::new(0.9, 0.3, 0.6),
    Vec3::ONE,
    // Styled colors go beyond what a display shows.
    Vec3::new(1.4, 0.7, 0.2),
    Vec3::new(-0.3, 0.4, 0.0),
];

fn fog(falloff: Falloff) -> Fog {
    Fog { color: Vec3::new(0.5, 0.6, 0.7), strength: 1.0, falloff, suns: Vec::new(), exponent: 8.0 }
}

#[track_caller]
fn near(found: Vec3, expected: Vec3, tolerance: f32) {
    assert!((found - expected).abs().max_element() <= tolerance, "found {found}, expected {expected}");
}

#[test]
fn nothing_changes_without_tint_and_air() {
    assert_eq!(Tint::IDENTITY.matrix(), None);
    assert_eq!(Tint { exposure: f32::NAN, ..Tint::IDENTITY }.matrix(), None);
    for display in DISPLAYS {
        let lit = Lit { tint: Mat3::IDENTITY, shade: 1.0, air: Air::CLEAR, display };
        for color in COLORS {
            near(lit.color(color), color, 1e-6);
            assert!((lit.contrast(color) - 1.0).abs() < 1e-4);
        }
    }
}

/// Where only fog is seen, splats have its color, whatever theirs is, and no strokes.
#[test]
fn full_fog_hides_everything() {
    let wall = fog(Falloff::Linear { start: 1.0, end: 3.0 });
    for display in DISPLAYS {
        let lit =
            Lit { tint: Mat3::IDENTITY, shade: 1.0, air: wall.along(Vec3::new(0.0, 3.0, -4.0)), display };
        for color in COLORS {
            near(lit.color(color), display.shown(wall.color), 1e-6);
            assert_eq!(lit.contrast(color), 0.0);
        }
    }
}

/// Half of the light of white, through a display without a curve: 0.5 as sRGB is 0.7354.
#[test]
fn tints_are_linear_light() {
    let shown = |tint: Tint, color: Vec3| {
        let lit = Lit { tint: tint.matrix().unwrap(), shade: 1.0, air: Air::CLEAR, display: DISPLAYS[0] };
        lit.color(color)
    };
    let darker = Tint { exposure: -1.0, ..Tint::IDENTITY };
    near(shown(darker, Vec3::ONE), Vec3::splat(0.7354), 1e-4);
    let red = Tint { color: Vec3::new(1.0, 0.5, 0.0), ..Tint::IDENTITY };
    near(shown(red, Vec3::ONE), Vec3::new(1.0, 0.7354, 0.0), 1e-4);
    // Pure green has the luminance 0.7152, as sRGB 0.8625.
    let gray = Tint { saturation: 0.0, ..Tint::IDENTITY };
    near(shown(gray, Vec3::Y), Vec3::splat(0.8625), 1e-4);
    assert!(Tint { color: Vec3::splat(-2.0), ..Tint::IDENTITY }.matrix().unwrap() == Mat3::ZERO);
}

#[test]
fn falloffs_by_hand() {
    // At a distance of 5.
    let ray = Vec3::new(0.0, 3.0, -4.0);
    let check = |falloff, lost: Vec3, added: Vec3| {
        let half = Fog { strength: 0.5, ..fog(falloff) };
        near(half.along(ray).transmission, 1.0 - 0.5 * lost, 1e-5);
        near(half.along(ray).light, 0.5 * added * half.color, 1e-5);
    };
    let all = Vec3::splat;
    check(Falloff::Linear { start: 4.0, end: 8.0 }, all(0.25), all(0.25));
    check(Falloff::Linear { start: 5.5, end: 5.5 }, all(0.0), all(0.0));
    check(Falloff::Linear { start: 4.5, end: 4.5 }, all(1.0), all(1.0));
    // exp(-1) and exp(-0.25).
    check(Falloff::Exponential { density: 0.2 }, all(0.632_121), all(0.632_121));
    check(Falloff::ExponentialSquared { density: 0.1 }, all(0.221_199), all(0.221_199));
    let (extinction, inscattering) = (Vec3::new(0.2, 0.05, 0.0), Vec3::new(0.0, 0.2, 0.05));
    let atmospheric = Falloff::Atmospheric { extinction, inscattering };
    check(atmospheric, Vec3::new(0.632_121, 0.221_199, 0.0), Vec3::new(0.0, 0.632_121, 0.221_199));
}

#[test]
fn suns_glow_in_fog() {
    let sun = Sun { direction: Vec3::NEG_Z, glow: Vec3::new(2.0, 1.0, 0.0) };
    let fog = Fog { suns: vec![sun], exponent: 2.0, ..fog(Falloff::Linear { start: 0.0, end: 1.0 }) };
    near(fog.along(5.0 * Vec3::NEG_Z).light, fog.color + sun.glow, 1e-6);
    // A cosine of 0.8.
    near(fog.along(Vec3::new(0.0, 3.0, -4.0)).light, fog.color + 0.64 * sun.glow, 1e-5);
    near(fog.along(5.0 * Vec3::Z).light, fog.color, 1e-6);
}

/// A map that looks down from 10 above: 4 units wide, 20 deep, nearest at the top.
#[test]
fn shadow_maps_are_looked_up() {
    // Right is x, up is -z: the light looks along -y.
    let to_light = glam::Mat4::look_to_rh(Vec3::new(0.0, 10.0, 0.0), Vec3::NEG_Y, Vec3::NEG_Z);
    let clip_from_point = glam::Mat4::orthographic_rh(-2.0, 2.0, -2.0, 2.0, 20.0, 0.0) * to_light;
    let cascade = ShadowCascade { clip_from_point, offset: 0.5 * Vec3::Y, far: 7.0 };
    near(cascade.place(Vec3::new(1.0, 4.5, -1.0)).unwrap(), Vec3::new(0.75, 0.25, 0.75), 1e-6);
    assert_eq!(cascade.place(Vec3::new(2.5, 4.5, 0.0)), None);
    assert_eq!(cascade.place(Vec3::new(0.0, 9.6, 0.0)), None);
    let cascades = [cascade, ShadowCascade { far: 20.0, ..cascade }];
    assert_eq!([6.9, 7.0, 20.0].map(|depth| ShadowCascade::at(&cascades, depth)), [Some(0), Some(1), None]);
    assert_eq!([in_shadow(0.75, 0.0), in_shadow(0.75, 1.0), in_shadow(0.0, 0.0)], [0.25, 1.0, 1.0]);
}

/// A lamp at height 4 that shines down. Half way to its range, 1 - 1/16 squared of it is left.
#[test]
fn lamps_reach_as_far_as_their_light() {
    let light_from_point = Affine3A::look_at_rh(4.0 * Vec3::Y, Vec3::ZERO, Vec3::Z);
    let cone = Cone { inner: 0.0, outer: std::f32::consts::FRAC_PI_3 };
    let spot = ShadowLamp {
        light_from_point,
        range: 8.0,
        near: 0.1,
        depth_bias: 0.0,
        normal_bias: 0.0,
        cone: Some(cone),
        map: 0,
    };
    let window = (1.0 - 1.0 / 16.0_f32).powi(2);
    let check = |found: Option<(f32, f32)>, share: f32, depth: f32| {
        let (found_share, found_depth) = found.unwrap();
        assert!((found_share - share).abs() < 1e-5 && (found_depth - depth).abs() < 1e-6, "{found:?}");
    };
    check(spot.reach(Vec3::ZERO), window, 0.1 / 4.0);
    // 4 away at 45 degrees: a share of (sqrt(1/2) - 1/2) / (1 - 1/2) of the root.
    let aside = Vec3::new(8.0_f32.sqrt(), 4.0 - 8.0_f32.sqrt(), 0.0);
    check(spot.reach(aside), window * (2.0 * (0.5_f32.sqrt() - 0.5)).powi(2), 0.1 / 8.0_f32.sqrt());
    let [beside, behind, beyond, close] =
        [Vec3::new(9.0, 0.0, 0.0), 5.0 * Vec3::Y, -5.0 * Vec3::Y, 3.95 * Vec3::Y];
    for outside in [beside, behind, beyond, close, 4.0 * Vec3::Y] {
        assert_eq!(spot.reach(outside), None, "{outside}");
    }
    // A point light sees what is behind, and compares the largest coordinate: here 3 of (3, 2).
    let point = ShadowLamp { cone: None, ..spot };
    check(point.reach(6.0 * Vec3::Y), (1.0 - (0.25_f32).powi(4)).powi(2), 0.1 / 2.0);
    assert!((point.reach(Vec3::new(3.0, 2.0, 0.0)).unwrap().1 - 0.1 / 3.0).abs() < 1e-6);
    // Both biases lead to the lamp: 0.3 and 0.05 of 4.
    let biased = ShadowLamp { depth_bias: 0.3, normal_bias: 0.05, ..spot };
    check(biased.reach(Vec3::ZERO), window, 0.1 / 3.5);
}

#[test]
fn the_srgb_curve_has_its_values_and_its_inverse() {
    // 0.5 is 188/255 on a display, give or take; 1 stays 1.
    assert!((srgb_from_linear(0.5) - 0.735_357).abs() < 1e-6);
    assert!((srgb_from_linear(1.0) - 1.0).abs() < 1e-6);
    for linear in [-0.5, 0.0, 0.001, 0.01, 0.2, 0.9, 1.5] {
        assert!((linear_from_srgb(srgb_from_linear(linear)) - linear).abs() < 2e-6, "{linear}");
    }
}
