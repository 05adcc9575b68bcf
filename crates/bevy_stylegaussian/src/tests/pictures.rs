//! Small images with pixels that are worked out by hand, or by the CPU rasterizer from the same Gaussians.

use std::time::Duration;

use bevy::{
    camera::{Viewport, visibility::RenderLayers},
    core_pipeline::tonemapping::Tonemapping,
    prelude::*,
    time::TimeUpdateStrategy,
};
use stylegaussian::{Camera as Pinhole, Scene, splat};

use crate::{
    GaussianSplats, StyleApplied, StyleSource, StyleTransition, splats::SplatSortKey,
    style::decoder::StyleBackend,
};

use super::world::{rendering::*, *};

pub(super) const SIZE: UVec2 = UVec2::new(64, 64);
pub(super) const FOV_Y: f32 = 0.8;
pub(super) const RED: [f32; 3] = [0.8, 0.1, 0.1];
pub(super) const GREEN: [f32; 3] = [0.1, 0.7, 0.2];
const BLUE: [f32; 3] = [0.1, 0.2, 0.9];

/// An app and the image of its first camera.
pub(super) struct Studio {
    pub(super) app: App,
    pub(super) image: Handle<Image>,
}

impl Studio {
    pub(super) fn new() -> Option<Self> {
        let mut app = app_with_rendering(StyleBackend::Cpu)?;
        let image = render_target(&mut app, SIZE);
        Some(Self { app, image })
    }

    /// A camera on the image, without tonemapping.
    pub(super) fn camera(&mut self, eye: Vec3, more: impl Bundle) -> Entity {
        let image = self.image.clone();
        self.camera_on(&image, eye, more)
    }

    pub(super) fn camera_on(&mut self, image: &Handle<Image>, eye: Vec3, more: impl Bundle) -> Entity {
        // `more` is inserted afterwards, so that it may replace any of these components.
        let mut camera = self.app.world_mut().spawn((
            Camera3d::default(),
            Camera { clear_color: Color::BLACK.into(), ..default() },
            target(image),
            Projection::from(PerspectiveProjection { fov: FOV_Y, ..default() }),
            Transform::from_translation(eye).looking_at(Vec3::ZERO, Vec3::Y),
            Tonemapping::None,
        ));
        camera.insert(more);
        camera.id()
    }

    pub(super) fn splats(&mut self, scene: Scene, transform: Transform) -> Entity {
        let splats = GaussianSplats(add_scene(&mut self.app, scene));
        self.app.world_mut().spawn((splats, transform)).id()
    }

    /// An unlit box, transparent if `alpha` is less than 1.
    pub(super) fn cuboid(&mut self, size: Vec3, position: Vec3, [r, g, b]: [f32; 3], alpha: f32) {
        let alpha_mode = if alpha < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque };
        let material = StandardMaterial {
            base_color: Color::srgba(r, g, b, alpha),
            unlit: true,
            alpha_mode,
            ..default()
        };
        let material = add(&mut self.app, material);
        let mesh = add(&mut self.app, Mesh::from(Cuboid::from_size(size)));
        let parts = (Mesh3d(mesh), MeshMaterial3d(material), Transform::from_translation(position));
        self.app.world_mut().spawn(parts);
    }

    pub(super) fn shoot(&mut self) -> Vec<[f32; 3]> {
        let image = self.image.clone();
        self.shoot_on(&image)
    }

    pub(super) fn shoot_on(&mut self, image: &Handle<Image>) -> Vec<[f32; 3]> {
        for _ in 0..3 {
            self.app.update();
        }
        read_back(&self.app, image).iter().map(|&[r, g, b, _]| [r, g, b]).collect()
    }
}

pub(super) fn pixel(picture: &[[f32; 3]], x: u32, y: u32) -> [f32; 3] {
    picture[(y * SIZE.x + x) as usize]
}

/// `top` with `alpha` over `bottom`: display-referred colors, blended in linear space.
fn over(top: [f32; 3], alpha: f32, bottom: [f32; 3]) -> [f32; 3] {
    let linear = Srgba::gamma_function;
    let blend = |i: usize| alpha * linear(top[i]) + (1.0 - alpha) * linear(bottom[i]);
    [0, 1, 2].map(|i| Srgba::gamma_function_inverse(blend(i)))
}

