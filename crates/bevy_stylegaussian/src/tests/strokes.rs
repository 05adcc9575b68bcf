//! Strokes in pictures: paintings on a wall, compared with the pictures of the CPU rasterizer.

use std::time::Duration;

use bevy::{
    core_pipeline::tonemapping::Tonemapping,
    prelude::*,
    render::{
        RenderApp,
        error_handler::{ErrorType, RenderErrorHandler, RenderErrorPolicy},
        render_resource::PollType,
        renderer::RenderDevice,
        settings::RenderCreation,
        sync_world::MainEntity,
    },
    time::TimeUpdateStrategy,
};
use stylegaussian::{
    Camera as Pinhole, Scene,
    layers::{Layer, Region, Shape, mix_layers},
    paint::{Canvas, Painted, Surface},
    restyle::Recipe,
    splat,
    strokes::{StrokeKnobs, StrokeLayer, StrokeMotion, Strokes, mix_strokes},
    work::Work,
};

use crate::{
    GaussianSplats, StyleApplied, StyleSource, StyleTransition, StyleVolume,
    colors::{ShownColors, StrokeTextures},
    style::{StyleMotion, StyleRelief, decoder::StyleBackend, has_unsettled_styles},
};

use super::{
    paint::{noise, paint},
    world::{rendering::*, *},
};

mod changes;

const SIZE: UVec2 = UVec2::new(128, 96);
const FOV_Y: f32 = 0.8;
const EYE: Vec3 = Vec3::new(0.5, 0.3, 2.6);
/// Time of an update.
const STEP: Duration = Duration::from_millis(50);
const ALL: Region = Region::EVERYWHERE;
/// Direction to a light.
const LIGHT: Vec3 = Vec3::new(1.0, 0.5, 0.6);

/// A wall in the plane z = 0 with a gentle pattern and white bars that stand out of it, without features.
fn wall() -> Scene {
    let n = 48;
    let place = |i: i32| (i as f32 + 0.5) / n as f32 * 2.0 - 1.0;
    let (xs, ys): (Vec<_>, Vec<_>) = (0..n * n).map(|i| (place(i % n), place(i / n))).unzip();
    let mut scene = balls(&[]);
    scene.means = xs.iter().zip(&ys).map(|(&x, &y)| Vec3::new(x, y, 0.0)).collect();
    scene.rotations = vec![Quat::IDENTITY; xs.len()];
    scene.scales = vec![Vec3::new(0.03, 0.03, 0.004); xs.len()];
    scene.opacities = vec![0.95; xs.len()];
    scene.order = (0..xs.len() as u32).collect();
    scene.n_source = xs.len();
    let color = |(x, y): (&f32, &f32)| match (x - 0.1).abs() < 0.03 || (y + 0.2).abs() < 0.03 {
        true => [0.95, 0.95, 0.9],
        false => [0.4 + 0.2 * (3.0 * x).sin(), 0.5 + 0.2 * y, 0.4],
    };
    scene.set_colors(&xs.iter().zip(&ys).map(color).collect::<Vec<_>>());
    scene
}

/// A wall before a camera.
pub(super) struct Studio {
    pub(super) app: App,
    target: Handle<Image>,
    pub(super) scene: Scene,
    pub(super) wall: Entity,
}

impl Studio {
    pub(super) fn new() -> Option<Self> {
        let mut app = app_with_rendering(StyleBackend::Cpu)?;
        app.insert_resource(TimeUpdateStrategy::ManualDuration(STEP));
        let target_image = render_target(&mut app, SIZE);
        app.world_mut().spawn((
            Camera3d::default(),
            Camera { clear_color: Color::BLACK.into(), ..default() },
            target(&target_image),
            Projection::from(PerspectiveProjection { fov: FOV_Y, ..default() }),
            Transform::from_translation(EYE).looking_at(Vec3::ZERO, Vec3::Y),
            Tonemapping::None,
            Msaa::Off,
        ));
        let scene = wall();
        let splats = GaussianSplats(add_scene(&mut app, scene.clone()));
        let wall = app.world_mut().spawn((splats, StyleSource::none())).id();
        Some(Self { app, target: target_image, scene, wall })
    }

    /// A painting as an asset, and the wall in it.
    fn painting(&mut self, seed: u64, colors: [[u8; 3]; 2]) -> (StyleSource, Painted) {
        let image = noise(seed, colors[0], colors[1]);
        let canvas = Canvas::new(&paint(&image));
        let work = Work::default();
        let surface = Surface::new(&self.scene, &work).unwrap();
        let painted = Recipe::painting(&canvas, &surface).restyle(&self.scene, &work).unwrap();
        (StyleSource::image(add(&mut self.app, image)), painted)
    }

