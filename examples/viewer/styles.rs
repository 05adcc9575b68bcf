//! The list of styles and their weights.

use std::{
    fs,
    path::{Path, PathBuf},
};

use bevy::prelude::*;
use bevy_stylegaussian::{
    StyleSource,
    style::{StyleInput, StyleLook, StyleMotion, StylePalette, StylePin, StyleRefine, WeightedStyle},
    stylegaussian::paint::Hand,
};
use stylegaussian_app::{Subject, relief_lit_from};

use crate::{ASSETS, panel::Transfer, scene::ShownScene};

/// File ending of presets made by `stylegaussian style`.
const PRESET: &str = ".style.safetensors";
/// File ending of baked looks.
const LOOK: &str = ".look.safetensors";

/// The scene that the looks in `assets/looks` belong to.
const BAKED_SCENE: &str = "demo.sgs";

/// How far a style is worked out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Finish {
    /// As soon as it is selected.
    Instant,
    /// Baked further while it is shown.
    Refined,
    /// As it was baked before; refined if it was not.
    #[default]
    Baked,
}

/// One style of the panel.
pub struct Style {
    pub name: String,
    pub input: StyleInput,
    /// The look that was baked from the same painting for the demo scene, or `None` if there is none.
    pub baked: Option<Handle<StyleLook>>,
    /// The painting, or `None` if there is none.
    pub picture: Option<Handle<Image>>,
    /// Weight in the mix, 0..1, before normalization.
    pub weight: f32,
    /// The part of the painting that is used, as shares of its sides, or `None` for all of it.
    pub crop: Option<Rect>,
}

impl Style {
    /// The style with its weight, shown by `input`: its own, or its look.
    fn weighted(&self, input: StyleInput) -> WeightedStyle {
        WeightedStyle { input, weight: self.weight, crop: self.crop }
    }

    /// The same pin with its place in the part of the painting that is used. `None` if it is outside.
    fn pin_in_part(&self, pin: StylePin) -> Option<StylePin> {
        let Some(part) = self.crop else { return Some(pin) };
        part.contains(pin.place).then(|| StylePin { place: (pin.place - part.min) / part.size(), ..pin })
    }

    /// The same pin with its place in the whole painting.
    fn pin_in_whole(&self, pin: StylePin) -> StylePin {
        let part = self.crop.unwrap_or(Rect::new(0.0, 0.0, 1.0, 1.0));
        StylePin { place: part.min + pin.place * part.size(), ..pin }
    }
}

/// All styles and their mix.
#[derive(Resource, Default)]
pub struct Styles {
    pub list: Vec<Style>,
    /// Share of the content that stays, 0..1.
    pub content: f32,
    /// How strokes are drawn, as factors: how much of them, how much stays clear of them, and their size; and
    /// how they move.
    pub paint: f32,
    pub protection: f32,
    pub stroke_scale: f32,
    /// Whether the used styles act as one, and are not mixed.
    pub is_collection: bool,
    /// The style whose colors are used in the others' stead, or `None` for their own.
    pub palette: Option<usize>,
    /// How much hues are pulled to the palette, 0..1.
    pub palette_strength: f32,
    /// The axis of the scene that strokes follow, or `None` for its edges.
    pub direction: Option<Vec3>,
    /// Pinned places, each in a style of the list and in the whole painting.
    pub pins: Vec<(usize, StylePin)>,
    /// The style and the spot of its painting that the next pin is for.
    pub spot: Option<(usize, Vec2)>,
    /// The style and the corner of the part of its painting that is being chosen.
    pub corner: Option<(usize, Vec2)>,
    pub motion: StyleMotion,
    /// Thickness of the paint, as a factor, and where the light on it is, in degrees around the world's y axis.
    pub relief: f32,
    pub light_from: f32,
    /// Whether strokes keep their size on screen.
    pub screen_stable: bool,
    pub finish: Finish,
    /// Whether the baked looks belong to the scene that is shown.
    pub looks_fit: bool,
}

impl Styles {
    /// Adds a file to the list, if it is not listed, and returns its index. The file is an image, a preset or a
    /// look; if there is an image of the same name beside a preset or a look, it becomes its picture.
    pub fn add(&mut self, path: &Path, assets: &AssetServer) -> usize {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let picture = picture_of(path).map(|picture| assets.load::<Image>(picture));
        let (input, name) = if let Some(stem) = name.strip_suffix(LOOK) {
            (StyleInput::Look(assets.load(path.to_owned())), format!("{stem} (baked)"))
        } else if let Some(stem) = name.strip_suffix(PRESET) {
            (StyleInput::Preset(assets.load(path.to_owned())), stem.to_owned())
        } else {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            (StyleInput::Image(assets.load(path.to_owned())), stem)
        };
        // Handles of the same path are equal while one of them is alive, so a file is listed once.
        let listed = self.list.iter().position(|style| style.input == input);
        listed.unwrap_or_else(|| {
            let look = format!("{ASSETS}/looks/{name}{LOOK}");
            let baked = Path::new(&look).exists().then(|| assets.load(look));
            self.list.push(Style { name, input, baked, picture, weight: 0.0, crop: None });
            self.list.len() - 1
        })
    }

