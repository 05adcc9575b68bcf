//! The shadow maps of an engine, as splats are compared with them.

use glam::{Affine3A, Mat4, Vec3, Vec3A};
use stylegaussian::light::{MAX_CASCADES, MAX_LAMPS, ShadowCascade, ShadowLamp};
use stylegaussian_shaders::splat::light::{self as shaders, SplatShadows};

use crate::splat::camera::{Camera, in_f64};

/// The shadow maps of one directional light and of lamps as one view sees them: a splat is in shadow if its
/// mean is.
#[derive(Clone, Debug, PartialEq)]
pub struct Shadows {
    /// Depths, reverse z: an array with one layer for each cascade and, wherever they say, one for each spot
    /// light, which compute shaders may read.
    pub maps: wgpu::TextureView,
    /// The same of point lights: an array of cubes.
    pub cubes: wgpu::TextureView,
    /// The cascades from near to far, of points in the world. Those after the fourth are left out.
    pub cascades: Vec<ShadowCascade>,
    /// The lamps, of points in the world. Those after the eighth are left out.
    pub lamps: Vec<ShadowLamp>,
}

impl Shadows {
    /// The cascades of points in a camera's view.
    pub(super) fn of_view(&self, camera: &Camera) -> Vec<ShadowCascade> {
        // In f64: far from the world's origin both factors are large.
        let world_from_view: Affine3A = camera.world_from_view;
        let clip_from_view = |clip_from_world: Mat4| {
            let product = clip_from_world.as_dmat4() * glam::DMat4::from(in_f64(&world_from_view));
            product.as_mat4()
        };
        // Rigid, so its inverse is its transpose.
        let turn = world_from_view.matrix3.transpose();
        let of_view = |cascade: &ShadowCascade| ShadowCascade {
            clip_from_point: clip_from_view(cascade.clip_from_point),
            offset: Vec3::from(turn * Vec3A::from(cascade.offset)),
            far: cascade.far,
        };
        self.cascades.iter().take(MAX_CASCADES).map(of_view).collect()
    }

    /// The uniforms for a camera.
    pub(super) fn uniforms(&self, camera: &Camera) -> SplatShadows {
        let of_view = self.of_view(camera);
        let n_lamps = self.lamps.len().min(MAX_LAMPS) as u32;
        let mut uniforms =
            SplatShadows { n_cascades: of_view.len() as u32, n_lamps, ..SplatShadows::default() };
        for (place, lamp) in uniforms.lamps.iter_mut().zip(&self.lamps) {
            *place = lamp_in_view(lamp, camera);
        }
        for (place, cascade) in uniforms.cascades.iter_mut().zip(&of_view) {
            let [x, y, z, w] = cascade.clip_from_point.to_cols_array_2d();
            *place = shaders::ShadowCascade {
                clip_from_view_x: x,
                clip_from_view_y: y,
                clip_from_view_z: z,
                clip_from_view_w: w,
                offset: cascade.offset.to_array(),
                far: cascade.far,
            };
        }
        uniforms
    }
}

/// A lamp as its uniforms have it, of points in a camera's view.
fn lamp_in_view(lamp: &ShadowLamp, camera: &Camera) -> shaders::ShadowLamp {
    // In f64: far from the world's origin both factors are large.
    let light_from_view = in_f64(&lamp.light_from_point) * in_f64(&camera.world_from_view);
    let row = |i: usize| {
        let turn = light_from_view.matrix3.row(i);
        turn.extend(light_from_view.translation[i]).as_vec4().to_array()
    };
    let &ShadowLamp { range, near, depth_bias, normal_bias, cone, map, .. } = lamp;
    shaders::ShadowLamp {
        light_from_view_x: row(0),
        light_from_view_y: row(1),
        light_from_view_z: row(2),
        range,
        near,
        depth_bias,
        normal_bias,
        cone: cone.map_or([0.0; 2], |cone| cone.scale_and_offset()),
        half_width: cone.map_or(0.0, |cone| cone.outer.tan()),
        map,
    }
}
