//! Requests of the page's script. Each changes the app's world in the next frame.

use std::cell::{Cell, RefCell};

use bevy::{
    ecs::{component::Mutable, query::QueryFilter},
    prelude::*,
    render::view::screenshot::{Screenshot, save_to_disk},
};
use bevy_stylegaussian::{
    StyleSource,
    style::{StyleMotion, decoder::StyleBudget},
    world::GaussianBudget,
};
use js_sys::Uint8Array;
use stylegaussian_app::{Arrival, Arrivals, Orbit, Subject, relief_lit_from};
use wasm_bindgen::prelude::wasm_bindgen;

use crate::{
    address,
    bridge::{Event, tell},
    paintings::Paintings,
    save::Saving,
    scene::{self, Next},
    style::Wish,
};

/// A request of the page's script, which is done in the next frame.
type Request = Box<dyn FnOnce(&mut World)>;

thread_local! {
    /// Requests since the last frame. They come between frames, when no system runs.
    static REQUESTS: RefCell<Vec<Request>> = const { RefCell::new(Vec::new()) };
    /// Whether the first frame was reported.
    static IS_TOLD: Cell<bool> = const { Cell::new(false) };
}

fn ask(request: impl FnOnce(&mut World) + 'static) {
    REQUESTS.with_borrow_mut(|requests| requests.push(Box::new(request)));
}

/// Asks for a change of a component that one entity has.
fn change<C: Component<Mutability = Mutable>, F: QueryFilter + 'static>(
    change: impl FnOnce(&mut C) + 'static,
) {
    ask(|world| {
        if let Ok(mut component) = world.query_filtered::<&mut C, F>().single_mut(world) {
            change(&mut component);
        }
    });
}

/// Asks for a change of the source of styles.
fn change_source(by: impl FnOnce(&mut StyleSource) + 'static) {
    change::<StyleSource, With<Subject>>(by);
}

/// Shows a scene beside the page, by its path in `assets`.
#[wasm_bindgen]
pub fn open_asset(path: String) {
    ask(|world| scene::open(world, |assets| Next::Asset(assets.load(path.clone()), path)));
}

/// Shows a world: levels of detail of a streamed SOG, by the address of its `lod-meta.json`. Its chunks are
/// fetched from beside that as the camera needs them.
#[wasm_bindgen]
pub fn open_world(address: String) {
    ask(move |world| scene::open(world, |assets| Next::World(assets.load(address::path_of(&address)))));
}

/// Sets the most Gaussians of a world that are shown, 1 million at first.
#[wasm_bindgen]
pub fn set_world_budget(gaussians: u32) {
    ask(move |world| world.insert_resource(GaussianBudget::new(gaussians as usize)));
}

/// Shows a scene of the visitor. Its bytes stay the browser's: the app's own memory ends at 4 GB.
#[wasm_bindgen]
pub fn open_file(name: String, bytes: Uint8Array) {
    ask(|world| scene::open(world, |_| Next::File { name, bytes }));
}

/// Takes an image of the visitor as the style `image:NAME`.
#[wasm_bindgen]
pub fn add_painting(name: String, bytes: Uint8Array) {
    ask(move |world| world.resource_mut::<Paintings>().add(&name, bytes));
}

/// Puts a mix of styles on the scene; `names` and `weights` go in pairs. `content` is the share of the
/// content's features, `strength` that of the style's colors, both 0..1. If `by_decoder`, the decoder alone
/// makes the colors of images.
#[wasm_bindgen]
pub fn set_style(names: Vec<String>, weights: Vec<f32>, content: f32, strength: f32, by_decoder: bool) {
    let styles = names.into_iter().zip(weights).collect();
    ask(move |world| world.insert_resource(Wish { styles, content, strength, by_decoder, is_due: true }));
}

/// Sets how strokes are drawn, from the next frame on: factors of the strokes (0 to 3), of what stays clear of
/// them (0 to 10) and of their size (0.1 to 10), 1 at first. Numbers outside are taken as the nearest one
/// inside, and none as 1. Nothing is computed.
#[wasm_bindgen]
pub fn set_strokes(paint: f32, protection: f32, stroke_scale: f32) {
    change_source(move |source| {
        (source.paint, source.protection, source.stroke_scale) = (paint, protection, stroke_scale);
    });
}

