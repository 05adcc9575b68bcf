//! transforms.json of instant-ngp, Nerfstudio and the synthetic NeRF scenes: OpenGL camera-to-world poses.

use std::path::Path;

use glam::{DAffine3, DMat3, DVec2, DVec3, UVec2};
use serde::Deserialize;
use serde_json::Value;
use stylegaussian_encoder::Image;

use super::{
    distortion::Distortion,
    photos::photo_paths,
    posed::{CameraOptions, CameraSet, CamerasError, Intrinsics, PosedCamera, invalid, picture_size, rigid},
};

/// The fields of the file that are used.
#[derive(Deserialize)]
struct Transforms {
    #[serde(flatten)]
    lens: Lens,
    frames: Vec<Frame>,
}

#[derive(Deserialize)]
struct Frame {
    #[serde(flatten)]
    lens: Lens,
    file_path: Option<String>,
    transform_matrix: Vec<Vec<f64>>,
}

/// Intrinsics of the file or of a frame. If both have a number, the frame's is used.
#[derive(Clone, Default, Deserialize)]
struct Lens {
    camera_model: Option<String>,
    w: Option<f64>,
    h: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    /// Full horizontal angle of view, in radians.
    camera_angle_x: Option<f64>,
    /// Full vertical angle of view, in radians.
    camera_angle_y: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    /// instant-ngp's lenses that are no pinholes. It has no model's name, and k1 to k4 are the fisheye's.
    is_fisheye: Option<Value>,
    ftheta_p0: Option<Value>,
    latlong: Option<Value>,
    equirectangular: Option<Value>,
}

/// Expected of a lens.
const A_PINHOLE: &str = "a pinhole camera (undistort the photos first)";

/// Models that are pinholes apart from their distortion. Files without a model are read as pinholes.
const MODELS: [&str; 5] = ["PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "SIMPLE_RADIAL", "RADIAL"];

/// Reads the parsed file at `path`. Photos are named relative to its folder. Cameras that have neither a size
/// nor a photo get the size of the options.
pub(super) fn read(path: &Path, json: Value, options: CameraOptions) -> Result<CameraSet, CamerasError> {
    let file: Transforms =
        serde_json::from_value(json).map_err(|source| CamerasError::Json { path: path.into(), source })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let names: Vec<&str> = file.frames.iter().filter_map(|frame| frame.file_path.as_deref()).collect();
    let mut photos = photo_paths(&[folder.into(), folder.join("images")], &names).into_iter();
    let mut n_without_size = 0;
    let mut cameras = Vec::new();
    for (i, frame) in file.frames.iter().enumerate() {
        let name = frame.file_path.clone().unwrap_or_else(|| i.to_string());
        let what = format!("frame {i} ({name})");
        let lens = frame.lens.or(&file.lens);
        lens.expect_pinhole(path, &what)?;
        let photo = frame.file_path.as_ref().and_then(|_| photos.next());
        let pose = pose(&frame.transform_matrix, path, &what)?;
        let own_size = lens.size(photo.as_deref(), path, &what);
        let pixels = match (own_size, options.size) {
            // A size that is no whole number of pixels stays an error.
            (Err(_), Some(size)) if lens.w.is_none() || lens.h.is_none() => {
                n_without_size += 1;
                size
            }
            (own_size, _) => own_size?,
        };
        let intrinsics = lens.intrinsics(pixels, path, &what)?;
        let camera = intrinsics.camera(pose, options.offset, path, &what)?;
        cameras.push(PosedCamera { name, camera, photo, distortion: lens.distortion(intrinsics) });
    }
    let mut warnings = Vec::new();
    if let Some(size) = options.size.filter(|_| n_without_size > 0) {
        warnings.push(format!(
            "{}: {n_without_size} cameras have neither w and h nor a photo, their pictures are taken as {}x{}",
            path.display(),
            size.x,
            size.y
        ));
    }
    Ok(CameraSet { cameras, warnings })
}

/// The view from the world, from a camera-to-world matrix in OpenGL axes.
fn pose(rows: &[Vec<f64>], path: &Path, what: &str) -> Result<DAffine3, CamerasError> {
    let is_affine = match rows {
        // The last row is always 0 0 0 1, so it may be left out.
        [_, _, _] => true,
        [_, _, _, last] => last[..] == [0.0, 0.0, 0.0, 1.0],
        _ => false,
    };
    if !is_affine || rows.iter().any(|row| row.len() != 4) {
        let found = format!("the matrix {rows:?}");
        return Err(invalid(path, what, found, "4 rows of 4 numbers, the last row 0 0 0 1"));
    }
    let row = |i: usize| DVec3::new(rows[i][0], rows[i][1], rows[i][2]);
    let rotation = DMat3::from_cols(row(0), row(1), row(2)).transpose();
    let translation = DVec3::new(rows[0][3], rows[1][3], rows[2][3]);
    let world_from_camera = rigid(rotation, translation, path, what)?;
    // OpenGL's camera has y up and looks along -z, ours has y down and looks along z.
    let camera_from_view = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)));
    Ok((world_from_camera * camera_from_view).inverse())
}

