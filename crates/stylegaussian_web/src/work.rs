//! Computations without an app: the page's [`worker`](crate::worker) calls them, in a module of its own. They
//! hold one scene.

use std::{cell::RefCell, sync::LazyLock};

use bevy::math::UVec2;
use bevy_stylegaussian::{
    stylegaussian::{
        Decoder, Neighbors, Scene,
        fold::{ChannelMap, stylize},
        paint::{Paint, Painted},
        views::choose_views,
    },
    stylegaussian_encoder::{Encoder, Image, StyleSize, paint_of, style_statistics},
    stylegaussian_files::{
        ReadOptions, Reading, SceneReader, decoder_from_bytes, scene_to_bytes, style_to_bytes,
    },
};
use js_sys::Function;
use stylegaussian_defaults::{DECODER, ENCODER, ENCODER_NAME};
use stylegaussian_train::{
    Progress, Stage, Watch,
    embed::{EmbedOptions, TrainingView, embed},
};
use wasm_bindgen::{JsValue, prelude::wasm_bindgen};

/// Pictures that a scene is embedded from, and the longer side of one in pixels: fewer and smaller ones than
/// the command line's 60 of 512 pixels, because a page computes on one thread.
const N_VIEWS: usize = 32;
const VIEW_SIZE: u32 = 384;

/// The name of scenes in messages and of their format.
const SCENE: &str = "scene.sgs";

thread_local! {
    static HELD: RefCell<Scene> = RefCell::default();
    /// The function of the worker's script that hears of progress.
    static TELL: RefCell<Option<Function>> = const { RefCell::new(None) };
}

/// The default encoder, which is opened when it is first needed.
static DEFAULT_ENCODER: LazyLock<Result<Encoder, String>> =
    LazyLock::new(|| Encoder::from_bytes(ENCODER_NAME, ENCODER.to_vec()).map_err(|error| error.to_string()));

/// Reads a capture in any format, holds it, and returns it as a `.sgs`.
#[wasm_bindgen]
pub fn work_read(name: &str, bytes: Vec<u8>, tell: Function) -> Result<Vec<u8>, String> {
    TELL.set(Some(tell));
    tell_progress("reading", None);
    let mut scene = read(bytes, name)?;
    // As in the `.sgs`, from which the app has it.
    scene.sort_by_morton();
    let bytes = written(SCENE, &scene)?;
    HELD.set(scene);
    Ok(bytes)
}

/// Holds the scene of a file.
#[wasm_bindgen]
pub fn work_hold(bytes: Vec<u8>) -> Result<Vec<u8>, String> {
    HELD.set(read(bytes, SCENE)?);
    Ok(Vec::new())
}

/// Gives the scene features, learned from pictures of itself, and returns it as a `.sgs`.
#[wasm_bindgen]
pub fn work_embed(tell: Function) -> Result<Vec<u8>, String> {
    TELL.set(Some(tell));
    let scene = HELD.with_borrow(embedded)?;
    let bytes = written(SCENE, &scene)?;
    HELD.set(scene);
    Ok(bytes)
}

/// Encodes a JPEG or PNG image of this name for the decoder, and returns its statistics as a
/// `.style.safetensors`.
#[wasm_bindgen]
pub fn work_encode(name: &str, bytes: &[u8], tell: Function) -> Result<Vec<u8>, String> {
    TELL.set(Some(tell));
    tell_progress("encoding", None);
    encoded(name, bytes)
}

/// Reads the paint of a JPEG or PNG image of this name, and returns its width, its height and its pixels as
/// RGBA. Those that may not be used are transparent. No encoder takes part.
#[wasm_bindgen]
pub fn work_pixels(name: &str, bytes: &[u8], tell: Function) -> Result<Vec<u8>, String> {
    TELL.set(Some(tell));
    tell_progress("painting", None);
    pixels_of(name, bytes)
}

/// The result of [`work_pixels`].
///
/// # Errors
/// If it is no such image.
pub fn pixels_of(name: &str, bytes: &[u8]) -> Result<Vec<u8>, String> {
    Ok(pixels(&paint_of(&painting(name, bytes)?)))
}

fn pixels(paint: &Paint) -> Vec<u8> {
    let used = |i: usize| paint.used.as_ref().is_none_or(|used| used[i]);
    let pixels = paint.pixels.as_chunks::<3>().0.iter().enumerate();
    let pixels = pixels.flat_map(|(i, [r, g, b])| [*r, *g, *b, if used(i) { 255 } else { 0 }]);
    [paint.width, paint.height]
        .into_iter()
        .flat_map(|side| (side as u32).to_le_bytes())
        .chain(pixels)
        .collect()
}

