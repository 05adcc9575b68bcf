//! Files to open: from the command line, dropped on the window, or named in the panel.

use std::path::{Path, PathBuf, absolute};

use bevy::{prelude::*, window::FileDragAndDrop};
use bevy_stylegaussian::{
    GaussianScene, GaussianSplats,
    mask::StyleMask,
    style::StylePin,
    stylegaussian::paint::Pin,
    stylegaussian_files::{read_pins, readable_extensions},
};

use crate::{
    panel::Notice,
    scene::{OF_SCENES, ShownScene},
    styles::Styles,
};

/// The files on the command line.
#[derive(Resource)]
pub struct CommandLine {
    pub scene: PathBuf,
    pub styles: Vec<PathBuf>,
}

/// A request to open a file of any kind.
#[derive(Message)]
pub struct OpenFile(pub PathBuf);

enum Kind {
    Scene,
    Style,
    Mask,
    Pins,
}

/// The kind of a file by its name, or `None` if it is unknown.
fn kind(path: &Path) -> Option<Kind> {
    let name = path.file_name()?.to_str()?.to_ascii_lowercase();
    // Before the last extension: other `.safetensors` files are no styles.
    if name.ends_with(".style.safetensors") || name.ends_with(".look.safetensors") {
        return Some(Kind::Style);
    }
    if name.ends_with(".mask.safetensors") {
        return Some(Kind::Mask);
    }
    if name.ends_with(".pins.json") {
        return Some(Kind::Pins);
    }
    match name.rsplit_once('.')?.1 {
        "jpg" | "jpeg" | "png" => Some(Kind::Style),
        extension if readable_extensions().contains(&extension) => Some(Kind::Scene),
        _ => None,
    }
}

/// Whether a file belongs to a single scene.
fn is_of_a_scene(path: &Path) -> bool {
    let name = path.to_string_lossy().to_ascii_lowercase();
    [".look.safetensors", ".mask.safetensors", ".pins.json"].iter().any(|end| name.ends_with(end))
}

/// The file that stands for a scene in a folder, or the path itself.
fn named(path: PathBuf) -> PathBuf {
    let inside = ["lod-meta.json", "meta.json"].map(|name| path.join(name));
    inside.into_iter().find(|file| file.is_file()).unwrap_or(path)
}

/// Everything that can be opened, for messages.
fn expected() -> String {
    let scenes: Vec<_> = readable_extensions().iter().map(|extension| format!(".{extension}")).collect();
    format!(
        "expected a scene ({}), a folder with one or a world, an image (.jpg, .png), a .style.safetensors, \
         a .look.safetensors, a .mask.safetensors or a .pins.json",
        scenes.join(", ")
    )
}

/// Opens the files on the command line. Several styles are mixed in equal parts.
pub fn open_arguments(
    arguments: Res<CommandLine>,
    assets: Res<AssetServer>,
    mut shown: ResMut<ShownScene>,
    mut styles: ResMut<Styles>,
    mut notice: ResMut<Notice>,
) {
    shown.load(&named(from_here(&arguments.scene)), &assets);
    for path in &arguments.styles {
        if shown.expects_world() && is_of_a_scene(path) {
            notice.fail(format!("{}: {OF_SCENES}", path.display()));
            continue;
        }
        let index = styles.add(&from_here(path), &assets);
        // And not `select`, which would leave the last one alone.
        styles.list[index].weight = 1.0;
    }
}

/// Opens files that are dropped on the window.
pub fn take_dropped(mut drops: MessageReader<FileDragAndDrop>, mut opened: MessageWriter<OpenFile>) {
    for drop in drops.read() {
        if let FileDragAndDrop::DroppedFile { path_buf, .. } = drop {
            opened.write(OpenFile(path_buf.clone()));
        }
    }
}

/// Opens files: a scene replaces the present one, a style is listed and applied, a mask is put on the scene,
/// and pins are put on the styles that are used.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub fn open(
    mut opened: MessageReader<OpenFile>,
    assets: Res<AssetServer>,
    mut shown: ResMut<ShownScene>,
    mut styles: ResMut<Styles>,
    mut notice: ResMut<Notice>,
    cloud: Single<(Entity, Option<&GaussianSplats>), With<StyleMask>>,
    scenes: Res<Assets<GaussianScene>>,
    mut commands: Commands,
) {
    for OpenFile(path) in opened.read() {
        let path = named(from_here(path));
        // The last file's error says nothing about this one.
        notice.clear();
        match kind(&path) {
            _ if !path.exists() => notice.fail(format!("{}: there is no such file", path.display())),
            _ if path.is_dir() => {
                notice.fail(format!("{}: found a folder without a scene, {}", path.display(), expected()));
            }
            Some(Kind::Scene) => shown.load(&path, &assets),
            Some(_) if shown.expects_world() && is_of_a_scene(&path) => {
                notice.fail(format!("{}: {OF_SCENES}", path.display()));
            }
            Some(Kind::Mask) => {
                commands.entity(cloud.0).insert(StyleMask::saved(assets.load(path)));
            }
            Some(Kind::Pins) => match pins(&path, cloud.1.and_then(|splats| scenes.get(&splats.0))) {
                Ok(pins) => styles.take_pins(pins.into_iter()),
                Err(error) => notice.fail(error),
            },
            Some(Kind::Style) => {
                let index = styles.add(&path, &assets);
                styles.select(Some(index));
            }
            None => notice.fail(format!("{}: {}", path.display(), expected())),
        }
    }
}

/// The pins of a file, for the scene that is shown.
fn pins(path: &Path, scene: Option<&GaussianScene>) -> Result<Vec<StylePin>, String> {
    let named = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let stored = read_pins(path).map_err(|error| error.to_string())?;
    let scene = scene.ok_or_else(|| named(&"the scene is still being loaded"))?;
    let pins = stored.pins_for(scene.scene()).map_err(|error| named(&error))?;
    let pin = |pin: &Pin| StylePin { at: pin.at, place: pin.place, painting: pin.painting };
    Ok(pins.iter().map(pin).collect())
}

/// The absolute path. The asset server would look for relative ones in the app's own folder.
fn from_here(path: &Path) -> PathBuf {
    absolute(path).unwrap_or_else(|_| path.to_owned())
}
