//! The place of a cloud in the world, and its extent.

use bevy::{math::Affine3A, prelude::*};

use crate::style::show::transition::TransitionCenter;

/// A cloud's place. Distances are in world units.
pub(crate) struct Place<'a> {
    pub(crate) world_from_scene: Affine3A,
    /// Corners, in scene space, of the box that holds almost all Gaussians, and of the box that holds all.
    usual: [Vec3; 2],
    all: [Vec3; 2],
    /// The place of an entity, or `None` if it has none.
    of_entity: &'a dyn Fn(Entity) -> Option<Vec3>,
}

impl<'a> Place<'a> {
    /// The place of a cloud with these boxes, in scene space.
    pub(crate) fn new(
        world_from_scene: Affine3A,
        usual: [Vec3; 2],
        all: [Vec3; 2],
        of_entity: &'a dyn Fn(Entity) -> Option<Vec3>,
    ) -> Self {
        Self { world_from_scene, usual, all, of_entity }
    }

    #[cfg(test)]
    pub(crate) fn for_tests(usual: [Vec3; 2], all: [Vec3; 2]) -> Self {
        Self { world_from_scene: Affine3A::IDENTITY, usual, all, of_entity: &|_| None }
    }

    /// The center of a sphere in world space.
    pub(crate) fn center(&self, center: TransitionCenter) -> Vec3 {
        let middle = || self.world_from_scene.transform_point3(0.5 * (self.usual[0] + self.usual[1]));
        match center {
            TransitionCenter::Point(point) => point,
            TransitionCenter::Entity(entity) => (self.of_entity)(entity).unwrap_or_else(middle),
        }
    }

    /// The largest distance of the usual box from a point, and that of the whole box.
    pub(crate) fn distances(&self, point: Vec3) -> (f32, f32) {
        let largest = |corners: [Vec3; 2]| {
            self.corners(corners).map(|corner| corner.distance(point)).fold(0.0, f32::max)
        };
        (largest(self.usual), largest(self.all))
    }

    /// The least and the largest place along a direction: of the usual box, and of the whole one.
    pub(crate) fn along(&self, direction: Vec3) -> ([f32; 2], [f32; 2]) {
        let range = |corners: [Vec3; 2]| {
            let along = self.corners(corners).map(|corner| corner.dot(direction));
            along.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)])
        };
        (range(self.usual), range(self.all))
    }

    /// The corners of a box of scene space, in world space.
    fn corners(&self, [min, max]: [Vec3; 2]) -> impl Iterator<Item = Vec3> {
        let world_from_scene = self.world_from_scene;
        (0..8).map(move |i| {
            let pick = Vec3::new((i & 1) as f32, ((i >> 1) & 1) as f32, ((i >> 2) & 1) as f32);
            world_from_scene.transform_point3(min + pick * (max - min))
        })
    }
}
