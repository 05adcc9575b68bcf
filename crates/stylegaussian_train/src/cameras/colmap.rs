//! COLMAP models: `cameras` and `images`, as text or binary. World-to-view poses in our axes.
//!
//! The format: <https://colmap.github.io/format.html>.

mod binary;
mod text;

use std::{
    collections::HashMap,
    fs,
    path::{Path, PathBuf},
};

use glam::{DAffine3, DQuat, DVec2, DVec3, UVec2};

use super::{
    distortion::Distortion,
    photos::photo_paths,
    posed::{CameraSet, CamerasError, Intrinsics, PosedCamera, invalid},
};

/// A lens of the model.
struct Lens {
    model: &'static Model,
    width: u64,
    height: u64,
    /// The model's parameters, in its order.
    parameters: Vec<f64>,
}

/// A registered photo.
struct Image {
    name: String,
    /// Rotation of the view from the world: w, x, y, z.
    rotation: [f64; 4],
    translation: [f64; 3],
    camera_id: u32,
}

/// One of COLMAP's camera models.
struct Model {
    name: &'static str,
    /// The number in binary files.
    id: i32,
    n_parameters: usize,
    /// Number of focal lengths at the start of the parameters, if the model is a pinhole apart from its
    /// distortion.
    n_focal: Option<usize>,
}

const fn model(name: &'static str, id: i32, n_parameters: usize, n_focal: Option<usize>) -> Model {
    Model { name, id, n_parameters, n_focal }
}

/// The models of COLMAP's `src/colmap/sensor/models.h`.
const MODELS: [Model; 12] = [
    model("SIMPLE_PINHOLE", 0, 3, Some(1)),
    model("PINHOLE", 1, 4, Some(2)),
    model("SIMPLE_RADIAL", 2, 4, Some(1)),
    model("RADIAL", 3, 5, Some(1)),
    model("OPENCV", 4, 8, Some(2)),
    model("OPENCV_FISHEYE", 5, 8, None),
    model("FULL_OPENCV", 6, 12, Some(2)),
    model("FOV", 7, 5, None),
    model("SIMPLE_RADIAL_FISHEYE", 8, 4, None),
    model("RADIAL_FISHEYE", 9, 5, None),
    model("THIN_PRISM_FISHEYE", 10, 12, None),
    model("RAD_TAN_THIN_PRISM_FISHEYE", 11, 16, None),
];

/// Whether `folder` itself holds a model.
pub(super) fn is_model(folder: &Path) -> bool {
    let has = |extension| {
        ["cameras", "images"].iter().all(|stem| folder.join(stem).with_extension(extension).is_file())
    };
    has("bin") || has("txt")
}

/// Reads the model with the most images among those that COLMAP's mapper numbers in the folder `sparse`. The
/// mapper writes several if it cannot join all images, and the first one need not be the largest.
pub(super) fn read_largest(sparse: &Path, offset: DVec3) -> Result<Option<CameraSet>, CamerasError> {
    let number = |path: &Path| path.file_name()?.to_str()?.parse::<u32>().ok();
    let folders = fs::read_dir(sparse).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut models: Vec<(u32, PathBuf)> = folders
        .filter_map(|folder| Some((number(&folder)?, folder)))
        .filter(|(_, folder)| is_model(folder))
        .collect();
    models.sort();
    if let [(_, model)] = &models[..] {
        return read(model, offset).map(Some);
    }
    // A model that cannot be read has no images; if it is taken, its error is told.
    let counts: Vec<usize> =
        models.iter().map(|(_, model)| images(model).map_or(0, |images| images.len())).collect();
    let Some((most, (_, model))) = counts.iter().zip(&models).rev().max_by_key(|(count, _)| **count) else {
        return Ok(None);
    };
    let mut set = read(model, offset)?;
    let which = match counts.iter().filter(|count| *count == most).count() {
        1 => "which has the most images",
        _ => "the first of those with the most images",
    };
    set.warnings.push(format!(
        "{}: found {} COLMAP models, took {}, {which}: {most} of {}",
        sparse.display(),
        models.len(),
        model.file_name().unwrap_or_default().display(),
        counts.iter().sum::<usize>()
    ));
    Ok(Some(set))
}

/// The images of the model in `folder`.
fn images(folder: &Path) -> Result<Vec<Image>, CamerasError> {
    match is_binary(folder) {
        true => binary::images(&folder.join("images.bin")),
        false => text::images(&folder.join("images.txt")),
    }
}

fn is_binary(folder: &Path) -> bool {
    ["cameras.bin", "images.bin"].iter().all(|name| folder.join(name).is_file())
}