/// Returns the scene as a `.glb` in the colors that its decoder makes of its features by a [`ChannelMap`].
#[wasm_bindgen]
pub fn work_decode(gain: Vec<f64>, shift: Vec<f64>) -> Result<Vec<u8>, String> {
    let scene = HELD.with_borrow(|held| decoded(held, &ChannelMap { gain, shift }))?;
    written("scene.glb", &scene)
}

/// Returns the scene as a `.glb` in colors and the mean of the strokes over them, bytes of a [`Painted`], or in
/// its own colors if there are none.
#[wasm_bindgen]
pub fn work_save(painted: &[u8]) -> Result<Vec<u8>, String> {
    HELD.with_borrow(|held| saved(held, painted))
}

fn saved(scene: &Scene, painted: &[u8]) -> Result<Vec<u8>, String> {
    let mut saved = scene.clone();
    if !painted.is_empty() {
        let painted = Painted::from_bytes(painted).map_err(|error| error.to_string())?;
        if painted.colors.len() != scene.len() {
            return Err(format!("found {} colors, expected {}", painted.colors.len(), scene.len()));
        }
        saved.set_colors(&painted.flattened(scene));
    }
    written("scene.glb", &saved)
}

/// The file of a scene.
fn written(name: &str, scene: &Scene) -> Result<Vec<u8>, String> {
    scene_to_bytes(name, scene).map_err(|error| error.to_string())
}

/// A scene in decoded colors. It carries its decoder, or has the default one.
fn decoded(scene: &Scene, map: &ChannelMap) -> Result<Scene, String> {
    let bundled;
    let decoder = match &scene.decoder {
        Some(decoder) => decoder,
        None => {
            let decoder = decoder_from_bytes(DECODER, "the default decoder");
            bundled = decoder.map_err(|error| error.to_string())?;
            &bundled
        }
    };
    let colors = stylize(scene, decoder, map).map_err(|error| error.to_string())?;
    let mut styled = scene.clone();
    styled.set_colors(&colors);
    Ok(styled)
}

/// Tells the page what is being done, and the share of it that is done, 0..1.
fn tell_progress(what: &str, share: Option<f32>) {
    let text = share.map_or_else(|| what.into(), |share| format!("{what} {share:.3}"));
    TELL.with_borrow(|tell| {
        // A page that cannot hear it is told nothing.
        tell.as_ref().map(|tell| tell.call1(&JsValue::NULL, &text.into()))
    });
}

/// Reads a file that the visitor has dropped. Gaussians are in the order of the file, as in the app's assets.
///
/// # Errors
/// If it is no scene, or one of several files.
pub fn read(bytes: Vec<u8>, name: &str) -> Result<Scene, String> {
    let mut reader = SceneReader::new(bytes, name, ReadOptions::default());
    match reader.read().map_err(|error| error.to_string())? {
        Reading::Scene(loaded) => Ok(loaded.scene),
        Reading::Needs(names) => {
            Err(format!("{name}: it needs other files ({}), expected a scene in one file", names.join(", ")))
        }
    }
}

fn encoder() -> Result<&'static Encoder, String> {
    LazyLock::force(&DEFAULT_ENCODER).as_ref().map_err(Clone::clone)
}

/// The statistics of an image.
fn encoded(name: &str, bytes: &[u8]) -> Result<Vec<u8>, String> {
    let image = painting(name, bytes)?;
    let statistics = style_statistics(encoder()?, &image, StyleSize::default());
    let statistics = statistics.map_err(|error| format!("{name}: {error}"))?;
    style_to_bytes(name, &statistics).map_err(|error| error.to_string())
}

/// A scene with features.
fn embedded(scene: &Scene) -> Result<Scene, String> {
    if scene.sh.is_none() {
        return Err("the capture has no colors to learn features from".into());
    }
    let encoder = encoder()?;
    tell_progress("embedding", Some(0.0));
    let cameras = choose_views(scene, N_VIEWS, UVec2::splat(VIEW_SIZE));
    if cameras.is_empty() || !cameras.iter().all(|camera| camera.is_usable()) {
        return Err("found no camera that sees the capture".into());
    }
    let view = |(i, camera): (usize, _)| TrainingView::rendered(format!("view {i}"), camera, VIEW_SIZE);
    let views: Vec<_> = cameras.iter().enumerate().map(view).collect();
    let watch = Watch { progress: &tell_embedding, ..Watch::default() };
    let mut scene = scene.clone();
    // As in the `.sgs`, from which the app has it.
    scene.sort_by_morton();
    embed(&mut scene, &views, encoder, &EmbedOptions::default(), watch).map_err(|error| error.to_string())?;
    scene.neighbors = Some(Neighbors::find(&scene.means, &scene.order, Decoder::K));
    Ok(scene)
}