    /// Selects one style alone, or none.
    pub fn select(&mut self, selected: Option<usize>) {
        for (index, style) in self.list.iter_mut().enumerate() {
            style.weight = if Some(index) == selected { 1.0 } else { 0.0 };
        }
    }

    /// The sum of all weights, for normalization.
    pub fn total(&self) -> f32 {
        self.list.iter().map(|style| style.weight).sum()
    }

    fn used(&self) -> impl Iterator<Item = &Style> {
        self.list.iter().filter(|style| style.weight > 0.0)
    }

    /// The input that a style is shown by: its own, or its look.
    fn shown_as(&self, style: &Style) -> StyleInput {
        let is_plain = style.crop.is_none() && !self.has_hand();
        let is_baked = self.finish == Finish::Baked && self.looks_fit && is_plain;
        let look = style.baked.clone().filter(|_| is_baked);
        look.map_or_else(|| style.input.clone(), StyleInput::Look)
    }

    /// Whether something is decided that no baked look shows.
    fn has_hand(&self) -> bool {
        self.is_collection
            || self.palette.is_some()
            || self.palette_strength != Hand::PALETTE
            || self.direction.is_some()
            || !self.pins.is_empty()
    }

    /// The styles with a painting that are used: pins number them.
    fn paintings(&self) -> impl Iterator<Item = usize> {
        let is_painting = |style: &Style| style.weight > 0.0 && !matches!(style.input, StyleInput::Look(_));
        self.list.iter().enumerate().filter(move |(_, style)| is_painting(style)).map(|(i, _)| i)
    }

    /// Whether a style is used, and a part of its painting can be.
    pub fn has_parts(&self, style: usize) -> bool {
        self.paintings().any(|painting| painting == style)
    }

    /// The parts of paintings that are used in place of all, by their styles.
    pub fn crops(&self) -> Vec<(usize, Rect)> {
        let crop = |(style, of): (usize, &Style)| Some((style, of.crop?));
        self.list.iter().enumerate().filter_map(crop).collect()
    }

    /// Uses these parts of paintings, and all of the others.
    pub fn set_crops(&mut self, crops: &[(usize, Rect)]) {
        for (style, of) in self.list.iter_mut().enumerate() {
            of.crop = crops.iter().find(|(cropped, _)| *cropped == style).map(|(_, part)| *part);
        }
    }

    /// The pins of the styles that are used.
    pub fn used_pins(&self) -> Vec<StylePin> {
        let of_painting = |(painting, style): (usize, usize)| {
            let own = self.pins.iter().filter(move |(of, _)| *of == style);
            own.filter_map(move |(_, pin)| self.list[style].pin_in_part(StylePin { painting, ..*pin }))
        };
        self.paintings().enumerate().flat_map(of_painting).collect()
    }

    /// Pins places of the styles that are used. Those of others are left out.
    pub fn take_pins(&mut self, pins: impl Iterator<Item = StylePin>) {
        let paintings: Vec<usize> = self.paintings().collect();
        let in_whole = |pin: StylePin| {
            let style = *paintings.get(pin.painting)?;
            Some((style, self.list[style].pin_in_whole(pin)))
        };
        self.pins = pins.filter_map(in_whole).collect();
    }

    /// Whether a look is in the mix, which is not refined.
    pub fn has_look(&self) -> bool {
        self.used().any(|style| matches!(self.shown_as(style), StyleInput::Look(_)))
    }

    /// Whether the shown mix is baked further.
    fn is_refined(&self) -> bool {
        let is_cropped = self.used().any(|style| style.crop.is_some());
        self.finish != Finish::Instant && !self.has_look() && !self.has_hand() && !is_cropped
    }

    /// The source of a part of the scene: one style alone, or the captured colors.
    pub fn source_of(&self, style: Option<usize>) -> StyleSource {
        let style = style.and_then(|style| self.list.get(style));
        let alone = |style: &Style| WeightedStyle { weight: 1.0, ..style.weighted(self.shown_as(style)) };
        StyleSource { styles: style.map(alone).into_iter().collect(), ..default() }
    }

