//! Volumes that change strokes, whatever their style.

use stylegaussian::strokes::{StrokeFactors, StrokeSeed};

use crate::style::VolumeStrokes;

use super::*;

/// The strokes of a painting, changed in a ball.
fn changed_in_ball(painted: &Painted, factors: StrokeFactors, radius: f32) -> Strokes {
    let Strokes { seeds, words, textures } = &painted.strokes;
    // Changed seeds have numbers behind all others.
    let first = seeds.len().next_power_of_two();
    let mut all = seeds.clone();
    all.resize(first, StrokeSeed::default());
    all.extend(seeds.iter().map(|seed| factors.seed(seed).packed().with_direction(seed.direction())));
    let shape = Shape::Ellipsoid { radii: Vec3::splat(radius) };
    let below = StrokeLayer {
        words: Some(words),
        first_seed: 0,
        region: ALL,
        strength: 1.0,
        mask: None,
        factors: None,
    };
    let change = StrokeLayer {
        words: None,
        first_seed: if factors.change_seeds() { first as u32 } else { 0 },
        region: Region { shape, softness: 0.2, ..ALL },
        factors: Some(factors),
        ..below
    };
    let words = mix_strokes(&wall().means, &[below, change]);
    Strokes { seeds: all, words, textures: textures.clone() }
}

#[test]
fn volumes_change_the_strokes_that_are_there() {
    let Some(mut studio) = Studio::new() else { return };
    let captured = {
        studio.next();
        studio.next()
    };
    let (source, painted) = studio.painting(1, WARM);
    studio.set(source.clone());
    studio.settle();
    let plain = studio.next();
    drain::<StyleApplied>(&mut studio.app);
    let colors: Vec<_> = painted.colors.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    let ball = StyleVolume::new(Sphere::new(0.5)).with_softness(0.2);
    let none = StrokeFactors::NONE;
    let usual = VolumeStrokes::default;
    let volume = studio.app.world_mut().spawn(ball.clone().with_strokes(usual())).id();
    studio.settle();
    assert!(distance(&studio.next(), &plain) < 1e-4);
    for (name, strokes, factors) in [
        ("no paint", usual().with_paint(0.0), StrokeFactors { amount: 0.0, ..none }),
        ("half of it", usual().with_paint(0.5), StrokeFactors { amount: 0.5, ..none }),
        ("strong", usual().with_protection(0.0), StrokeFactors { protection: 0.0, ..none }),
        ("large", usual().with_stroke_scale(2.0), StrokeFactors { stroke_scale: 2.0, ..none }),
        (
            "upright",
            usual().with_direction(Vec3::Y).with_paint(1.5),
            StrokeFactors { direction: Some(Vec3::Y), amount: 1.5, ..none },
        ),
    ] {
        studio.app.world_mut().get_mut::<StyleVolume>(volume).unwrap().strokes = Some(strokes);
        let expected = changed_in_ball(&painted, factors, 0.5);
        // In the next frame.
        studio.check(name, splat::Colors::Mixed(&colors), &expected, &StrokeKnobs::DEFAULT);
        let found = studio.next();
        assert!(distance(&found, &plain) > 1e-4, "{name} changes nothing");
        // The wall's corner is as it was.
        let corner = 128 * 24 + 26..128 * 24 + 32;
        assert!(distance(&found[corner.clone()], &plain[corner]) < 1e-4, "{name}");
    }
    // A volume alone gives paint a thickness, in the light of the cloud's source. Then it has none again.
    studio.app.world_mut().get_mut::<StyleVolume>(volume).unwrap().strokes =
        Some(usual().with_added_relief(2.0));
    studio.set(source.clone().with_relief(StyleRelief::lit_from(LIGHT).with_amount(0.0)));
    let lit = studio.next();
    assert!(distance(&lit, &plain) > 1e-4, "no relief");
    let corner = 128 * 24 + 26..128 * 24 + 32;
    assert!(distance(&lit[corner.clone()], &plain[corner]) < 1e-4);
    studio.set(source.clone());
    // Along a curve that is a line, strokes run as along its direction.
    let mut set = |strokes: VolumeStrokes| {
        studio.app.world_mut().get_mut::<StyleVolume>(volume).unwrap().strokes = Some(strokes);
        studio.next()
    };
    let along = set(usual().with_direction(Vec3::Y));
    let on_line = set(usual().with_direction(vec![Vec3::NEG_Y, Vec3::ZERO, Vec3::Y]));
    assert!(distance(&on_line, &along) < 1e-4 && distance(&on_line, &plain) > 1e-4);
    assert!(drain::<StyleApplied>(&mut studio.app).iter().all(|applied| applied.entity != studio.wall));
    // A mask that nobody painted steers nothing.
    let painted_volume = StyleVolume { mask: Some(1), strokes: Some(usual().with_paint(0.0)), ..ball };
    *studio.app.world_mut().get_mut(volume).unwrap() = painted_volume.clone();
    assert!(distance(&studio.next(), &plain) < 1e-4);
    // Captured colors have no strokes.
    *studio.app.world_mut().get_mut(volume).unwrap() = StyleVolume { mask: None, ..painted_volume };
    studio.set(StyleSource::none());
    studio.settle();
    assert!(distance(&studio.next(), &captured) < 1e-4);
}
