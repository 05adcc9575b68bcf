//! The directions of a file's coordinate axes.
//!
//! Scenes in memory have the axes of 3DGS `.ply` files, [`Axes::RDF`]: x to the right, y down, z forward.
//! Readers of other conventions mirror means, rotations and spherical harmonics; a turn by half a circle is two
//! mirrors.

use std::{fmt, str::FromStr};

use glam::{Affine3A, Mat3A, Quat, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{scene::Scene, sh::n_coefficients};

/// The directions of the axes x, y and z: right or left, up or down, forward or back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
// In text, as in messages and on the command line.
#[serde(try_from = "String", into = "String")]
pub struct Axes {
    /// Whether x, y and z point to the left, up and back: against those of [`Axes::RDF`].
    flipped: [bool; 3],
}

impl Axes {
    /// Right, down, forward: 3DGS `.ply` files and cameras of OpenCV and COLMAP.
    pub const RDF: Self = Self { flipped: [false; 3] };
    /// Right, up, back: SPZ by its specification, glTF, OpenGL and Bevy.
    pub const RUB: Self = Self { flipped: [false, true, true] };

    /// Axes of which these point against those of [`Axes::RDF`].
    pub const fn from_flipped(flipped: [bool; 3]) -> Self {
        Self { flipped }
    }

    /// The factor of each coordinate on the way from [`Axes::RDF`] and back: 1 or -1.
    pub fn signs(self) -> Vec3 {
        Vec3::from(self.flipped.map(|flipped| if flipped { -1.0 } else { 1.0 }))
    }

    /// Turns a scene from these axes to [`Axes::RDF`], or back: both are the same.
    pub fn turn(self, scene: &mut Scene) {
        if self == Self::RDF {
            return;
        }
        let signs = self.signs();
        scene.means.iter_mut().for_each(|mean| *mean *= signs);
        scene.offset *= signs.as_dvec3();
        // A mirror turns the axis of a rotation as a vector and its angle back, which is a product of signs.
        let of_axis = signs * signs.x * signs.y * signs.z;
        for rotation in &mut scene.rotations {
            *rotation = Quat::from_vec4((rotation.xyz() * of_axis).extend(rotation.w));
        }
        if let Some(up) = &mut scene.up {
            *up *= signs;
        }
        for camera in &mut scene.cameras {
            camera.view_from_world.matrix3 *= Mat3A::from_diagonal(signs);
            if signs.x * signs.y * signs.z < 0.0 {
                // A camera cannot be mirrored, but its picture can: left and right change places.
                camera.view_from_world =
                    Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0)) * camera.view_from_world;
                camera.center.x = camera.size.x as f32 - camera.center.x;
            }
        }
        if let Some(sh) = &mut scene.sh {
            let signs = sh_signs(self);
            sh.coefficients.par_chunks_exact_mut(3 * n_coefficients(sh.degree)).for_each(|of_gaussian| {
                for (rgb, sign) in of_gaussian.as_chunks_mut::<3>().0.iter_mut().zip(signs) {
                    rgb.iter_mut().for_each(|value| *value *= sign);
                }
            });
        }
    }
}

/// The factor of each spherical harmonic under the mirrors, 1 or -1 `[16]`: every basis function is odd or even
/// in each coordinate.
pub fn sh_signs(axes: Axes) -> [f32; 16] {
    /// The coordinates in which the functions are odd, read off [`crate::sh::basis`].
    const ODD: [&str; 16] =
        ["", "y", "z", "x", "xy", "yz", "", "xz", "", "y", "xyz", "y", "z", "x", "z", "x"];
    let signs = axes.signs();
    ODD.map(|odd| {
        odd.chars().fold(1.0, |sign, axis| {
            sign * match axis {
                'x' => signs.x,
                'y' => signs.y,
                _ => signs.z,
            }
        })
    })
}

/// Three letters, as SPZ names its coordinate systems: `RUB`.
impl fmt::Display for Axes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let letters = [('R', 'L'), ('D', 'U'), ('F', 'B')];
        for ((plain, flipped), is_flipped) in letters.into_iter().zip(self.flipped) {
            write!(f, "{}", if is_flipped { flipped } else { plain })?;
        }
        Ok(())
    }
}

impl From<Axes> for String {
    fn from(axes: Axes) -> Self {
        axes.to_string()
    }
}

impl TryFrom<String> for Axes {
    type Error = UnknownAxes;

    fn try_from(text: String) -> Result<Self, UnknownAxes> {
        text.parse()
    }
}