/// Sets how strokes move, from the next frame on: `still`, as at first, `boil` (redrawn some times a second) or
/// `flow` (along their own direction), how many times per second (0 to 60), and how far, in widths of a stroke
/// (0 to 8). Nothing is computed.
#[wasm_bindgen]
pub fn set_motion(kind: String, rate: f32, distance: f32) {
    let motion = match &*kind {
        "still" => StyleMotion::Still,
        "boil" => StyleMotion::boil(rate),
        "flow" => StyleMotion::flow(rate),
        _ => {
            let found = format!("found the motion `{kind}`, expected still, boil or flow");
            return ask(move |_| tell(Event::Failed, &found));
        }
    };
    change_source(move |source| source.motion = motion.with_amount(distance));
}

/// Sets the thickness of strokes, from the next frame on, as a factor (0 to 4; 0 at first), and where the light
/// on them is, in degrees around the scene. Nothing is computed.
#[wasm_bindgen]
pub fn set_relief(amount: f32, light_from: f32) {
    change_source(move |source| source.relief = relief_lit_from(light_from, amount));
}

/// Sets whether strokes keep their size on screen, from near and far, from the next frame on. At first they do
/// not. Nothing is computed.
#[wasm_bindgen]
pub fn set_screen_stable(screen_stable: bool) {
    change_source(move |source| source.screen_stable = screen_stable);
}

/// Gives the scene that is shown features, in the page's worker, so that it can be decoded. It is then `loaded`
/// once more.
#[wasm_bindgen]
pub fn embed_soon() {
    ask(|world| scene::embed(world, true));
}

/// Ends what [`embed_soon`] has begun.
#[wasm_bindgen]
pub fn cancel_embedding() {
    ask(|world| scene::embed(world, false));
}

/// Sets the way in which changes of style are shown, for those that come: `fade`, `sphere` (from what the
/// camera turns around), `front` (from left to right) or `noise` (spots that grow), and its time.
#[wasm_bindgen]
pub fn set_transition(kind: String, seconds: f32) {
    ask(move |world| match Arrival::from_name(&kind) {
        Some(way) => world.insert_resource(Arrivals { way, seconds }),
        None => tell(
            Event::Failed,
            &format!("found the transition `{kind}`, expected fade, sphere, front or noise"),
        ),
    });
}

/// Sets the GPU time per frame for changes of style, in milliseconds. `Infinity` completes a change in one
/// frame.
#[wasm_bindgen]
pub fn set_budget(milliseconds: f32) {
    ask(move |world| world.insert_resource(StyleBudget { ms_per_frame: milliseconds.max(0.0) }));
}

/// Turns the camera around the scene by angles in radians.
#[wasm_bindgen]
pub fn turn(yaw: f32, pitch: f32) {
    change::<Orbit, ()>(move |orbit| orbit.turn(yaw, pitch));
}

/// Moves the camera to the right, up and back, in shares of its distance.
#[wasm_bindgen]
pub fn fly(right: f32, up: f32, back: f32) {
    change::<Orbit, ()>(move |orbit| orbit.fly(Vec3::new(right, up, back)));
}

/// Multiplies the camera's distance.
#[wasm_bindgen]
pub fn zoom(factor: f32) {
    change::<Orbit, ()>(move |orbit| orbit.zoom(factor));
}

/// Downloads the picture.
#[wasm_bindgen]
pub fn save_picture_soon() {
    ask(|world| {
        world.spawn(Screenshot::primary_window()).observe(save_to_disk("stylegaussian.png"));
    });
}

/// Downloads the scene in the colors of the shown style, as a `.glb`.
#[wasm_bindgen]
pub fn save_glb_soon() {
    ask(|world| world.resource_mut::<Saving>().is_wanted = true);
}

/// Does what the script has asked for since the last frame.
pub fn do_requests(world: &mut World) {
    for request in REQUESTS.take() {
        request(world);
    }
    if !IS_TOLD.replace(true) {
        tell(Event::Ready, "");
    }
}
