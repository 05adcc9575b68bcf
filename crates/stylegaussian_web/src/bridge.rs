//! The way from the app to the page's script: events, and what it may ask at any time.

use std::cell::RefCell;

use bevy::prelude::*;
use bevy_stylegaussian::{
    GaussianSceneFailed, GaussianSceneReady, StyleApplied, StyleFailed, world::WorldState,
};
use js_sys::Function;
use stylegaussian_app::Subject;
use wasm_bindgen::{JsValue, prelude::wasm_bindgen};

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
    /// The script's function that hears events.
    static LISTENER: RefCell<Option<Function>> = const { RefCell::new(None) };
    /// The answer of [`cameras`].
    static CAMERAS: RefCell<String> = const { RefCell::new(String::new()) };
    /// The answer of [`world`].
    static WORLD: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Calls `listener` with the kind and the text of each event: `ready`, `progress`, `loaded`, `shown`, `applied`
/// or `failed`.
#[wasm_bindgen]
pub fn listen(listener: Function) {
    LISTENER.set(Some(listener));
}

/// Counts of the world that is shown, as JSON, or an empty text if there is none: `parts`, `shown_parts`,
/// `shown` and `arriving` Gaussians, `loading` files, and parts that are `waiting` for another level or are
/// `unstyled`.
#[wasm_bindgen]
pub fn world() -> String {
    WORLD.with_borrow(Clone::clone)
}

/// The camera in the axes of the scene that is shown, as a `transforms.json` of one frame in JSON:
/// `stylegaussian render` draws the same picture with it.
#[wasm_bindgen]
pub fn cameras() -> String {
    CAMERAS.with_borrow(Clone::clone)
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
