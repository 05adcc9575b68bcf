//! A camera that orbits a point, looks around, pans and flies.

use std::f32::consts::FRAC_PI_2;

use bevy::{
    camera::{CameraOutputMode, Viewport, visibility::RenderLayers},
    core_pipeline::tonemapping::Tonemapping,
    input::mouse::{AccumulatedMouseScroll, MouseScrollUnit},
    prelude::*,
    render::render_resource::BlendState,
};
use bevy_egui::{PrimaryEguiContext, input::EguiWantsInput};

use crate::{
    panel::Panel,
    parts::{Parts, Tool},
    scene::ShownScene,
};

/// Vertical angle of view in radians, about that of a 60 mm lens.
const FIELD_OF_VIEW: f32 = 0.7;
/// Radians per point of cursor movement.
const TURN: f32 = 0.006;
/// Share of the distance covered by one step of the wheel.
const ZOOM: f32 = 0.12;
/// Share of the distance covered per second of flying.
const SPEED: f32 = 0.5;
/// Longest time step in seconds: a slower frame counts as this long, so that flying never jumps past the scene.
const LONGEST_STEP: f32 = 0.25;

/// Position of the camera: at `distance` from `target`, in the direction given by `yaw` and `pitch` (radians).
#[derive(Component, Clone, Default)]
pub struct Orbit {
    target: Vec3,
    distance: f32,
    yaw: f32,
    pitch: f32,
}

impl Orbit {
    /// Shows the whole scene, slightly from above.
    pub fn frame(&mut self, scene: &ShownScene) {
        let (center, radius) = scene.extent;
        // At radius / sin(half the angle), a sphere fills the height exactly. Captures are seldom round, so a
        // little nearer.
        let distance = 0.85 * radius / (0.5 * FIELD_OF_VIEW).sin();
        *self = Self { target: scene.world_from_scene() * center, distance, yaw: 0.0, pitch: 0.35 };
    }

    /// The point in the middle of the view.
    pub fn target(&self) -> Vec3 {
        self.target
    }

    fn rotation(&self) -> Quat {
        Quat::from_rotation_y(self.yaw) * Quat::from_rotation_x(-self.pitch)
    }

    fn transform(&self) -> Transform {
        let rotation = self.rotation();
        Transform::from_translation(self.target + rotation * Vec3::Z * self.distance).with_rotation(rotation)
    }

    fn turn(&mut self, by: Vec2) {
        self.yaw -= by.x * TURN;
        // Not quite the poles, where left and right would swap.
        self.pitch = (self.pitch + by.y * TURN).clamp(0.01 - FRAC_PI_2, FRAC_PI_2 - 0.01);
    }
}

/// Spawns a camera for the scene, beside the panel, and one over it for the panel.
pub fn spawn(mut commands: Commands) {
    commands.spawn((
        Camera3d::default(),
        Projection::from(PerspectiveProjection { fov: FIELD_OF_VIEW, near: 0.02, ..default() }),
        // Splats have soft edges and nothing else is drawn, so multisampling would only take more time.
        Msaa::Off,
        Tonemapping::None,
        Orbit { distance: 10.0, ..default() },
    ));
    commands.spawn((
        PrimaryEguiContext,
        Camera2d,
        Msaa::Off,
        RenderLayers::none(),
        Camera {
            // Over the scene: its picture is blended and the scene's is not cleared.
            order: 1,
            output_mode: CameraOutputMode::Write {
                blend_state: Some(BlendState::ALPHA_BLENDING),
                clear_color: ClearColorConfig::None,
            },
            clear_color: ClearColorConfig::Custom(Color::NONE),
            ..default()
        },
    ));
}