    fn source(&self) -> StyleSource {
        StyleSource {
            styles: self.used().map(|style| style.weighted(self.shown_as(style))).collect(),
            content: self.content,
            paint: self.paint,
            protection: self.protection,
            stroke_scale: self.stroke_scale,
            is_collection: self.is_collection,
            palette: self.palette.and_then(|style| palette_of(&self.list.get(style)?.input)),
            palette_strength: self.palette_strength,
            stroke_direction: self.direction.map(Into::into),
            pins: self.used_pins().into(),
            motion: self.motion,
            screen_stable: self.screen_stable,
            relief: relief_lit_from(self.light_from, self.relief),
            ..default()
        }
    }

    fn refine(&self) -> StyleRefine {
        // Presets are refined toward the pictures beside them, or not at all if one has none.
        let painting = |style: &Style| Some((style.picture.clone()?, style.weight));
        let paintings = self.used().map(painting).collect::<Option<_>>().unwrap_or_default();
        StyleRefine { paintings, ..default() }
    }
}

/// The colors of a style, or `None` of a look.
fn palette_of(input: &StyleInput) -> Option<StylePalette> {
    match input {
        StyleInput::Image(image) => Some(image.clone().into()),
        StyleInput::Preset(preset) => Some(preset.clone().into()),
        _ => None,
    }
}

/// The image of a style file: the file itself, or one beside a preset or a look.
fn picture_of(path: &Path) -> Option<PathBuf> {
    let whole = path.to_string_lossy();
    let stem = whole.strip_suffix(PRESET).or_else(|| whole.strip_suffix(LOOK));
    let Some(stem) = stem else { return Some(path.to_owned()) };
    ["jpg", "jpeg", "png"]
        .map(|extension| PathBuf::from(format!("{stem}.{extension}")))
        .into_iter()
        .find(|p| p.exists())
}

/// Lists `assets/styles`.
pub fn list_shipped(mut commands: Commands, assets: Res<AssetServer>) {
    let folder = fs::read_dir(Path::new(ASSETS).join("styles")).into_iter().flatten().flatten();
    let mut images: Vec<_> = folder.map(|entry| entry.path()).collect();
    // The images and not the presets beside them, which are of the same paintings.
    images.retain(|path| !path.to_string_lossy().ends_with(PRESET));
    // The order of a folder is arbitrary, and keys count on it.
    images.sort();
    let (paint, protection, stroke_scale) = (1.0, 1.0, 1.0);
    let palette_strength = Hand::PALETTE;
    let mut styles = Styles { paint, protection, stroke_scale, palette_strength, ..default() };
    for image in images {
        styles.add(&image, &assets);
    }
    commands.insert_resource(styles);
}

/// Keys 1 to 8 select one of the first eight styles, 0 none.
pub fn press_keys(keys: Res<ButtonInput<KeyCode>>, mut styles: ResMut<Styles>) {
    use KeyCode::{Digit0, Digit1, Digit2, Digit3, Digit4, Digit5, Digit6, Digit7, Digit8};
    for (number, key) in
        [Digit0, Digit1, Digit2, Digit3, Digit4, Digit5, Digit6, Digit7, Digit8].into_iter().enumerate()
    {
        if keys.just_pressed(key) {
            styles.select(number.checked_sub(1));
        }
    }
}

/// Applies the mix to the scene if it changed.
pub fn apply(
    mut commands: Commands,
    mut styles: ResMut<Styles>,
    shown: Res<ShownScene>,
    scene: Single<(Entity, &mut StyleSource, Option<&mut StyleRefine>), With<Subject>>,
    mut transfer: ResMut<Transfer>,
) {
    let (entity, mut source, refine) = scene.into_inner();
    let looks_fit = shown.name == BAKED_SCENE && !shown.is_world;
    if styles.looks_fit != looks_fit {
        styles.looks_fit = looks_fit;
    }
    // Only a real change may touch the component: `Changed<StyleSource>` would restyle in each frame.
    let mut wanted = styles.source();
    if shown.is_world {
        // They are of the scene before it, or of one that is to come.
        wanted.pins = default();
        wanted.styles.retain(|style| !matches!(style.input, StyleInput::Look(_)));
    }
    // How strokes are drawn is shown at once, and nothing comes of it later.
    let is_computed = source.styles != wanted.styles
        || source.content != wanted.content
        || source.is_collection != wanted.is_collection
        || source.palette != wanted.palette
        || source.palette_strength != wanted.palette_strength
        || source.stroke_direction != wanted.stroke_direction
        || source.pins != wanted.pins;
    if source.set_if_neq(wanted) && is_computed {
        transfer.is_under_way = !source.is_none();
    }
    match refine {
        Some(mut refine) if styles.is_refined() => {
            refine.set_if_neq(styles.refine());
        }
        Some(_) => {
            commands.entity(entity).remove::<StyleRefine>();
        }
        None if styles.is_refined() => {
            commands.entity(entity).insert(styles.refine());
        }
        None => {}
    }
}