/// Reads the model in `folder`, the binary one if there are both. Cameras are sorted by name, because COLMAP's
/// order is arbitrary. Photos are expected in the `images` folder here, or up to three levels up.
/// Cameras count from `offset`.
pub(super) fn read(folder: &Path, offset: DVec3) -> Result<CameraSet, CamerasError> {
    let (lenses, images_path) = match is_binary(folder) {
        true => (binary::cameras(&folder.join("cameras.bin"))?, folder.join("images.bin")),
        false => (text::cameras(&folder.join("cameras.txt"))?, folder.join("images.txt")),
    };
    let mut images = images(folder)?;
    images.sort_by(|a, b| a.name.cmp(&b.name));

    let names: Vec<&str> = images.iter().map(|image| image.name.as_str()).collect();
    let photos = photo_paths(&[photo_folder(folder)], &names);
    let mut cameras = Vec::new();
    for (image, photo) in images.into_iter().zip(photos) {
        let what = format!("image {}", image.name);
        let Some(lens) = lenses.get(&image.camera_id) else {
            return Err(invalid(
                &images_path,
                &what,
                format!("camera {}", image.camera_id),
                "a known camera",
            ));
        };
        let pose = image.pose(&images_path, &what)?;
        let intrinsics = lens.intrinsics(&images_path, &what)?;
        let camera = intrinsics.camera(pose, offset, &images_path, &what)?;
        let distortion = lens.distortion(intrinsics);
        cameras.push(PosedCamera { name: image.name, camera, photo: Some(photo), distortion });
    }
    Ok(CameraSet { cameras, warnings: Vec::new() })
}

fn photo_folder(model: &Path) -> PathBuf {
    // nerfstudio keeps models in colmap/sparse/0.
    let relative = ["images", "../images", "../../images", "../../../images"];
    let candidates = relative.map(|relative| model.join(relative));
    let found = candidates.iter().find(|folder| folder.is_dir());
    found.unwrap_or(&candidates[2]).clone()
}

impl Image {
    /// View from world.
    fn pose(&self, path: &Path, what: &str) -> Result<DAffine3, CamerasError> {
        let [w, x, y, z] = self.rotation;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        let translation = DVec3::from(self.translation);
        // Any clear length is accepted and normalized, because text files round. A quaternion near 0 has no
        // direction.
        if !(rotation.is_finite() && rotation.length() > 0.1 && translation.is_finite()) {
            let found = format!("rotation {:?}, translation {translation}", self.rotation);
            return Err(invalid(path, what, found, "a quaternion of unit length and a finite translation"));
        }
        Ok(DAffine3::from_rotation_translation(rotation.normalize(), translation))
    }
}

impl Lens {
    /// The distortion of a model that is a pinhole apart from it.
    fn distortion(&self, Intrinsics { focal, center, size }: Intrinsics) -> Option<Distortion> {
        // Focal lengths and the principal point come first. Distortion follows.
        let n_pinhole = self.model.n_focal.map_or(0, |n| n + 2);
        let (radial, tangential, rational) = match self.parameters[n_pinhole..] {
            [k1] => ([k1, 0.0, 0.0, 0.0], [0.0; 2], [0.0; 3]),
            [k1, k2] => ([k1, k2, 0.0, 0.0], [0.0; 2], [0.0; 3]),
            [k1, k2, p1, p2] => ([k1, k2, 0.0, 0.0], [p1, p2], [0.0; 3]),
            [k1, k2, p1, p2, k3, k4, k5, k6] => ([k1, k2, k3, 0.0], [p1, p2], [k4, k5, k6]),
            _ => return None,
        };
        let lens = Distortion { focal, center, size, radial, rational, tangential };
        lens.is_any().then_some(lens)
    }

    /// The posed camera. `what` names the image in errors about `path`.
    fn intrinsics(&self, path: &Path, what: &str) -> Result<Intrinsics, CamerasError> {
        let (focal, center) = match (self.model.n_focal, self.parameters.as_slice()) {
            (Some(1), &[f, cx, cy, ..]) => (DVec2::splat(f), DVec2::new(cx, cy)),
            (Some(2), &[fx, fy, cx, cy, ..]) => (DVec2::new(fx, fy), DVec2::new(cx, cy)),
            _ => {
                let found = format!("camera model {}", self.model.name);
                return Err(invalid(path, what, found, "a pinhole camera (undistort the photos first)"));
            }
        };
        let (Ok(width), Ok(height)) = (u32::try_from(self.width), u32::try_from(self.height)) else {
            let found = format!("a picture of {} x {}", self.width, self.height);
            return Err(invalid(path, what, found, "a size in pixels"));
        };
        Ok(Intrinsics { focal, center, size: UVec2::new(width, height) })
    }
}

/// Lenses by camera number.
type Lenses = HashMap<u32, Lens>;
