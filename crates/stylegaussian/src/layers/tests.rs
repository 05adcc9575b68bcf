//! Distances by hand and by search, weights, and mixes by hand.

use std::f32::consts::TAU;

use glam::{Affine3A, Quat, Vec3};

use super::*;
use crate::random::Random;

/// Every shape, none of its sizes equal.
fn shapes() -> [Shape; 9] {
    [
        Shape::Everything,
        Shape::HalfSpace,
        Shape::Ellipsoid { radii: Vec3::splat(0.7) },
        Shape::Cuboid { half_size: Vec3::new(0.3, 0.5, 0.8) },
        Shape::Cylinder { radius: 0.4, half_height: 0.7 },
        Shape::Capsule { radius: 0.3, half_length: 0.5 },
        Shape::Cone { radius: 0.5, height: 1.2 },
        Shape::Torus { major_radius: 0.8, minor_radius: 0.25 },
        Shape::Noise { size: 0.4, level: 0.5 },
    ]
}

fn point(random: &mut Random) -> Vec3 {
    Vec3::from_array([(); 3].map(|()| 4.0 * random.uniform() - 2.0))
}

#[test]
fn distances_by_hand() {
    let near = |shape: Shape, point: [f32; 3], expected: f32| {
        let found = shape.distance(Vec3::from_array(point));
        assert!((found - expected).abs() < 1e-6, "{shape:?} at {point:?}: {found}, expected {expected}");
    };
    let [_, half_space, sphere, cuboid, cylinder, capsule, cone, torus, _] = shapes();
    near(half_space, [5.0, 0.3, 1.0], 0.3);
    near(sphere, [0.0, 1.7, 0.0], 1.0);
    near(sphere, [0.0; 3], -0.7);
    near(cuboid, [0.6, 0.9, 0.0], 0.5); // 3-4-5 from the edge
    near(cuboid, [0.0; 3], -0.3);
    near(cylinder, [0.7, 1.1, 0.0], 0.5);
    near(capsule, [0.0, -1.5, 0.0], 0.7);
    near(cone, [0.0, 1.0, 0.0], 0.4); // above the tip at 0.6
    near(cone, [0.0, -1.0, 0.0], 0.4); // below the bottom at -0.6
    near(cone, [0.8, -1.0, 0.0], 0.5); // 3-4-5 from the rim
    near(torus, [0.0, 0.0, 1.3], 0.25);
    near(torus, [0.0; 3], 0.55);
    // First order: near the long end of an ellipsoid, where its surface is flat to y and z.
    near(Shape::Ellipsoid { radii: Vec3::new(2.0, 0.5, 1.0) }, [2.001, 0.0, 0.0], 0.001);
}

/// A distance changes by at most the step. Exact shapes change by all of it in some direction.
#[test]
fn distances_have_a_slope_of_at_most_one() {
    let mut random = Random::new(3);
    for shape in &shapes()[1..8] {
        for _ in 0..500 {
            let (at, step) = (point(&mut random), 1e-2);
            let of_axis = |axis: Vec3| shape.distance(at + step * axis) - shape.distance(at - step * axis);
            let gradient = Vec3::new(of_axis(Vec3::X), of_axis(Vec3::Y), of_axis(Vec3::Z)) / (2.0 * step);
            assert!(gradient.length() < 1.02, "{shape:?} at {at}: {gradient}");
        }
    }
}

#[test]
fn edges_are_soft_within_their_width() {
    let region = |softness: f32| Region {
        shape: Shape::HalfSpace,
        shape_from_scene: Affine3A::from_translation(-Vec3::Y),
        softness,
    };
    let weight = |softness: f32, y: f32| region(softness).weight(Vec3::new(3.0, y, 0.0));
    assert_eq!([weight(0.0, 0.999), weight(0.0, 1.0)], [1.0, 0.0]);
    assert_eq!([weight(0.4, 0.8), weight(0.4, 1.0), weight(0.4, 1.2)], [1.0, 0.5, 0.0]);
    // A quarter of the way through the edge: 3/16 - 2/64.
    assert!((weight(0.4, 1.1) - 0.156_25).abs() < 1e-6);
    assert_eq!(Region::EVERYWHERE.weight(Vec3::splat(1e30)), 1.0);
}

