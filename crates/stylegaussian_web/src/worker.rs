//! The page's worker: a thread of the browser that runs this same module without an app, for computations that
//! would stop frames.
//!
//! `worker.js` calls the functions of [`work`](crate::work) there, one after another, and posts what they
//! answer. Without a worker, in a page that gives none or where it does not start, the app computes on its own
//! thread.

use std::{cell::RefCell, collections::HashMap};

use bevy::asset::AssetId;
use bevy_stylegaussian::GaussianScene;
use js_sys::{Array, Function, Object, Reflect, Uint8Array};
use wasm_bindgen::{JsCast, JsValue, closure::Closure, prelude::wasm_bindgen};

use crate::{
    bridge::{self, Event},
    memory,
};

#[wasm_bindgen]
extern "C" {
    /// A worker of the browser.
    #[derive(Clone, Debug)]
    type Worker;
    #[wasm_bindgen(method, catch, js_name = postMessage)]
    fn post(this: &Worker, message: &JsValue) -> Result<(), JsValue>;
    #[wasm_bindgen(method)]
    fn terminate(this: &Worker);
    #[wasm_bindgen(method, setter, js_name = onmessage)]
    fn set_onmessage(this: &Worker, hear: &Function);
    #[wasm_bindgen(method, setter, js_name = onerror)]
    fn set_onerror(this: &Worker, hear: &Function);
    #[wasm_bindgen(thread_local_v2, js_name = document)]
    static DOCUMENT: JsValue;
}

/// The worker's state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// There is none.
    #[default]
    Absent,
    /// Its module is being started.
    Starting,
    /// It takes calls.
    Ready,
}

/// Bytes, or why there are none.
type Answer = Result<Vec<u8>, String>;

/// A call of a function of [`work`](crate::work) in the worker.
#[derive(Debug)]
pub struct Call(u32);

#[derive(Default)]
struct Page {
    /// The page's function that makes a worker.
    make: Option<Function>,
    worker: Option<Worker>,
    state: State,
    /// The number of the last call.
    last: u32,
    /// The calls that somebody waits for. `None` are not answered yet.
    calls: HashMap<u32, Option<Answer>>,
    /// The scene that the worker holds.
    held: Option<AssetId<GaussianScene>>,
}

thread_local! {
    static PAGE: RefCell<Page> = RefCell::default();
}

/// Gives the app a function that returns a new `Worker` of `worker.js`. It is called at once, and when a worker
/// was stopped.
#[wasm_bindgen]
pub fn use_worker(make: Function) {
    PAGE.with_borrow_mut(|page| page.make = Some(make));
    start();
}

/// The worker's state.
pub fn state() -> State {
    PAGE.with_borrow(|page| page.state)
}

/// Calls a function of [`work`](crate::work). The worker must be ready.
pub fn call(function: &str, given: &[JsValue]) -> Call {
    let (id, worker) = PAGE.with_borrow_mut(|page| {
        page.last += 1;
        page.calls.insert(page.last, None);
        (page.last, page.worker.clone())
    });
    let message = Object::new();
    set(&message, "id", &id.into());
    set(&message, "call", &function.into());
    set(&message, "given", &given.iter().collect::<Array>());
    let posted = worker.map(|worker| worker.post(&message));
    if !matches!(posted, Some(Ok(()))) {
        answer(id, Err(format!("the page's worker does not take `{function}`")));
    }
    Call(id)
}

impl Call {
    /// The answer, once, or `None` while the worker computes.
    pub fn answer(&self) -> Option<Answer> {
        PAGE.with_borrow_mut(|page| page.calls.get_mut(&self.0)?.take())
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        // Nobody waits for it any more. The worker computes it all the same.
        PAGE.with_borrow_mut(|page| page.calls.remove(&self.0));
    }
}

/// The scene that the worker holds.
pub fn held() -> Option<AssetId<GaussianScene>> {
    PAGE.with_borrow(|page| page.held)
}

