//! A camera of a capture, the errors of reading cameras, and the checks that all formats share.

use std::{
    borrow::Cow,
    fs, io,
    path::{Path, PathBuf},
};

use glam::{Affine3A, DAffine3, DMat3, DQuat, DVec2, DVec3, UVec2};
use stylegaussian::Camera;

use super::distortion::Distortion;

/// Facts that a file of cameras does not tell.
#[derive(Clone, Copy, Debug, Default)]
pub struct CameraOptions {
    /// The size of pictures for cameras that have an angle of view, but neither a size nor a photo. A warning
    /// counts these.
    pub size: Option<UVec2>,
    /// The [`offset`](stylegaussian::Scene::offset) of the scene that they see, whose source has the file's
    /// world. Cameras count from the scene's origin, as its means do.
    pub offset: DVec3,
    /// Whether the cameras are those of photos without distortion, as [`TrainingView::photo`] takes them.
    /// Otherwise distortion is ignored, with a warning.
    ///
    /// [`TrainingView::photo`]: crate::embed::TrainingView::photo
    pub undistorts: bool,
}

/// One camera of a capture.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedCamera {
    /// The photo's name as the file gives it, or the camera's number if it gives none.
    pub name: String,
    /// Pose and intrinsics. The size is the file's; the photo itself may be smaller or larger.
    pub camera: Camera,
    /// The path at which the photo should be, not checked. `None` if the file names no photo.
    pub photo: Option<PathBuf>,
    /// The lens of the photo, if it is distorted.
    pub distortion: Option<Distortion>,
}

impl PosedCamera {
    /// The photo's path, for a caller who needs the photo.
    ///
    /// # Errors
    /// If no photo is named, or the named one does not exist.
    pub fn require_photo(&self) -> Result<&Path, CamerasError> {
        match &self.photo {
            Some(path) if path.is_file() => Ok(path),
            Some(path) if path.is_dir() => {
                Err(CamerasError::PhotoIsFolder { camera: self.name.clone(), photo: path.clone() })
            }
            Some(path) => Err(CamerasError::NoPhoto { camera: self.name.clone(), photo: path.clone() }),
            None => Err(CamerasError::NoPhotoName { camera: self.name.clone() }),
        }
    }
}

/// The cameras of a capture, and warnings from reading them.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraSet {
    /// At least one camera. COLMAP's are sorted by name, others are in file order.
    pub cameras: Vec<PosedCamera>,
    /// Warnings for people, e.g. that lens distortion is ignored.
    pub warnings: Vec<String>,
}

impl CameraSet {
    /// Makes the cameras those of photos without distortion, and tells what these lose. Focal lengths stay, so
    /// what is seen stays where it is, but for the edges.
    pub(super) fn undistort(&mut self, path: &Path) -> Result<(), CamerasError> {
        // Most captures have one lens.
        let mut last = None;
        let (mut n, mut most) = (0, 0.0f64);
        for posed in &mut self.cameras {
            let Some(lens) = posed.distortion else { continue };
            let filled = match last {
                Some((of, filled)) if of == lens => filled,
                _ => lens.filled(),
            };
            let Some((corner, size)) = filled else {
                let found = format!("a distortion of {}", lens.coefficients());
                return Err(invalid(path, &posed.name, found, "one that leaves half of the picture's sides"));
            };
            last = Some((lens, filled));
            most = most.max(lens.lost(corner, size));
            n += 1;
            posed.camera.center -= corner.as_vec2();
            posed.camera.size = size;
        }
        if n > 0 {
            let lost = 100.0 * most;
            self.warnings.push(format!(
                "{}: {n} photos are taken without their lens distortion, and lose at most {lost:.1} % of the \
                 picture, at its edges",
                path.display()
            ));
        }
        Ok(())
    }

    /// Warns if the cameras' distortion is ignored.
    pub(super) fn tell_distortion(&mut self, path: &Path) {
        let n = self.cameras.iter().filter(|posed| posed.distortion.is_some()).count();
        if n > 0 {
            let path = path.display();
            self.warnings.push(format!("{path}: the lens distortion of {n} cameras is ignored"));
        }
    }
}

/// Cameras could not be read.
#[derive(Debug, thiserror::Error)]
pub enum CamerasError {
    /// A file or folder could not be read.
    #[error("{path}: {source}", path = .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The JSON is malformed.
    #[error(
        "{path}: found a fault in the JSON ({source}), expected JSON, which has no NaN, Infinity or comments",
        path = .path.display()
    )]
    Json {
        /// The file.
        path: PathBuf,
        /// The position and the reason.
        source: serde_json::Error,
    },
    /// The file or folder has no known format.
    #[error(
        "{path}: found no cameras, expected transforms.json, transforms_train.json, 3DGS cameras.json, or a \
         COLMAP model (cameras and images, .txt or .bin, here, in 0, in sparse/0, in colmap/sparse/0 or in \
         dense/0/sparse)",
        path = .path.display()
    )]
    Unrecognized {
        /// The file or folder.
        path: PathBuf,
    },
    /// A value in the file is impossible.
    #[error("{path}: {what}: found {found}, expected {expected}", path = .path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The part of the file, e.g. a camera's name or a line.
        what: String,
        /// The value found.
        found: String,
        /// The values expected.
        expected: &'static str,
    },
    /// The photo that a camera names does not exist.
    #[error("camera {camera}: the photo {photo} does not exist", photo = .photo.display())]
    NoPhoto {
        /// The camera's name.
        camera: String,
        /// The path at which the photo should be.
        photo: PathBuf,
    },
    /// A folder has the name of the photo that a camera names.
    #[error("camera {camera}: the photo {photo} is a folder", photo = .photo.display())]
    PhotoIsFolder {
        /// The camera's name.
        camera: String,
        /// The path at which the photo should be.
        photo: PathBuf,
    },
    /// The camera file names no photo for this camera.
    #[error("camera {camera}: found no photo for it in the file of cameras, expected the name of one")]
    NoPhotoName {
        /// The camera's name.
        camera: String,
    },
    /// More than half of the photos do not exist.
    #[error("{n_missing} of {n} photos are missing, expected at least half of them; the first: {first}")]
    NoPhotos {
        /// Cameras without a photo.
        n_missing: usize,
        /// All cameras.
        n: usize,
        /// The fault of the first.
        first: Box<CamerasError>,
    },
    /// The photo that should give a camera's size cannot be read.
    #[error("cannot take the picture's size: {source}")]
    PhotoSize {
        /// The photo.
        photo: PathBuf,
        /// The reason.
        source: stylegaussian_encoder::ImageError,
    },
}

