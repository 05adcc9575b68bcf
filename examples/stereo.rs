//! Two eyes side by side. Both look straight ahead. Asymmetric frusta, as in headsets, make their images agree
//! at the distance of the screen; the eyes are not turned. Look at the left image with the left eye and at the
//! right one with the right eye. `SplatEyes` makes a pair of the two cameras: both blend splats in the same
//! order and in the same colors, which are computed once.
//!
//! ```sh
//! cargo run --release --example stereo
//! ```

use bevy::{
    camera::{CameraProjection, SubCameraView, Viewport},
    core_pipeline::tonemapping::Tonemapping,
    math::Vec3A,
    prelude::*,
};
use bevy_stylegaussian::prelude::*;

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// Distance between the eyes, in scene units. A thirtieth of the distance to the screen is comfortable.
const EYE_DISTANCE: f32 = 0.4;
/// Distance to the screen: the plane that both eyes see at the same place of their images.
const SCREEN_DISTANCE: f32 = 12.0;

/// An off-axis perspective projection. All but `near` are tangents: lengths at distance 1.
#[derive(Clone, Debug)]
pub struct OffAxis {
    /// Half of the image's width and height.
    pub half_size: Vec2,
    /// Direction from the eye to the middle of the image.
    pub middle: Vec2,
    /// Distance of the near plane.
    pub near: f32,
}

impl CameraProjection for OffAxis {
    /// Reverse z without a far plane, like Bevy's own perspective.
    fn get_clip_from_view(&self) -> Mat4 {
        // x_clip = (x + middle.x z) / half_size.x and w = -z: the middle of the image is where x / -z is
        // `middle.x`.
        let (scale, shift) = (self.half_size.recip(), self.middle / self.half_size);
        Mat4::from_cols(
            Vec4::new(scale.x, 0.0, 0.0, 0.0),
            Vec4::new(0.0, scale.y, 0.0, 0.0),
            Vec4::new(shift.x, shift.y, 0.0, -1.0),
            Vec4::new(0.0, 0.0, self.near, 0.0),
        )
    }

    fn get_clip_from_view_for_sub(&self, sub: &SubCameraView) -> Mat4 {
        let (full, size) = (sub.full_size.as_vec2(), sub.size.as_vec2());
        let middle = (2.0 * sub.offset + size) / full - 1.0;
        // The part of the image that `sub` names, stretched to the whole clip space. Its y points down, that of
        // clip space up.
        let crop = Mat4::from_scale((full / size).extend(1.0))
            * Mat4::from_translation(Vec3::new(-middle.x, middle.y, 0.0));
        crop * self.get_clip_from_view()
    }

    fn update(&mut self, width: f32, height: f32) {
        self.half_size.x = self.half_size.y * width / height;
    }

    fn far(&self) -> f32 {
        // Only for the frustum and its culling: the projection itself has no far plane.
        1_000.0
    }

    fn get_frustum_corners(&self, z_near: f32, z_far: f32) -> [Vec3A; 8] {
        // In the order of Bevy's perspective: bottom right, top right, top left, bottom left, first near and
        // then far.
        let corners = [vec2(1.0, -1.0), vec2(1.0, 1.0), vec2(-1.0, 1.0), vec2(-1.0, -1.0)];
        let at = |z: f32| {
            corners.map(|corner| ((self.middle + corner * self.half_size) * z.abs()).extend(z).into())
        };
        let ([a, b, c, d], [e, f, g, h]) = (at(z_near), at(z_far));
        [a, b, c, d, e, f, g, h]
    }
}

fn main() -> AppExit {
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin { file_path: ASSETS.into(), ..default() }))
        .add_plugins(StyleGaussianPlugin::default())
        .add_systems(Startup, (setup, backdrop::spawn))
        .add_systems(Update, place_eyes)
        .run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    let style = assets.load("styles/dots.style.safetensors");
    commands.spawn((GaussianSplats(assets.load("demo.sgs")), StyleSource::preset(style), HiddenUntilStyled));
    let head = Transform::from_xyz(0.0, 4.2, 11.2).looking_at(Vec3::ZERO, Vec3::Y);
    commands.spawn((head, Visibility::default())).with_children(|head| {
        let mut other = None;
        for (order, x) in [-0.5 * EYE_DISTANCE, 0.5 * EYE_DISTANCE].into_iter().enumerate() {
            // An eye left of the head has its screen to the right of it, and the other way round.
            let middle = Vec2::new(-x / SCREEN_DISTANCE, 0.0);
            let eye = OffAxis { half_size: Vec2::splat(0.5), middle, near: 0.1 };
            let mut eye = head.spawn((
                Camera3d::default(),
                Camera { order: order as isize, ..default() },
                Projection::custom(eye),
                Tonemapping::None,
                Msaa::Off,
                Transform::from_xyz(x, 0.0, 0.0),
            ));
            // One of the two names the other.
            if let Some(other) = other {
                eye.insert(SplatEyes(other));
            }
            other = Some(eye.id());
        }
    });
}

/// Gives each eye its half of the window.
fn place_eyes(mut eyes: Query<&mut Camera>, window: Single<&Window>) {
    // A minimized window has no pixels, and a viewport needs one.
    let physical_size = (window.physical_size() / UVec2::new(2, 1)).max(UVec2::ONE);
    for mut eye in &mut eyes {
        // Written only if it differs, so that change detection stays quiet.
        if eye.viewport.as_ref().is_none_or(|viewport| viewport.physical_size != physical_size) {
            let physical_position = UVec2::new(physical_size.x * eye.order as u32, 0);
            eye.viewport = Some(Viewport { physical_position, physical_size, ..default() });
        }
    }
}