    pub(super) fn set(&mut self, source: StyleSource) {
        *self.app.world_mut().get_mut(self.wall).unwrap() = source;
    }

    /// Updates until all styles are drawn.
    pub(super) fn settle(&mut self) {
        self.app.update();
        update_until(&mut self.app, "drawn styles", |world| !has_unsettled_styles(world));
    }

    /// The picture after an update.
    pub(super) fn next(&mut self) -> Vec<[f32; 3]> {
        self.app.update();
        read_back(&self.app, &self.target).iter().map(|&[r, g, b, _]| [r, g, b]).collect()
    }

    /// The CPU rasterizer's picture.
    fn expected(&self, colors: splat::Colors, strokes: &Strokes, knobs: &StrokeKnobs) -> Vec<[f32; 3]> {
        let camera = Pinhole::look_at(EYE, Vec3::ZERO, Vec3::Y, FOV_Y, SIZE);
        over_black(&splat::render_strokes(&self.scene, colors, (strokes, knobs), &camera, None))
    }

    /// Checks the next picture against the wall in a painting's colors and strokes.
    #[track_caller]
    pub(super) fn check(
        &mut self,
        name: &str,
        colors: splat::Colors,
        strokes: &Strokes,
        knobs: &StrokeKnobs,
    ) {
        let found = self.next();
        let expected = self.expected(colors, strokes, knobs);
        let plain = self.expected(colors, strokes, &StrokeKnobs { amount: 0.0, ..*knobs });
        let seen = |i: usize| expected[i].iter().any(|&channel| channel > 0.02);
        let (with, without) = (psnr(&found, &expected, seen), psnr(&plain, &expected, seen));
        eprintln!("{name}: {with:.1} dB, strokes make {without:.1} dB");
        assert!(with > 40.0, "{name}: {with:.1} dB");
        // Otherwise strokes are not seen, and the comparison would say nothing of them.
        assert!(without < 34.0, "{name}: {without:.1} dB");
    }
}

/// The mean distance of two pictures.
pub(super) fn distance(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    let sum: f32 = a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs()).sum();
    sum / a.as_flattened().len() as f32
}

const WARM: [[u8; 3]; 2] = [[240, 190, 60], [90, 20, 30]];
const COLD: [[u8; 3]; 2] = [[60, 120, 230], [220, 240, 250]];

#[test]
fn strokes_and_their_knobs_are_those_of_the_cpu() {
    let Some(mut studio) = Studio::new() else { return };
    let (source, painted) = studio.painting(1, WARM);
    let before = {
        studio.next();
        studio.next()
    };
    studio.set(source.clone());
    studio.settle();
    drain::<StyleApplied>(&mut studio.app);
    let usual = StrokeKnobs::DEFAULT;
    studio.check("a painting", splat::Colors::Rgb(&painted.colors), &painted.strokes, &usual);
    for (name, source, knobs) in [
        ("twice the paint", source.clone().with_paint(2.0), StrokeKnobs { amount: 2.0, ..usual }),
        ("strong", source.clone().with_protection(0.0), StrokeKnobs { protection: 0.0, ..usual }),
        (
            "of one size",
            source.clone().with_screen_stable(true).with_stroke_scale(1.5),
            StrokeKnobs { screen_stable: true, stroke_scale: 1.5, ..usual },
        ),
        (
            "relief",
            source.clone().with_relief(StyleRelief::lit_from(LIGHT).with_amount(2.0)),
            StrokeKnobs { relief: 2.0, light: LIGHT, ..usual },
        ),
        ("large strokes", source.clone().with_stroke_scale(2.0), StrokeKnobs { stroke_scale: 2.0, ..usual }),
    ] {
        let pictures = [&usual, &knobs]
            .map(|knobs| studio.expected(splat::Colors::Rgb(&painted.colors), &painted.strokes, knobs));
        assert!(distance(&pictures[0], &pictures[1]) > 2e-3, "{name} changes nothing");
        studio.set(source);
        // In the next frame.
        studio.check(name, splat::Colors::Rgb(&painted.colors), &painted.strokes, &knobs);
        assert!(!has_unsettled_styles(studio.app.world_mut()), "{name}");
        assert!(drain::<StyleApplied>(&mut studio.app).is_empty(), "{name}");
    }
    studio.set(StyleSource::none());
    studio.settle();
    let after = studio.next();
    assert!(distance(&before, &after) < 1e-4, "{}", distance(&before, &after));
    // Its painting leaves the GPU once nobody keeps the style.
    let textures = studio.app.sub_app(RenderApp).world().resource::<StrokeTextures>().0.clone();
    assert_eq!(textures.n_used(), 1, "kept for the one who comes back to it");
}