/// Checks that two colors differ by at most two steps of 8 bits.
fn check(what: &str, found: [f32; 3], expected: [f32; 3]) {
    let error = (0..3).map(|i| (found[i] - expected[i]).abs()).fold(0.0, f32::max);
    assert!(error <= 2.0 / 255.0, "{what}: found {found:?}, expected {expected:?}");
}

/// The CPU rasterizer's image of a scene from `eye`, over black.
pub(super) fn reference(scene: &Scene, eye: Vec3) -> Vec<[f32; 3]> {
    rasterized(scene, &Pinhole::look_at(eye, Vec3::ZERO, Vec3::Y, FOV_Y, SIZE))
}

/// The CPU rasterizer's image of a scene, over black.
pub(super) fn rasterized(scene: &Scene, camera: &Pinhole) -> Vec<[f32; 3]> {
    over_black(&splat::render(scene, splat::Colors::Captured, camera))
}

/// Checks a whole image against the rasterizer's, over the pixels that are not black in the latter.
pub(super) fn check_picture(what: &str, found: &[[f32; 3]], expected: &[[f32; 3]]) {
    let seen = |i: usize| expected[i].iter().any(|&channel| channel > 0.02);
    assert!((0..expected.len()).filter(|&i| seen(i)).count() > 100, "{what}: hardly anything to compare");
    let psnr = psnr(found, expected, seen);
    eprintln!("{what}: {psnr:.1} dB");
    // 40 dB are a root mean square error of 2.55 steps of 8 bits.
    assert!(psnr > 40.0, "{what}: {psnr:.1} dB");
}

/// A Gaussian so large that its alpha in the middle of the image is its opacity.
fn backdrop(z: f32, opacity: f32, color: [f32; 3]) -> Ball {
    // The image is about 8 wide at distance 10: a tenth of a standard deviation to its edge.
    Ball { mean: Vec3::new(0.0, 0.0, z), scale: 40.0, opacity, color }
}

pub(super) const EYE: Vec3 = Vec3::new(0.0, 0.0, 10.0);

#[test]
fn meshes_in_front_hide_splats_and_meshes_behind_shine_through() {
    for msaa in [Msaa::Off, Msaa::Sample4] {
        let Some(mut studio) = Studio::new() else { return };
        studio.camera(EYE, msaa);
        // Thin in z, so that all of it is near the depth of its mean.
        studio.splats(balls(&[backdrop(0.0, 0.75, RED)]), Transform::from_scale(Vec3::new(1.0, 1.0, 0.001)));
        studio.cuboid(Vec3::new(4.0, 8.0, 0.5), Vec3::new(-2.0, 0.0, 1.0), BLUE, 1.0);
        studio.cuboid(Vec3::new(8.0, 8.0, 0.5), Vec3::new(0.0, 0.0, -1.0), GREEN, 1.0);
        let picture = studio.shoot();
        check("behind the blue box", pixel(&picture, 20, 32), BLUE);
        check("before the green box", pixel(&picture, 44, 32), over(RED, 0.75, GREEN));
    }
}

#[test]
fn a_mesh_through_a_cloud_hides_what_is_behind_it_alone() {
    let Some(mut studio) = Studio::new() else { return };
    studio.camera(EYE, Msaa::Off);
    studio.splats(balls(&[backdrop(2.0, 0.5, RED), backdrop(-2.0, 0.9, GREEN)]), Transform::default());
    studio.cuboid(Vec3::new(4.0, 8.0, 0.5), Vec3::new(-2.0, 0.0, 0.0), BLUE, 1.0);
    let picture = studio.shoot();
    check("box between the two", pixel(&picture, 20, 32), over(RED, 0.5, BLUE));
    // Splats blend among themselves in display-referred colors, and the result blends with black in linear
    // space.
    let blended = [0, 1, 2].map(|i| (0.5 * RED[i] + 0.5 * 0.9 * GREEN[i]) / 0.95);
    check("beside the box", pixel(&picture, 44, 32), over(blended, 0.95, [0.0; 3]));
}

#[test]
fn transparent_meshes_in_front_cover_splats() {
    let Some(mut studio) = Studio::new() else { return };
    studio.camera(EYE, Msaa::Sample4);
    studio.splats(balls(&[backdrop(0.0, 0.75, RED)]), Transform::default());
    studio.cuboid(Vec3::new(4.0, 8.0, 0.1), Vec3::new(-2.0, 0.0, 1.0), BLUE, 0.5);
    let picture = studio.shoot();
    let red = over(RED, 0.75, [0.0; 3]);
    // Only the face toward the camera is drawn, so the glass blends once.
    check("glass before the splat", pixel(&picture, 20, 32), over(BLUE, 0.5, red));
    check("beside the glass", pixel(&picture, 44, 32), red);
}

