//! Saving a screenshot, or the scene in its present colors.

use std::{fs, path::PathBuf};

use bevy::{
    prelude::*,
    render::view::screenshot::{Screenshot, ScreenshotCaptured},
    tasks::{Task, futures::check_ready},
};
use bevy_stylegaussian::{
    AppliedStyle, GaussianScene, GaussianSplats,
    mask::StyleMask,
    stylegaussian::paint::{Pin, StoredPins},
    stylegaussian_files::{write_mask, write_pins, write_scene},
};
use stylegaussian_app::{Subject, save_shown};

use crate::{
    panel::{Notice, Panel},
    scene::{OF_SCENES, ShownScene},
    styles::Styles,
};

/// Output folder, relative to the working directory.
const FOLDER: &str = "out/viewer";

/// A request to save something.
#[derive(Message, Clone, Copy, PartialEq)]
pub enum Save {
    /// A screenshot of the window without the panel.
    Screenshot,
    /// The scene, as a file with this extension.
    Scene(&'static str),
    /// The paint on the scene.
    Mask,
    /// The pinned places.
    Pins,
}

/// The task that writes a scene, or `None`.
#[derive(Resource, Default)]
pub struct Saving(Option<Task<Result<PathBuf, String>>>);

impl Saving {
    /// Whether a scene is being written.
    pub fn is_under_way(&self) -> bool {
        self.0.is_some()
    }
}

/// Takes a screenshot of a frame that is drawn without the panel.
pub fn take_screenshot(
    mut wishes: MessageReader<Save>,
    mut panel: ResMut<Panel>,
    shown: Res<ShownScene>,
    mut commands: Commands,
) {
    if !wishes.read().any(|wish| *wish == Save::Screenshot) {
        return;
    }
    // The screenshot is of this very frame, in which the panel has not been drawn yet.
    panel.omit_once();
    let name = shown.name.clone();
    commands.spawn(Screenshot::primary_window()).observe(
        move |captured: On<ScreenshotCaptured>, mut notice: ResMut<Notice>| {
            let saved = new_path(&name, "png").and_then(|path| {
                let picture = captured.image.clone().try_into_dynamic().map_err(|error| error.to_string())?;
                picture.to_rgb8().save(&path).map_err(|error| format!("{}: {error}", path.display()))?;
                Ok(path)
            });
            notice.tell_saved(saved);
        },
    );
}

/// Writes the scene in the background.
pub fn save_scene(
    mut wishes: MessageReader<Save>,
    shown: Res<ShownScene>,
    scenes: Res<Assets<GaussianScene>>,
    splats: Single<(&GaussianSplats, Option<&AppliedStyle>), With<Subject>>,
    mut saving: ResMut<Saving>,
) {
    let extension = wishes.read().find_map(|wish| match wish {
        Save::Scene(extension) => Some(*extension),
        Save::Screenshot | Save::Mask | Save::Pins => None,
    });
    let (splats, style) = *splats;
    let (Some(extension), Some(scene)) = (extension, scenes.get(&splats.0)) else { return };
    let name = shown.name.clone();
    saving.0 = Some(save_shown(scene, style, move |scene| {
        let path = new_path(&name, extension)?;
        write_scene(&path, scene).map_err(|error| error.to_string())?;
        Ok(path)
    }));
}

/// Writes the painted weights.
pub fn save_mask(
    mut wishes: MessageReader<Save>,
    shown: Res<ShownScene>,
    mask: Single<&StyleMask>,
    mut notice: ResMut<Notice>,
) {
    if !wishes.read().any(|wish| *wish == Save::Mask) {
        return;
    }
    let Some(stored) = mask.to_stored() else { return };
    let saved = new_path(&shown.name, "mask.safetensors").and_then(|path| {
        write_mask(&path, &stored).map_err(|error| error.to_string())?;
        Ok(path)
    });
    notice.tell_saved(saved);
}

/// Writes the pinned places.
pub fn save_pins(
    mut wishes: MessageReader<Save>,
    shown: Res<ShownScene>,
    scenes: Res<Assets<GaussianScene>>,
    splats: Single<Option<&GaussianSplats>, With<Subject>>,
    styles: Res<Styles>,
    mut notice: ResMut<Notice>,
) {
    if !wishes.read().any(|wish| *wish == Save::Pins) {
        return;
    }
    let Some(splats) = *splats else { return notice.fail(OF_SCENES.into()) };
    let Some(scene) = scenes.get(&splats.0) else { return };
    let pins = StoredPins::new(scene.scene(), styles.used_pins().into_iter().map(Pin::from).collect());
    let saved = new_path(&shown.name, "pins.json").and_then(|path| {
        write_pins(&path, &pins).map_err(|error| error.to_string())?;
        Ok(path)
    });
    notice.tell_saved(saved);
}

/// Shows the path of the written scene.
pub fn finish_scene(mut saving: ResMut<Saving>, mut notice: ResMut<Notice>) {
    if let Some(saved) = saving.0.as_mut().and_then(check_ready) {
        saving.0 = None;
        notice.tell_saved(saved);
    }
}

/// An unused path, named after the scene.
fn new_path(scene: &str, extension: &str) -> Result<PathBuf, String> {
    fs::create_dir_all(FOLDER).map_err(|error| format!("{FOLDER}: {error}"))?;
    let stem = scene.rsplit_once('.').map_or(scene, |(stem, _)| stem);
    // A new number each time: saving never overwrites a file.
    let mut paths = (1..).map(|number| PathBuf::from(format!("{FOLDER}/{stem}_{number:03}.{extension}")));
    paths.find(|path| !path.exists()).ok_or_else(|| format!("{FOLDER} is full"))
}