#[test]
fn strength_and_volumes_mix_strokes() {
    let Some(mut studio) = Studio::new() else { return };
    let (source, painted) = studio.painting(1, WARM);
    let rgba: Vec<_> = painted.colors.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    let mixed = |layers: &[(bool, Region, f32)]| {
        let means = &wall().means;
        let colors: Vec<_> = layers
            .iter()
            .map(|&(has_look, region, strength)| Layer {
                look: has_look.then_some(&rgba[..]),
                region,
                strength,
                mask: None,
            })
            .collect();
        let strokes: Vec<_> = layers
            .iter()
            .map(|&(has_look, region, strength)| StrokeLayer {
                words: has_look.then_some(&painted.strokes.words[..]),
                first_seed: 0,
                region,
                strength,
                mask: None,
                factors: None,
            })
            .collect();
        let words = mix_strokes(means, &strokes);
        (mix_layers(means, &colors), Strokes { words, ..painted.strokes.clone() })
    };
    let knobs = StrokeKnobs::DEFAULT;
    studio.set(source.clone().with_strength(0.75));
    studio.settle();
    let (colors, strokes) = mixed(&[(true, ALL, 1.0), (false, ALL, 0.25)]);
    studio.check("three quarters of the strength", splat::Colors::Mixed(&colors), &strokes, &knobs);

    studio.set(StyleSource::none());
    let ball = StyleVolume::new(Sphere::new(0.8)).with_softness(0.3);
    let volume = studio.app.world_mut().spawn((ball, source)).id();
    studio.settle();
    studio.next();
    let sphere = Shape::Ellipsoid { radii: Vec3::splat(0.8) };
    let region = Region { shape: sphere, softness: 0.3, ..ALL };
    let (colors, strokes) = mixed(&[(true, region, 1.0)]);
    studio.check("a ball", splat::Colors::Mixed(&colors), &strokes, &knobs);
    studio.app.world_mut().despawn(volume);
    studio.next();
    studio.next();
    let shown = studio.app.sub_app(RenderApp).world().resource::<ShownColors>();
    assert!(shown.shown_strokes(MainEntity::from(studio.wall)).is_none());
}

/// The game's first directional light falls on paint, and without one paint is flat.
#[cfg(feature = "pbr")]
#[test]
fn paint_is_lit_by_the_sun() {
    let Some(mut studio) = Studio::new() else { return };
    let (source, painted) = studio.painting(1, WARM);
    studio.set(source.clone());
    studio.settle();
    let flat = studio.next();
    studio.set(source.with_relief(StyleRelief::sun()));
    assert!(studio.next() == flat);
    let sun = Transform::from_translation(LIGHT).looking_at(Vec3::ZERO, Vec3::Y);
    studio.app.world_mut().spawn((DirectionalLight::default(), sun));
    let knobs = StrokeKnobs { relief: 1.0, light: LIGHT, ..StrokeKnobs::DEFAULT };
    studio.check("sun", splat::Colors::Rgb(&painted.colors), &painted.strokes, &knobs);
    assert!(distance(&studio.next(), &flat) > 1e-3);
}