#[test]
fn two_cameras_each_see_their_own_order() {
    let Some(mut studio) = Studio::new() else { return };
    let other = render_target(&mut studio.app, SIZE);
    studio.camera(EYE, Msaa::Sample4);
    studio.camera_on(&other, -EYE, Msaa::Off);
    // Nearly opaque, so the front one is seen. Three of them: a kernel that takes four at a time must handle
    // the rest.
    let scene = balls(&[backdrop(1.0, 0.99, RED), backdrop(0.0, 0.99, BLUE), backdrop(-1.0, 0.99, GREEN)]);
    studio.splats(scene.clone(), Transform::default());
    let front = studio.shoot();
    let back = studio.shoot_on(&other);
    check_picture("from the front", &front, &reference(&scene, EYE));
    check_picture("from the back", &back, &reference(&scene, -EYE));
    assert!(pixel(&front, 32, 32)[0] > 0.7 && pixel(&back, 32, 32)[1] > 0.6);
}

#[test]
fn two_viewports_share_a_picture() {
    let Some(mut studio) = Studio::new() else { return };
    let half = |x: u32| Viewport {
        physical_position: UVec2::new(x, 0),
        physical_size: UVec2::new(32, 64),
        ..default()
    };
    let camera = |x: u32, order: isize| Camera {
        viewport: Some(half(x)),
        order,
        // The second camera must not clear what the first one drew.
        clear_color: if order == 0 { Color::BLACK.into() } else { ClearColorConfig::None },
        ..default()
    };
    studio.camera(EYE, (Msaa::Sample4, camera(0, 0)));
    studio.camera(-EYE, (Msaa::Sample4, camera(32, 1)));
    studio.splats(balls(&[backdrop(1.0, 0.9, RED), backdrop(-1.0, 0.9, GREEN)]), Transform::default());
    let picture = studio.shoot();
    // The front splat covers 0.9 and the back one 0.9 of the remaining 0.1: together 0.99, by which the
    // premultiplied sum is divided.
    let blend = |front: [f32; 3], back: [f32; 3]| {
        over([0, 1, 2].map(|i| (0.9 * front[i] + 0.09 * back[i]) / 0.99), 0.99, [0.0; 3])
    };
    for x in [2, 16, 30] {
        check("left", pixel(&picture, x, 32), blend(RED, GREEN));
        check("right", pixel(&picture, 32 + x, 32), blend(GREEN, RED));
    }
}

/// Random translucent balls in a cube of 4 units.
pub(super) fn translucent(n: usize, seed: u64) -> Vec<Ball> {
    let mut next = numbers(seed);
    let ball = |_| Ball {
        mean: 2.0 * Vec3::new(next(), next(), next()),
        scale: 0.5 + 0.2 * next(),
        opacity: 0.6 + 0.3 * next(),
        color: [0.5 + 0.5 * next(), 0.5 + 0.5 * next(), 0.5 + 0.5 * next()],
    };
    (0..n).map(ball).collect()
}

/// Random translucent Gaussians in two clouds that fill the same space, compared with one cloud of all of them.
#[test]
fn overlapping_clouds_interleave() {
    let Some(mut studio) = Studio::new() else { return };
    let all = translucent(60, 3);
    let moved = |balls: &[Ball], by: Vec3| balls.iter().map(|b| Ball { mean: b.mean - by, ..*b }).collect();
    let by = Vec3::new(0.5, -1.0, 2.0);
    let second: Vec<Ball> = moved(&all[30..], by);
    studio.camera(EYE, Msaa::Off);
    studio.splats(balls(&all[..30]), Transform::default());
    studio.splats(balls(&second), Transform::from_translation(by));
    check_picture("two clouds", &studio.shoot(), &reference(&balls(&all), EYE));
}

