//! The place of a capture in a world.

use bevy::prelude::*;
use stylegaussian::views::Framing;

use super::{attach::LoadedScene, component::GaussianSplats};

/// Places an entity's scene: once it is loaded, and again for each other scene or `FitScene`, the entity's
/// `Transform` is set so that the scene stands upright and its dense part fills a ball.
///
/// Captures have an unknown unit and origin, and most have y down. Up is what the file says, or else the
/// direction that most of the scene's surfaces share. The ball is that of
/// [`GaussianScene::framing`](super::GaussianScene::framing): neither floaters nor a background far away make
/// the scene small. A place that was captured from within is fitted into the ball like any other scene: a game
/// that begins inside of it puts its camera at the [`eye`](stylegaussian::views::Framing::eye) of that framing,
/// which this `Transform` maps into the parent's space.
///
/// The `Transform` may be changed afterwards. A parent's turns and moves the scene as it is.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::prelude::*;
/// # fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
/// commands.spawn((GaussianSplats(assets.load("garden.ply")), FitScene::new(Vec3::Y, 3.0)));
/// # }
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[require(GaussianSplats)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct FitScene {
    /// Center of the ball, in the parent's space.
    pub center: Vec3,
    /// Radius of the ball, above 0. One that is not leaves the `Transform` as it is.
    pub radius: f32,
}

impl Default for FitScene {
    /// The unit ball.
    fn default() -> Self {
        Self { center: Vec3::ZERO, radius: 1.0 }
    }
}

impl FitScene {
    /// A ball.
    pub fn new(center: Vec3, radius: f32) -> Self {
        Self { center, radius }
    }

    /// The transform that fits a scene into the ball.
    fn transform(self, framing: Framing) -> Transform {
        let rotation = Quat::from_rotation_arc(framing.up.normalize_or(Vec3::Y), Vec3::Y);
        let scale = self.radius / framing.frame.radius;
        let translation = self.center - scale * (rotation * framing.frame.center);
        Transform { translation, rotation, scale: Vec3::splat(scale) }
    }
}

/// The entity got another scene, or is to be fitted elsewhere.
type FitChanged = Or<(Changed<LoadedScene>, Changed<FitScene>)>;

/// Fits scenes that came or changed, in the frame in which they are attached.
pub(super) fn fit_scenes(
    mut fitted: Query<(NameOrEntity, &FitScene, &LoadedScene, &mut Transform), FitChanged>,
) {
    for (name, fit, scene, mut transform) in &mut fitted {
        // A scene of which nothing is visible has no place.
        let Some(framing) = scene.asset.framing() else { continue };
        if fit.radius > 0.0 && fit.radius.is_finite() {
            *transform = fit.transform(framing);
        } else {
            let radius = fit.radius;
            warn!("{name}: FitScene has the radius {radius}, expected one above 0: the scene stays as it is");
        }
    }
}

#[cfg(test)]
mod tests {
    use stylegaussian::frame::Frame;

    use super::*;

    #[test]
    fn a_scene_is_turned_upright_into_the_ball() {
        let frame = Frame { center: Vec3::new(10.0, -20.0, 30.0), radius: 4.0 };
        for up in [Vec3::NEG_Y, Vec3::Y, Vec3::Z, Vec3::new(0.1, -0.9, 0.3).normalize()] {
            let framing = Framing { frame, up, n_left_out: 0, eye: None };
            let transform = FitScene::new(Vec3::new(1.0, 2.0, 3.0), 0.5).transform(framing);
            let close = |a: Vec3, b: Vec3| assert!(a.distance(b) < 1e-5, "{up}: {a} {b}");
            close(transform.transform_point(frame.center), Vec3::new(1.0, 2.0, 3.0));
            close(transform.rotation * up, Vec3::Y);
            // A place on the ball, straight up.
            close(transform.transform_point(frame.center + 4.0 * up), Vec3::new(1.0, 2.5, 3.0));
        }
    }
}
