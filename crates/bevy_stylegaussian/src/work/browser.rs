//! The browser's worker: a thread that runs this same module without the app, and answers calls of paint
//! ([`stylegaussian::apart`]) beside frames.
//!
//! Its script (`browser.js`) loads the script that `wasm-bindgen` has made and that runs this module, by the
//! same address, and starts the module that the browser has compiled already, all but `main`. Page and worker
//! share no memory, so the host needs no headers. The first call starts it. Calls are answered one after
//! another. If the worker dies, the next call starts another one, which holds nothing yet; if none can be
//! started, whoever calls computes.

use std::{cell::RefCell, collections::VecDeque, rc::Rc};

use async_lock::OnceCell;
use bevy::log::warn;
use js_sys::{Array, Error, Function, Object, Reflect, Uint8Array};
use stylegaussian::{
    apart::{Apart, Pieces},
    work::Work,
};
use wasm_bindgen::{JsCast, JsError, JsValue, closure::Closure, prelude::wasm_bindgen};

use super::script;

/// The script of the worker.
const SCRIPT: &str = include_str!("browser.js");

#[wasm_bindgen]
extern "C" {
    /// A worker of the browser.
    type Worker;
    #[wasm_bindgen(constructor, catch)]
    fn new_worker(address: &str, options: &JsValue) -> Result<Worker, JsValue>;
    #[wasm_bindgen(method, catch, js_name = postMessage)]
    fn post(this: &Worker, message: &JsValue, given: &Array) -> Result<(), JsValue>;
    #[wasm_bindgen(method)]
    fn terminate(this: &Worker);
    #[wasm_bindgen(method, setter, js_name = onmessage)]
    fn set_onmessage(this: &Worker, hear: &Function);
    #[wasm_bindgen(method, setter, js_name = onerror)]
    fn set_onerror(this: &Worker, hear: &Function);

    /// Tells the page something, in the worker.
    #[wasm_bindgen(js_name = postMessage)]
    fn tell_page(message: &JsValue);

    /// Bytes of the browser.
    type Blob;
    #[wasm_bindgen(constructor)]
    fn new_blob(parts: &Array, options: &JsValue) -> Blob;
    #[wasm_bindgen(js_namespace = URL, js_name = createObjectURL)]
    fn address_of(blob: &Blob) -> String;
    #[wasm_bindgen(js_namespace = URL, js_name = revokeObjectURL)]
    fn revoke(address: &str);
}

/// A call is not answered.
#[derive(Clone, Debug)]
pub(crate) enum Fail {
    /// There is no worker.
    Absent,
    /// The worker was replaced before it came to this call. The next one holds nothing yet.
    Replaced,
    /// Nobody wants the answer any more.
    Canceled,
    /// The worker answers with a sentence: what is asked for cannot be had.
    Said(String),
}

/// A call that is not answered yet.
struct Waiting {
    call: Uint8Array,
    work: Work,
    /// Whether it may be long, and nothing that the worker holds is worth its end.
    ends_worker: bool,
    answer: Rc<OnceCell<Result<Uint8Array, Fail>>>,
}

#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum State {
    /// Nobody has called.
    #[default]
    Untried,
    /// Its module is being started.
    Starting,
    /// It answers.
    Ready,
    /// It does not start here.
    Absent,
}

#[derive(Default)]
struct Page {
    state: State,
    worker: Option<Worker>,
    /// The number of the present worker, from 1.
    number: u32,
    waiting: VecDeque<Waiting>,
    running: Option<Waiting>,
}

thread_local! {
    static PAGE: RefCell<Page> = RefCell::default();
    /// The scenes and paintings that the worker holds, in its own module.
    static APART: RefCell<Apart> = RefCell::default();
}

