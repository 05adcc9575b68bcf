//! The loader of scenes, which may lie in several files.

use bevy::{
    asset::{AssetLoader, AssetPath, LoadContext, io::Reader},
    prelude::*,
};
use serde::{Deserialize, Serialize};
use stylegaussian::{Axes, work::Work};
use stylegaussian_files::{Loaded, ReadOptions, Reading, SceneReader};

use super::{asset::GaussianScene, progress::SceneReadings};
use crate::{
    loader::{LoadError, read_all},
    work::{Lane, Workers, for_one, taken},
};

/// Settings of loading a [`GaussianScene`].
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::{GaussianScene, scene::SceneSettings, stylegaussian::Axes};
/// # fn load(assets: &AssetServer) -> Handle<GaussianScene> {
/// // An SPZ scene of a program that keeps the axes of `.ply` files.
/// let settings = |settings: &mut SceneSettings| settings.axes = Some(Axes::RDF);
/// assets.load_builder().with_settings(settings).load("garden.spz")
/// # }
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct SceneSettings {
    /// The axes of the file's coordinates, or `None` for those that the file or its format's specification
    /// says.
    pub axes: Option<Axes>,
    /// The most Gaussians of a scene that is stored at several levels of detail, or `None` for the finest
    /// level.
    pub budget: Option<usize>,
}

/// Loads scenes.
#[derive(TypePath)]
pub(super) struct SceneLoader {
    workers: Workers,
    readings: SceneReadings,
}

impl FromWorld for SceneLoader {
    fn from_world(world: &mut World) -> Self {
        let readings = world.resource::<SceneReadings>().clone();
        Self { workers: world.resource::<Workers>().clone(), readings }
    }
}

/// The state of a load, which moves between the tasks that wait for files and those that compute.
enum Step {
    Done(Box<GaussianScene>),
    Needs(SceneReader, Vec<String>),
}

impl AssetLoader for SceneLoader {
    type Asset = GaussianScene;
    type Settings = SceneSettings;
    type Error = LoadError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        settings: &SceneSettings,
        context: &mut LoadContext<'_>,
    ) -> Result<GaussianScene, LoadError> {
        let path = context.path().clone();
        let bytes = read_all(reader, &path).await?;
        let options = ReadOptions { axes: settings.axes, budget: settings.budget };
        let mut scene = SceneReader::new(bytes, &name(&path), options);
        loop {
            let name = name(&path);
            let (readings, of) = (self.readings.clone(), path.clone());
            // If the last handle is dropped, Bevy drops this future, and that cancels the reading. Not in a
            // browser, where one reading is one task.
            let reading = self.workers.start(Lane::Scenes, move |work| {
                let _reading = readings.add(of, work);
                let step = step(scene, &name, work);
                work.check()?;
                for_one(step)
            });
            match taken(reading).await?? {
                Step::Done(scene) => return Ok(*scene),
                Step::Needs(reader, names) => {
                    scene = reader;
                    for name in names {
                        let bytes = context.read_asset_bytes(beside(&path, &name)).await;
                        let bytes = bytes.map_err(|error| LoadError::Part {
                            path: path.to_string(),
                            part: name.clone(),
                            error: Box::new(error),
                        })?;
                        scene.add(name, bytes);
                    }
                }
            }
        }
    }

    fn extensions(&self) -> &[&str] {
        // Not `.glb`, `.gltf` and `.json`, although scenes come in them: assets that are loaded without a type,
        // and labeled ones as `a.glb#Scene0`, go by the extension, and are hardly ever scenes of Gaussians.
        &["sgs", "ply", "spz", "sog", "splat", "ksplat"]
    }
}

/// Share of a load that reading the files is said to take. The rest is for what is found in the scene.
const READING: f32 = 0.8;

/// Reads the scene as far as its files allow.
fn step(mut reader: SceneReader, name: &str, work: &Work) -> Result<Step, LoadError> {
    let reading = reader.read_if_wanted(&work.part(0.0, READING));
    match reading.map_err(|error| LoadError::Parse(error.into()))? {
        Reading::Needs(names) => Ok(Step::Needs(reader, names)),
        Reading::Scene(loaded) => {
            // Finding neighbors takes as much memory again as a large file: free the files first.
            drop(reader);
            let Loaded { scene, warnings, .. } = *loaded;
            for warning in warnings {
                warn!("{name}: {warning}");
            }
            let scene = GaussianScene::new_if_wanted(scene, &work.part(READING, 1.0))?;
            Ok(Step::Done(Box::new(scene)))
        }
    }
}

/// The name of a file, for messages and for its extension: addresses on the web may end with a query.
fn name(path: &AssetPath) -> String {
    let name = path.to_string();
    name.split('?').next().unwrap_or(&name).to_owned()
}

/// A file by its path relative to the one that names it. The reader has checked that it does not lead
/// elsewhere. It is not parsed as an asset's path, in which some characters have a meaning.
pub(crate) fn beside<'a>(path: &AssetPath<'a>, name: &str) -> AssetPath<'a> {
    let at = path.path().with_file_name(name);
    AssetPath::from_path_buf(at).with_source(path.source().clone_owned())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn files_of_a_scene_lie_beside_the_one_that_names_them() {
        let of = |path: &str, name: &str| beside(&AssetPath::parse(path), name).to_string();
        assert_eq!(of("scenes/a/meta.json", "means_l.webp"), "scenes/a/means_l.webp");
        assert_eq!(of("meta.json", "0_0/meta.json"), "0_0/meta.json");
        assert_eq!(of("http://b.org/a/meta.json", "x.webp"), "http://b.org/a/x.webp");
        let hash = beside(&AssetPath::parse("a/meta.json"), "x#y.webp");
        assert_eq!((hash.path(), hash.label()), (Path::new("a/x#y.webp"), None));
        assert_eq!(name(&AssetPath::parse("http://b.org/a.splat?v=2")), "http://b.org/a.splat");
    }
}
