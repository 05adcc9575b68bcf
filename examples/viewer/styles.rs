//! The list of styles and their weights.

use std::{
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

use bevy::prelude::*;
use bevy_stylegaussian::{StyleInput, StyleRefine, StyleSource, StyleTransition};

use crate::{ASSETS, panel::Transfer};

/// File ending of statistics made by `stylegaussian style`.
const PRESET: &str = ".style.safetensors";
/// File ending of baked looks.
const LOOK: &str = ".look.safetensors";

/// One style of the panel.
pub struct Style {
    pub name: String,
    pub input: StyleInput,
    /// The painting, or `None` if there is none.
    pub picture: Option<Handle<Image>>,
    /// Weight in the mix, 0..1, before normalization.
    pub weight: f32,
}

/// All styles and their mix.
#[derive(Resource, Default)]
pub struct Styles {
    pub list: Vec<Style>,
    /// Share of the content's features that stays, 0..1.
    pub content: f32,
    /// Duration of a fade from one style to the next.
    pub fade_in_seconds: f32,
    /// Whether styles are baked further while they are shown.
    pub are_refined: bool,
}

impl Styles {
    /// Adds a file to the list, if it is not listed, and returns its index. The file is an image, statistics or a look; if
    /// there is an image of the same name beside statistics or a look, it becomes their picture.
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
            self.list.push(Style { name, input, picture, weight: 0.0 });
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

    /// Whether a look is in the mix, which is not refined.
    pub fn has_look(&self) -> bool {
        self.used().any(|style| matches!(style.input, StyleInput::Look(_)))
    }

    fn source(&self) -> StyleSource {
        let styles = self.used().map(|style| (style.input.clone(), style.weight));
        StyleSource::mix(styles).with_content(self.content)
    }

    fn refine(&self) -> StyleRefine {
        // Presets are refined toward the pictures beside them, or not at all if one has none.
        let painting = |style: &Style| Some((style.picture.clone()?, style.weight));
        let paintings = self.used().map(painting).collect::<Option<_>>().unwrap_or_default();
        StyleRefine { paintings, ..default() }
    }
}

/// The image of a style file: the file itself, or one beside statistics or a look.
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
    let mut presets: Vec<_> = folder.map(|entry| entry.path()).collect();
    presets.retain(|path| path.to_string_lossy().ends_with(PRESET));
    // The order of a folder is arbitrary, and keys count on it.
    presets.sort();
    let mut styles = Styles { fade_in_seconds: 0.5, are_refined: true, ..default() };
    for preset in presets {
        styles.add(&preset, &assets);
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
    styles: Res<Styles>,
    scene: Single<(Entity, &mut StyleSource, &mut StyleTransition, Option<&mut StyleRefine>)>,
    mut transfer: ResMut<Transfer>,
) {
    let (entity, mut source, mut transition, refine) = scene.into_inner();
    // Only a real change may touch the component: `Changed<StyleSource>` would restyle in each frame.
    if source.set_if_neq(styles.source()) {
        transfer.is_under_way = !source.is_none();
    }
    transition.set_if_neq(StyleTransition { duration: Duration::from_secs_f32(styles.fade_in_seconds) });
    match refine {
        Some(mut refine) if styles.are_refined => {
            refine.set_if_neq(styles.refine());
        }
        Some(_) => {
            commands.entity(entity).remove::<StyleRefine>();
        }
        None if styles.are_refined => {
            commands.entity(entity).insert(styles.refine());
        }
        None => {}
    }
}
