//! Volumes: parts of the world that have a style.

use bevy::{
    ecs::entity::{EntityMapper, MapEntities},
    math::Affine3A,
    prelude::*,
};
use stylegaussian::layers::{Cover, Region, RegionCover, Shape};

use crate::{colors::SplatTint, style::wish::strokes::VolumeStrokes};

/// A part of the world in which splats have the style of this entity's [`StyleSource`](crate::StyleSource), or
/// their captured colors if that is none, or in which [`strokes`](Self::strokes) are changed or another light
/// falls ([`tint`](Self::tint)). Its `Transform` places, turns and scales it.
///
/// Any number of volumes may overlap, with one another and with any number of clouds, and may move in each
/// frame. They lie over the styles of the clouds themselves, and over one another by their priority. A style is
/// computed once for each scene that a volume comes near, and shared with whatever else wants it; until it is
/// there, the volume changes nothing.
///
/// A volume has the [`strength`](crate::StyleSource::strength) of its own source, and its strokes
/// [move](crate::StyleSource::motion) as that says. How strokes are drawn (`paint`, `protection`,
/// `stroke_scale` and `relief`) is of a cloud as a whole: the source on the cloud says it, or a default if that
/// has none. [`strokes`](Self::strokes) change that within a volume, over its own style too.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::{StyleSource, StyleVolume};
/// # fn system(mut commands: Commands, assets: Res<AssetServer>) {
/// // A ball of ink around the player, with a soft edge.
/// let ink = StyleSource::image(assets.load("ink.jpg"));
/// commands.spawn((StyleVolume::new(Sphere::new(2.0)).with_softness(0.5), ink));
/// // A statue that stays as it was.
/// let statue = Transform::from_xyz(3.0, 0.0, 1.0);
/// commands.spawn((StyleVolume::new(Cuboid::new(1.0, 2.0, 1.0)).with_priority(1), statue));
/// # }
/// ```
#[derive(Component, Clone, Debug, Default, PartialEq, Reflect)]
// And `StyleSource`, which the plugin requires for it.
#[require(Transform, Visibility)]
#[component(map_entities)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleVolume {
    /// The shape, around the entity's origin. A scale that is not uniform keeps round shapes round.
    pub shape: VolumeShape,
    /// Width of the edge in world units, at least 0: half of it lies within the shape.
    pub softness: f32,
    /// Volumes of a higher priority lie over those of a lower one. Of two equal ones, the entity that was
    /// spawned later usually lies over the other.
    pub priority: i32,
    /// The only entity whose splats have the style, or `None` if all have it.
    pub cloud: Option<Entity>,
    /// The channel of the clouds' [`StyleMask`](crate::mask::StyleMask), 0..4, in which the style shows as far
    /// as it is painted, or `None` if it shows in all of the volume. Clouds without a mask do not have the
    /// style then, and a channel beyond the fourth is never painted.
    pub mask: Option<usize>,
    /// Changes of all strokes within, those of the volume's own style too. With them, a volume without a style
    /// leaves the styles that are there, instead of showing captured colors. `None` by default.
    pub strokes: Option<VolumeStrokes>,
    /// The light on all splats within, whatever their style, as [`SplatTint`] changes that of an entity. Tints
    /// of volumes that overlap multiply, and so do those of entities; a soft edge has a part of the tint. Like
    /// `strokes`, it leaves the styles that are there if the volume has none. It does not follow
    /// [`mask`](Self::mask): a volume that does, tints nothing. At most 16 volumes tint an entity, those of the
    /// highest priority. `None` by default, which costs nothing.
    pub tint: Option<SplatTint>,
}

impl MapEntities for StyleVolume {
    fn map_entities<M: EntityMapper>(&mut self, mapper: &mut M) {
        if let Some(cloud) = &mut self.cloud {
            *cloud = mapper.get_mapped(*cloud);
        }
    }
}

/// The shape of a [`StyleVolume`]: one of Bevy's, or one without bounds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Reflect)]
#[reflect(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum VolumeShape {
    /// All of space.
    #[default]
    Everything,
    /// Everything below the entity: the side of its -y.
    HalfSpace,
    /// A ball; an ellipsoid if its scale is not uniform.
    Sphere(Sphere),
    /// A box.
    Cuboid(Cuboid),
    /// A cylinder along y.
    Cylinder(Cylinder),
    /// A capsule along y.
    Capsule(Capsule3d),
    /// A cone along y.
    Cone(Cone),
    /// A ring around y.
    Torus(Torus),
}

macro_rules! from_shapes {
    ($($variant:ident($shape:ty)),*) => {
        $(impl From<$shape> for VolumeShape {
            fn from(shape: $shape) -> Self {
                Self::$variant(shape)
            }
        })*
    };
}

from_shapes!(
    Sphere(Sphere),
    Cuboid(Cuboid),
    Cylinder(Cylinder),
    Capsule(Capsule3d),
    Cone(Cone),
    Torus(Torus)
);

impl StyleVolume {
    /// A volume with a hard edge.
    pub fn new(shape: impl Into<VolumeShape>) -> Self {
        Self { shape: shape.into(), ..default() }
    }

    /// All of space.
    pub fn everything() -> Self {
        Self::new(VolumeShape::Everything)
    }

    /// Everything on the side of the entity's -y.
    pub fn half_space() -> Self {
        Self::new(VolumeShape::HalfSpace)
    }