#[test]
fn splats_move_turn_and_grow_with_their_entity() {
    let Some(mut studio) = Studio::new() else { return };
    let scene = small_scene(50, 4);
    studio.camera(EYE, (Msaa::Off, SplatSortKey::ViewZ));
    let entity = studio.splats(scene.clone(), Transform::default());
    for step in 0..3 {
        let (turn, scale) = (Quat::from_axis_angle(Vec3::Y, 0.7 * step as f32), 1.0 + 0.5 * step as f32);
        let translation = Vec3::new(0.4, -0.3, 0.5) * step as f32;
        let transform = Transform { translation, rotation: turn, scale: Vec3::splat(scale) };
        *studio.app.world_mut().get_mut::<Transform>(entity).unwrap() = transform;
        // Moving the cloud is the same as moving the eye the other way, so the reference shows the scene from
        // there.
        let view_from_scene = Pinhole::look_at(EYE, Vec3::ZERO, Vec3::Y, FOV_Y, SIZE).view_from_world
            * transform.compute_affine();
        let scene_from_view = view_from_scene.inverse();
        // The scale of the entity is in the view as well. Scaling the scene instead makes the view rigid again.
        let scaled = Scene {
            means: scene.means.iter().map(|mean| scale * mean).collect(),
            scales: scene.scales.iter().map(|s| scale * s).collect(),
            ..scene.clone()
        };
        let (_, rotation, _) = scene_from_view.to_scale_rotation_translation();
        let eye = scale * Vec3::from(scene_from_view.translation);
        let rigid = bevy::math::Affine3A::from_rotation_translation(rotation, eye);
        let camera = Pinhole {
            view_from_world: rigid.inverse(),
            ..Pinhole::look_at(EYE, Vec3::ZERO, Vec3::Y, FOV_Y, SIZE)
        };
        check_picture(&format!("step {step}"), &studio.shoot(), &rasterized(&scaled, &camera));
    }
}

#[test]
fn stretched_entities_stretch_their_splats() {
    let Some(mut studio) = Studio::new() else { return };
    let mut scene = balls(&[Ball { mean: Vec3::new(0.5, 0.25, 0.0), scale: 0.3, opacity: 0.9, color: RED }]);
    studio.camera(EYE, Msaa::Off);
    // A negative factor mirrors, which the scales of a round Gaussian cannot show: only its place.
    let stretch = Vec3::new(3.0, 0.5, -2.0);
    studio.splats(scene.clone(), Transform::from_scale(stretch));
    scene.means[0] *= stretch;
    scene.scales[0] *= stretch.abs();
    check_picture("stretched", &studio.shoot(), &reference(&scene, EYE));
}

#[test]
fn orthographic_cameras_see_no_perspective() {
    let Some(mut studio) = Studio::new() else { return };
    let projection = OrthographicProjection {
        scaling_mode: bevy::camera::ScalingMode::FixedVertical { viewport_height: 8.0 },
        ..OrthographicProjection::default_3d()
    };
    studio.camera(EYE, (Msaa::Off, Projection::from(projection)));
    let ball = |x: f32, z: f32, color| Ball { mean: Vec3::new(x, 0.0, z), scale: 0.5, opacity: 0.9, color };
    studio.splats(balls(&[ball(-2.0, 4.0, RED), ball(2.0, -40.0, GREEN)]), Transform::default());
    let picture = studio.shoot();
    // 8 pixels to a unit: sigma is 4 pixels (sqrt(16 + 0.3) with the low-pass), centers at x = 16 and 48; a
    // pixel's center is half a pixel away from there.
    for (x, color) in [(16, RED), (48, GREEN)] {
        for dx in [0, 4, 8] {
            let squared = (dx as f32 + 0.5).powi(2) + 0.25;
            let alpha = 0.9 * (-squared / (2.0 * 16.3)).exp();
            check("an even disc", pixel(&picture, x + dx, 32), over(color, alpha, [0.0; 3]));
        }
    }
}