pub(super) fn read(path: &Path) -> Result<Vec<u8>, CamerasError> {
    fs::read(path).map_err(|source| CamerasError::Io { path: path.into(), source })
}

pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<serde_json::Value, CamerasError> {
    serde_json::from_slice(&utf8(bytes)).map_err(|source| CamerasError::Json { path: path.into(), source })
}

/// Text as UTF-8 without a byte order mark, which editors and shells of Windows put in front.
pub(crate) fn utf8(bytes: &[u8]) -> Cow<'_, [u8]> {
    let of_utf16 = |unit: fn([u8; 2]) -> u16, bytes: &[u8]| -> Vec<u8> {
        let units = bytes.chunks_exact(2).map(|pair| unit([pair[0], pair[1]]));
        let text = char::decode_utf16(units).map(|letter| letter.unwrap_or(char::REPLACEMENT_CHARACTER));
        text.collect::<String>().into_bytes()
    };
    match bytes {
        [0xEF, 0xBB, 0xBF, rest @ ..] => Cow::Borrowed(rest),
        [0xFF, 0xFE, rest @ ..] => Cow::Owned(of_utf16(u16::from_le_bytes, rest)),
        [0xFE, 0xFF, rest @ ..] => Cow::Owned(of_utf16(u16::from_be_bytes, rest)),
        _ => Cow::Borrowed(bytes),
    }
}

/// The size of a picture, from sides that a file may write as `640.0`.
pub(super) fn picture_size(width: f64, height: f64, path: &Path, what: &str) -> Result<UVec2, CamerasError> {
    let side = |x: f64| (x.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&x)).then_some(x as u32);
    match (side(width), side(height)) {
        (Some(width), Some(height)) => Ok(UVec2::new(width, height)),
        _ => Err(invalid(path, what, format!("size {width} x {height}"), "whole numbers of pixels")),
    }
}

pub(super) fn invalid(path: &Path, what: &str, found: impl ToString, expected: &'static str) -> CamerasError {
    CamerasError::Invalid { path: path.into(), what: what.into(), found: found.to_string(), expected }
}

/// Intrinsics of a pinhole camera, in pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Intrinsics {
    pub focal: DVec2,
    pub center: DVec2,
    pub size: UVec2,
}

impl Intrinsics {
    /// The camera at `view_from_world`, in a world whose origin is `offset`. `what` names it in errors about
    /// `path`.
    pub fn camera(
        self,
        view_from_world: DAffine3,
        offset: DVec3,
        path: &Path,
        what: &str,
    ) -> Result<Camera, CamerasError> {
        if self.size.min_element() == 0 {
            return Err(invalid(path, what, self.size, "a picture size above 0"));
        }
        if !(self.focal.is_finite() && self.focal.min_element() > 0.0) {
            return Err(invalid(path, what, self.focal, "focal lengths above 0"));
        }
        if !self.center.is_finite() {
            return Err(invalid(path, what, self.center, "a finite principal point"));
        }
        // Before f32 rounds it: far from the file's origin, by more than a picture shows.
        let view_from_world = view_from_world * DAffine3::from_translation(offset);
        let rotation = view_from_world.matrix3.as_mat3();
        let translation = view_from_world.translation.as_vec3();
        let camera = Camera {
            view_from_world: Affine3A::from_mat3_translation(rotation, translation),
            focal: self.focal.as_vec2(),
            center: self.center.as_vec2(),
            size: self.size,
            near: Camera::NEAR,
        };
        if !camera.is_usable() {
            let found = format!(
                "{:e} away, {:e} pixels",
                view_from_world.translation.length(),
                self.focal.min_element()
            );
            return Err(invalid(path, what, found, "a position and focal lengths below 1e18, above 1e-18"));
        }
        Ok(camera)
    }
}

/// Largest difference of a rotation's product with its transpose from the identity. Files round to a few
/// digits.
const RIGID_WITHIN: f64 = 1e-3;

/// The pose with these columns and an exact rotation, or an error if the matrix is not nearly rigid.
pub(super) fn rigid(
    rotation: DMat3,
    translation: DVec3,
    path: &Path,
    what: &str,
) -> Result<DAffine3, CamerasError> {
    // R R^T = I also holds for mirrors, which the determinant tells apart.
    let off = rotation * rotation.transpose() - DMat3::IDENTITY;
    let is_rotation = off.is_finite() && off.abs_diff_eq(DMat3::ZERO, RIGID_WITHIN);
    if !(is_rotation && rotation.determinant() > 0.0 && translation.is_finite()) {
        let found = format!("the matrix {rotation}, {translation}");
        return Err(invalid(path, what, found, "a rotation and a translation"));
    }
    // Through a quaternion, which removes the file's rounding errors.
    let rotation = DQuat::from_mat3(&rotation).normalize();
    Ok(DAffine3::from_rotation_translation(rotation, translation))
}
