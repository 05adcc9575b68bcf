//! The way between the page's script and the app: requests there, events back.

use std::cell::{Cell, RefCell};

use bevy::prelude::*;
use bevy_stylegaussian::{
    GaussianSceneFailed, GaussianSceneReady, StyleApplied, StyleFailed, world::WorldState,
};
use js_sys::{Function, Uint8Array};
use stylegaussian_app::Subject;
use wasm_bindgen::{JsValue, prelude::wasm_bindgen};

/// A request of the page's script.
#[derive(Message, Clone, Debug)]
pub enum Request {
    /// A scene beside the page, by its path in `assets`.
    OpenAsset(String),
    /// A world, by the address of its `lod-meta.json`.
    OpenWorld(String),
    /// Most Gaussians of a world that are shown.
    WorldBudget(usize),
    /// A scene of the visitor.
    OpenFile {
        /// The file's name.
        name: String,
        /// The file's bytes. They stay the browser's: the app's own memory ends at 4 GB.
        bytes: Uint8Array,
    },
    /// An image of the visitor, as the style `image:NAME`.
    AddPainting {
        /// The name.
        name: String,
        /// The file's bytes.
        bytes: Uint8Array,
    },
    /// A mix of styles, in place of the present one.
    Style {
        /// Names and weights, see [`style`](crate::style). None are the captured colors.
        styles: Vec<(String, f32)>,
        /// Share of the content's features, 0..1.
        content: f32,
        /// Share of the style's colors, 0..1.
        strength: f32,
        /// Whether the decoder alone makes the colors of images, without their strokes.
        by_decoder: bool,
    },
    /// How strokes are drawn: factors, as those of [`StyleSource`](bevy_stylegaussian::StyleSource).
    Strokes {
        /// Of the strokes, 0 to 3.
        paint: f32,
        /// Of what stays clear of them, 0 to 10.
        protection: f32,
        /// Of their size, 0.1 to 10.
        stroke_scale: f32,
    },
    /// How strokes move.
    Motion {
        /// `still`, `boil` or `flow`.
        kind: String,
        /// Times per second, 0 to 60.
        rate: f32,
        /// In widths of a stroke, 0 to 8.
        distance: f32,
    },
    /// The thickness of strokes.
    Relief {
        /// As a factor, 0 to 4.
        amount: f32,
        /// Where the light is, in degrees around the scene.
        light_from: f32,
    },
    /// Whether strokes keep their size on screen.
    ScreenStable(bool),
    /// A turn around the scene, in radians.
    Turn {
        /// To the right.
        yaw: f32,
        /// Upward.
        pitch: f32,
    },
    /// A move along the camera's axes (right, up, back), in shares of its distance.
    Fly(Vec3),
    /// A factor of the distance.
    Zoom(f32),
    /// Features for the scene that is shown.
    Embed,
    /// No features.
    CancelEmbedding,
    /// The way in which changes of style are shown.
    Transition {
        /// `fade`, `sphere`, `front` or `noise`.
        kind: String,
        /// Its time.
        seconds: f32,
    },
    /// GPU time per frame for changes of style, in milliseconds.
    Budget(f32),
    /// A download of the picture.
    SavePicture,
    /// A download of the scene in the colors of the shown style, as a `.glb`.
    SaveGlb,
}

/// The kinds of event that the page's script hears.
#[derive(Clone, Copy, Debug)]
pub enum Event {
    /// The first frame was drawn.
    Ready,
    /// Work that takes a while: `reading`, `encoding`, `painting` or `embedding`, the last with the share that
    /// is done, 0..1.
    Progress,
    /// A scene was read: its number of Gaussians, and whether it has features, which the decoder needs.
    Loaded,
    /// The scene is drawn.
    Shown,
    /// A style is shown: the milliseconds since it was asked for.
    Applied,
    /// Something could not be done: a sentence.
    Failed,
}

thread_local! {
    /// Requests since the last frame. They come between frames, when no system runs.
    static REQUESTS: RefCell<Vec<Request>> = const { RefCell::new(Vec::new()) };
    /// The script's function that hears events.
    static LISTENER: RefCell<Option<Function>> = const { RefCell::new(None) };
    /// The answer of [`cameras`].
    static CAMERAS: RefCell<String> = const { RefCell::new(String::new()) };
    /// The answer of [`world`].
    static WORLD: RefCell<String> = const { RefCell::new(String::new()) };
    /// Whether the first frame was reported.
    static IS_TOLD: Cell<bool> = const { Cell::new(false) };
}