#[test]
fn hidden_and_layered_splats_are_not_drawn() {
    let Some(mut studio) = Studio::new() else { return };
    studio.camera(EYE, Msaa::Off);
    let entity = studio.splats(balls(&[backdrop(0.0, 0.9, RED)]), Transform::default());
    let red = over(RED, 0.9, [0.0; 3]);
    check("shown", pixel(&studio.shoot(), 32, 32), red);
    studio.app.world_mut().entity_mut(entity).insert(Visibility::Hidden);
    check("hidden", pixel(&studio.shoot(), 32, 32), [0.0; 3]);
    studio.app.world_mut().entity_mut(entity).insert((Visibility::Visible, RenderLayers::layer(1)));
    check("on another layer", pixel(&studio.shoot(), 32, 32), [0.0; 3]);
    studio.app.world_mut().entity_mut(entity).insert(RenderLayers::layer(0));
    check("shown again", pixel(&studio.shoot(), 32, 32), red);
    // The mean is far outside of the image, the splat is not.
    *studio.app.world_mut().get_mut::<Transform>(entity).unwrap() = Transform::from_xyz(30.0, 0.0, 0.0);
    assert!(pixel(&studio.shoot(), 32, 32)[0] > 0.3);
    studio.app.world_mut().entity_mut(entity).despawn();
    check("despawned", pixel(&studio.shoot(), 32, 32), [0.0; 3]);
}

/// A camera that turns away from a scene sees the same as the rasterizer, which culls single splats but no
/// scenes: the scene is drawn until its last splat has left the image.
#[test]
fn nothing_pops_at_the_edge_of_the_picture() {
    let Some(mut studio) = Studio::new() else { return };
    let camera = studio.camera(EYE, Msaa::Off);
    let needle = Scene { scales: vec![Vec3::new(2.0, 0.2, 0.6)], ..balls(&[backdrop(0.0, 0.99, BLUE)]) };
    studio.splats(needle.clone(), Transform::default());
    let mut n_seen = 0;
    for step in 0..15 {
        let target = EYE + Quat::from_rotation_y(0.1 * step as f32) * Vec3::NEG_Z;
        let eye = Transform::from_translation(EYE).looking_at(target, Vec3::Y);
        *studio.app.world_mut().get_mut::<Transform>(camera).unwrap() = eye;
        let pinhole = Pinhole::look_at(EYE, target, Vec3::Y, FOV_Y, SIZE);
        let (found, expected) = (studio.shoot(), rasterized(&needle, &pinhole));
        // At an alpha of 1/255, rounding decides whether a splat is drawn: 10 steps of sRGB for this blue over
        // black.
        let error = found.iter().zip(&expected).map(|(a, b)| (a[2] - b[2]).abs()).fold(0.0, f32::max);
        assert!(error <= 11.0 / 255.0, "step {step}: {error}");
        n_seen += u32::from(expected.iter().any(|color| color[2] > 0.0));
    }
    // The splat must be seen at first and have left the image at the end, or nothing was tested.
    assert!((5..14).contains(&n_seen), "seen in {n_seen} steps");
}

/// A style of a single color fades in over ten frames, each a tenth of the fade's duration.
#[test]
fn looks_fade_from_one_to_the_next() {
    let Some(mut studio) = Studio::new() else { return };
    let step = Duration::from_millis(10);
    studio.app.insert_resource(TimeUpdateStrategy::ManualDuration(step));
    studio.camera(EYE, Msaa::Off);
    // A decoder that ignores features: only its last bias counts.
    let mut scene = small_scene(1, 1);
    scene.set_colors(&[RED]);
    (scene.means[0], scene.scales[0], scene.opacities[0]) = (Vec3::ZERO, Vec3::splat(40.0), 0.9);
    let last = scene.decoder.as_mut().unwrap().layers.last_mut().unwrap();
    last.weight.fill(0.0);
    last.bias = GREEN.to_vec();
    let style = add_style(&mut studio.app, small_style(1));
    let entity = studio.splats(scene, Transform::default());
    let picture = |studio: &mut Studio| {
        let image = studio.image.clone();
        let [r, g, b, _] = read_back(&studio.app, &image)[(32 * SIZE.x + 32) as usize];
        [r, g, b]
    };
    studio.shoot();
    check("before", picture(&mut studio), over(RED, 0.9, [0.0; 3]));
    let transition = StyleTransition::fade(10 * step);
    studio.app.world_mut().entity_mut(entity).insert((StyleSource::preset(style), transition));
    update_until(&mut studio.app, "StyleApplied", |world| {
        !world.resource::<Messages<StyleApplied>>().is_empty()
    });
    // The fade began in the frame before the event.
    for n_steps in 1..13 {
        let t = (n_steps as f32 / 10.0).min(1.0);
        let mix = [0, 1, 2].map(|i| RED[i] + t * (GREEN[i] - RED[i]));
        check(&format!("after {n_steps} tenths"), picture(&mut studio), over(mix, 0.9, [0.0; 3]));
        studio.app.update();
    }
}
