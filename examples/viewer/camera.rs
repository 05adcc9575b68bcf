//! The mouse and keys that move the camera, and its picture beside the panel.

use bevy::{
    camera::{CameraOutputMode, Viewport, visibility::RenderLayers},
    input::mouse::{AccumulatedMouseScroll, MouseScrollUnit},
    prelude::*,
    render::render_resource::BlendState,
};
use bevy_egui::{PrimaryEguiContext, input::EguiWantsInput};
use stylegaussian_app::{Orbit, splat_camera};

use crate::{
    panel::Panel,
    parts::{Parts, Tool},
    scene::ShownScene,
};

/// Radians per point of cursor movement.
const TURN: f32 = 0.006;
/// Share of the distance per point of cursor movement.
const PAN: f32 = 0.001;
/// Share of the distance covered by one step of the wheel.
const ZOOM: f32 = 0.12;
/// Share of the distance covered per second of flying.
const SPEED: f32 = 0.5;
/// Longest time step in seconds: a slower frame counts as this long, so that flying never jumps past the scene.
const LONGEST_STEP: f32 = 0.25;

/// Spawns a camera for the scene, beside the panel, and one over it for the panel.
pub fn spawn(mut commands: Commands) {
    commands.spawn(splat_camera());
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
        orbit.zoom((-ZOOM * scroll.delta.y / pixels_per_step).exp());
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
    // The scene follows the cursor: it moves to the right if the camera turns or moves to the left.
    let motion = Vec2::new(-motion.x, motion.y);
    // Otherwise the left button is the tool's.
    if buttons.pressed(MouseButton::Left) && parts.tool == Tool::View {
        orbit.turn(TURN * motion.x, TURN * motion.y);
    } else if buttons.pressed(MouseButton::Right) {
        orbit.look(0.5 * TURN * motion.x, 0.5 * TURN * motion.y);
    } else if buttons.pressed(MouseButton::Middle) {
        orbit.fly(PAN * motion.extend(0.0));
    }
}

/// Flies along the camera's axes: W A S D ahead and aside, Q and E down and up, Shift faster. F shows the whole
/// scene.
pub fn fly(
    keys: Res<ButtonInput<KeyCode>>,
    time: Res<Time>,
    scene: Res<ShownScene>,
    camera: Single<(&mut Orbit, &Camera)>,
) {
    let (mut orbit, camera) = camera.into_inner();
    if keys.just_pressed(KeyCode::KeyF) {
        *orbit = scene.framing.orbit(camera);
    }
    let axis = |forth, back| f32::from(keys.pressed(forth)) - f32::from(keys.pressed(back));
    // The camera looks along -z, so S is positive.
    let step = Vec3::new(
        axis(KeyCode::KeyD, KeyCode::KeyA),
        axis(KeyCode::KeyE, KeyCode::KeyQ),
        axis(KeyCode::KeyS, KeyCode::KeyW),
    );
    if step != Vec3::ZERO {
        let haste = if keys.pressed(KeyCode::ShiftLeft) { 4.0 } else { 1.0 };
        let seconds = time.delta_secs().min(LONGEST_STEP);
        orbit.fly(SPEED * haste * seconds * step);
    }
}

/// Places the scene's picture beside the panel.
pub fn place_picture(
    mut camera: Single<&mut Camera, With<Orbit>>,
    window: Single<&Window>,
    panel: Res<Panel>,
) {
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