fn ask(request: Request) {
    REQUESTS.with_borrow_mut(|requests| requests.push(request));
}

/// Calls `listener` with the kind and the text of each event: `ready`, `progress`, `loaded`, `shown`, `applied`
/// or `failed`.
#[wasm_bindgen]
pub fn listen(listener: Function) {
    LISTENER.set(Some(listener));
}

/// Shows a scene beside the page, by its path in `assets`.
#[wasm_bindgen]
pub fn open_asset(path: String) {
    ask(Request::OpenAsset(path));
}

/// Shows a world: levels of detail of a streamed SOG, by the address of its `lod-meta.json`. Its chunks are
/// fetched from beside that as the camera needs them.
#[wasm_bindgen]
pub fn open_world(address: String) {
    ask(Request::OpenWorld(address));
}

/// Sets the most Gaussians of a world that are shown, 1 million at first.
#[wasm_bindgen]
pub fn set_world_budget(gaussians: u32) {
    ask(Request::WorldBudget(gaussians as usize));
}

/// Counts of the world that is shown, as JSON, or an empty text if there is none: `parts`, `shown_parts`,
/// `shown` and `arriving` Gaussians, `loading` files, and parts that are `waiting` for another level or are
/// `unstyled`.
#[wasm_bindgen]
pub fn world() -> String {
    WORLD.with_borrow(Clone::clone)
}

/// Shows a scene of the visitor.
#[wasm_bindgen]
pub fn open_file(name: String, bytes: Uint8Array) {
    ask(Request::OpenFile { name, bytes });
}

/// Takes an image of the visitor as the style `image:NAME`.
#[wasm_bindgen]
pub fn add_painting(name: String, bytes: Uint8Array) {
    ask(Request::AddPainting { name, bytes });
}

/// Puts a mix of styles on the scene; `names` and `weights` go in pairs. `content` is the share of the
/// content's features, `strength` that of the style's colors, both 0..1. If `by_decoder`, the decoder alone
/// makes the colors of images.
#[wasm_bindgen]
pub fn set_style(names: Vec<String>, weights: Vec<f32>, content: f32, strength: f32, by_decoder: bool) {
    ask(Request::Style { styles: names.into_iter().zip(weights).collect(), content, strength, by_decoder });
}

/// Sets how strokes are drawn, from the next frame on: factors of the strokes (0 to 3), of what stays clear of
/// them (0 to 10) and of their size (0.1 to 10), 1 at first. Numbers outside are taken as the nearest one
/// inside, and none as 1. Nothing is computed.
#[wasm_bindgen]
pub fn set_strokes(paint: f32, protection: f32, stroke_scale: f32) {
    ask(Request::Strokes { paint, protection, stroke_scale });
}

/// Sets how strokes move, from the next frame on: `still`, as at first, `boil` (redrawn some times a second) or
/// `flow` (along their own direction), how many times per second (0 to 60), and how far, in widths of a stroke
/// (0 to 8). Nothing is computed.
#[wasm_bindgen]
pub fn set_motion(kind: String, rate: f32, distance: f32) {
    ask(Request::Motion { kind, rate, distance });
}

/// Sets the thickness of strokes, from the next frame on, as a factor (0 to 4; 0 at first), and where the light
/// on them is, in degrees around the scene. Nothing is computed.
#[wasm_bindgen]
pub fn set_relief(amount: f32, light_from: f32) {
    ask(Request::Relief { amount, light_from });
}

/// Sets whether strokes keep their size on screen, from near and far, from the next frame on. At first they do
/// not. Nothing is computed.
#[wasm_bindgen]
pub fn set_screen_stable(screen_stable: bool) {
    ask(Request::ScreenStable(screen_stable));
}

/// Gives the scene that is shown features, in the page's worker, so that it can be decoded. It is then `loaded`
/// once more.
#[wasm_bindgen]
pub fn embed_soon() {
    ask(Request::Embed);
}

/// Ends what [`embed_soon`] has begun.
#[wasm_bindgen]
pub fn cancel_embedding() {
    ask(Request::CancelEmbedding);
}

/// Sets the way in which changes of style are shown, for those that come: `fade`, `sphere` (from what the
/// camera turns around), `front` (from left to right) or `noise` (spots that grow), and its time.
#[wasm_bindgen]
pub fn set_transition(kind: String, seconds: f32) {
    ask(Request::Transition { kind, seconds });
}

