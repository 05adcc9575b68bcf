//! cameras.bin and images.bin: little endian, a count, then the records.

use std::path::Path;

use super::{CamerasError, Image, Lens, Lenses, MODELS, invalid};
use crate::cameras::posed::read;

/// Bytes of a 2D point of an image: x, y (f64), the number of its 3D point (i64).
const POINT_SIZE: u64 = 24;

/// The lenses of cameras.bin: number (u32), model (i32), width, height (u64), parameters (f64).
pub(super) fn cameras(path: &Path) -> Result<Lenses, CamerasError> {
    let bytes = read(path)?;
    let mut bytes = Bytes { path, rest: &bytes, total: bytes.len() };
    let mut lenses = Lenses::new();
    // Nothing is reserved for the count: a damaged file ends the loop with an error at its first missing byte.
    for _ in 0..bytes.u64("the number of cameras")? {
        let id = bytes.u32("a camera's number")?;
        let model_id = bytes.u32("a camera's model")? as i32;
        let Some(model) = MODELS.iter().find(|model| model.id == model_id) else {
            let found = format!("camera model number {model_id}");
            return Err(invalid(path, &format!("camera {id}"), found, "a model of COLMAP's"));
        };
        let (width, height) = (bytes.u64("a camera's width")?, bytes.u64("a camera's height")?);
        let parameters = bytes.f64s(model.n_parameters, "a camera's parameters")?;
        lenses.insert(id, Lens { model, width, height, parameters });
    }
    Ok(lenses)
}

/// The images of images.bin: number (u32), rotation w x y z and translation (f64), camera (u32), name (ends
/// with 0), number of points (u64), points.
pub(super) fn images(path: &Path) -> Result<Vec<Image>, CamerasError> {
    let bytes = read(path)?;
    let mut bytes = Bytes { path, rest: &bytes, total: bytes.len() };
    let mut images = Vec::new();
    for _ in 0..bytes.u64("the number of images")? {
        bytes.u32("an image's number")?;
        let mut pose = [0.0; 7];
        for x in &mut pose {
            *x = bytes.f64("an image's pose")?;
        }
        let [qw, qx, qy, qz, tx, ty, tz] = pose;
        let camera_id = bytes.u32("an image's camera")?;
        let name = bytes.name()?;
        let n_points = bytes.u64("an image's number of points")?;
        // A product too large for 64 bits is too large for the file too.
        bytes.skip(n_points.saturating_mul(POINT_SIZE), "an image's points")?;
        images.push(Image { name, rotation: [qw, qx, qy, qz], translation: [tx, ty, tz], camera_id });
    }
    Ok(images)
}

/// The rest of a file.
struct Bytes<'a> {
    path: &'a Path,
    rest: &'a [u8],
    total: usize,
}

impl<'a> Bytes<'a> {
    fn skip(&mut self, n: u64, what: &str) -> Result<&'a [u8], CamerasError> {
        let split = usize::try_from(n).ok().and_then(|n| self.rest.split_at_checked(n));
        let Some((taken, rest)) = split else {
            let at = self.total - self.rest.len();
            let found = format!("{} of {n} bytes at byte {at}", self.rest.len());
            return Err(invalid(self.path, what, found, "a file that is not cut off"));
        };
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], CamerasError> {
        let mut array = [0; N];
        array.copy_from_slice(self.skip(N as u64, what)?);
        Ok(array)
    }

    fn u32(&mut self, what: &str) -> Result<u32, CamerasError> {
        self.array(what).map(u32::from_le_bytes)
    }

    fn u64(&mut self, what: &str) -> Result<u64, CamerasError> {
        self.array(what).map(u64::from_le_bytes)
    }

    fn f64(&mut self, what: &str) -> Result<f64, CamerasError> {
        self.array(what).map(f64::from_le_bytes)
    }

    fn f64s(&mut self, n: usize, what: &str) -> Result<Vec<f64>, CamerasError> {
        (0..n).map(|_| self.f64(what)).collect()
    }

    fn name(&mut self) -> Result<String, CamerasError> {
        let end = self.rest.iter().position(|&byte| byte == 0).unwrap_or(self.rest.len());
        let name = String::from_utf8_lossy(self.skip(end as u64, "an image's name")?).into_owned();
        self.skip(1, "the end of an image's name")?;
        Ok(name)
    }
}
