//! Downloads: the picture, and the scene in the colors of its style.

use bevy::{
    prelude::*,
    render::view::screenshot::{Screenshot, save_to_disk},
    tasks::{Task, futures::check_ready},
};
use bevy_stylegaussian::{
    AppliedStyle, GaussianScene, GaussianSplats,
    stylegaussian::{Scene, fold::StylizeError, morton, paint::Painted, strokes::Strokes},
    stylegaussian_files::scene_to_bytes,
};
use js_sys::{Array, Uint8Array};
use stylegaussian_app::{Subject, save_shown};
use wasm_bindgen::{JsValue, prelude::wasm_bindgen};

use crate::{
    bridge::{self, Event, Request},
    paintings::Paintings,
    scene::Shown,
    style::Wish,
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

/// Downloads the picture as a file.
pub fn picture(mut requests: MessageReader<Request>, mut commands: Commands) {
    if requests.read().any(|request| matches!(request, Request::SavePicture)) {
        commands.spawn(Screenshot::primary_window()).observe(save_to_disk("stylegaussian.png"));
    }
}

/// The file that is being made.
#[derive(Resource, Default)]
pub struct Saving(Option<Making>);

/// Who makes a file.
enum Making {
    /// A task, if there is no worker.
    Task(Task<Result<Vec<u8>, String>>),
    /// The worker, which may also decode them.
    Worker(Call),
}

/// Downloads the scene as a file.
pub fn scene(
    mut requests: MessageReader<Request>,
    subject: Single<(Option<&GaussianSplats>, Option<&AppliedStyle>), With<Subject>>,
    scenes: Res<Assets<GaussianScene>>,
    (shown, wish, paintings): (Res<Shown>, Res<Wish>, Res<Paintings>),
    mut saving: ResMut<Saving>,
) {
    if requests.read().any(|request| matches!(request, Request::SaveGlb)) {
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
        saving.0 = Some(if !has_worker {
            let write = |scene: &Scene| scene_to_bytes(SCENE, scene).map_err(|error| error.to_string());
            Making::Task(save_shown(scene, style, write))
        } else if let Some(given) = style.and_then(|_| wish.for_worker(&paintings)) {
            Making::Worker(worker::call("work_decode", &given))
        } else {
            match style.map(|style| shown_in(style, scene.scene())).transpose() {
                Ok(painted) => {
                    let painted = worker::bytes(&painted.unwrap_or_default());
                    Making::Worker(worker::call("work_save", &[painted]))
                }
                Err(error) => return bridge::tell(Event::Failed, &error.to_string()),
            }
        });
    }
    let made = match &mut saving.0 {
        None => return,
        Some(Making::Task(task)) => check_ready(task),
        Some(Making::Worker(call)) => call.answer(),
    };
    let Some(made) = made else { return };
    saving.0 = None;
    match made {
        Ok(bytes) => download(&bytes, SCENE),
        Err(error) => bridge::tell(Event::Failed, &error),
    }
}

/// The colors and strokes of a scene for the worker, which holds it in the order of a `.sgs`.
fn shown_in(style: &AppliedStyle, scene: &Scene) -> Result<Vec<u8>, StylizeError> {
    let strokes = style.strokes().map(|strokes| (**strokes).clone()).unwrap_or_default();
    let painted = Painted { colors: style.colors()?.to_vec(), strokes, ..Painted::default() };
    Ok(in_order(&painted, &morton::order(&scene.means)).to_bytes())
}

/// A painted scene with its Gaussians in another order, `indices` `[N]` into the present one.
fn in_order(painted: &Painted, indices: &[u32]) -> Painted {
    fn of<T: Copy>(values: &[T], indices: &[u32]) -> Vec<T> {
        indices.iter().map(|i| values[*i as usize]).collect()
    }
    let Strokes { seeds, words, textures } = painted.strokes.clone();
    let words = if words.is_empty() { words } else { of(&words, indices) };
    let strokes = Strokes { seeds, words, textures };
    Painted { colors: of(&painted.colors, indices), strokes, ..*painted }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_go_with_their_gaussians() {
        let colors = vec![[0.1, 0.2, 0.3], [-0.25, 0.5, 1.25], [0.7, 0.8, 0.9]];
        let strokes = Strokes { words: vec![7, 8, 9], ..Strokes::default() };
        let mut painted = Painted { colors, strokes, ..Painted::default() };
        let turned = in_order(&painted, &[2, 0, 1]);
        assert_eq!((turned.colors[0], &turned.strokes.words[..]), (painted.colors[2], &[9, 7, 8][..]));
        painted.strokes.words.clear();
        assert!(in_order(&painted, &[2, 1, 0]).strokes.words.is_empty());
    }
}
