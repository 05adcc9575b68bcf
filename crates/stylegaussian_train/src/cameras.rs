//! Posed cameras of a capture: transforms.json, COLMAP models, and the cameras.json that 3DGS trainers write.
//!
//! Every camera comes out as a pinhole in our axes (x right, y down, z forward), in the file's world, or from
//! the origin of a scene that is far from that world's. The formats, one module each: `transforms`, `colmap`,
//! `three_dgs`; `posed`, `photos` and `distortion` have their common parts.

mod colmap;
mod distortion;
mod photos;
mod posed;
#[cfg(test)]
mod tests;
mod three_dgs;
mod transforms;

use std::{fs, path::Path};

use glam::UVec2;
use stylegaussian::Camera;

pub use distortion::Distortion;
#[cfg(feature = "training")]
pub(crate) use posed::utf8;
pub use posed::{CameraOptions, CameraSet, CamerasError, PosedCamera};
use posed::{invalid, parse, read};

/// Reads the cameras at `path`: a transforms.json, a 3DGS cameras.json, a file of a COLMAP model, or a folder
/// with one of these (in this order: transforms.json, COLMAP in sparse/0, sparse, the folder itself,
/// colmap/sparse/0, colmap/sparse, dense/sparse or dense/0/sparse, cameras.json, transforms_train.json, COLMAP
/// in 0). Of several numbered COLMAP models, the one with the most images is read.
///
/// # Errors
/// If the file is missing, truncated or malformed, a pose is not rigid, the lens is no pinhole (distortion
/// alone is only a warning, or taken out of photos), or the file has no camera.
pub fn read_cameras(path: &Path) -> Result<CameraSet, CamerasError> {
    read_cameras_with(path, CameraOptions::default())
}

/// [`read_cameras`], with what the file does not tell.
///
/// # Errors
/// As [`read_cameras`].
pub fn read_cameras_with(path: &Path, options: CameraOptions) -> Result<CameraSet, CamerasError> {
    let metadata = fs::metadata(path).map_err(|source| CamerasError::Io { path: path.into(), source })?;
    let mut set = if metadata.is_dir() { read_folder(path, options) } else { read_file(path, options) }?;
    if set.cameras.is_empty() {
        return Err(invalid(path, "cameras", "none", "at least one"));
    }
    match options.undistorts {
        true => set.undistort(path)?,
        false => set.tell_distortion(path),
    }
    Ok(set)
}

fn read_folder(folder: &Path, options: CameraOptions) -> Result<CameraSet, CamerasError> {
    let transforms = folder.join("transforms.json");
    if transforms.is_file() {
        return read_file(&transforms, options);
    }
    // COLMAP's mapper numbers its models in sparse. Its undistorter writes to sparse itself, in the folders of
    // dense for those who reconstruct automatically. nerfstudio keeps both in colmap.
    for model in ["sparse", "", "colmap/sparse", "dense/sparse", "dense/0/sparse"] {
        let model = folder.join(model);
        if model != folder
            && let Some(set) = colmap::read_largest(&model, options.offset)?
        {
            return Ok(set);
        }
        if colmap::is_model(&model) {
            return colmap::read(&model, options.offset);
        }
    }
    // The synthetic NeRF scenes have a file of transforms for each of their parts.
    for name in ["cameras.json", "transforms_train.json"] {
        let cameras = folder.join(name);
        if cameras.is_file() {
            return read_file(&cameras, options);
        }
    }
    // The folder sparse itself.
    match colmap::read_largest(folder, options.offset)? {
        Some(set) => Ok(set),
        None => Err(CamerasError::Unrecognized { path: folder.into() }),
    }
}

fn read_file(path: &Path, options: CameraOptions) -> Result<CameraSet, CamerasError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("bin" | "txt") if colmap::is_model(folder) => colmap::read(folder, options.offset),
        // 3DGS trainers write a list, all others an object.
        Some("json") => {
            let json: serde_json::Value = parse(path, &read(path)?)?;
            match json.as_array() {
                Some(cameras) => three_dgs::read(path, cameras, options.offset),
                None => transforms::read(path, &json, options),
            }
        }
        _ => Err(CamerasError::Unrecognized { path: path.into() }),
    }
}

/// The same view with a longer side of `longer_side` pixels, and no side shorter than 16.
pub fn scaled(camera: &Camera, longer_side: u32) -> Camera {
    let factor = longer_side as f32 / camera.size.max_element().max(1) as f32;
    camera.resized((camera.size.as_vec2() * factor).round().as_uvec2().max(UVec2::splat(16)))
}
