//! The cameras.json of the 3DGS trainer: camera-to-world poses in OpenCV axes.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec2, DVec3};
use serde::Deserialize;
use serde_json::Value;

use super::{
    photos::photo_paths,
    posed::{CameraSet, CamerasError, Intrinsics, PosedCamera, invalid, picture_size, rigid},
};

/// Expected of each camera.
const EXPECTED: &str = "img_name, numbers width, height, fx and fy, a position of 3 and a rotation of 3 x 3";

#[derive(Deserialize)]
struct Entry {
    img_name: String,
    /// Pixels. Some trainers write them as floats.
    width: f64,
    height: f64,
    /// Position of the camera in the world.
    position: [f64; 3],
    /// Rows of the camera-to-world rotation.
    rotation: [[f64; 3]; 3],
    /// Pixels.
    fx: f64,
    fy: f64,
}

/// Reads the parsed file at `path`. Photos are expected in `images` beside it. The format has no principal
/// point, so the picture's middle is used. Cameras count from `offset`.
pub(super) fn read(path: &Path, cameras: &[Value], offset: DVec3) -> Result<CameraSet, CamerasError> {
    let entry = |(i, value): (usize, &Value)| {
        let wrong = |error: serde_json::Error| invalid(path, &format!("camera {i}"), error, EXPECTED);
        Entry::deserialize(value).map_err(wrong)
    };
    let entries = cameras.iter().enumerate().map(entry).collect::<Result<Vec<Entry>, CamerasError>>()?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let names: Vec<&str> = entries.iter().map(|entry| entry.img_name.as_str()).collect();
    let photos = photo_paths(&[folder.join("images"), folder.into()], &names);
    let camera = |(i, (entry, photo)): (usize, (Entry, PathBuf))| {
        let what = format!("camera {i} ({})", entry.img_name);
        // The file has rows, glam takes columns.
        let rotation = DMat3::from_cols_array_2d(&entry.rotation).transpose();
        let world_from_view = rigid(rotation, DVec3::from(entry.position), path, &what)?;
        let size = picture_size(entry.width, entry.height, path, &what)?;
        let intrinsics =
            Intrinsics { focal: DVec2::new(entry.fx, entry.fy), center: size.as_dvec2() / 2.0, size };
        Ok(PosedCamera {
            camera: intrinsics.camera(world_from_view.inverse(), offset, path, &what)?,
            photo: (!entry.img_name.is_empty()).then_some(photo),
            name: entry.img_name,
            // The trainer takes pinholes alone.
            distortion: None,
        })
    };
    let cameras = entries.into_iter().zip(photos).enumerate().map(camera);
    let cameras = cameras.collect::<Result<_, CamerasError>>()?;
    Ok(CameraSet { cameras, warnings: Vec::new() })
}
