//! Downloads of the scene in the colors of its style.

use bevy::{
    prelude::*,
    tasks::{Task, futures::check_ready},
};
use bevy_stylegaussian::{
    AppliedStyle, GaussianScene, GaussianSplats,
    stylegaussian::{Scene, fold::StylizeError},
    stylegaussian_files::scene_to_bytes,
};
use js_sys::{Array, Float64Array, Uint8Array};
use stylegaussian_app::{Subject, save_shown};
use wasm_bindgen::{JsValue, prelude::wasm_bindgen};

use crate::{
    bridge::{self, Event},
    scene::Shown,
    worker::{self, Call, State},
};

/// The name of a downloaded scene.
const SCENE: &str = "stylegaussian.glb";

#[wasm_bindgen]
extern "C" {
    /// Bytes of the browser.
    type Blob;
    #[wasm_bindgen(constructor)]
    fn new(parts: &Array) -> Blob;

    #[wasm_bindgen(js_namespace = URL, js_name = createObjectURL)]
    fn url_of(blob: &Blob) -> String;
    #[wasm_bindgen(js_namespace = URL, js_name = revokeObjectURL)]
    fn revoke(url: &str);

    /// An `<a>` of the page.
    type Link;
    #[wasm_bindgen(js_namespace = document, js_name = createElement)]
    fn create_element(kind: &str) -> Link;
    #[wasm_bindgen(method, setter, js_name = href)]
    fn set_href(this: &Link, url: &str);
    #[wasm_bindgen(method, setter, js_name = download)]
    fn set_download(this: &Link, name: &str);
    #[wasm_bindgen(method)]
    fn click(this: &Link);
}

/// The file that is being made.
#[derive(Resource, Default)]
pub struct Saving {
    /// Whether one was asked for, which nobody makes yet.
    pub is_wanted: bool,
    making: Option<Making>,
}

/// Who makes a file.
enum Making {
    /// A task, if there is no worker.
    Task(Task<Result<Vec<u8>, String>>),
    /// The worker, which may also decode its colors.
    Worker(Call),
}

/// Downloads the scene as a file.
pub fn scene(
    subject: Single<(Option<&GaussianSplats>, Option<&AppliedStyle>), With<Subject>>,
    scenes: Res<Assets<GaussianScene>>,
    shown: Res<Shown>,
    mut saving: ResMut<Saving>,
) {
    if std::mem::take(&mut saving.is_wanted) {
        let (splats, style) = *subject;
        let Some(splats) = splats else {
            return bridge::tell(
                Event::Failed,
                "A world is not saved as one file. Open a single scene to save it.",
            );
        };
        let Some(scene) = scenes.get(&splats.0) else {
            return bridge::tell(Event::Failed, "There is no scene to save.");
        };
        let has_worker = worker::state() == State::Ready && shown.hold(splats.0.id(), scene).is_ok();
        saving.making = Some(if has_worker {
            match written(style) {
                Ok(call) => Making::Worker(call),
                Err(error) => return bridge::tell(Event::Failed, &error.to_string()),
            }
        } else {
            let write = |scene: &Scene| scene_to_bytes(SCENE, scene).map_err(|error| error.to_string());
            Making::Task(save_shown(scene, style, write))
        });
    }
    let made = match &mut saving.making {
        None => return,
        Some(Making::Task(task)) => check_ready(task),
        Some(Making::Worker(call)) => call.answer(),
    };
    let Some(made) = made else { return };
    saving.making = None;
    match made {
        Ok(bytes) => download(&bytes, SCENE),
        Err(error) => bridge::tell(Event::Failed, &error),
    }
}

/// Has the worker, which holds the scene, write it in the colors of a style.
fn written(style: Option<&AppliedStyle>) -> Result<Call, StylizeError> {
    // No style has a decoder of its own here, so the worker chooses the same one.
    if let Some((_, map)) = style.and_then(AppliedStyle::decoded) {
        let [gain, shift] =
            [&map.gain, &map.shift].map(|of| JsValue::from(Float64Array::from(of.as_slice())));
        return Ok(worker::call("work_decode", &[gain, shift]));
    }
    let painted = style.map(AppliedStyle::painted).transpose()?;
    let painted = painted.map_or_else(Vec::new, |painted| painted.to_bytes());
    Ok(worker::call("work_save", &[worker::bytes(&painted)]))
}

/// Has the browser save bytes as a file of this name.
fn download(bytes: &[u8], name: &str) {
    let parts: JsValue = Uint8Array::from(bytes).into();
    let url = url_of(&Blob::new(&Array::of1(&parts)));
    let link = create_element("a");
    link.set_href(&url);
    link.set_download(name);
    link.click();
    revoke(&url);
}
