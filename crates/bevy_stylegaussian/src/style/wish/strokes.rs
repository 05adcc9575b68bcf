//! Strokes of a part of the scene, and where strokes run.

use bevy::{math::Affine3A, prelude::*};
use stylegaussian::{
    paint::Direction,
    strokes::{StrokeCurve, StrokeFactors},
};

use crate::style::wish::motion::StyleMotion;

/// The way in which strokes run on the scene, in the local space of the entity: that of a
/// [`StyleSource`](crate::StyleSource), or of a [`StyleVolume`](crate::StyleVolume).
#[derive(Clone, Debug, PartialEq, Reflect)]
#[reflect(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum StrokeDirection {
    /// Along a vector of any length above 0.
    Along(Vec3),
    /// Along a line through these points, at least two: each spot's strokes run as the line does where it is
    /// nearest. If the last point is the first, the line is closed.
    Curve(Vec<Vec3>),
}

impl From<Vec3> for StrokeDirection {
    fn from(direction: Vec3) -> Self {
        Self::Along(direction)
    }
}

impl From<Vec<Vec3>> for StrokeDirection {
    fn from(points: Vec<Vec3>) -> Self {
        Self::Curve(points)
    }
}

impl StrokeDirection {
    /// The same for painting.
    pub(crate) fn of_paint(&self) -> Direction<'_> {
        match self {
            Self::Along(direction) => Direction::Along(*direction),
            Self::Curve(points) => Direction::Curve(points),
        }
    }
}

/// Changes of the strokes in a [`StyleVolume`](crate::StyleVolume), whatever their style. Factors multiply
/// those of the cloud's [`StyleSource`](crate::StyleSource) and those of volumes below. A change is shown in
/// the next frame and computes nothing.
///
/// Paint up to 1 and protection follow soft edges and painted weights smoothly. All else changes spot by spot.
/// Of the volumes on one cloud that change such things, eight count, the topmost.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::{StyleVolume, style::VolumeStrokes};
/// # fn system(mut commands: Commands) {
/// // Nearly bare where channel 0 is painted.
/// commands.spawn(StyleVolume::painted(0).with_strokes(VolumeStrokes::default().with_paint(0.2)));
/// // Broad strokes that fall, in a box.
/// let falling = VolumeStrokes::default().with_stroke_scale(2.0).with_direction(Vec3::NEG_Y);
/// commands.spawn(StyleVolume::new(Cuboid::new(1.0, 4.0, 1.0)).with_strokes(falling));
/// # }
/// ```
#[derive(Clone, Debug, PartialEq, Reflect)]
#[reflect(Clone, Debug, Default, PartialEq)]
pub struct VolumeStrokes {
    /// Factor of [`StyleSource::paint`](crate::StyleSource::paint), 0 to 10.
    pub paint: f32,
    /// Factor of [`StyleSource::protection`](crate::StyleSource::protection), 0 to 10.
    pub protection: f32,
    /// Factor of [`StyleSource::stroke_scale`](crate::StyleSource::stroke_scale), 0.1 to 10. It does nothing if
    /// strokes keep their size on screen.
    pub stroke_scale: f32,
    /// Factor of the thickness of the cloud's relief, 0 to 10.
    pub relief: f32,
    /// Thickness that is added to it, 0 to 4, so that paint has one where the cloud's has none. It is in the
    /// light of the cloud's [`StyleSource::relief`](crate::StyleSource::relief): by default, in that of the
    /// game's first directional light.
    pub added_relief: f32,
    /// Direction of strokes in the volume's own space; `None` for their own. Each spot's paint is turned about
    /// the middle of the spot. Of a curve of more than eight points, evenly chosen ones count, the first and
    /// the last among them. Points that do not differ, or are no numbers, change nothing.
    pub direction: Option<StrokeDirection>,
    /// The way in which strokes move; `None` for their own.
    pub motion: Option<StyleMotion>,
}

impl Default for VolumeStrokes {
    /// No change.
    fn default() -> Self {
        Self {
            paint: 1.0,
            protection: 1.0,
            stroke_scale: 1.0,
            relief: 1.0,
            added_relief: 0.0,
            direction: None,
            motion: None,
        }
    }
}

