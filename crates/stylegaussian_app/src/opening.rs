//! A scene that is opened: its state of loading, and its part that a camera is to see.

use bevy::{asset::LoadState, prelude::*};
use bevy_stylegaussian::{
    GaussianScene,
    stylegaussian_files::world::{UP, World as Levels},
};

use crate::camera::Orbit;

/// Share of the means that lie outside of the framed box on each side of an axis: floaters are few and far
/// away.
const OUTSIDE: f64 = 0.03;

/// Radius of what is framed if there is nothing, in scene units.
const NOTHING: f32 = 0.1;

/// Marks the entity of the scene or the world that is shown. The parts of a world are entities, too.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Subject;

/// A scene or a world that was asked for, or `None` while it is being loaded.
///
/// # Errors
/// If it cannot be loaded.
pub fn loaded_asset<'a, A: Asset>(
    handle: &Handle<A>,
    loaded: &'a Assets<A>,
    assets: &AssetServer,
) -> Option<Result<&'a A, String>> {
    match assets.get_load_state(handle) {
        Some(LoadState::Failed(error)) => Some(Err(error.to_string())),
        _ => loaded.get(handle).map(Ok),
    }
}

/// The part of a scene that a camera is to see: its bulk, upright.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Framing {
    /// The scene's up direction, which is turned to the world's y.
    pub up: Vec3,
    /// Center of the bulk, in the scene's own axes.
    pub center: Vec3,
    /// Radius of the bulk, in scene units.
    pub radius: f32,
    /// The spot from which it was captured and the distance of what is near, in the scene's own axes and units,
    /// if that spot is within.
    pub eye: Option<(Vec3, f32)>,
}

impl Framing {
    /// Measures a scene.
    pub fn of(asset: &GaussianScene) -> Self {
        let scene = asset.scene();
        let radius = |[min, max]: [Vec3; 2]| (max - min).length() / 2.0;
        // Gaussians in one point have the size that they are drawn with.
        let sized = |bulk: [Vec3; 2]| if radius(bulk) > 0.0 { Some(bulk) } else { scene.splat_bounds() };
        let [min, max] = scene.bulk(OUTSIDE).and_then(sized).unwrap_or_default();
        let framing = asset.framing();
        Self {
            // If nothing is visible: captures are usually in the axes of structure from motion, with y down.
            up: framing.map_or(scene.up.unwrap_or(Vec3::NEG_Y), |framing| framing.up),
            center: (min + max) / 2.0,
            radius: if radius([min, max]) > 0.0 { radius([min, max]) } else { NOTHING },
            eye: framing.and_then(|framing| framing.eye).map(|eye| (eye.at, eye.room)),
        }
    }

    /// Measures a world by the boxes of its parts.
    pub fn of_world(levels: &Levels) -> Self {
        let parts = || {
            levels.nodes.iter().map(|node| {
                let counts = node.levels.iter().flatten().map(|run| run.range.len());
                (node.bounds, counts.max().unwrap_or(0))
            })
        };
        let edge = |corner: usize, outside: f64| {
            Vec3::from_array([0, 1, 2].map(|axis| {
                let places = parts().map(|(bounds, count)| (bounds[corner][axis], count));
                place_above(places.collect(), outside)
            }))
        };
        let [min, max] = [edge(0, OUTSIDE), edge(1, 1.0 - OUTSIDE)];
        let radius = (max - min).length() / 2.0;
        let radius = if radius > 0.0 { radius } else { NOTHING };
        Self { up: UP, center: (min + max) / 2.0, radius, eye: None }
    }

    /// The rotation that turns the scene upright.
    pub fn world_from_scene(&self) -> Quat {
        Quat::from_rotation_arc(self.up.normalize_or(Vec3::Y), Vec3::Y)
    }

    /// The place of this camera from which it sees the scene whole; that of the capture if it was made within.
    pub fn orbit(&self, camera: &Camera) -> Orbit {
        if let Some((eye, room)) = self.eye {
            let upright = self.world_from_scene();
            return Orbit::within(upright * eye, upright * self.center, room);
        }
        // A camera that has not drawn yet has no size.
        let size = camera.logical_viewport_size().unwrap_or(Vec2::ONE);
        Orbit::frame(self.world_from_scene() * self.center, self.radius, size.x / size.y.max(1.0))
    }
}

/// The lowest of these places that has at least a `share` of all Gaussians at it or below it. Each place comes
/// with its number of Gaussians.
fn place_above(mut places: Vec<(f32, usize)>, share: f64) -> f32 {
    places.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let total: usize = places.iter().map(|(_, count)| count).sum();
    let mut passed = 0;
    let is_above = |(_, count): &&(f32, usize)| {
        passed += count;
        passed as f64 >= share * total as f64
    };
    places.iter().find(is_above).map_or(0.0, |(at, _)| *at)
}

#[cfg(test)]
mod tests {
    use bevy_stylegaussian::{
        stylegaussian::Scene,
        stylegaussian_files::world::{Node, Run},
    };

    use super::*;

    fn framing_of(scene: Scene) -> Framing {
        Framing::of(&GaussianScene::new(scene))
    }