/// Answers a call, in the worker.
#[wasm_bindgen]
pub fn stylegaussian_apart(call: Vec<u8>) -> Result<Vec<u8>, JsError> {
    // The page ends the worker to stop it.
    let work = Work::telling(|share| tell_page(&object(&[("progress", share.into())])));
    APART.with_borrow_mut(|apart| apart.answer(&call, &work)).map_err(Into::into)
}

/// The number of the worker, which is started if there is none.
pub(crate) fn present() -> Result<u32, Fail> {
    PAGE.with_borrow_mut(|page| {
        if page.state == State::Untried {
            page.start();
        }
        if page.state == State::Absent { Err(Fail::Absent) } else { Ok(page.number) }
    })
}

/// Whether there is a worker that answers at once.
pub(crate) fn is_ready() -> bool {
    PAGE.with_borrow(|page| page.state == State::Ready)
}

/// The answer to a call. Whoever drops what it waits for cancels `work`. If `ends`, the call may be long, and
/// the worker is ended with it then.
///
/// # Errors
/// If there is none: see [`Fail`].
pub(crate) async fn call(pieces: &Pieces<'_>, work: &Work, ends: bool) -> Result<Vec<u8>, Fail> {
    present()?;
    let answer = Rc::<OnceCell<_>>::default();
    let call =
        Waiting { call: joined(pieces), work: work.clone(), ends_worker: ends, answer: Rc::clone(&answer) };
    PAGE.with_borrow_mut(|page| {
        page.waiting.push_back(call);
        page.advance();
    });
    answer.wait().await.as_ref().map(Uint8Array::to_vec).map_err(Clone::clone)
}

/// Tells the worker of this number something that has no answer, if it is the present one.
pub(crate) fn tell(number: u32, pieces: &Pieces<'_>) {
    PAGE.with_borrow_mut(|page| {
        if number > 0 && number == page.number && page.worker.is_some() {
            let (work, answer) = (Work::default(), Rc::default());
            page.waiting.push_back(Waiting { call: joined(pieces), work, ends_worker: false, answer });
            page.advance();
        }
    });
}

/// Gives up calls that nobody wants any more.
pub(crate) fn stop_canceled() {
    PAGE.with_borrow_mut(|page| {
        let is_canceled = |call: &Waiting| call.work.is_canceled();
        page.waiting.retain(|call| {
            if is_canceled(call) {
                call.end(Fail::Canceled);
            }
            !is_canceled(call)
        });
        if let Some(call) = page.running.take_if(|call| call.ends_worker && is_canceled(call)) {
            call.end(Fail::Canceled);
            page.stop(&Fail::Replaced);
        }
    });
}

impl Waiting {
    fn end(&self, fail: Fail) {
        // Nobody else sets it.
        let _ = self.answer.try_set(Err(fail));
    }
}

impl Page {
    /// Starts a worker.
    fn start(&mut self) {
        self.number += 1;
        self.state = State::Starting;
        if let Err(reason) = self.try_start() {
            self.give_up(&reason);
        }
    }

    fn try_start(&mut self) -> Result<(), String> {
        let stack = Reflect::get(&Error::new(""), &"stack".into()).ok().and_then(|stack| stack.as_string());
        let stack = stack.unwrap_or_default();
        let script = script::address(&stack).ok_or("the module's script has no address")?;
        let parts = Array::of1(&JsValue::from(SCRIPT));
        let of_script = address_of(&Blob::new_blob(&parts, &object(&[("type", "text/javascript".into())])));
        let worker = Worker::new_worker(&of_script, &object(&[("type", "module".into())]));
        let worker = worker.map_err(|_| "it is forbidden")?;
        let number = self.number;
        let mut of_script = Some(of_script);
        let hear = Closure::<dyn FnMut(JsValue)>::new(move |event| {
            // The browser has loaded it.
            of_script.take().iter().for_each(|address| revoke(address));
            PAGE.with_borrow_mut(|page| page.hear(number, &event));
        });
        worker.set_onmessage(hear.into_js_value().unchecked_ref());
        // The script cannot be run.
        let fail = Closure::<dyn FnMut()>::new(move || {
            PAGE.with_borrow_mut(|page| {
                if page.number == number && page.state == State::Starting {
                    page.give_up("its script cannot be run");
                }
            });
        });
        worker.set_onerror(fail.into_js_value().unchecked_ref());
        let message = object(&[("script", script.into()), ("module", wasm_bindgen::module())]);
        worker.post(&message, &Array::new()).map_err(|_| "it does not take the module")?;
        self.worker = Some(worker);
        Ok(())
    }

