//! Computations without an app: the page's [`worker`](crate::worker) calls them, in a module of its own. They hold one scene.

use std::{cell::RefCell, collections::HashMap};

use bevy::math::UVec2;
use bevy_stylegaussian::{
    stylegaussian::{
        Decoder, Neighbors, Scene,
        file::{self, ReadOptions, Reading, SceneReader},
        fold::{self, StylizeError},
        paint::{Canvas, Paint, Surface, lay},
        views::choose_views,
    },
    stylegaussian_encoder::{Encoder, Image, StyleSize, painted_style},
};
use js_sys::{Array, Function, Uint8Array};
use stylegaussian_defaults::{DECODER, ENCODER, ENCODER_NAME};
use stylegaussian_train::{
    Progress, Stage, Watch,
    embed::{EmbedOptions, TrainingView, embed},
};
use wasm_bindgen::{JsError, JsValue, prelude::wasm_bindgen};

/// Pictures that a scene is embedded from, and the longer side of one in pixels: fewer and smaller ones than the command
/// line's 60 of 512 pixels, because a page computes on one thread.
const N_VIEWS: usize = 32;
const VIEW_SIZE: u32 = 384;

/// The name of scenes in messages and of their format.
const SCENE: &str = "scene.sgs";

/// Everything that the worker keeps between calls.
#[derive(Default)]
struct Held {
    scene: Scene,
    /// The scene's surface, once paint was laid on.
    surface: Option<Surface>,
    /// The default encoder, once it was needed.
    encoder: Option<Encoder>,
    /// The paint of the images that were encoded, by their names as styles. Files round it.
    paints: HashMap<String, Paint>,
}

thread_local! {
    static HELD: RefCell<Held> = RefCell::default();
    /// The function of the worker's script that hears of progress.
    static TELL: RefCell<Option<Function>> = const { RefCell::new(None) };
}

/// Reads a capture in any format, holds it, and returns it as a `.sgs`.
#[wasm_bindgen]
pub fn work_read(name: &str, bytes: Vec<u8>, tell: Function) -> Result<Vec<u8>, JsError> {
    TELL.set(Some(tell));
    tell_progress("reading", None);
    let scene = read(bytes, name).map_err(|error| JsError::new(&error))?;
    let bytes = file::scene_to_bytes(SCENE, &scene)?;
    hold(scene);
    Ok(bytes)
}

/// Holds the scene of a file.
#[wasm_bindgen]
pub fn work_hold(bytes: Vec<u8>) -> Result<Vec<u8>, JsError> {
    hold(read(bytes, SCENE).map_err(|error| JsError::new(&error))?);
    Ok(Vec::new())
}

/// Gives the scene features, learned from pictures of itself, and returns it as a `.sgs`.
#[wasm_bindgen]
pub fn work_embed(tell: Function) -> Result<Vec<u8>, JsError> {
    TELL.set(Some(tell));
    HELD.with_borrow_mut(|held| {
        held.open_encoder().map_err(|error| JsError::new(&error))?;
        held.embed().map_err(|error| JsError::new(&error))
    })
}

/// Encodes a JPEG or PNG image that has this name as a style, and returns its statistics and paint as a `.style.safetensors`.
#[wasm_bindgen]
pub fn work_encode(name: &str, bytes: &[u8], tell: Function) -> Result<Vec<u8>, JsError> {
    TELL.set(Some(tell));
    tell_progress("encoding", None);
    HELD.with_borrow_mut(|held| held.encode(name, bytes)).map_err(|error| JsError::new(&error))
}

/// Lays the paint of an image that was encoded under this name, or else that of a `.style.safetensors`, on the scene, and returns its colors, f32 `[N, 3]` in the order of a `.sgs`.
#[wasm_bindgen]
pub fn work_paint(name: &str, style: &[u8], tell: Function) -> Result<Vec<u8>, JsError> {
    TELL.set(Some(tell));
    tell_progress("painting", None);
    let colors =
        HELD.with_borrow_mut(|held| held.paint(name, style)).map_err(|error| JsError::new(&error))?;
    Ok(bytes_of(&colors))
}

/// Decodes a mix of `.style.safetensors`, and returns the scene in these colors as a `.glb`.
#[wasm_bindgen]
pub fn work_decode(styles: Array, weights: &[f32], content: f32) -> Result<Vec<u8>, JsError> {
    let styles: Vec<Vec<u8>> = styles.iter().map(|bytes| Uint8Array::new(&bytes).to_vec()).collect();
    let styles: Vec<_> = styles.iter().map(Vec::as_slice).zip(weights.iter().copied()).collect();
    let scene = HELD.with_borrow(|held| decoded(&held.scene, &styles, content));
    Ok(file::scene_to_bytes("scene.glb", &scene.map_err(|error| JsError::new(&error))?)?)
}

