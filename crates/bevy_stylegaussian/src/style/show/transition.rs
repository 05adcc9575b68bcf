//! Transitions from one style to the next: fades, waves, fronts and spots.

use std::time::Duration;

use bevy::{
    ecs::entity::{EntityMapper, MapEntities},
    math::{
        Affine3A,
        curve::{
            Curve,
            easing::{EaseFunction, EasingCurve},
        },
    },
    prelude::*,
};
use stylegaussian::layers::{Region, Shape};

use crate::style::show::place::Place;

/// The way in which an entity's changes of style are shown. Without this component, changes are immediate.
///
/// A transition begins once the new style is complete. A change that comes in between begins at once, over what
/// is shown.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::{StyleSource, StyleTransition};
/// # use std::time::Duration;
/// # fn system(mut commands: Commands, cloud: Entity, hit: Vec3, style: StyleSource) {
/// // A wave from the place that was hit.
/// commands.entity(cloud).insert((style, StyleTransition::sphere(hit, Duration::from_secs(2))));
/// # }
/// ```
#[derive(Component, Clone, Debug, PartialEq, Reflect)]
#[component(map_entities)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleTransition {
    /// Time from the last frame in the old colors to the first in the new colors alone.
    pub duration: Duration,
    /// The places that change first.
    pub shape: TransitionShape,
    /// The progress over time.
    pub easing: EaseFunction,
    /// The clock.
    pub clock: TransitionClock,
}

impl MapEntities for StyleTransition {
    fn map_entities<M: EntityMapper>(&mut self, mapper: &mut M) {
        if let TransitionShape::Sphere { center: TransitionCenter::Entity(entity), .. } = &mut self.shape {
            *entity = mapper.get_mapped(*entity);
        }
    }
}

impl Default for StyleTransition {
    /// A fade of half a second.
    fn default() -> Self {
        Self {
            duration: Duration::from_millis(500),
            shape: TransitionShape::Fade,
            easing: EaseFunction::Linear,
            clock: TransitionClock::Real,
        }
    }
}

/// The places of a scene that change first. The first style of a [`StyleVolume`](crate::StyleVolume) fades in,
/// whatever the shape; later ones replace it in this shape.
#[derive(Clone, Debug, Default, PartialEq, Reflect)]
#[reflect(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum TransitionShape {
    /// All places change together.
    #[default]
    Fade,
    /// A sphere that grows until it holds the scene.
    Sphere {
        /// Its center.
        center: TransitionCenter,
        /// Width of its edge in world units, at least 0.
        softness: f32,
    },
    /// A plane that sweeps through the scene.
    Front {
        /// Direction of its way, in world space.
        direction: Dir3,
        /// Width of its edge in world units, at least 0.
        softness: f32,
    },
    /// Spots that grow together.
    Dissolve {
        /// Distance of spots in world units, above 0.
        size: f32,
        /// Softness of the spots' edges, as a part of their size, at least 0.
        softness: f32,
    },
}

/// The center of a growing sphere.
#[derive(Clone, Copy, Debug, PartialEq, Reflect)]
#[reflect(Clone, Debug, PartialEq)]
pub enum TransitionCenter {
    /// A point in world space.
    Point(Vec3),
    /// The place of an entity, which may move. If it is gone, the place of the scene.
    Entity(Entity),
}

/// The clock of a transition.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Clone, Debug, Default, PartialEq)]
pub enum TransitionClock {
    /// `Time<Real>`, which goes on while a game is paused or slowed down.
    #[default]
    Real,
    /// `Time<Virtual>`, which stops and slows down with the game.
    Virtual,
}

impl From<Vec3> for TransitionCenter {
    fn from(point: Vec3) -> Self {
        Self::Point(point)
    }
}

impl From<Entity> for TransitionCenter {
    fn from(entity: Entity) -> Self {
        Self::Entity(entity)
    }
}

impl StyleTransition {
    /// A fade.
    pub fn fade(duration: Duration) -> Self {
        Self { duration, ..default() }
    }

