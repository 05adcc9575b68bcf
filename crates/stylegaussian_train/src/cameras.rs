//! Posed cameras of a capture: transforms.json, COLMAP models, and the cameras.json that 3DGS trainers write.
//!
//! Every camera comes out as a pinhole in our axes (x right, y down, z forward), in the file's world. The
//! formats, one module each: `transforms`, `colmap`, `three_dgs`; `posed` has their common parts.

mod colmap;
mod posed;
#[cfg(test)]
mod tests;
mod three_dgs;
mod transforms;

use std::{fs, path::Path};

use glam::UVec2;
use stylegaussian::Camera;

pub use posed::{CameraSet, CamerasError, PosedCamera};
use posed::{invalid, parse, read};

/// Reads the cameras at `path`: a transforms.json, a 3DGS cameras.json, a file of a COLMAP model, or a folder
/// with one of these (in this order: transforms.json, COLMAP in sparse/0, sparse or the folder itself,
/// cameras.json).
///
/// # Errors
/// If the file is missing, truncated or malformed, a pose is not rigid, the lens is no pinhole (distortion
/// alone is only a warning), or the file has no camera.
pub fn read_cameras(path: &Path) -> Result<CameraSet, CamerasError> {
    let metadata = fs::metadata(path).map_err(|source| CamerasError::Io { path: path.into(), source })?;
    let set = if metadata.is_dir() { read_folder(path) } else { read_file(path) }?;
    if set.cameras.is_empty() {
        return Err(invalid(path, "cameras", "none", "at least one"));
    }
    Ok(set)
}

fn read_folder(folder: &Path) -> Result<CameraSet, CamerasError> {
    let transforms = folder.join("transforms.json");
    if transforms.is_file() {
        return read_file(&transforms);
    }
    // COLMAP's mapper numbers its models from 0. Its undistorter writes to sparse itself.
    for model in [folder.join("sparse/0"), folder.join("sparse"), folder.into()] {
        if colmap::is_model(&model) {
            return colmap::read(&model);
        }
    }
    let cameras = folder.join("cameras.json");
    if cameras.is_file() {
        return read_file(&cameras);
    }
    Err(CamerasError::Unrecognized { path: folder.into() })
}

fn read_file(path: &Path) -> Result<CameraSet, CamerasError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("bin" | "txt") if colmap::is_model(folder) => colmap::read(folder),
        // 3DGS trainers write a list, all others an object.
        Some("json") => {
            let json: serde_json::Value = parse(path, &read(path)?)?;
            if json.is_array() { three_dgs::read(path, json) } else { transforms::read(path, json) }
        }
        _ => Err(CamerasError::Unrecognized { path: path.into() }),
    }
}

/// The same view with a longer side of `longer_side` pixels, and no side shorter than 16.
pub fn scaled(camera: &Camera, longer_side: u32) -> Camera {
    let factor = longer_side as f32 / camera.size.max_element().max(1) as f32;
    camera.resized((camera.size.as_vec2() * factor).round().as_uvec2().max(UVec2::splat(16)))
}