/// Reads a painting, which errors call `name`.
fn painting(name: &str, bytes: &[u8]) -> Result<Image, String> {
    Image::painting_from_bytes(bytes, name.as_ref()).map_err(|error| error.to_string())
}

/// Tells how far embedding is: views take about two thirds of the time.
fn tell_embedding(now: Progress) {
    let done = now.done as f32 / now.total.max(1) as f32;
    let share = if now.stage == Stage::Views { 0.65 * done } else { 0.65 + 0.35 * done };
    tell_progress("embedding", Some(share));
}

#[cfg(test)]
mod tests {
    use bevy_stylegaussian::{
        stylegaussian::{
            fold::transfer,
            paint::{Canvas, Surface},
            restyle::Recipe,
            work::Work,
        },
        stylegaussian_files::style_from_bytes,
    };

    use super::*;

    /// A part of the demo scene, and an image.
    fn given() -> (Scene, &'static [u8]) {
        let demo = read(include_bytes!("../../../assets/demo.sgs").to_vec(), SCENE).unwrap();
        let scene = demo.subset(&Vec::from_iter(0..3000));
        (scene, include_bytes!("../../../assets/styles/halftone.png"))
    }

    #[test]
    fn the_pixels_of_a_painting_are_its_paint() {
        let (_, png) = given();
        let image = Image::painting_from_bytes(png, "halftone.png".as_ref()).unwrap();
        let mut paint = paint_of(&image);
        let read = pixels(&paint);
        assert_eq!(read[..8], [paint.width as u32, paint.height as u32].map(u32::to_le_bytes).concat());
        let rgba = |i: usize| &read[8 + 4 * i..][..4];
        assert_eq!((&rgba(7)[..3], rgba(7)[3]), (&paint.pixels[21..24], 255));
        assert_eq!(read.len(), 8 + 4 * paint.width * paint.height);
        paint.used = Some((0..paint.width * paint.height).map(|i| i != 7).collect());
        let read = pixels(&paint);
        assert_eq!([read[8 + 4 * 6 + 3], read[8 + 4 * 7 + 3]], [255, 0]);
    }

    #[test]
    fn a_scene_is_saved_with_the_mean_of_its_strokes() {
        let (mut scene, png) = given();
        scene.features = None;
        let image = Image::painting_from_bytes(png, "halftone.png".as_ref()).unwrap();
        let canvas = Canvas::new(&paint_of(&image));
        let work = Work::default();
        let surface = Surface::new(&scene, &work).unwrap();
        let painted = Recipe::painting(&canvas, &surface).restyle(&scene, &work).unwrap();
        // In the file's order, which is the scene's.
        let of_glb = |painted: &[u8]| {
            let glb = saved(&scene, painted).unwrap();
            match SceneReader::new(glb, "scene.glb", ReadOptions::default()).read().unwrap() {
                Reading::Scene(loaded) => loaded.scene.base_colors(),
                Reading::Needs(names) => panic!("{names:?}"),
            }
        };
        let with_strokes = of_glb(&painted.to_bytes());
        let flat = painted.flattened(&scene);
        assert_eq!(with_strokes.len(), flat.len());
        let near = |(a, b): (&[f32; 3], &[f32; 3])| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(with_strokes.iter().zip(&flat).all(near));
        let bare = Painted { colors: painted.colors, ..Painted::default() };
        assert_ne!(of_glb(&bare.to_bytes()), with_strokes);
        assert_ne!(of_glb(&[]), with_strokes);
        let of_others = Painted { colors: vec![[0.5; 3]; 3], ..Painted::default() };
        assert!(saved(&scene, &of_others.to_bytes()).unwrap_err().contains("found 3 colors"));
    }

    #[test]
    fn a_painting_is_encoded_for_the_decoder() {
        let (mut scene, png) = given();
        let style = encoded("halftone.png", png).unwrap();
        let error = encoded("halftone.png", &png[..100]).unwrap_err();
        assert!(error.starts_with("halftone.png"), "{error}");
        let style = style_from_bytes(&style, "halftone.png").unwrap();
        let map = transfer(scene.features.as_ref().unwrap(), &[(&style, 1.0)], 0.0).unwrap();
        let styled = decoded(&scene, &map).unwrap();
        assert_ne!(styled.base_colors(), scene.base_colors());
        scene.features = None;
        assert!(decoded(&scene, &map).unwrap_err().contains("no features"));
    }

    #[test]
    fn no_scene_is_told_by_its_name() {
        assert!(read(b"no scene at all".to_vec(), "garden.spz").unwrap_err().contains("garden.spz"));
    }
}