    /// Tries no more.
    fn give_up(&mut self, reason: &str) {
        warn!("the browser gives no worker ({reason}): paint is computed between frames");
        self.stop(&Fail::Absent);
        self.state = State::Absent;
    }

    /// Ends the worker with all that it computes and holds. The next call starts another one.
    fn stop(&mut self, fail: &Fail) {
        if let Some(worker) = self.worker.take() {
            worker.terminate();
        }
        self.state = State::Untried;
        let calls = self.running.take().into_iter().chain(std::mem::take(&mut self.waiting));
        calls.for_each(|call| call.end(fail.clone()));
    }

    /// Has the worker, if it is free, answer the next call.
    fn advance(&mut self) {
        if self.state != State::Ready || self.running.is_some() {
            return;
        }
        let (Some(worker), Some(next)) = (&self.worker, self.waiting.pop_front()) else { return };
        let message = object(&[("call", next.call.clone().into())]);
        // Its bytes are not copied: they are the worker's from now on.
        match worker.post(&message, &Array::of1(&JsValue::from(next.call.buffer()))) {
            Ok(()) => self.running = Some(next),
            Err(_) => {
                next.end(Fail::Said("the browser's worker does not take a call".into()));
                self.advance();
            }
        }
    }

    /// Hears a message of the worker of this number.
    fn hear(&mut self, number: u32, event: &JsValue) {
        let Some(data) = get(event, "data").filter(|_| number == self.number && self.worker.is_some()) else {
            return;
        };
        let text = |name: &str| get(&data, name)?.as_string();
        if get(&data, "ready").is_some() {
            self.state = State::Ready;
        } else if let Some(reason) = text("stopped") {
            if self.state == State::Starting {
                return self.give_up(&reason);
            }
            if let Some(call) = self.running.take() {
                call.end(Fail::Said(format!("the browser's worker has stopped ({reason})")));
            }
            self.stop(&Fail::Replaced);
        } else if let Some(share) = get(&data, "progress").and_then(|share| share.as_f64()) {
            if let Some(call) = &self.running {
                // Whether it is still wanted is seen once a frame.
                let _ = call.work.at(share as f32);
            }
        } else if let Some(call) = self.running.take() {
            match get(&data, "answer") {
                Some(answer) => {
                    let _ = call.answer.try_set(Ok(answer.unchecked_into()));
                }
                None => call.end(Fail::Said(text("error").unwrap_or_default())),
            }
        }
        self.advance();
    }
}

/// Bytes of the browser.
fn joined(pieces: &Pieces<'_>) -> Uint8Array {
    let n_bytes: usize = pieces.iter().map(|piece| piece.len()).sum();
    let joined = Uint8Array::new_with_length(n_bytes as u32);
    let mut at = 0;
    for piece in pieces {
        let end = at + piece.len() as u32;
        joined.subarray(at, end).copy_from(piece);
        at = end;
    }
    joined
}

/// An object of these properties.
fn object(properties: &[(&str, JsValue)]) -> JsValue {
    let object = Object::new();
    for (name, value) in properties {
        // An object of our own takes any.
        let _ = Reflect::set(&object, &(*name).into(), value);
    }
    object.into()
}

/// A property that is there.
fn get(object: &JsValue, name: &str) -> Option<JsValue> {
    Reflect::get(object, &name.into()).ok().filter(|value| !value.is_undefined())
}
