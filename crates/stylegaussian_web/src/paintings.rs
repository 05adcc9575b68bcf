//! Paintings as styles. The page's worker lays their paint on, and encodes them if the decoder is to make the
//! colors; where there is none, the plugin does on the page's thread.

use std::{collections::HashMap, sync::Arc};

use bevy::{
    asset::RenderAssetUsages,
    image::{CompressedImageFormats, ImageSampler, ImageType},
    prelude::*,
};
use bevy_stylegaussian::{
    GaussianScene, StyleLook, StyleStatistics,
    style::StyleInput,
    stylegaussian::{Look, Scene, look::MadeFrom, morton, paint::Painted},
    stylegaussian_files::style_from_bytes,
};
use js_sys::Uint8Array;
use wasm_bindgen::JsValue;

use crate::{
    bridge::{self, Event, Request},
    memory, painted,
    scene::Shown,
    style,
    worker::{self, Call, State},
};

/// The paintings that were dropped or asked for, by their names as styles.
#[derive(Resource, Default)]
pub struct Paintings(HashMap<String, Painting>);

/// A painting.
struct Painting {
    file: File,
    /// The image, if there is no worker.
    image: Option<Handle<Image>>,
    /// The statistics for the decoder, once the worker has encoded the painting.
    style: Handle<StyleStatistics>,
    encoded: Encoded,
    /// The scene that it was last wanted on, and its colors and strokes there.
    laid_on: Option<LaidOn>,
}

/// The file of a painting.
enum File {
    /// One that the visitor has dropped.
    Dropped(Uint8Array),
    /// An image beside the page, by its path in `assets`.
    Asset(String),
}

/// Stage of a painting's encoding, which the decoder alone needs.
enum Encoded {
    No,
    Wanted,
    Coming(Call),
    /// The bytes of the style.
    Yes(Vec<u8>),
}

/// A painting on a scene.
struct LaidOn {
    scene: AssetId<GaussianScene>,
    look: Handle<StyleLook>,
    stage: Stage,
}

/// Stage of laying paint on.
enum Stage {
    Wanted,
    Coming(Call),
    Done,
}

impl Painting {
    fn new(file: File, styles: &Assets<StyleStatistics>) -> Self {
        Self { file, image: None, style: styles.reserve_handle(), encoded: Encoded::No, laid_on: None }
    }
}

/// Takes images that the visitor has dropped.
pub fn take_dropped(
    mut requests: MessageReader<Request>,
    mut paintings: ResMut<Paintings>,
    styles: Res<Assets<StyleStatistics>>,
) {
    for request in requests.read() {
        let Request::AddPainting { name, bytes } = request else { continue };
        let painting = Painting::new(File::Dropped(bytes.clone()), &styles);
        paintings.0.insert(format!("image:{name}"), painting);
    }
}

/// The painting and the choices that a style is made from.
pub struct Wanted<'a> {
    /// The style's name: `image:NAME` was dropped, `paint:NAME` is an image of the page.
    pub name: &'a str,
    /// Whether the decoder alone makes the colors.
    pub by_decoder: bool,
    /// The scene that is shown.
    pub scene: AssetId<GaussianScene>,
}