/// Notes that the worker holds a scene.
pub fn holds(scene: Option<AssetId<GaussianScene>>) {
    PAGE.with_borrow_mut(|page| page.held = scene);
}

/// A copy of bytes for the worker.
pub fn bytes(bytes: &[u8]) -> JsValue {
    Uint8Array::from(bytes).into()
}

/// A file beside the page, by its path in `assets`, for the worker to load.
pub fn asset(path: &str) -> JsValue {
    let base = DOCUMENT.with(|document| Reflect::get(document, &"baseURI".into()));
    // As Bevy does: relative to the page.
    let base = base.ok().and_then(|base| base.as_string()).unwrap_or_default();
    let folder = base.rsplit_once('/').map_or("", |(folder, _)| folder);
    let file = Object::new();
    set(&file, "url", &format!("{folder}/assets/{path}").into());
    file.into()
}

/// Stops the worker with all that it computes, and starts another one. Calls under way fail for this reason.
pub fn restart(reason: &str) {
    stop(reason);
    start();
}

fn stop(reason: &str) {
    PAGE.with_borrow_mut(|page| {
        if let Some(worker) = page.worker.take() {
            worker.terminate();
        }
        (page.state, page.held) = (State::Absent, None);
        for answer in page.calls.values_mut() {
            answer.get_or_insert_with(|| Err(reason.into()));
        }
    });
}

fn start() {
    let Some(make) = PAGE.with_borrow(|page| page.make.clone()) else { return };
    // The page may be one where workers are forbidden.
    let Ok(worker) = make.call0(&JsValue::NULL) else { return };
    let worker: Worker = worker.unchecked_into();
    let hear = Closure::<dyn FnMut(JsValue)>::new(|event| hear(&event)).into_js_value();
    worker.set_onmessage(hear.unchecked_ref());
    // The script is missing, or cannot be run. Starting it anew would not help.
    let fail = Closure::<dyn FnMut()>::new(|| stop("the page's worker does not start")).into_js_value();
    worker.set_onerror(fail.unchecked_ref());
    let message = Object::new();
    set(&message, "module", &wasm_bindgen::module());
    if worker.post(&message).is_ok() {
        PAGE.with_borrow_mut(|page| (page.worker, page.state) = (Some(worker), State::Starting));
    }
}

/// Hears a message of the worker.
fn hear(event: &JsValue) {
    let Some(data) = get(event, "data") else { return };
    let text = |name: &str| get(&data, name)?.as_string();
    if get(&data, "ready").is_some() {
        PAGE.with_borrow_mut(|page| page.state = State::Ready);
    } else if let Some(reason) = text("stopped") {
        let was_ready = state() == State::Ready;
        stop(&format!("the page's worker has stopped ({reason})"));
        // One that never was ready would not be the next time.
        if was_ready {
            start();
        }
    } else if let Some(progress) = text("progress") {
        bridge::tell(Event::Progress, &progress);
    } else if let Some(id) = get(&data, "id").and_then(|id| id.as_f64()) {
        let error = || Err(text("error").unwrap_or_default());
        let bytes = get(&data, "bytes").map(|bytes| memory::copied(&Uint8Array::new(&bytes)));
        answer(id as u32, bytes.unwrap_or_else(error));
    }
}

/// Keeps an answer if somebody waits for it.
fn answer(id: u32, answer: Answer) {
    PAGE.with_borrow_mut(|page| {
        if let Some(waiting) = page.calls.get_mut(&id) {
            *waiting = Some(answer);
        }
    });
}

/// A property that is there.
fn get(object: &JsValue, name: &str) -> Option<JsValue> {
    Reflect::get(object, &name.into()).ok().filter(|value| !value.is_undefined())
}

/// Sets a property of an object of our own, which takes any.
fn set(object: &Object, name: &str, value: &JsValue) {
    let _ = Reflect::set(object, &name.into(), value);
}
