//! transforms.json of instant-ngp, Nerfstudio and the synthetic NeRF scenes: OpenGL camera-to-world poses.

use std::{f64::consts::PI, path::Path};

use glam::{DAffine3, DMat3, DVec2, DVec3, UVec2};
use serde::Deserialize;
use serde_json::Value;
use stylegaussian_encoder::Image;

use super::{
    distortion::Distortion,
    photos::photo_paths,
    posed::{CameraOptions, CameraSet, CamerasError, Intrinsics, PosedCamera, invalid, picture_size, rigid},
};

/// Expected of a lens.
const A_PINHOLE: &str = "a pinhole camera (undistort the photos first)";

/// Models that are pinholes apart from their distortion. Files without a model are read as pinholes.
const MODELS: [&str; 5] = ["PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "SIMPLE_RADIAL", "RADIAL"];

/// Reads the parsed file at `path`. Photos are named relative to its folder. Cameras that have neither a size
/// nor a photo get the size of the options.
pub(super) fn read(path: &Path, file: &Value, options: CameraOptions) -> Result<CameraSet, CamerasError> {
    let Some(frames) = file.get("frames").and_then(Value::as_array) else {
        let found = if file.get("frames").is_some() { "no list" } else { "none" };
        return Err(invalid(path, "frames", found, "a list of cameras"));
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    let names: Vec<&str> = frames.iter().filter_map(file_path).collect();
    let mut photos = photo_paths(&[folder.into(), folder.join("images")], &names).into_iter();
    let mut n_without_size = 0;
    let mut cameras = Vec::new();
    for (i, frame) in frames.iter().enumerate() {
        let photo = file_path(frame).and_then(|_| photos.next());
        let name = file_path(frame).map_or_else(|| i.to_string(), Into::into);
        let what = &*format!("frame {i} ({name})");
        let lens = Lens { frame, file, path, what };
        lens.expect_pinhole()?;
        let pose = pose(frame.get("transform_matrix"), path, what)?;
        let pixels = match (lens.size()?, options.size) {
            (Some(size), _) => size,
            (None, given) => match (lens.size_of(photo.as_deref()), given) {
                (Err(_), Some(size)) => {
                    n_without_size += 1;
                    size
                }
                (size, _) => size?,
            },
        };
        let intrinsics = lens.intrinsics(pixels)?;
        let camera = intrinsics.camera(pose, options.offset, path, what)?;
        cameras.push(PosedCamera { name, camera, photo, distortion: lens.distortion(intrinsics)? });
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

/// The name of a frame's photo.
fn file_path(frame: &Value) -> Option<&str> {
    frame.get("file_path")?.as_str()
}

/// The view from the world, from a camera-to-world matrix in OpenGL axes.
fn pose(matrix: Option<&Value>, path: &Path, what: &str) -> Result<DAffine3, CamerasError> {
    const EXPECTED: &str = "4 rows of 4 numbers, the last row 0 0 0 1";
    let Some(matrix) = matrix else { return Err(invalid(path, what, "no transform_matrix", EXPECTED)) };
    let wrong = || invalid(path, what, format!("the transform_matrix {matrix}"), EXPECTED);
    let rows = <Vec<[f64; 4]>>::deserialize(matrix).map_err(|_| wrong())?;
    let is_affine = match &rows[..] {
        // The last row is always 0 0 0 1, so it may be left out.
        [_, _, _] => true,
        [_, _, _, last] => *last == [0.0, 0.0, 0.0, 1.0],
        _ => false,
    };
    if !is_affine {
        return Err(wrong());
    }
    let row = |i: usize| DVec3::new(rows[i][0], rows[i][1], rows[i][2]);
    let rotation = DMat3::from_cols(row(0), row(1), row(2)).transpose();
    let translation = DVec3::new(rows[0][3], rows[1][3], rows[2][3]);
    let world_from_camera = rigid(rotation, translation, path, what)?;
    // OpenGL's camera has y up and looks along -z, ours has y down and looks along z.
    let camera_from_view = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)));
    Ok((world_from_camera * camera_from_view).inverse())
}

/// The intrinsics of a frame.
struct Lens<'a> {
    frame: &'a Value,
    /// The whole file. Its values are those of frames that have none.
    file: &'a Value,
    /// The file's path and the frame's name, for errors.
    path: &'a Path,
    what: &'a str,
}