impl Paintings {
    /// The input for a painting, or `None` if there is no such painting. What the worker makes comes later.
    ///
    /// # Errors
    /// If there is no worker and the image cannot be decoded.
    pub fn input(
        &mut self,
        Wanted { name, by_decoder, scene }: Wanted,
        assets: &AssetServer,
        images: &mut Assets<Image>,
        (styles, looks): (&Assets<StyleStatistics>, &Assets<StyleLook>),
    ) -> Result<Option<StyleInput>, String> {
        if let Some(path) = name.strip_prefix("paint:").filter(|path| style::is_plain(path)) {
            let asset = || Painting::new(File::Asset(format!("styles/{path}")), styles);
            self.0.entry(name.into()).or_insert_with(asset);
        }
        let Some(painting) = self.0.get_mut(name) else { return Ok(None) };
        if worker::state() == State::Absent {
            if painting.image.is_none() {
                painting.image = Some(match &painting.file {
                    File::Dropped(bytes) => images.add(decode(&memory::copied(bytes)?)?),
                    File::Asset(path) => assets.load(path.clone()),
                });
            }
            return Ok(painting.image.clone().map(StyleInput::Image));
        }
        if by_decoder {
            if matches!(painting.encoded, Encoded::No) {
                painting.encoded = Encoded::Wanted;
            }
            return Ok(Some(StyleInput::Preset(painting.style.clone())));
        }
        if painting.laid_on.as_ref().is_none_or(|laid_on| laid_on.scene != scene) {
            painting.laid_on = Some(LaidOn { scene, look: looks.reserve_handle(), stage: Stage::Wanted });
        }
        Ok(painting.laid_on.as_ref().map(|laid_on| StyleInput::Look(laid_on.look.clone())))
    }
}

impl Paintings {
    /// The file of a painting's statistics for the worker, or `None` if there is none yet.
    pub fn style_file(&self, name: &str) -> Option<JsValue> {
        match &self.0.get(name)?.encoded {
            Encoded::Yes(bytes) => Some(worker::bytes(bytes)),
            _ => None,
        }
    }
}

/// Decodes an image. Its content decides its format, and not a name.
fn decode(bytes: &[u8]) -> Result<Image, String> {
    let kind = match bytes {
        [0xff, 0xd8, ..] => "jpg",
        [0x89, b'P', b'N', b'G', ..] => "png",
        _ => return Err("found neither a JPEG nor a PNG image".into()),
    };
    let sampler = ImageSampler::default();
    let usage = RenderAssetUsages::MAIN_WORLD;
    Image::from_buffer(bytes, ImageType::Extension(kind), CompressedImageFormats::NONE, true, sampler, usage)
        .map_err(|error| error.to_string())
}

/// Has the worker make what is wanted, and takes what it has made.
pub fn advance(
    mut paintings: ResMut<Paintings>,
    mut styles: ResMut<Assets<StyleStatistics>>,
    mut looks: ResMut<Assets<StyleLook>>,
    scenes: Res<Assets<GaussianScene>>,
    shown: Res<Shown>,
) {
    for (name, painting) in &mut paintings.0 {
        if let Err(error) = painting.advance_style(name, &mut styles) {
            bridge::tell(Event::Failed, &error);
            // Asked for again, it is tried again.
            painting.encoded = Encoded::No;
        }
        if let Err(error) = painting.advance_look(name, &mut looks, &scenes, &shown) {
            bridge::tell(Event::Failed, &error);
            painting.laid_on = None;
        }
    }
}

impl Painting {
    /// Has the worker, which is ready, do this with the painting of this name.
    fn call(&self, function: &str, name: &str) -> Call {
        let file = match &self.file {
            File::Dropped(bytes) => bytes.clone().into(),
            File::Asset(path) => worker::asset(path),
        };
        let name = name.split_once(':').map_or(name, |(_, name)| name);
        worker::call(function, &[name.into(), file])
    }

    fn advance_style(&mut self, name: &str, styles: &mut Assets<StyleStatistics>) -> Result<(), String> {
        match &self.encoded {
            Encoded::Wanted if worker::state() == State::Ready => {
                self.encoded = Encoded::Coming(self.call("work_encode", name));
            }
            Encoded::Coming(call) => {
                let Some(bytes) = call.answer().transpose()? else { return Ok(()) };
                let statistics = style_from_bytes(&bytes, name).map_err(|error| error.to_string())?;
                let style = StyleStatistics { statistics: Arc::new(statistics), paint: None };
                styles.insert(&self.style, style).map_err(|error| error.to_string())?;
                self.encoded = Encoded::Yes(bytes);
            }
            _ => {}
        }
        Ok(())
    }