/// Returns the scene as a `.glb` in colors, f32 `[N, 3]` in the order of a `.sgs`, or in its own if there are none.
#[wasm_bindgen]
pub fn work_save(colors: &[u8]) -> Result<Vec<u8>, JsError> {
    let written = HELD.with_borrow(|held| saved(&held.scene, colors));
    written.map_err(|error| JsError::new(&error))
}

fn saved(scene: &Scene, colors: &[u8]) -> Result<Vec<u8>, String> {
    let mut scene = scene.clone();
    if !colors.is_empty() {
        let colors = colors_of(colors)?;
        if colors.len() != scene.len() {
            return Err(format!("found {} colors, expected {}", colors.len(), scene.len()));
        }
        scene.set_colors(&colors);
    }
    file::scene_to_bytes("scene.glb", &scene).map_err(|error| error.to_string())
}

/// Colors as bytes: f32 `[N, 3]`.
pub fn bytes_of<'a>(colors: impl IntoIterator<Item = &'a [f32; 3]>) -> Vec<u8> {
    colors.into_iter().flatten().flat_map(|value| value.to_le_bytes()).collect()
}

/// The colors that [`bytes_of`] has written.
///
/// # Errors
/// If a part of one is missing.
pub fn colors_of(bytes: &[u8]) -> Result<Vec<[f32; 3]>, String> {
    let (values, []) = bytes.as_chunks::<4>() else { return Err("found a part of a color".into()) };
    let (colors, []) = values.as_chunks::<3>() else { return Err("found a part of a color".into()) };
    Ok(colors.iter().map(|color| color.map(f32::from_le_bytes)).collect())
}

/// A scene in the decoded colors of a mix of styles: bytes of `.style.safetensors`, and their weights.
fn decoded(scene: &Scene, styles: &[(&[u8], f32)], content: f32) -> Result<Scene, String> {
    let features = scene.features.as_ref().ok_or_else(|| StylizeError::NoFeatures.to_string())?;
    let style = |(bytes, weight): &(&[u8], f32)| {
        let style = file::style_from_bytes(bytes, "a style").map_err(|error| error.to_string())?;
        Ok((style, f64::from(*weight)))
    };
    let styles = styles.iter().map(style).collect::<Result<Vec<_>, String>>()?;
    let styles: Vec<_> = styles.iter().map(|(style, weight)| (style, *weight)).collect();
    let map = fold::transfer(features, &styles, f64::from(content)).map_err(|error| error.to_string())?;
    let bundled;
    let decoder = match &scene.decoder {
        Some(decoder) => decoder,
        None => {
            let decoder = file::decoder_from_bytes(DECODER, "the default decoder");
            bundled = decoder.map_err(|error| error.to_string())?;
            &bundled
        }
    };
    let colors = fold::stylize(scene, decoder, &map).map_err(|error| error.to_string())?;
    let mut styled = scene.clone();
    styled.set_colors(&colors);
    Ok(styled)
}

fn hold(scene: Scene) {
    HELD.with_borrow_mut(|held| (held.scene, held.surface) = (scene, None));
}

/// Tells the page what is being done, and the share of it that is done, 0..1.
fn tell_progress(what: &str, share: Option<f32>) {
    let text = share.map_or_else(|| what.into(), |share| format!("{what} {share:.3}"));
    TELL.with_borrow(|tell| {
        // A page that cannot hear it is told nothing.
        tell.as_ref().map(|tell| tell.call1(&JsValue::NULL, &text.into()))
    });
}

/// Reads a file that the visitor has dropped. Gaussians are in Morton order, as in a `.sgs`.
///
/// # Errors
/// If it is no scene, or one of several files.
pub fn read(bytes: Vec<u8>, name: &str) -> Result<Scene, String> {
    let mut reader = SceneReader::new(bytes, name, ReadOptions::default());
    match reader.read().map_err(|error| error.to_string())? {
        Reading::Scene(loaded) => {
            let mut scene = loaded.scene;
            scene.sort_by_morton();
            Ok(scene)
        }
        Reading::Needs(names) => {
            Err(format!("{name}: it needs other files ({}), expected a scene in one file", names.join(", ")))
        }
    }
}

impl Held {
    fn open_encoder(&mut self) -> Result<&Encoder, String> {
        if self.encoder.is_none() {
            let encoder = Encoder::from_onnx(ENCODER_NAME, ENCODER.to_vec());
            self.encoder = Some(encoder.map_err(|error| error.to_string())?);
        }
        self.encoder.as_ref().ok_or_else(String::new)
    }

