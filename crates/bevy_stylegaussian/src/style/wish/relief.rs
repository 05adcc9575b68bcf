//! Light on the thickness of paint.

use bevy::{math::Affine3A, prelude::*};

/// The relief of a [`StyleSource`](crate::StyleSource)'s strokes: paint has a thickness, and a light falls on
/// it. Flat paint stays as it is, since the captured light is in its color. A change is shown in the next frame
/// and computes nothing.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::{StyleSource, style::StyleRelief};
/// # fn system(mut source: Single<&mut StyleSource>) {
/// source.relief = StyleRelief::sun();
/// source.relief = StyleRelief::lit_from(Vec3::new(1.0, 2.0, 0.5)).with_amount(1.5);
/// # }
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Reflect)]
#[reflect(Clone, Debug, Default, PartialEq)]
pub struct StyleRelief {
    /// Factor of the thickness, 0 to 4. At 0, the default, there is no relief.
    pub amount: f32,
    /// The light.
    pub light: PaintLight,
}

/// The light on paint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Reflect)]
#[reflect(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum PaintLight {
    /// That of the game's first directional light, by the order of entities. Paint is flat if there is none,
    /// and without the feature `pbr`.
    #[default]
    Sun,
    /// A light in this direction from the scene, in world space, of any length but 0.
    Direction(Vec3),
}

impl StyleRelief {
    /// Relief in the game's first directional light.
    pub fn sun() -> Self {
        Self { amount: 1.0, light: PaintLight::Sun }
    }

    /// Relief in a light that comes from this direction, in world space.
    pub fn lit_from(direction: Vec3) -> Self {
        Self { amount: 1.0, light: PaintLight::Direction(direction) }
    }

    /// The same relief with this factor of the thickness, 0 to 4.
    pub fn with_amount(self, amount: f32) -> Self {
        Self { amount, ..self }
    }

    /// The amount within 0 to 4; 0 if it is no number.
    pub(crate) fn usual_amount(self) -> f32 {
        if self.amount.is_nan() { 0.0 } else { self.amount.clamp(0.0, 4.0) }
    }

    /// The direction to the light in the space of a scene at this place, or 0 if there is none or paint is
    /// flat. `to_sun` is the direction to the first directional light.
    pub(crate) fn to_light(self, world_from_scene: &Affine3A, to_sun: Option<Vec3>) -> Vec3 {
        // A light that moves changes nothing then.
        if self.usual_amount() <= 0.0 {
            return Vec3::ZERO;
        }
        self.to_any_light(world_from_scene, to_sun)
    }

    /// The same, also if paint is flat, for volumes that give it a thickness.
    pub(crate) fn to_any_light(self, world_from_scene: &Affine3A, to_sun: Option<Vec3>) -> Vec3 {
        let to_light = match self.light {
            PaintLight::Sun => to_sun,
            PaintLight::Direction(direction) => Some(direction),
        };
        // Directions turn as the scene does. That of a flat scene is not finite.
        let in_scene = world_from_scene.matrix3.inverse() * to_light.unwrap_or_default();
        in_scene.normalize_or_zero()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_turns_against_the_scene() {
        let place = Affine3A::from_scale_rotation_translation(
            Vec3::splat(2.0),
            Quat::from_rotation_y(std::f32::consts::FRAC_PI_2),
            Vec3::new(5.0, 0.0, 0.0),
        );
        let relief = StyleRelief::lit_from(Vec3::new(0.0, 0.0, -3.0));
        // A quarter turn about y brings x to -z.
        assert!(relief.to_light(&place, None).distance(Vec3::X) < 1e-6);
        assert!(StyleRelief::sun().to_light(&place, Some(Vec3::NEG_Z)).distance(Vec3::X) < 1e-6);
        assert_eq!(StyleRelief::sun().to_light(&place, None), Vec3::ZERO);
        let flat = Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0));
        for bad in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
            assert_eq!(StyleRelief::lit_from(bad).to_light(&place, None), Vec3::ZERO, "{bad}");
        }
        assert!(relief.to_light(&flat, None).is_finite());
        assert_eq!(relief.with_amount(0.0).to_light(&place, None), Vec3::ZERO);
        let amounts = [f32::NAN, -1.0, 9.0].map(|amount| relief.with_amount(amount).usual_amount());
        assert_eq!(amounts, [0.0, 0.0, 4.0]);
    }
}