/// Sets the GPU time per frame for changes of style, in milliseconds. `Infinity` completes a change in one
/// frame.
#[wasm_bindgen]
pub fn set_budget(milliseconds: f32) {
    ask(Request::Budget(milliseconds.max(0.0)));
}

/// Turns the camera around the scene by angles in radians.
#[wasm_bindgen]
pub fn turn(yaw: f32, pitch: f32) {
    ask(Request::Turn { yaw, pitch });
}

/// Moves the camera to the right, up and back, in shares of its distance.
#[wasm_bindgen]
pub fn fly(right: f32, up: f32, back: f32) {
    ask(Request::Fly(Vec3::new(right, up, back)));
}

/// Multiplies the camera's distance.
#[wasm_bindgen]
pub fn zoom(factor: f32) {
    ask(Request::Zoom(factor));
}

/// The camera in the axes of the scene that is shown, as a `transforms.json` of one frame in JSON:
/// `stylegaussian render` draws the same picture with it.
#[wasm_bindgen]
pub fn cameras() -> String {
    CAMERAS.with_borrow(Clone::clone)
}

/// Downloads the picture.
#[wasm_bindgen]
pub fn save_picture_soon() {
    ask(Request::SavePicture);
}

/// Downloads the scene in the colors of the shown style, as a `.glb`.
#[wasm_bindgen]
pub fn save_glb_soon() {
    ask(Request::SaveGlb);
}

/// Tells the page's script, if it listens.
pub fn tell(event: Event, text: &str) {
    let kind = match event {
        Event::Ready => "ready",
        Event::Progress => "progress",
        Event::Loaded => "loaded",
        Event::Shown => "shown",
        Event::Applied => "applied",
        Event::Failed => "failed",
    };
    LISTENER.with_borrow(|listener| {
        if let Some(listener) = listener {
            // An error in the page's script is the page's own, and the browser has reported it.
            let _ = listener.call2(&JsValue::NULL, &kind.into(), &text.into());
        }
    });
}

/// Notes the camera for [`cameras`]: the angle of view in radians, the size in pixels, and the place in the
/// scene's axes.
pub fn note_camera(vertical_angle: f32, size: UVec2, scene_from_camera: Mat4) {
    let row = |i| scene_from_camera.row(i).to_array();
    let focal = 0.5 * size.y as f32 / (0.5 * vertical_angle).tan();
    CAMERAS.set(format!(
        "{{\"w\": {}, \"h\": {}, \"fl_x\": {focal}, \"fl_y\": {focal}, \
         \"frames\": [{{\"transform_matrix\": {:?}}}]}}",
        size.x,
        size.y,
        [row(0), row(1), row(2), row(3)],
    ));
}

/// Notes the counts for [`world`].
pub fn note_world(state: Option<&WorldState>) {
    let text = state.map(|state| {
        let WorldState { parts, shown_parts, shown, arriving, loading, waiting, unstyled, .. } = state;
        format!(
            "{{\"parts\": {parts}, \"shown_parts\": {shown_parts}, \"shown\": {shown}, \
             \"arriving\": {arriving}, \"loading\": {loading}, \"waiting\": {waiting}, \
             \"unstyled\": {unstyled}}}"
        )
    });
    WORLD.set(text.unwrap_or_default());
}

/// Passes on what the script has asked for since the last frame.
pub fn take_requests(mut requests: MessageWriter<Request>) {
    requests.write_batch(REQUESTS.take());
    if !IS_TOLD.replace(true) {
        tell(Event::Ready, "");
    }
}

// Parts of a world are scenes, too. `world` tells of them all together.

/// Tells that a scene is drawn.
pub fn tell_shown(ready: On<GaussianSceneReady>, subjects: Query<(), With<Subject>>) {
    if subjects.contains(ready.entity) {
        tell(Event::Shown, "");
    }
}

/// Tells that a style is shown.
pub fn tell_applied(applied: On<StyleApplied>, subjects: Query<(), With<Subject>>) {
    if subjects.contains(applied.entity) {
        tell(Event::Applied, &applied.elapsed.as_millis().to_string());
    }
}

/// Tells why a scene cannot be shown.
pub fn tell_failed_scene(failed: On<GaussianSceneFailed>, subjects: Query<(), With<Subject>>) {
    if subjects.contains(failed.entity) {
        tell(Event::Failed, &failed.error.to_string());
    }
}

/// Tells why a style cannot be shown.
pub fn tell_failed_style(failed: On<StyleFailed>) {
    tell(Event::Failed, &failed.error.to_string());
}