    /// The style of an image, with its paint.
    fn encode(&mut self, style: &str, bytes: &[u8]) -> Result<Vec<u8>, String> {
        let name = style.split_once(':').map_or(style, |(_, name)| name);
        let image = Image::from_bytes(bytes, name.as_ref()).map_err(|error| error.to_string())?;
        let encoded = painted_style(self.open_encoder()?, &image, StyleSize::default());
        let (statistics, paint) = encoded.map_err(|error| format!("{name}: {error}"))?;
        let bytes =
            file::painted_style_to_bytes(name, &statistics, &paint).map_err(|error| error.to_string());
        self.paints.insert(style.into(), paint);
        bytes
    }

    fn paint(&mut self, name: &str, style: &[u8]) -> Result<Vec<[f32; 3]>, String> {
        // The worker that encoded it may have been stopped.
        if !self.paints.contains_key(name) {
            let paint = file::paint_from_bytes(style, name).map_err(|error| error.to_string())?;
            self.paints.insert(name.into(), paint.ok_or("found a style without paint")?);
        }
        let surface = self.surface.get_or_insert_with(|| Surface::new(&self.scene));
        let painted = lay(&self.scene, surface, &[(&Canvas::new(&self.paints[name]), 1.0)], 0.0);
        // The page takes colors alone, so each has the mean of the strokes over it.
        Ok(painted.flattened(&self.scene))
    }

    fn embed(&mut self) -> Result<Vec<u8>, String> {
        let Some(encoder) = &self.encoder else { return Err(String::new()) };
        if self.scene.sh.is_none() {
            return Err("the capture has no colors to learn features from".into());
        }
        tell_progress("embedding", Some(0.0));
        let cameras = choose_views(&self.scene, N_VIEWS, UVec2::splat(VIEW_SIZE));
        if cameras.is_empty() || !cameras.iter().all(|camera| camera.is_usable()) {
            return Err("found no camera that sees the capture".into());
        }
        let view = |(i, camera): (usize, _)| TrainingView::rendered(format!("view {i}"), camera, VIEW_SIZE);
        let views: Vec<_> = cameras.iter().enumerate().map(view).collect();
        let watch = Watch { progress: &tell_embedding, ..Watch::default() };
        let mut scene = self.scene.clone();
        embed(&mut scene, &views, encoder, &EmbedOptions::default(), watch)
            .map_err(|error| error.to_string())?;
        scene.neighbors = Some(Neighbors::find(&scene.means, &scene.order, Decoder::K));
        let bytes = file::scene_to_bytes(SCENE, &scene).map_err(|error| error.to_string())?;
        (self.scene, self.surface) = (scene, None);
        Ok(bytes)
    }
}

/// Tells how far embedding is: views take about two thirds of the time.
fn tell_embedding(now: Progress) {
    let done = now.done as f32 / now.total.max(1) as f32;
    let share = if now.stage == Stage::Views { 0.65 * done } else { 0.65 + 0.35 * done };
    tell_progress("embedding", Some(share));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_painting_is_encoded_and_laid_on() {
        let png = include_bytes!("../../../assets/styles/halftone.png");
        let mut held = Held::default();
        let style = held.encode("image:halftone.png", png).unwrap();
        let error = held.encode("image:halftone.png", &png[..100]).unwrap_err();
        assert!(error.starts_with("halftone.png"), "{error}");
        let demo = read(include_bytes!("../../../assets/demo.sgs").to_vec(), SCENE).unwrap();
        held.scene = demo.subset(&Vec::from_iter(0..3000));
        let colors = held.paint("image:halftone.png", &style).unwrap();
        assert_eq!(held.paint("of a file", &style).unwrap().len(), colors.len());
        assert_eq!(colors.len(), held.scene.len());
        assert_ne!(colors, held.scene.base_colors());
        let styled = decoded(&held.scene, &[(&style, 1.0)], 0.0).unwrap();
        assert_ne!(styled.base_colors(), held.scene.base_colors());
        assert!(decoded(&held.scene, &[], 0.0).unwrap_err().contains("mix weights"));
        let glb = read(saved(&held.scene, &bytes_of(&colors)).unwrap(), "scene.glb").unwrap();
        assert_eq!(glb.len(), held.scene.len());
        let own = read(saved(&held.scene, &[]).unwrap(), "scene.glb").unwrap();
        assert_ne!(glb.base_colors(), own.base_colors());
        assert!(saved(&held.scene, &[0; 12]).unwrap_err().contains("found 1 colors"));
    }

    #[test]
    fn no_scene_is_told_by_its_name() {
        assert!(read(b"no scene at all".to_vec(), "garden.spz").unwrap_err().contains("garden.spz"));
    }
}
