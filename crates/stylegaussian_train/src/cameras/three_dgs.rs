//! The cameras.json of the 3DGS trainer: camera-to-world poses in OpenCV axes.

use std::path::Path;

use glam::{DMat3, DVec2, DVec3, UVec2};
use serde::Deserialize;
use serde_json::Value;

use super::posed::{CameraSet, CamerasError, Intrinsics, PosedCamera, photo_path, rigid};

#[derive(Deserialize)]
struct Entry {
    img_name: String,
    /// Pixels.
    width: u32,
    height: u32,
    /// Position of the camera in the world.
    position: [f64; 3],
    /// Rows of the camera-to-world rotation.
    rotation: [[f64; 3]; 3],
    /// Pixels.
    fx: f64,
    fy: f64,
}

/// Reads the parsed file at `path`. Photos are expected in `images` beside it. The format has no principal
/// point, so the picture's middle is used.
pub(super) fn read(path: &Path, json: Value) -> Result<CameraSet, CamerasError> {
    let entries: Vec<Entry> =
        serde_json::from_value(json).map_err(|source| CamerasError::Json { path: path.into(), source })?;
    let photos = path.parent().unwrap_or(Path::new("")).join("images");
    let camera = |(i, entry): (usize, Entry)| {
        let what = format!("camera {i} ({})", entry.img_name);
        // The file has rows, glam takes columns.
        let rotation = DMat3::from_cols_array_2d(&entry.rotation).transpose();
        let world_from_view = rigid(rotation, DVec3::from(entry.position), path, &what)?;
        let size = UVec2::new(entry.width, entry.height);
        let intrinsics =
            Intrinsics { focal: DVec2::new(entry.fx, entry.fy), center: size.as_dvec2() / 2.0, size };
        Ok(PosedCamera {
            camera: intrinsics.camera(world_from_view.inverse(), path, &what)?,
            photo: (!entry.img_name.is_empty()).then(|| photo_path(&photos, &entry.img_name)),
            name: entry.img_name,
        })
    };
    let cameras = entries.into_iter().enumerate().map(camera).collect::<Result<_, CamerasError>>()?;
    Ok(CameraSet { cameras, warnings: Vec::new() })
}