/// A shape whose size is no number holds nothing, nor do its edges.
#[test]
fn shapes_without_a_size_that_is_a_number_hold_nothing() {
    let cylinder = Shape::Cylinder { radius: f32::NAN, half_height: 1.0 };
    let capsule = Shape::Capsule { radius: 1.0, half_length: f32::NAN };
    for shape in [Shape::Cuboid { half_size: Vec3::new(1.0, f32::NAN, 1.0) }, cylinder, capsule] {
        let region = Region { shape, softness: 0.8, ..Region::EVERYWHERE };
        assert_eq!(region.weight(Vec3::splat(0.1)), 0.0, "{shape:?}");
    }
    let cube = Region { shape: Shape::Cuboid { half_size: Vec3::ONE }, softness: 0.8, ..Region::EVERYWHERE };
    assert_eq!(cube.weight(Vec3::new(0.0, f32::NAN, 0.0)), 0.0);
}

/// Volumes of no size, of infinite size, and of NaN are outside or inside, and never NaN.
#[test]
fn degenerate_regions_have_weights() {
    let mut random = Random::new(4);
    let sizes = [0.0, f32::INFINITY, f32::NAN, -1.0, f32::MIN_POSITIVE];
    let mut shapes = vec![Shape::Everything, Shape::HalfSpace];
    for a in sizes {
        for b in sizes {
            shapes.extend([
                Shape::Ellipsoid { radii: Vec3::new(a, b, 1.0) },
                Shape::Cuboid { half_size: Vec3::new(a, b, 1.0) },
                Shape::Cylinder { radius: a, half_height: b },
                Shape::Capsule { radius: a, half_length: b.max(0.0) },
                Shape::Cone { radius: a, height: b },
                Shape::Torus { major_radius: a, minor_radius: b },
                Shape::Noise { size: a, level: b },
            ]);
        }
    }
    for shape in shapes {
        for softness in sizes {
            let places = [Affine3A::IDENTITY, Affine3A::from_translation(Vec3::NAN)];
            for shape_from_scene in places {
                let region = Region { shape, shape_from_scene, softness };
                for at in [point(&mut random), Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
                    let weight = region.weight(at);
                    assert!((0.0..=1.0).contains(&weight), "{region:?} at {at}: {weight}");
                }
            }
        }
    }
    let nothing =
        Region { shape: Shape::Cuboid { half_size: Vec3::ZERO }, softness: 0.0, ..Region::EVERYWHERE };
    assert_eq!(nothing.weight(Vec3::ZERO), 0.0);
}

#[test]
fn turned_and_moved_shapes_keep_their_points() {
    let place =
        Affine3A::from_rotation_translation(Quat::from_rotation_z(TAU / 4.0), Vec3::new(5.0, 0.0, 0.0));
    let shape = Shape::Capsule { radius: 0.1, half_length: 2.0 };
    let region = Region { shape, shape_from_scene: place.inverse(), softness: 0.0 };
    // The axis now lies along x.
    assert_eq!(region.weight(Vec3::new(6.9, 0.0, 0.0)), 1.0);
    assert_eq!(region.weight(Vec3::new(5.0, 1.0, 0.0)), 0.0);
}

#[test]
fn noise_is_smooth_and_spread_over_its_range() {
    let mut random = Random::new(5);
    let values: Vec<f32> = (0..4000).map(|_| lattice_noise(20.0 * point(&mut random))).collect();
    assert!(values.iter().all(|value| (0.0..=1.0).contains(value)));
    let mean = values.iter().sum::<f32>() / values.len() as f32;
    assert!((mean - 0.5).abs() < 0.02, "{mean}");
    assert!(values.iter().any(|&value| value < 0.1) && values.iter().any(|&value| value > 0.9));
    // Two numbers at most 1 apart, mixed by a curve of slope 1.5 at most, in each of three axes.
    let at = point(&mut random);
    let step = lattice_noise(at + 1e-3) - lattice_noise(at);
    assert!(step.abs() <= 4.5e-3 + 1e-6, "{step}");
}