impl Lens {
    fn or(&self, global: &Self) -> Self {
        let first = |a: Option<f64>, b: Option<f64>| a.or(b);
        Self {
            camera_model: self.camera_model.clone().or_else(|| global.camera_model.clone()),
            w: first(self.w, global.w),
            h: first(self.h, global.h),
            fl_x: first(self.fl_x, global.fl_x),
            fl_y: first(self.fl_y, global.fl_y),
            cx: first(self.cx, global.cx),
            cy: first(self.cy, global.cy),
            camera_angle_x: first(self.camera_angle_x, global.camera_angle_x),
            camera_angle_y: first(self.camera_angle_y, global.camera_angle_y),
            k1: first(self.k1, global.k1),
            k2: first(self.k2, global.k2),
            k3: first(self.k3, global.k3),
            k4: first(self.k4, global.k4),
            p1: first(self.p1, global.p1),
            p2: first(self.p2, global.p2),
            is_fisheye: self.is_fisheye.clone().or_else(|| global.is_fisheye.clone()),
            ftheta_p0: self.ftheta_p0.clone().or_else(|| global.ftheta_p0.clone()),
            latlong: self.latlong.clone().or_else(|| global.latlong.clone()),
            equirectangular: self.equirectangular.clone().or_else(|| global.equirectangular.clone()),
        }
    }

    /// Refuses lenses whose pictures are no pinholes', even if their coefficients are 0.
    fn expect_pinhole(&self, path: &Path, what: &str) -> Result<(), CamerasError> {
        if let Some(model) = self.camera_model.as_deref().filter(|model| !MODELS.contains(model)) {
            return Err(invalid(path, what, format!("camera model {model}"), A_PINHOLE));
        }
        let is_on = |value: &Option<Value>| match value {
            None | Some(Value::Null | Value::Bool(false)) => false,
            Some(Value::Number(number)) => number.as_f64() != Some(0.0),
            Some(_) => true,
        };
        let lenses = [
            ("is_fisheye", is_on(&self.is_fisheye)),
            // A coefficient, which may be 0.
            ("ftheta_p0", self.ftheta_p0.is_some()),
            ("latlong", is_on(&self.latlong)),
            ("equirectangular", is_on(&self.equirectangular)),
        ];
        match lenses.into_iter().find(|(_, is_on)| *is_on) {
            Some((name, _)) => Err(invalid(path, what, format!("a lens with {name}"), A_PINHOLE)),
            None => Ok(()),
        }
    }

    fn distortion(&self, Intrinsics { focal, center, size }: Intrinsics) -> Option<Distortion> {
        let or_0 = |k: Option<f64>| k.unwrap_or(0.0);
        let radial = [self.k1, self.k2, self.k3, self.k4].map(or_0);
        let tangential = [self.p1, self.p2].map(or_0);
        let lens = Distortion { focal, center, size, radial, rational: [0.0; 3], tangential };
        lens.is_any().then_some(lens)
    }

    fn intrinsics(&self, size: UVec2, path: &Path, what: &str) -> Result<Intrinsics, CamerasError> {
        let angle_x = self.camera_angle_x.map(|angle| focal(size.x, angle));
        let angle_y = self.camera_angle_y.map(|angle| focal(size.y, angle));
        let Some(fl_x) = self.fl_x.or(angle_x) else {
            return Err(invalid(path, what, "no focal length", "fl_x or camera_angle_x"));
        };
        // Square pixels, if nothing else is said.
        let fl_y = self.fl_y.or(angle_y).unwrap_or(fl_x);
        let middle = size.as_dvec2() / 2.0;
        let center = DVec2::new(self.cx.unwrap_or(middle.x), self.cy.unwrap_or(middle.y));
        Ok(Intrinsics { focal: DVec2::new(fl_x, fl_y), center, size })
    }

    /// The stated size in pixels, or the photo's.
    fn size(&self, photo: Option<&Path>, path: &Path, what: &str) -> Result<UVec2, CamerasError> {
        if let (Some(w), Some(h)) = (self.w, self.h) {
            return picture_size(w, h, path, what);
        }
        let Some(photo) = photo else {
            return Err(invalid(path, what, "neither w and h nor a photo", "one of them"));
        };
        let size = Image::size(photo);
        size.map(UVec2::from).map_err(|source| CamerasError::PhotoSize { photo: photo.into(), source })
    }
}

/// The focal length in pixels at which `side` pixels see `angle` (full, in radians).
fn focal(side: u32, angle: f64) -> f64 {
    f64::from(side) / (2.0 * (angle / 2.0).tan())
}