/// Strokes that boil four times a second, in frames of 50 ms: five frames are equal.
#[test]
fn strokes_move_by_the_games_clock() {
    let Some(mut studio) = Studio::new() else { return };
    let (source, painted) = studio.painting(1, WARM);
    let motion = StrokeMotion::Boil { rate: 4.0, amount: 1.0 };
    studio.set(source.clone().with_motion(StyleMotion::boil(4.0).with_amount(1.0)));
    studio.settle();
    studio.next();
    drain::<StyleApplied>(&mut studio.app);
    let seconds = |studio: &Studio| studio.app.world().resource::<Time<Virtual>>().elapsed_secs_f64();
    let mut last: Option<(f64, Vec<[f32; 3]>)> = None;
    for _ in 0..12 {
        let found = studio.next();
        // In frames that are counted in whole milliseconds.
        let drawing = (4.0 * seconds(&studio)).floor();
        if let Some((before, picture)) = last {
            assert_eq!(before == drawing, picture == found, "drawings {before} and {drawing}");
        }
        last = Some((drawing, found));
    }
    let moved = painted.strokes.moved(motion, seconds(&studio) + STEP.as_secs_f64());
    studio.check("boiling", splat::Colors::Rgb(&painted.colors), &moved, &StrokeKnobs::DEFAULT);
    // Over the next redraw, a game that is paused shows the same.
    studio.app.world_mut().resource_mut::<Time<Virtual>>().pause();
    let paused = studio.next();
    assert!((0..8).all(|_| studio.next() == paused));
    studio.app.world_mut().resource_mut::<Time<Virtual>>().unpause();
    assert!((0..8).any(|_| studio.next() != paused));
    // A game that sets its clock back shows what it showed then.
    *studio.app.world_mut().resource_mut::<Time<Virtual>>() = Time::default();
    let moved = painted.strokes.moved(motion, STEP.as_secs_f64());
    studio.check("set back", splat::Colors::Rgb(&painted.colors), &moved, &StrokeKnobs::DEFAULT);
    assert!(drain::<StyleApplied>(&mut studio.app).is_empty(), "nothing is computed");

    // A ball of the same style that boils on a wall that does not.
    studio.set(source.clone());
    let ball = StyleVolume::new(Sphere::new(0.4));
    let moving = source.with_motion(StyleMotion::boil(20.0).with_amount(1.0));
    studio.app.world_mut().spawn((ball, moving));
    studio.settle();
    studio.next();
    let frames: Vec<_> = (0..4).map(|_| studio.next()).collect();
    let at = |x: usize, y: usize| frames.iter().any(|frame| frame[y * 128 + x] != frames[0][y * 128 + x]);
    let n_moving = |range: std::ops::Range<usize>| range.filter(|&x| at(x, 48)).count();
    // The ball covers the middle, and no pixel near the wall's left edge.
    assert!(n_moving(54..66) > 3 && n_moving(25..35) == 0, "{} {}", n_moving(54..66), n_moving(25..35));
}

/// From one painting to another, and back before the first fade is over, no frame differs much from the one
/// before.
#[test]
fn fades_between_paintings_do_not_pop() {
    let Some(mut studio) = Studio::new() else { return };
    let [(warm, _), (cold, _)] = [(1, WARM), (2, COLD)].map(|(seed, colors)| studio.painting(seed, colors));
    studio.set(warm.clone());
    studio.settle();
    let transition = StyleTransition::fade(20 * STEP);
    studio.app.world_mut().entity_mut(studio.wall).insert(transition);
    let first = studio.next();
    let (mut last, mut largest) = (first.clone(), 0.0_f32);
    let mut steps = |studio: &mut Studio, n: usize| {
        for _ in 0..n {
            let next = studio.next();
            largest = largest.max(distance(&last, &next));
            last = next;
            // Leaves the cores to the paint that is waited for.
            std::thread::sleep(Duration::from_millis(2));
        }
        last.clone()
    };
    studio.set(cold);
    steps(&mut studio, 1);
    while has_unsettled_styles(studio.app.world_mut()) {
        steps(&mut studio, 1);
    }
    let second = steps(&mut studio, 22);
    // Back, and again before that is over: more changes than are worn at once, so some are frozen.
    let sources = [warm.clone(), studio.painting(3, WARM).0, studio.painting(4, COLD).0, warm];
    for source in sources {
        studio.set(source);
        steps(&mut studio, 1);
        while has_unsettled_styles(studio.app.world_mut()) {
            steps(&mut studio, 1);
        }
        steps(&mut studio, 3);
    }
    let third = steps(&mut studio, 25);
    let whole = distance(&first, &second);
    eprintln!("{whole:.4} between the paintings, at most {largest:.4} from frame to frame");
    assert!(whole > 0.05 && largest < 0.25 * whole, "{largest} of {whole}");
    assert!(distance(&first, &third) < 2e-3, "{}", distance(&first, &third));
}

#[test]
fn a_lost_device_brings_strokes_back() {
    let Some(mut studio) = Studio::new() else { return };
    studio.app.insert_resource(RenderErrorHandler(|error, _, _| match error.ty {
        ErrorType::DeviceLost => RenderErrorPolicy::Recover(RenderCreation::default()),
        _ => panic!("{error:?}"),
    }));
    let (source, painted) = studio.painting(1, WARM);
    studio.set(source);
    studio.settle();
    let colors = splat::Colors::Rgb(&painted.colors);
    studio.check("before", colors, &painted.strokes, &StrokeKnobs::DEFAULT);
    let device = studio.app.sub_app(RenderApp).world().resource::<RenderDevice>().clone();
    device.wgpu_device().destroy();
    // The loss is reported at the next poll, and Bevy recovers in a later frame.
    let _ = device.poll(PollType::Poll);
    (0..12).for_each(|_| studio.app.update());
    studio.check("after", colors, &painted.strokes, &StrokeKnobs::DEFAULT);
}