/// Left button: orbit. Right: look around. Middle: pan. Wheel: zoom. Drags that begin on the panel are ignored.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub fn drag(
    buttons: Res<ButtonInput<MouseButton>>,
    mut motion: MessageReader<CursorMoved>,
    scroll: Res<AccumulatedMouseScroll>,
    window: Single<&Window>,
    panel: Res<Panel>,
    egui: Res<EguiWantsInput>,
    parts: Res<Parts>,
    mut began_on_picture: Local<bool>,
    mut orbit: Single<&mut Orbit>,
) {
    let is_on_panel = window.cursor_position().is_none_or(|cursor| cursor.x < panel.width());
    let is_on_picture = !is_on_panel && !egui.wants_any_pointer_input();
    if scroll.delta.y != 0.0 && is_on_picture {
        let pixels_per_step = if scroll.unit == MouseScrollUnit::Pixel { 40.0 } else { 1.0 };
        // Exponential, so that a step in and a step out cancel at any distance.
        orbit.distance *= (-ZOOM * scroll.delta.y / pixels_per_step).exp();
    }
    // Movement of the cursor, since remote desktops do not report raw mouse movement.
    let motion: Vec2 = motion.read().filter_map(|moved| moved.delta).sum();
    if buttons.get_just_pressed().next().is_some() {
        // In a slow frame, this motion includes the way to the place of the click.
        *began_on_picture = is_on_picture;
        return;
    }
    if motion == Vec2::ZERO || !*began_on_picture {
        return;
    }
    // Otherwise the left button is the tool's.
    if buttons.pressed(MouseButton::Left) && parts.tool == Tool::View {
        orbit.turn(motion);
    } else if buttons.pressed(MouseButton::Right) {
        let eye = orbit.transform().translation;
        // Looking around keeps the eye in place and moves the target around it.
        orbit.turn(0.5 * motion);
        orbit.target = eye - orbit.rotation() * Vec3::Z * orbit.distance;
    } else if buttons.pressed(MouseButton::Middle) {
        let shift = Vec3::new(-motion.x, motion.y, 0.0) * orbit.distance * 0.001;
        orbit.target = orbit.target + orbit.rotation() * shift;
    }
}

/// Flies: W A S D in the direction of view, Q and E down and up, Shift faster. F shows the whole scene.
pub fn fly(
    keys: Res<ButtonInput<KeyCode>>,
    time: Res<Time>,
    scene: Res<ShownScene>,
    mut orbit: Single<&mut Orbit>,
) {
    if keys.just_pressed(KeyCode::KeyF) {
        orbit.frame(&scene);
    }
    let axis = |forth, back| f32::from(keys.pressed(forth)) - f32::from(keys.pressed(back));
    // The camera looks along -z, so S is positive.
    let ahead = Vec3::new(axis(KeyCode::KeyD, KeyCode::KeyA), 0.0, axis(KeyCode::KeyS, KeyCode::KeyW));
    let step = orbit.rotation() * ahead + Vec3::Y * axis(KeyCode::KeyE, KeyCode::KeyQ);
    if step != Vec3::ZERO {
        let haste = if keys.pressed(KeyCode::ShiftLeft) { 4.0 } else { 1.0 };
        let seconds = time.delta_secs().min(LONGEST_STEP);
        orbit.target = orbit.target + step * orbit.distance * SPEED * haste * seconds;
    }
}

/// Places the camera, and its viewport beside the panel.
pub fn place(
    camera: Single<(&Orbit, &mut Transform, &mut Camera)>,
    window: Single<&Window>,
    panel: Res<Panel>,
) {
    let (orbit, mut transform, mut camera) = camera.into_inner();
    // A transform that is written in each frame would count as changed and be propagated each time.
    transform.set_if_neq(orbit.transform());
    // The panel is in points, a viewport in pixels.
    let left = (panel.width() * window.scale_factor()).round() as u32;
    let size = window.physical_size();
    let viewport = (left > 0 && left < size.x && size.y > 0).then(|| Viewport {
        physical_position: UVec2::new(left, 0),
        physical_size: UVec2::new(size.x - left, size.y),
        ..default()
    });
    let rect =
        |viewport: &Option<Viewport>| viewport.as_ref().map(|v| (v.physical_position, v.physical_size));
    // `Viewport` has no equality.
    if rect(&camera.viewport) != rect(&viewport) {
        camera.viewport = viewport;
    }
}