    /// A sphere that grows from a point in world space, or from an entity, with an edge of half a world unit.
    pub fn sphere(center: impl Into<TransitionCenter>, duration: Duration) -> Self {
        let shape = TransitionShape::Sphere { center: center.into(), softness: 0.5 };
        Self { duration, shape, ..default() }
    }

    /// A plane that sweeps along a direction in world space, with an edge of half a world unit.
    pub fn front(direction: Dir3, duration: Duration) -> Self {
        Self { duration, shape: TransitionShape::Front { direction, softness: 0.5 }, ..default() }
    }

    /// Spots at a distance of `size` world units.
    pub fn dissolve(size: f32, duration: Duration) -> Self {
        Self { duration, shape: TransitionShape::Dissolve { size, softness: 0.1 }, ..default() }
    }

    /// The same transition with another progress over time.
    pub fn with_easing(self, easing: EaseFunction) -> Self {
        Self { easing, ..self }
    }

    /// The same transition with an edge of this width: see [`TransitionShape`]. Fades have none.
    pub fn with_softness(mut self, width: f32) -> Self {
        match &mut self.shape {
            TransitionShape::Fade => {}
            TransitionShape::Sphere { softness, .. }
            | TransitionShape::Front { softness, .. }
            | TransitionShape::Dissolve { softness, .. } => *softness = width,
        }
        self
    }

    /// The same transition on another clock.
    pub fn with_clock(self, clock: TransitionClock) -> Self {
        Self { clock, ..self }
    }

    /// The progress after a time, 0..1.
    pub(crate) fn progress(&self, elapsed: Duration) -> f32 {
        let duration = self.duration.as_secs_f32();
        let linear = if duration > 0.0 { (elapsed.as_secs_f32() / duration).min(1.0) } else { 1.0 };
        // Some curves leave 0..1 on the way.
        EasingCurve::new(0.0, 1.0, self.easing).sample_clamped(linear).clamp(0.0, 1.0)
    }

    /// The part of a scene that has the new colors at a progress of 0..1, and their share there.
    pub(crate) fn reached(&self, progress: f32, place: &Place) -> (Region, f32) {
        let (shape, world_from_shape, softness) = match self.shape {
            TransitionShape::Fade => return (Region::EVERYWHERE, progress),
            TransitionShape::Sphere { center, softness } => {
                let center = place.center(center);
                let (usual, farthest) = place.distances(center);
                let radius = reach(progress, 0.0, usual, farthest + 0.5 * softness);
                // The edge of a sphere that has just begun is narrower: nothing jumps.
                let shape = Shape::Ellipsoid { radii: Vec3::splat(radius) };
                (shape, Affine3A::from_translation(center), softness.min(2.0 * radius))
            }
            TransitionShape::Front { direction, softness } => {
                let ([first, usual], [begin, last]) = place.along(*direction);
                // Most of the scene within most of the time, and all of it within all.
                let half = 0.5 * softness;
                let at = reach(progress, begin.max(2.0 * first - usual) - half, usual, last + half);
                let turn = Quat::from_rotation_arc(Vec3::Y, *direction);
                let shape_at = Affine3A::from_rotation_translation(turn, at * *direction);
                (Shape::HalfSpace, shape_at, softness)
            }
            TransitionShape::Dissolve { size, softness } => {
                // Noise lies within 0..1; the edge goes half of its width beyond.
                let level = progress * (1.0 + 0.5 * softness);
                let edge = size * softness.min(2.0 * level);
                (Shape::Noise { size, level }, Affine3A::IDENTITY, edge)
            }
        };
        let shape_from_scene = world_from_shape.inverse() * place.world_from_scene;
        (Region { shape, shape_from_scene, softness }, 1.0)
    }
}

/// The part of the time within which a transition reaches the usual extent of a scene. The rest is for what
/// lies far outside, such as a sky.
const USUAL_PART: f32 = 0.9;