impl Lens<'_> {
    /// The value of a key, unless it is null.
    fn value(&self, key: &str) -> Option<&Value> {
        [self.frame, self.file].into_iter().find_map(|part| part.get(key).filter(|value| !value.is_null()))
    }

    fn number(&self, key: &str) -> Result<Option<f64>, CamerasError> {
        let number = |value: &Value| {
            value.as_f64().ok_or_else(|| self.invalid(format!("{key} {value}"), "a number without quotes"))
        };
        self.value(key).map(number).transpose()
    }

    fn number_or_0(&self, key: &str) -> Result<f64, CamerasError> {
        Ok(self.number(key)?.unwrap_or(0.0))
    }

    fn invalid(&self, found: impl ToString, expected: &'static str) -> CamerasError {
        invalid(self.path, self.what, found, expected)
    }

    /// Refuses lenses whose pictures are no pinholes', even if their coefficients are 0.
    fn expect_pinhole(&self) -> Result<(), CamerasError> {
        if let Some(model) = self.value("camera_model")
            && !model.as_str().is_some_and(|model| MODELS.contains(&model))
        {
            let model = model.as_str().map_or_else(|| model.to_string(), Into::into);
            return Err(self.invalid(format!("camera model {model}"), A_PINHOLE));
        }
        // instant-ngp's lenses that are no pinholes. It has no model's name, and k1 to k4 are the fisheye's.
        let is_on = |key: &&str| match self.value(key) {
            None | Some(Value::Bool(false)) => false,
            // The first of several coefficients, which may be 0.
            Some(Value::Number(number)) => *key == "ftheta_p0" || number.as_f64() != Some(0.0),
            Some(_) => true,
        };
        match ["is_fisheye", "ftheta_p0", "latlong", "equirectangular"].into_iter().find(is_on) {
            Some(key) => Err(self.invalid(format!("a lens with {key}"), A_PINHOLE)),
            None => Ok(()),
        }
    }

    fn distortion(
        &self,
        Intrinsics { focal, center, size }: Intrinsics,
    ) -> Result<Option<Distortion>, CamerasError> {
        let k = |key| self.number_or_0(key);
        let radial = [k("k1")?, k("k2")?, k("k3")?, k("k4")?];
        let tangential = [k("p1")?, k("p2")?];
        let lens = Distortion { focal, center, size, radial, rational: [0.0; 3], tangential };
        Ok(lens.is_any().then_some(lens))
    }

    fn intrinsics(&self, size: UVec2) -> Result<Intrinsics, CamerasError> {
        let Some(fl_x) = self.focal("fl_x", "camera_angle_x", size.x)? else {
            return Err(self.invalid("no focal length", "fl_x or camera_angle_x"));
        };
        // Square pixels, if nothing else is said.
        let fl_y = self.focal("fl_y", "camera_angle_y", size.y)?.unwrap_or(fl_x);
        let middle = size.as_dvec2() / 2.0;
        let center =
            DVec2::new(self.number("cx")?.unwrap_or(middle.x), self.number("cy")?.unwrap_or(middle.y));
        Ok(Intrinsics { focal: DVec2::new(fl_x, fl_y), center, size })
    }

    /// The focal length in pixels of the key `length`, or the one at which `side` pixels see the angle of view
    /// (full, in radians) of the key `angle`.
    fn focal(&self, length: &str, angle: &str, side: u32) -> Result<Option<f64>, CamerasError> {
        if let Some(length) = self.number(length)? {
            return Ok(Some(length));
        }
        match self.number(angle)? {
            None => Ok(None),
            Some(full) if full > 0.0 && full < PI => Ok(Some(f64::from(side) / (2.0 * (full / 2.0).tan()))),
            Some(full) => Err(self.invalid(format!("{angle} {full}"), "radians, above 0 and below pi")),
        }
    }

    /// The stated size in pixels.
    fn size(&self) -> Result<Option<UVec2>, CamerasError> {
        match self.number("w")?.zip(self.number("h")?) {
            Some((w, h)) => picture_size(w, h, self.path, self.what).map(Some),
            None => Ok(None),
        }
    }

    /// The size of the frame's photo in pixels.
    fn size_of(&self, photo: Option<&Path>) -> Result<UVec2, CamerasError> {
        let Some(photo) = photo else {
            return Err(self.invalid("neither w and h nor a photo", "one of them"));
        };
        let size = Image::size(photo);
        size.map(UVec2::from).map_err(|source| CamerasError::PhotoSize { photo: photo.into(), source })
    }
}