    fn advance_look(
        &mut self,
        name: &str,
        looks: &mut Assets<StyleLook>,
        scenes: &Assets<GaussianScene>,
        shown: &Shown,
    ) -> Result<(), String> {
        let Some(laid_on) = &self.laid_on else { return Ok(()) };
        let Some(scene) = scenes.get(laid_on.scene) else { return Ok(()) };
        let stage = match &laid_on.stage {
            Stage::Wanted if worker::state() == State::Ready => {
                shown.hold(laid_on.scene, scene)?;
                Stage::Coming(self.call("work_paint", name))
            }
            Stage::Coming(call) => {
                let Some(bytes) = call.answer().transpose()? else { return Ok(()) };
                let look = look(scene.scene(), &painted::from_bytes(&bytes)?)?;
                looks.insert(&laid_on.look, StyleLook(Arc::new(look))).map_err(|error| error.to_string())?;
                Stage::Done
            }
            _ => return Ok(()),
        };
        self.laid_on = self.laid_on.take().map(|laid_on| LaidOn { stage, ..laid_on });
        Ok(())
    }
}

/// The look of a scene that was painted in Morton order.
fn look(scene: &Scene, painted: &Painted) -> Result<Look, String> {
    if painted.colors.len() != scene.len() {
        return Err(format!("found {} colors, expected {}", painted.colors.len(), scene.len()));
    }
    let mut rows = vec![0; scene.len()];
    for (row, i) in (0..).zip(morton::order(&scene.means)) {
        rows[i as usize] = row;
    }
    let Painted { colors, strokes, .. } = painted::in_order(painted, &rows);
    Ok(Look::new(scene, &colors, MadeFrom::default()).with_strokes(scene, &strokes))
}

#[cfg(test)]
mod tests {
    use bevy_stylegaussian::stylegaussian::{scene::Sh, strokes::Strokes};

    use super::*;

    #[test]
    fn only_images_are_decoded() {
        let png = include_bytes!("../../../assets/styles/halftone.png");
        assert!(decode(png).is_ok());
        assert!(decode(&png[..100]).is_err());
        assert!(decode(b"GIF89a").is_err());
        assert!(decode(b"").is_err());
    }

    #[test]
    fn what_the_worker_has_painted_reaches_its_gaussians() {
        let mut scene = Scene {
            means: [3.0, 0.0, 2.0, 1.0].map(Vec3::splat).to_vec(),
            rotations: vec![Quat::IDENTITY; 4],
            scales: vec![Vec3::ONE; 4],
            opacities: vec![1.0; 4],
            order: vec![0, 1, 2, 3],
            n_source: 4,
            ..Scene::default()
        };
        scene.sh = Some(Sh { degree: 0, coefficients: vec![0.0; 12] });
        let sorted = scene.subset(&morton::order(&scene.means));
        let colors = sorted.means.iter().map(|mean| mean.to_array()).collect();
        let words = sorted.means.iter().map(|mean| mean.x as u32).collect();
        let strokes = Strokes { words, ..painted::tests::painted().strokes };
        let mut painted = Painted { colors, strokes, ..Painted::default() };
        let look = look(&scene, &painted).unwrap();
        let expected: Vec<_> = scene.means.iter().map(|mean| mean.to_array()).collect();
        assert_eq!(look.colors_for(&scene).unwrap(), expected);
        let strokes = look.strokes_for(&scene).unwrap().unwrap();
        assert_eq!(strokes.words, [3, 0, 2, 1]);
        assert_eq!((strokes.seeds, strokes.textures), (painted.strokes.seeds, painted.strokes.textures));
        painted.strokes = Strokes::default();
        assert!(!super::look(&scene, &painted).unwrap().has_strokes());
        painted.colors.pop();
        assert!(super::look(&scene, &painted).unwrap_err().contains("found 3 colors"));
    }
}