    /// Everything that is painted in a channel of the clouds' [`StyleMask`](crate::mask::StyleMask), 0..4.
    pub fn painted(channel: usize) -> Self {
        Self { mask: Some(channel), ..default() }
    }

    /// The same volume with an edge of this width in world units.
    pub fn with_softness(self, softness: f32) -> Self {
        Self { softness, ..self }
    }

    /// The same volume with this priority.
    pub fn with_priority(self, priority: i32) -> Self {
        Self { priority, ..self }
    }

    /// The same volume, which changes the strokes within.
    pub fn with_strokes(self, strokes: VolumeStrokes) -> Self {
        Self { strokes: Some(strokes), ..self }
    }

    /// The same volume, in which another light falls on splats.
    ///
    /// ```
    /// # use bevy::prelude::*;
    /// # use bevy_stylegaussian::{SplatTint, StyleVolume};
    /// # fn system(mut commands: Commands) {
    /// // The light of a lamp, which ends softly.
    /// let lamp = SplatTint { color: Color::srgb(1.0, 0.8, 0.5), exposure: 1.0, ..default() };
    /// commands.spawn(StyleVolume::new(Sphere::new(2.0)).with_softness(2.0).with_tint(lamp));
    /// # }
    /// ```
    pub fn with_tint(self, tint: SplatTint) -> Self {
        Self { tint: Some(tint), ..self }
    }

    /// The same volume for the splats of one entity alone.
    pub fn for_cloud(self, cloud: Entity) -> Self {
        Self { cloud: Some(cloud), ..self }
    }

    /// The channel of masks that counts.
    pub(crate) fn channel(&self) -> Option<u32> {
        self.mask.map(|channel| u32::try_from(channel).unwrap_or(u32::MAX))
    }

    /// Whether the volume changes what is there, besides any style of its own.
    pub(crate) fn is_change(&self) -> bool {
        self.strokes.is_some() || self.tint.is_some()
    }

    pub(crate) fn is_everything(&self) -> bool {
        self.shape == VolumeShape::Everything
    }

    /// The part of world space that the volume takes up.
    pub(crate) fn region(&self, transform: &GlobalTransform) -> Region {
        let (scale, rotation, translation) = transform.to_scale_rotation_translation();
        let shape = match self.shape {
            VolumeShape::Everything => Shape::Everything,
            VolumeShape::HalfSpace => Shape::HalfSpace,
            VolumeShape::Sphere(Sphere { radius }) => Shape::Ellipsoid { radii: Vec3::splat(radius) },
            VolumeShape::Cuboid(Cuboid { half_size }) => Shape::Cuboid { half_size },
            VolumeShape::Cylinder(Cylinder { radius, half_height }) => {
                Shape::Cylinder { radius, half_height }
            }
            VolumeShape::Capsule(Capsule3d { radius, half_length }) => Shape::Capsule { radius, half_length },
            VolumeShape::Cone(Cone { radius, height }) => Shape::Cone { radius, height },
            VolumeShape::Torus(Torus { minor_radius, major_radius }) => {
                Shape::Torus { major_radius, minor_radius }
            }
        };
        let world_from_shape = Affine3A::from_rotation_translation(rotation, translation);
        Region {
            shape: shape.scaled(scale),
            shape_from_scene: world_from_shape.inverse(),
            softness: self.softness,
        }
    }

    /// Whether the volume may touch a ball of world space.
    pub(crate) fn may_touch(&self, transform: &GlobalTransform, center: Vec3, radius: f32) -> bool {
        RegionCover::new(&self.region(transform)).of(center, radius) != Cover::Outside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A volume that holds a point of a ball touches the ball.
    #[test]
    fn what_is_within_is_touched() {
        let shapes: [VolumeShape; 8] = [
            VolumeShape::Everything,
            VolumeShape::HalfSpace,
            Sphere::new(1.0).into(),
            Cuboid::new(1.0, 3.0, 2.0).into(),
            Cylinder::new(0.5, 2.0).into(),
            Capsule3d::new(0.5, 2.0).into(),
            Cone::new(1.0, 2.0).into(),
            Torus::new(0.5, 1.5).into(),
        ];
        let transform = Transform::from_xyz(1.0, 2.0, 3.0)
            .with_rotation(Quat::from_rotation_x(0.7))
            .with_scale(Vec3::new(1.0, 2.0, 0.5));
        let transform = GlobalTransform::from(transform);
        for shape in shapes {
            let volume = StyleVolume::new(shape).with_softness(0.2);
            let region = volume.region(&transform);
            let mut n_within = 0;
            for i in 0..8000 {
                let [x, y, z] = [i % 20, i / 20 % 20, i / 400].map(|i| 0.5 * i as f32 - 4.75);
                let point = Vec3::new(x, y, z) + Vec3::new(1.0, 2.0, 3.0);
                if region.weight(point) > 0.0 {
                    n_within += 1;
                    for radius in [0.0, 1.0] {
                        let center = point + radius * Vec3::new(0.6, 0.0, 0.8);
                        assert!(volume.may_touch(&transform, center, radius), "{shape:?} {point}");
                    }
                }
            }
            assert!(n_within > 0, "{shape:?}");
        }
        let far = Vec3::splat(100.0);
        assert!(!StyleVolume::new(Sphere::new(1.0)).may_touch(&transform, far, 10.0));
    }
}