/// A text that names no axes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "found axes `{0}`, expected three letters: r or l, u or d, f or b, such as rdf (3DGS .ply) or \
     rub (SPZ, glTF)"
)]
pub struct UnknownAxes(String);

impl FromStr for Axes {
    type Err = UnknownAxes;

    fn from_str(text: &str) -> Result<Self, UnknownAxes> {
        let flipped = match text.to_ascii_lowercase().as_bytes() {
            [x @ (b'r' | b'l'), y @ (b'd' | b'u'), z @ (b'f' | b'b')] => [*x == b'l', *y == b'u', *z == b'b'],
            _ => return Err(UnknownAxes(text.into())),
        };
        Ok(Self { flipped })
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Mat3, UVec2, Vec2};

    use super::*;
    use crate::{
        camera::Camera,
        sh::{basis, evaluate},
    };

    fn all() -> impl Iterator<Item = Axes> {
        (0..8).map(|bits| Axes::from_flipped([bits & 1 > 0, bits & 2 > 0, bits & 4 > 0]))
    }

    #[test]
    fn names_come_back() {
        for axes in all() {
            assert_eq!(axes.to_string().parse(), Ok(axes));
        }
        assert_eq!("rub".parse(), Ok(Axes::RUB));
        assert_eq!(serde_json::to_string(&Axes::RUB).unwrap(), r#""RUB""#);
        assert_eq!(serde_json::from_str::<Axes>(r#""rdf""#).unwrap(), Axes::RDF);
        assert!(serde_json::from_str::<Axes>(r#""up""#).unwrap_err().to_string().contains("three letters"));
        for text in ["", "rd", "rdfx", "drf", "rdé"] {
            assert_eq!(text.parse::<Axes>(), Err(UnknownAxes(text.into())));
        }
    }

    #[test]
    fn spherical_harmonics_and_covariances_are_mirrored_with_the_space() {
        let direction = Vec3::new(0.48, -0.6, 0.64);
        let coefficients: Vec<f32> = (0..48).map(|i| (i as f32 * 0.7).sin()).collect();
        let rotation = Quat::from_xyzw(0.1, -0.5, 0.3, 0.8).normalize();
        let scales = Vec3::new(0.1, 0.5, 2.0);
        let covariance = |rotation: Quat| {
            let axes = Mat3::from_quat(rotation) * Mat3::from_diagonal(scales);
            axes * axes.transpose()
        };
        let eye = Vec3::new(1.0, 2.0, -5.0);
        let camera = Camera::look_at(eye, Vec3::X, Vec3::NEG_Y, 0.9, UVec2::new(640, 480));
        let pixel = |(camera, point): (&Camera, Vec3)| {
            let p = camera.view_from_world.transform_point3(point);
            camera.focal * p.truncate() / p.z + camera.center
        };
        for axes in all() {
            let mut scene = Scene {
                means: vec![direction],
                offset: DVec3::new(1e6, -2e6, 3e6),
                rotations: vec![rotation],
                scales: vec![scales],
                opacities: vec![1.0],
                sh: Some(crate::scene::Sh { degree: 3, coefficients: coefficients.clone() }),
                order: vec![0],
                n_source: 1,
                cameras: vec![camera.clone()],
                ..Scene::default()
            };
            axes.turn(&mut scene);
            let is_mirror = axes.signs().element_product() < 0.0;
            let [before, after] = [(&camera, direction), (&scene.cameras[0], scene.means[0])].map(pixel);
            let expected = if is_mirror { Vec2::new(640.0 - before.x, before.y) } else { before };
            assert!(after.abs_diff_eq(expected, 1e-3), "{axes}: {after}, expected {expected}");
            assert!(scene.cameras[0].view_from_world.matrix3.determinant() > 0.0, "{axes}");
            let signs = axes.signs();
            assert_eq!(scene.means[0], direction * signs);
            assert_eq!(scene.offset, DVec3::new(1e6, -2e6, 3e6) * signs.as_dvec3());
            let mirror = Mat3::from_diagonal(signs);
            let expected = mirror * covariance(rotation) * mirror;
            assert!(covariance(scene.rotations[0]).abs_diff_eq(expected, 1e-6), "{axes}");
            let turned = scene.sh.as_ref().unwrap();
            let seen = evaluate(3, &turned.coefficients, direction * signs);
            assert!(seen.abs_diff_eq(evaluate(3, &coefficients, direction), 1e-6), "{axes}");
            let (a, b) = (basis(3, direction), basis(3, direction * signs));
            for (i, sign) in sh_signs(axes).into_iter().enumerate() {
                assert!((a[i] * sign - b[i]).abs() < 1e-6, "{axes}: function {i}");
            }
        }
    }
}
