//! Photos of a capture: where they are, and which are missing.

use std::{
    collections::{HashMap, HashSet},
    path::{Path, PathBuf},
};

use stylegaussian_encoder::image::extensions;

use super::posed::{CameraSet, CamerasError};

/// Most parts of a name that are tried, from its end. Longer paths are no photo's.
const MOST_PARTS: usize = 16;

impl CameraSet {
    /// The cameras whose photos exist. A warning counts the others.
    ///
    /// # Errors
    /// If more than half of the photos are missing.
    pub fn with_photos(mut self) -> Result<Self, CamerasError> {
        let n = self.cameras.len();
        let mut first = None;
        self.cameras.retain(|posed| match posed.require_photo() {
            Ok(_) => true,
            Err(error) => {
                first.get_or_insert(error);
                false
            }
        });
        let n_missing = n - self.cameras.len();
        match first {
            Some(first) if 2 * n_missing > n => {
                return Err(CamerasError::NoPhotos { n_missing, n, first: first.into() });
            }
            Some(first) => self.warnings.push(format!(
                "{n_missing} of {n} photos are missing, and their cameras are left out; the first: {first}"
            )),
            None => {}
        }
        Ok(self)
    }
}

/// The paths of photos with these names, in order. Names are relative to the first of `folders`.
///
/// A photo that is not there is looked for in all folders by the end of its name, since files of cameras are
/// written on other machines: `C:\\captures\\garden\\images\\000.png` is `garden/images/000.png`,
/// `images/000.png` or `000.png`. An extension may be missing. If nothing is found, or the same photo for two
/// names, the path is where the name says.
pub(super) fn photo_paths(folders: &[PathBuf], names: &[&str]) -> Vec<PathBuf> {
    let plain = |name: &str| folders.first().map_or_else(|| name.into(), |folder| folder.join(name));
    let found: Vec<(PathBuf, bool)> = names
        .iter()
        .map(|name| match existing(plain(name)) {
            Some(path) => (path, true),
            None => (by_end(folders, name).unwrap_or_else(|| plain(name)), false),
        })
        .collect();
    let mut name_of_path: HashMap<&Path, &str> = HashMap::new();
    let mut shared: HashSet<&Path> = HashSet::new();
    for ((path, _), name) in found.iter().zip(names) {
        if name_of_path.insert(path, name).is_some_and(|other| other != *name) {
            shared.insert(path);
        }
    }
    let path = |((path, is_plain), name): (&(PathBuf, bool), &&str)| match is_plain {
        false if shared.contains(path.as_path()) => plain(name),
        _ => path.clone(),
    };
    found.iter().zip(names).map(path).collect()
}

/// The longest end of `name` that exists in one of `folders`.
fn by_end(folders: &[PathBuf], name: &str) -> Option<PathBuf> {
    let parts: Vec<&str> = name.split(['/', '\\']).filter(|part| !matches!(*part, "" | "." | "..")).collect();
    let ends = (parts.len().saturating_sub(MOST_PARTS)..parts.len()).map(|start| &parts[start..]);
    ends.flat_map(|end| {
        folders.iter().map(move |folder| end.iter().fold(folder.clone(), |path, part| path.join(part)))
    })
    .find_map(existing)
}

/// `path` as it is, with its extension in the other case, or with an image's extension, if such a file exists.
fn existing(path: PathBuf) -> Option<PathBuf> {
    if path.is_file() {
        return Some(path);
    }
    let extended = |extension: String| {
        let mut path = path.clone().into_os_string();
        path.push(".");
        path.push(extension);
        PathBuf::from(path)
    };
    // Systems on which cases are the same let names of both pass.
    let in_case = |case: fn(&str) -> String| Some(path.with_extension(case(path.extension()?.to_str()?)));
    let cases: [fn(&str) -> String; 2] = [str::to_lowercase, str::to_uppercase];
    let upper = extensions().map(str::to_uppercase);
    let extended = extensions().map(str::to_owned).chain(upper).map(extended);
    cases.into_iter().filter_map(in_case).chain(extended).find(|path| path.is_file())
}