/// A way from `begin` past `usual` to `end`, at a progress of 0..1.
fn reach(progress: f32, begin: f32, usual: f32, end: f32) -> f32 {
    // Scenes without anything far away are reached at one speed.
    let is_even = end - begin <= 1.5 * (usual - begin);
    if is_even {
        return begin + progress * (end - begin);
    }
    let (near, far) =
        ((progress / USUAL_PART).min(1.0), (progress - USUAL_PART).max(0.0) / (1.0 - USUAL_PART));
    // Squared, so that the speed grows without a jump that would be seen.
    begin + near * (usual - begin) + far * far * (end - usual)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place() -> Place<'static> {
        Place::for_tests([Vec3::splat(-1.0), Vec3::splat(1.0)], [Vec3::splat(-1.0), Vec3::splat(50.0)])
    }

    /// Shares at points, at a progress.
    fn shares(transition: &StyleTransition, progress: f32) -> Vec<f32> {
        let points = [
            Vec3::ZERO,
            Vec3::new(0.9, -0.3, 0.2),
            Vec3::splat(-1.0),
            Vec3::splat(50.0),
            Vec3::new(-1.0, 0.5, 1.0),
        ];
        let (region, strength) = transition.reached(progress, &place());
        points.iter().map(|&point| strength * region.weight(point)).collect()
    }

    fn all_shapes() -> Vec<StyleTransition> {
        let second = Duration::from_secs(1);
        let shapes = [
            StyleTransition::fade(second),
            StyleTransition::sphere(Vec3::new(0.3, 0.2, -3.0), second),
            StyleTransition::sphere(Vec3::ZERO, second),
            StyleTransition::front(Dir3::from_xyz(1.0, 2.0, -0.5).unwrap(), second),
            StyleTransition::dissolve(0.3, second),
        ];
        let wide = shapes.iter().cloned().map(|transition| transition.with_softness(3.0));
        shapes.iter().cloned().chain(wide).collect()
    }

    /// Nothing of the scene has changed at the beginning, all of it at the end, and nothing changes back on the
    /// way.
    #[test]
    fn transitions_begin_with_nothing_and_end_with_all() {
        for transition in all_shapes() {
            assert!(shares(&transition, 0.0).iter().all(|&share| share < 1e-4), "{transition:?}");
            assert!(shares(&transition, 1.0).iter().all(|&share| share > 1.0 - 1e-4), "{transition:?}");
            let mut last = shares(&transition, 0.0);
            for step in 1..=200 {
                let next = shares(&transition, step as f32 / 200.0);
                let is_lower = last.iter().zip(&next).any(|(last, next)| *next < last - 1e-4);
                assert!(!is_lower, "{transition:?} at {step}: {last:?}, {next:?}");
                last = next;
            }
        }
    }

    /// A sky far away takes a tenth of the time, however far it is.
    #[test]
    fn a_far_sky_does_not_hurry_a_wave() {
        let wave = StyleTransition::sphere(Vec3::ZERO, Duration::from_secs(1)).with_softness(0.0);
        let radius = |progress: f32| match wave.reached(progress, &place()).0.shape {
            Shape::Ellipsoid { radii } => radii.x,
            _ => f32::NAN,
        };
        assert!(
            radius(0.45) < 1.0,
            "half of the way to the corner of the usual box at 1.73: {}",
            radius(0.45)
        );
        assert!(radius(1.0) > 86.0);
    }

    #[test]
    fn easing_and_time_give_the_progress() {
        let fade = StyleTransition::fade(Duration::from_secs(4));
        assert_eq!(fade.progress(Duration::from_secs(1)), 0.25);
        assert_eq!(fade.progress(Duration::from_secs(9)), 1.0);
        assert_eq!(fade.with_easing(EaseFunction::QuadraticIn).progress(Duration::from_secs(1)), 0.0625);
        assert_eq!(StyleTransition::fade(Duration::ZERO).progress(Duration::ZERO), 1.0);
        let forever = StyleTransition::fade(Duration::MAX);
        assert!(forever.progress(Duration::from_secs(100)) < 1e-6);
        // A curve that swings beyond its ends.
        let swinging = StyleTransition::fade(Duration::from_secs(1)).with_easing(EaseFunction::BackInOut);
        assert!((0..=100).all(|i| (0.0..=1.0).contains(&swinging.progress(Duration::from_millis(10 * i)))));
    }
}
