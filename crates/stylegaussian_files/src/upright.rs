//! Scenes set upright for formats whose y axis points up by definition.
//!
//! Scenes in memory keep the coordinates of their source, whatever their up direction. Viewers of glTF and SPZ
//! take the y axis for up. So a scene whose up direction is known is turned for them, by quarter turns, which
//! are exact. The up direction that it had goes into the file, and our readers turn it back: cameras and looks
//! of the scene fit both. The chunks of a world, where -y is up, have no place for it, and stay turned.

use std::borrow::Cow;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use stylegaussian::{axes::Axes, scene::Scene};

use super::{
    error::{Loaded, Mismatch, mismatch},
    place,
};

/// A scene in axes [`Axes::RDF`], turned so that the axis nearest to its up direction points to -y, which is up
/// in these axes; and the up direction that it had. `None` if it was upright or its up direction is not known:
/// then it is as it was.
pub(super) fn upright(scene: Cow<'_, Scene>) -> Result<(Cow<'_, Scene>, Option<Vec3>), Mismatch> {
    let up = scene.up;
    let Some(axis) = up.and_then(nearest_axis).filter(|&axis| axis != Vec3::NEG_Y) else {
        return Ok((scene, None));
    };
    let mut turned = scene.into_owned();
    turn(&mut turned, axis, false)?;
    Ok((Cow::Owned(turned), up))
}

/// A scene as it was before [`upright`]. `up` is the direction that it had then, if it was known.
///
/// # Errors
/// If `up` is no direction.
pub(super) fn laid_back(mut loaded: Loaded, up: Option<Vec3>) -> Result<Loaded, Mismatch> {
    if let Some(up) = up {
        lay_back(&mut loaded.scene, up)?;
        if nearest_axis(up) != Some(Vec3::NEG_Y) {
            loaded.axes_because +=
                "; the scene, set upright for viewers, was turned back to its own up direction";
        }
    }
    Ok(loaded)
}

/// Undoes [`upright`].
fn lay_back(scene: &mut Scene, up: Vec3) -> Result<(), Mismatch> {
    let Some(axis) = nearest_axis(up) else {
        return Err(mismatch(format_args!("an up direction of {up:?}"), "finite numbers, not all 0"));
    };
    turn(scene, axis, true)?;
    scene.up = Some(up);
    Ok(())
}

/// The unit vector along an axis that is nearest to `up`, or `None` if `up` is no direction.
fn nearest_axis(up: Vec3) -> Option<Vec3> {
    let up = up.try_normalize()?;
    let largest = up.abs().max_position();
    let mut axis = Vec3::ZERO;
    axis[largest] = up[largest].signum();
    Some(axis)
}

/// Turns `axis`, one of the six, to -y, or back.
fn turn(scene: &mut Scene, axis: Vec3, is_back: bool) -> Result<(), Mismatch> {
    if axis == Vec3::Y {
        // Half a turn about x is two mirrors, and its own inverse.
        Axes::RUB.turn(scene);
        return Ok(());
    }
    let arc = DMat3::from_quat(DQuat::from_rotation_arc(axis.as_dvec3(), DVec3::NEG_Y));
    // Of a quarter turn all elements are 0, 1 or -1.
    let columns = [arc.x_axis, arc.y_axis, arc.z_axis].map(DVec3::round);
    let turn = DMat3::from_cols(columns[0], columns[1], columns[2]);
    let turn = if is_back { turn.transpose() } else { turn };
    scene.up = scene.up.map(|up| (turn * up.as_dvec3()).as_vec3());
    place::place(scene, DAffine3::from_mat3(turn), &mut Vec::new())
}

#[cfg(test)]
mod tests {
    use stylegaussian::{
        scene::Sh,
        sh::{evaluate, n_coefficients},
    };

    use super::*;

    fn scene(up: Vec3) -> Scene {
        let coefficients = (0..3 * n_coefficients(3)).map(|i| (i as f32 * 0.7).sin()).collect();
        Scene {
            means: vec![Vec3::new(1.0, -2.0, 3.0)],
            offset: DVec3::new(1e6, 2e6, -3e6),
            rotations: vec![glam::Quat::from_xyzw(0.1, -0.5, 0.3, 0.8).normalize()],
            scales: vec![Vec3::new(0.1, 0.5, 2.0)],
            opacities: vec![1.0],
            sh: Some(Sh { degree: 3, coefficients }),
            order: vec![0],
            n_source: 1,
            up: Some(up),
            ..Scene::default()
        }
    }

    fn turned(source: &Scene) -> (Scene, Option<Vec3>) {
        let (turned, up) = upright(Cow::Borrowed(source)).unwrap();
        (turned.into_owned(), up)
    }

    #[test]
    fn the_nearest_axis_points_up_and_comes_back() {
        let tilt = Vec3::new(0.1, 0.2, -0.15);
        for axis in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::Z, Vec3::NEG_Z] {
            let source = scene(axis + tilt);
            let (mut turned, up) = turned(&source);
            let up = up.expect("it is not upright");
            assert_eq!(Some(up), source.up);
            assert!(turned.up.unwrap().normalize().y < -0.9, "{axis}: {:?}", turned.up);
            // Heights are kept, as are the colors seen from a direction.
            assert_eq!(turned.means[0].y, -source.means[0].dot(axis), "{axis}");
            assert_eq!(turned.offset.y, -source.offset.dot(axis.as_dvec3()), "{axis}");
            let along = |scene: &Scene, direction: Vec3| {
                evaluate(3, &scene.sh.as_ref().unwrap().coefficients, direction)
            };
            assert!(along(&turned, Vec3::NEG_Y).abs_diff_eq(along(&source, axis), 1e-5), "{axis}");
            lay_back(&mut turned, up).unwrap();
            assert_eq!((&turned.means, turned.up), (&source.means, source.up), "{axis}");
            assert_eq!(turned.offset, source.offset, "{axis}");
            assert!(turned.rotations[0].dot(source.rotations[0]).abs() > 1.0 - 1e-6);
            let (a, b) = (turned.sh.unwrap().coefficients, source.sh.unwrap().coefficients);
            assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-5), "{axis}");
        }
    }

    #[test]
    fn upright_scenes_stay() {
        for up in [Some(Vec3::new(0.3, -1.0, 0.4)), None, Some(Vec3::ZERO)] {
            let source = Scene { up, ..scene(Vec3::X) };
            let (turned, up) = upright(Cow::Borrowed(&source)).unwrap();
            assert!(up.is_none() && matches!(turned, Cow::Borrowed(_)));
        }
        assert!(lay_back(&mut scene(Vec3::X), Vec3::ZERO).is_err());
    }

    #[test]
    fn a_scene_on_its_head_comes_back_exactly() {
        let source = scene(Vec3::Y);
        let (mut turned, up) = turned(&source);
        assert_ne!(turned.rotations, source.rotations);
        lay_back(&mut turned, up.unwrap()).unwrap();
        assert_eq!((turned.means, turned.rotations, turned.up), (source.means, source.rotations, source.up));
        assert_eq!(turned.sh.unwrap().coefficients, source.sh.unwrap().coefficients);
    }
}