#[test]
fn layers_lie_on_one_another() {
    let means = [Vec3::ZERO, Vec3::new(0.0, 10.0, 0.0)];
    let (red, half) = ([[1.0, 0.0, 0.0, 1.0]; 2], [[0.0, 0.4, 0.0, 0.5]; 2]);
    let below = Region { shape: Shape::HalfSpace, softness: 2.0, ..Region::EVERYWHERE };
    let layer = |look, region, strength| Layer { look, region, strength, mask: None };
    // Half of the first Gaussian is red; the second lies outside.
    let mixed = mix_layers(&means, &[layer(Some(&red[..]), below, 1.0)]);
    assert_eq!(mixed, [[0.5, 0.0, 0.0, 0.5], [0.0; 4]]);
    // A quarter of a look that is itself half captured, over red.
    let layers =
        [layer(Some(&red[..]), Region::EVERYWHERE, 1.0), layer(Some(&half[..]), Region::EVERYWHERE, 0.25)];
    assert_eq!(
        mix_layers(&means[..1], &layers.map(|l| Layer { look: l.look.map(|look| &look[..1]), ..l }))[0],
        [0.75, 0.1, 0.0, 0.875]
    );
    // The captured colors come back on top.
    let layers = [layer(Some(&red[..]), Region::EVERYWHERE, 1.0), layer(None, below, 1.0)];
    assert_eq!(mix_layers(&means, &layers), [[0.5, 0.0, 0.0, 0.5], [1.0, 0.0, 0.0, 1.0]]);
    // A mask counts by its channel: 51 of 255 is a fifth.
    let mask = [[0, 0, 51, 0]; 2];
    let painted = Layer { mask: Some((&mask[..], 2)), ..layer(Some(&red[..]), Region::EVERYWHERE, 1.0) };
    assert_eq!(mix_layers(&means, &[painted])[0], [0.2, 0.0, 0.0, 0.2]);
}

/// The cover of a ball holds for the points within it, and most balls lie inside or outside.
#[test]
fn balls_are_covered_as_their_points_are() {
    let mut random = Random::new(7);
    let all = [Shape::Ellipsoid { radii: Vec3::new(0.4, 0.9, 1.4) }].into_iter().chain(shapes());
    for shape in all {
        let mut counts = [0; 3];
        for i in 0..300 {
            let turn = Quat::from_axis_angle(point(&mut random).normalize(), TAU * random.uniform());
            let scale = if i % 2 == 0 { Vec3::splat(1.5) } else { Vec3::new(0.5, 1.0, 2.0) };
            let shape_from_scene = Affine3A::from_quat(turn)
                * Affine3A::from_scale_rotation_translation(scale, turn, 0.3 * point(&mut random));
            let region = Region { shape, shape_from_scene, softness: 0.2 * random.uniform() };
            let (center, radius) = (point(&mut random), 0.1 * random.uniform());
            let cover = RegionCover::new(&region).of(center, radius);
            counts[cover as usize] += 1;
            for _ in 0..20 {
                let within = center + radius * random.uniform() * point(&mut random).normalize();
                let weight = region.weight(within);
                match cover {
                    Cover::Outside => assert_eq!(weight, 0.0, "{region:?} at {within}"),
                    Cover::Inside => assert_eq!(weight, 1.0, "{region:?} at {within}"),
                    Cover::Edge => {}
                }
            }
        }
        // Noise is an edge nearly everywhere.
        let is_noise = matches!(shape, Shape::Noise { .. });
        assert!(is_noise || counts[Cover::Edge as usize] < 200, "{shape:?}: {counts:?}");
    }
    let nowhere = Region { shape_from_scene: Affine3A::from_translation(Vec3::NAN), ..Region::EVERYWHERE };
    let nowhere = Region { shape: Shape::HalfSpace, ..nowhere };
    assert_eq!(RegionCover::new(&nowhere).of(Vec3::ZERO, 1.0), Cover::Edge);
}