    /// A scene of these means.
    fn scene(means: Vec<Vec3>) -> Scene {
        let n = means.len();
        Scene {
            rotations: vec![Quat::IDENTITY; n],
            scales: vec![Vec3::splat(1e-3); n],
            opacities: vec![1.0; n],
            order: (0..n as u32).collect(),
            n_source: n,
            means,
            ..Scene::default()
        }
    }

    #[test]
    fn a_scene_is_framed_upright_in_the_middle() {
        let means = vec![Vec3::ZERO, Vec3::new(2.0, 4.0, 4.0)];
        let framing = framing_of(scene(means));
        // Half of the diagonal, which is 6 long.
        assert_eq!((framing.center, framing.radius), (Vec3::new(1.0, 2.0, 2.0), 3.0));
        // Without an up axis, y is down.
        let upright = framing.world_from_scene();
        assert!((upright * Vec3::NEG_Y).distance(Vec3::Y) < 1e-6);
        let orbit = framing.orbit(&Camera::default());
        assert!(orbit.target().distance(upright * framing.center) < 1e-6);
        assert!(orbit.distance() > framing.radius);
    }

    /// Walls around a spot, of Gaussians that grow with the distance from it: the camera begins there, and
    /// looks toward the middle.
    #[test]
    fn a_place_that_was_captured_from_within_is_entered() {
        let at = Vec3::new(2.0, 1.6, 0.0);
        let (mut means, mut scales) = (Vec::new(), Vec::new());
        for i in 0..3000 {
            // Directions on a spiral over the sphere.
            let y = 1.0 - 2.0 * (i as f32 + 0.5) / 3000.0;
            let (sin, cos) = (2.4 * i as f32).sin_cos();
            let ray = Vec3::new((1.0 - y * y).sqrt() * cos, y, (1.0 - y * y).sqrt() * sin);
            // Walls at 5 to either side of the origin, a floor at 0, and no roof: an empty sky.
            let to = |side: f32, from: f32, along: f32| (side * along.signum() - from) / along;
            let mut t = to(5.0, at.x, ray.x).min(to(5.0, at.z, ray.z));
            if ray.y < 0.0 {
                t = t.min(-at.y / ray.y);
            }
            if at.y + t * ray.y < 4.0 {
                means.push(at + t * ray);
                scales.push(Vec3::splat(0.02 * t));
            }
        }
        let framing = framing_of(Scene { scales, up: Some(Vec3::Y), ..scene(means) });
        let (eye, room) = framing.eye.unwrap();
        assert!(eye.distance(at) < 1.0 && room > 0.0, "{eye} {room}");
        let view = framing.orbit(&Camera::default()).transform();
        assert!(view.translation.distance(eye) < 1e-4);
        assert!(view.forward().dot(framing.center - eye) > 0.0 && view.forward().y.abs() < 1e-4);
        let outside = framing_of(scene(vec![Vec3::ZERO, Vec3::ONE]));
        assert_eq!(outside.eye, None);
    }

    #[test]
    fn small_scenes_and_single_gaussians_are_framed() {
        let means = vec![Vec3::ZERO, Vec3::new(2e-4, 4e-4, 4e-4)];
        let framing = framing_of(scene(means));
        assert!((framing.radius / 3e-4 - 1.0).abs() < 1e-5, "{}", framing.radius);
        let framing = framing_of(scene(vec![Vec3::X]));
        assert!(framing.center.distance(Vec3::X) < 1e-6, "{}", framing.center);
        // 3.33 deviations along each axis.
        assert!((framing.radius / 5.77e-3 - 1.0).abs() < 0.01, "{}", framing.radius);
    }

    /// A row of parts of equal counts along x, and one of few Gaussians far away.
    #[test]
    fn a_world_is_framed_without_what_is_far_away() {
        let node = |x: f32, count: usize| Node {
            bounds: [Vec3::new(x, 0.0, 0.0), Vec3::new(x + 1.0, 2.0, 4.0)],
            levels: vec![Some(Run { file: 0, range: 0..count }), None],
        };
        let mut nodes: Vec<Node> = (0..10).map(|i| node(i as f32, 100)).collect();
        nodes.push(node(900.0, 10));
        let levels = Levels { n_levels: 2, files: vec!["a.sog".into()], environment: None, nodes };
        let framing = Framing::of_world(&levels);
        assert_eq!(framing.center, Vec3::new(5.0, 1.0, 2.0));
        assert!((framing.radius - 0.5 * 120.0_f32.sqrt()).abs() < 1e-5, "{}", framing.radius);
        assert_eq!((framing.up, framing.eye), (Vec3::NEG_Y, None));
        let empty = Framing::of_world(&Levels { nodes: Vec::new(), ..levels });
        assert_eq!((empty.center, empty.radius), (Vec3::ZERO, NOTHING));
    }

    #[test]
    fn any_up_direction_and_an_empty_scene_are_framed() {
        let framing = framing_of(Scene { up: Some(Vec3::new(0.0, 0.0, 3.0)), ..Scene::default() });
        let up = Vec3::new(0.0, 0.0, 3.0);
        assert_eq!(framing, Framing { up, center: Vec3::ZERO, radius: 0.1, eye: None });
        assert!((framing.world_from_scene() * Vec3::Z).distance(Vec3::Y) < 1e-6);
        assert_eq!(Framing::default().world_from_scene(), Quat::IDENTITY);
    }
}