impl VolumeStrokes {
    /// The same changes with this factor of paint.
    pub fn with_paint(self, paint: f32) -> Self {
        Self { paint, ..self }
    }

    /// The same changes with this factor of protection.
    pub fn with_protection(self, protection: f32) -> Self {
        Self { protection, ..self }
    }

    /// The same changes with this factor of the size of strokes.
    pub fn with_stroke_scale(self, stroke_scale: f32) -> Self {
        Self { stroke_scale, ..self }
    }

    /// The same changes with this factor of the thickness of paint.
    pub fn with_relief(self, relief: f32) -> Self {
        Self { relief, ..self }
    }

    /// The same changes with this thickness in addition, 0 to 4: 1 is as thick as
    /// [`StyleRelief::sun`](crate::style::StyleRelief::sun).
    pub fn with_added_relief(self, added_relief: f32) -> Self {
        Self { added_relief, ..self }
    }

    /// The same changes with strokes that run along a direction or a curve, in the volume's own space.
    pub fn with_direction(self, direction: impl Into<StrokeDirection>) -> Self {
        Self { direction: Some(direction.into()), ..self }
    }

    /// The same changes with strokes that move.
    pub fn with_motion(self, motion: StyleMotion) -> Self {
        Self { motion: Some(motion), ..self }
    }

    /// The changes within sane ranges, with the direction in the space of a scene at this place. NaN changes
    /// nothing.
    pub(crate) fn usual(&self, world_from_scene: &Affine3A, volume: &GlobalTransform) -> StrokeFactors {
        let scene_from_world = world_from_scene.inverse();
        let in_scene = |direction: Vec3| world_from_scene.matrix3.inverse() * (volume.rotation() * direction);
        let place = |&point: &Vec3| scene_from_world.transform_point3(volume.transform_point(point));
        let (direction, curve) = match &self.direction {
            None => (None, None),
            Some(StrokeDirection::Along(direction)) => (Some(in_scene(*direction)), None),
            Some(StrokeDirection::Curve(points)) => {
                (None, StrokeCurve::new(&points.iter().map(place).collect::<Vec<_>>()))
            }
        };
        let factors = StrokeFactors {
            amount: self.paint,
            protection: self.protection,
            stroke_scale: self.stroke_scale,
            relief: self.relief,
            added_relief: self.added_relief,
            direction,
            curve,
            motion: self.motion.map(StyleMotion::usual),
        };
        factors.usual()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_turn_with_the_volume_and_against_the_scene() {
        let quarter = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
        let place = Affine3A::from_scale_rotation_translation(Vec3::splat(2.0), quarter, Vec3::X);
        let volume = GlobalTransform::from(Transform::from_xyz(0.0, 5.0, 0.0).with_scale(Vec3::splat(3.0)));
        let strokes = VolumeStrokes::default().with_direction(Vec3::NEG_Z);
        // A quarter turn about y brings x to -z.
        assert!(strokes.usual(&place, &volume).direction.unwrap().distance(Vec3::X) < 1e-6);
        let turned = GlobalTransform::from(Transform::from_rotation(quarter));
        let along_x = VolumeStrokes::default().with_direction(Vec3::X);
        assert!(along_x.usual(&Affine3A::IDENTITY, &turned).direction.unwrap().distance(Vec3::NEG_Z) < 1e-6);
        // Points have the place and the scale of the volume, too.
        let curve = VolumeStrokes::default().with_direction(vec![Vec3::ZERO, Vec3::NEG_Z, Vec3::ONE]);
        let found = curve.usual(&Affine3A::from_translation(Vec3::X), &volume).curve.unwrap();
        let expected = [Vec3::new(-1.0, 5.0, 0.0), Vec3::new(-1.0, 5.0, -3.0), Vec3::new(2.0, 8.0, 3.0)];
        assert!(found.points().iter().zip(expected).all(|(found, expected)| found.distance(expected) < 1e-5));
        let none = VolumeStrokes::default().with_direction(vec![Vec3::ONE]);
        assert_eq!(none.usual(&place, &volume), StrokeFactors::NONE);
        for bad in [Vec3::ZERO, Vec3::NAN] {
            let strokes = VolumeStrokes::default().with_direction(bad).with_paint(f32::NAN);
            assert_eq!(strokes.usual(&place, &volume), StrokeFactors::NONE);
        }
    }
}
