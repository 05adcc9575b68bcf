//! The atmosphere of an engine, as splats are seen through it.

use glam::Vec3;
use stylegaussian::light::Atmosphere;
use stylegaussian_shaders::splat::light::SplatAtmosphere;

use crate::bindings::{texture_binding, uniform_binding};

/// The atmosphere before the splats of one view: each has the air that lies before its mean. Views with one are
/// lit by [`SplatPass::light_in_atmosphere`](crate::splat::SplatPass::light_in_atmosphere).
///
/// Both tables are textures that compute shaders may read and filter, such as those of Bevy's
/// `AtmosphereTextures`, and may change in each frame.
#[derive(Clone, Debug, PartialEq)]
pub struct AerialPerspective {
    /// The air, and what places in the tables mean.
    pub atmosphere: Atmosphere,
    /// L of [`Atmosphere`], three-dimensional.
    pub light: wgpu::TextureView,
    /// T of [`Atmosphere`], two-dimensional.
    pub transmittance: wgpu::TextureView,
}

impl AerialPerspective {
    /// The bindings of uniforms and tables.
    pub(super) fn bindings() -> [wgpu::BindingType; 3] {
        let table = |dimension| {
            let filterable = wgpu::TextureSampleType::Float { filterable: true };
            texture_binding(filterable, dimension)
        };
        [
            uniform_binding::<SplatAtmosphere>(),
            table(wgpu::TextureViewDimension::D3),
            table(wgpu::TextureViewDimension::D2),
        ]
    }

    /// L and T, and what is known of them.
    pub(super) fn parts(&self) -> ([wgpu::TextureView; 2], SplatAtmosphere) {
        ([self.light.clone(), self.transmittance.clone()], uniforms(&self.atmosphere))
    }
}

fn uniforms(atmosphere: &Atmosphere) -> SplatAtmosphere {
    let row = |i: usize| atmosphere.clip_from_view.row(i).to_array();
    let column = |column: Vec3| column.extend(0.0).to_array();
    SplatAtmosphere {
        clip_from_view_x: row(0),
        clip_from_view_y: row(1),
        clip_from_view_w: row(3),
        meters_from_view_x: column(atmosphere.meters_from_view.x_axis),
        meters_from_view_y: column(atmosphere.meters_from_view.y_axis),
        meters_from_view_z: column(atmosphere.meters_from_view.z_axis),
        up: atmosphere.up.to_array(),
        altitude: atmosphere.altitude,
        inner_radius: atmosphere.inner_radius,
        thickness: atmosphere.thickness,
        max_distance: atmosphere.max_distance,
        n_slices: atmosphere.n_slices as f32,
        exposure: atmosphere.exposure,
        grayness: f32::from(u8::from(atmosphere.is_gray)),
        ..SplatAtmosphere::default()
    }
}
