//! The light stage on the GPU: `splat_light`, which tints colors, darkens them in shadow and puts them behind
//! fog and the air of an atmosphere.
//!
//! The tables of an atmosphere may be made after splats are sorted, so views in one wait for them: see
//! [`LightStage::encode_waiting`].
//!
//! Nothing of it is compiled, allocated or dispatched before a view has any of these.

use std::sync::OnceLock;

use glam::{DMat4, Mat3, Vec3};
use stylegaussian::light::{Falloff, Fog, MAX_SUNS, Tint, TintVolume, steepness};
use stylegaussian_shaders::splat::light::{
    self as shaders, FALLOFF_ATMOSPHERIC, FALLOFF_EXPONENTIAL, FALLOFF_EXPONENTIAL_SQUARED, FALLOFF_LINEAR,
    FogSun, SplatAtmosphere, SplatLight, SplatShadows,
};

use super::{
    camera::Camera,
    cloud::Cloud,
    composite::CompositeMode,
    dispatch::dispatch,
    tonemapping::{InverseTable, Tonemapping},
};
use crate::{
    bindings::{
        Kernel, at_strides, bind_group, compute_pass, one_of, storage_binding, stride, texture_binding,
        uniform_binding, uniforms_binding,
    },
    buffers,
};

pub use aerial::AerialPerspective;
pub use shadows::Shadows;

/// The light and the air of a view: see [`stylegaussian::light`]. They change the colors of its splats before
/// these are drawn, and how much of their strokes is seen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewLight {
    /// The air, if there is any. Suns are in world space.
    pub fog: Option<Fog>,
    /// The atmosphere that the camera is in, if it is in one. It lies before the fog.
    pub aerial: Option<AerialPerspective>,
    /// The tint of each cloud, in the order of the clouds that are drawn; those without one keep their colors.
    pub tints: Vec<Tint>,
    /// The volumes that tint each cloud, in the same order, of points in the world. None by default.
    pub volumes: Vec<Vec<TintVolume>>,
    /// The shadow maps that are compared with splats, if any are.
    pub shadows: Option<Shadows>,
    /// Share of its light, 0..1, that each cloud loses in shadow, in the same order; none by default.
    pub shadow_amounts: Vec<f32>,
    /// The tone mapping by which the camera shows light, now or later.
    pub tonemapping: Tonemapping,
    /// Stops by which the camera brightens light before it.
    pub exposure: f32,
    /// The inverse of a tone mapping that [`needs_table`](Tonemapping::needs_table). If it is missing, colors
    /// stay.
    pub table: Option<InverseTable>,
}

/// The pipelines.
#[derive(Debug, Default)]
pub(super) struct LightStage {
    shared: OnceLock<Shared>,
    /// Four for each tone mapping, by its number: without shadows and with them, then both in an atmosphere.
    kernels: [[OnceLock<Kernel>; 4]; Tonemapping::N],
}

/// Resources that all of them bind.
#[derive(Debug)]
struct Shared {
    sampler: wgpu::Sampler,
    shadow_sampler: wgpu::Sampler,
    /// Bound where no table is needed.
    no_table: wgpu::TextureView,
    /// Bound in views without strokes.
    no_strokes: wgpu::Buffer,
}

/// The light of a view from frame to frame.
#[derive(Debug, Default)]
pub(super) struct LitView {
    wish: Option<ViewLight>,
    /// The sources of this frame's colors, and of the records on the GPU.
    now: Source,
    drawn: Source,
    uniforms: Option<wgpu::Buffer>,
    aerial_uniforms: Option<wgpu::Buffer>,
    shadow_uniforms: Option<wgpu::Buffer>,
    /// Whether the dispatches of this frame wait for the tables of an atmosphere.
    is_waiting: bool,
    /// The resources that the group was made for, and the group.
    group: Option<(Bound, wgpu::BindGroup)>,
}

/// The resources that a group depends on.
#[derive(Clone, Debug, PartialEq)]
struct Bound {
    buffers: [wgpu::Buffer; 5],
    tonemapping: Tonemapping,
    table: Option<InverseTable>,
    air: Option<[wgpu::TextureView; 2]>,
    maps: Option<[wgpu::TextureView; 2]>,
}

/// All that determines the light on a view's records.
#[derive(Clone, Debug, Default, PartialEq)]
struct Source {
    /// Those of clouds whose colors change.
    clouds: Vec<SplatLight>,
    tonemapping: Tonemapping,
    table: Option<InverseTable>,
    /// The tables of the atmosphere, and its uniforms.
    aerial: Option<([wgpu::TextureView; 2], SplatAtmosphere)>,
    /// Maps and cubes, and their uniforms.
    shadows: Option<([wgpu::TextureView; 2], SplatShadows)>,
}

/// The buffers of a view that the kernel reads and changes: keys, both halves of the records, and strokes if it
/// shows any.
pub(super) struct LightBuffers<'a> {
    pub keys: &'a wgpu::Buffer,
    pub geometry_halves: &'a wgpu::Buffer,
    pub color_halves: &'a wgpu::Buffer,
    pub strokes: Option<&'a wgpu::Buffer>,
}

impl LightStage {
    /// The kernel for a tone mapping, with or without shadows and an atmosphere, which is compiled unless it is
    /// there.
    pub fn kernel(
        &self,
        device: &wgpu::Device,
        tonemapping: Tonemapping,
        shadowed: bool,
        aerial: bool,
    ) -> &Kernel {
        let variant = usize::from(shadowed) + 2 * usize::from(aerial);
        self.kernels[tonemapping as usize][variant].get_or_init(|| {
            let uniforms = uniforms_binding::<SplatLight>();
            let table = InverseTable::binding();
            let (read, write) = (storage_binding(true), storage_binding(false));
            let sampler = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
            let mut bindings = vec![uniforms, read, read, write, write, table, table, sampler];
            if aerial {
                bindings.extend(AerialPerspective::bindings());
            }
            if shadowed {
                let depths = |dimension| texture_binding(wgpu::TextureSampleType::Depth, dimension);
                bindings.extend([
                    uniform_binding::<SplatShadows>(),
                    depths(wgpu::TextureViewDimension::D2Array),
                    wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison),
                    depths(wgpu::TextureViewDimension::CubeArray),
                ]);
            }
            let mode = CompositeMode::InvertTonemapping(tonemapping).mode();
            let constants = [("mode", f64::from(mode)), ("curve", f64::from(tonemapping.curve()))];
            let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
            Kernel::with_options(device, shaders::light(shadowed, aerial), &bindings, options)
        })
    }

    fn shared(&self, device: &wgpu::Device) -> &Shared {
        let sampler = |compare| {
            device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("splat_light"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                compare,
                ..Default::default()
            })
        };
        self.shared.get_or_init(|| Shared {
            sampler: sampler(None),
            // Reverse z: what is in the light is nearest to it.
            shadow_sampler: sampler(Some(wgpu::CompareFunction::GreaterEqual)),
            no_table: InverseTable::none(device),
            no_strokes: buffers::create(device, "splat_no_strokes", 16, wgpu::BufferUsages::STORAGE),
        })
    }

    /// Finds the light on the records of `clouds`, and uploads it and binds what they need if it changed or if
    /// records are made anew. Returns whether it changed.
    #[expect(clippy::too_many_arguments, reason = "two of them are wgpu's own at every call")]
    pub fn write(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        view: &mut LitView,
        buffers: &LightBuffers,
        camera: &Camera,
        clouds: &[Cloud],
        is_new: bool,
    ) -> bool {
        view.now = view.source(camera, clouds, buffers.strokes.is_some());
        // What casts shadows may have moved, and the tables of an atmosphere are made anew in each frame.
        let is_relit = view.now != view.drawn || view.now.shadows.is_some() || view.now.aerial.is_some();
        view.is_waiting = view.now.aerial.is_some();
        if !view.now.clouds.is_empty() {
            self.bind(device, view, buffers);
            if let Some(uniforms) = view.uniforms.as_ref().filter(|_| is_relit || is_new) {
                queue.write_buffer(uniforms, 0, &at_strides(view.now.clouds.iter().copied()));
            }
            if let (Some((_, atmosphere)), Some(buffer)) = (&view.now.aerial, &view.aerial_uniforms) {
                queue.write_buffer(buffer, 0, bytemuck::bytes_of(atmosphere));
            }
            if let (Some((_, shadows)), Some(buffer)) = (&view.now.shadows, &view.shadow_uniforms) {
                queue.write_buffer(buffer, 0, bytemuck::bytes_of(shadows));
            }
        }
        view.drawn.clone_from(&view.now);
        is_relit
    }

    fn bind(&self, device: &wgpu::Device, view: &mut LitView, bound: &LightBuffers) {
        let size = (stride::<SplatLight>() * view.now.clouds.len()) as u64;
        let uniforms = match view.uniforms.take().filter(|uniforms| uniforms.size() >= size) {
            Some(uniforms) => uniforms,
            None => buffers::uniforms(device, "splat_light", size),
        };
        view.uniforms = Some(uniforms.clone());
        let shared = self.shared(device);
        let strokes = bound.strokes.unwrap_or(&shared.no_strokes);
        let buffers = [&uniforms, bound.keys, bound.geometry_halves, bound.color_halves, strokes];
        let Source { tonemapping, table, aerial, shadows, .. } = &view.now;
        let of = Bound {
            buffers: buffers.map(wgpu::Buffer::clone),
            tonemapping: *tonemapping,
            table: table.clone(),
            air: aerial.as_ref().map(|(tables, _)| tables.clone()),
            maps: shadows.as_ref().map(|(maps, _)| maps.clone()),
        };
        if view.group.as_ref().is_some_and(|(last, _)| *last == of) {
            return;
        }
        let [_, keys, geometry, color, strokes] = buffers.map(wgpu::Buffer::as_entire_binding);
        let inverse = table.as_ref().map_or(&shared.no_table, InverseTable::view);
        let curve = table.as_ref().and_then(InverseTable::curve).unwrap_or(&shared.no_table);
        let [inverse, curve] = [inverse, curve].map(wgpu::BindingResource::TextureView);
        let sampler = wgpu::BindingResource::Sampler(&shared.sampler);
        let mut resources =
            vec![one_of::<SplatLight>(&uniforms), keys, geometry, color, strokes, inverse, curve, sampler];
        if let Some(([light, transmittance], _)) = aerial {
            let size = size_of::<SplatAtmosphere>() as u64;
            let create = || buffers::uniforms(device, "splat_atmosphere", size);
            resources.push(view.aerial_uniforms.get_or_insert_with(create).as_entire_binding());
            resources.push(wgpu::BindingResource::TextureView(light));
            resources.push(wgpu::BindingResource::TextureView(transmittance));
        }
        if let Some(([maps, cubes], _)) = shadows {
            let size = size_of::<SplatShadows>() as u64;
            let create = || buffers::uniforms(device, "splat_shadows", size);
            resources.push(view.shadow_uniforms.get_or_insert_with(create).as_entire_binding());
            resources.push(wgpu::BindingResource::TextureView(maps));
            resources.push(wgpu::BindingResource::Sampler(&shared.shadow_sampler));
            resources.push(wgpu::BindingResource::TextureView(cubes));
        }
        let layout = &self.kernel(device, *tonemapping, shadows.is_some(), aerial.is_some()).layout;
        view.group = Some((of, bind_group(device, "splat_light", layout, &resources)));
    }

    /// Dispatches every cloud that was written, unless they wait.
    pub fn encode(&self, device: &wgpu::Device, pass: &mut wgpu::ComputePass, view: &LitView) {
        if !view.is_waiting {
            self.dispatch(device, pass, view);
        }
    }

    /// Dispatches every cloud of a view that waits, once. Does nothing for others.
    pub fn encode_waiting(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        view: &mut LitView,
    ) {
        if std::mem::take(&mut view.is_waiting) {
            self.dispatch(device, &mut compute_pass(encoder, "splat_light"), view);
        }
    }

    fn dispatch(&self, device: &wgpu::Device, pass: &mut wgpu::ComputePass, view: &LitView) {
        let Some((_, group)) = view.group.as_ref().filter(|_| !view.now.clouds.is_empty()) else { return };
        let Source { tonemapping, aerial, shadows, .. } = &view.now;
        let kernel = self.kernel(device, *tonemapping, shadows.is_some(), aerial.is_some());
        pass.set_pipeline(&kernel.pipeline);
        for (i, cloud) in view.now.clouds.iter().enumerate() {
            pass.set_bind_group(0, group, &[(i * stride::<SplatLight>()) as u32]);
            dispatch(pass, cloud.n_records);
        }
    }
}

impl LitView {
    /// Sets the light of the next frames.
    pub fn set(&mut self, light: Option<ViewLight>) {
        self.wish = light;
    }

    /// The light on the records of `clouds`. Records are in the order of the clouds that can be drawn.
    fn source(&self, camera: &Camera, clouds: &[Cloud], has_strokes: bool) -> Source {
        let is_complete = |wish: &&ViewLight| wish.table.is_some() || !wish.tonemapping.needs_table();
        let Some(wish) = self.wish.as_ref().filter(is_complete) else { return Source::default() };
        let fog = wish.fog.as_ref().filter(|fog| fog.is_finite() && fog.strength > 0.0);
        let aerial = wish.aerial.as_ref().filter(|aerial| aerial.atmosphere.is_usable());
        let of_view = of_view(camera, wish.exposure, fog);
        let (mut first_record, mut lit) = (0, Vec::new());
        for (i, cloud) in clouds.iter().enumerate().filter(|(_, cloud)| cloud.is_drawable()) {
            let n_records = cloud.scene.n_gaussians() as u32;
            let tint = wish.tints.get(i).and_then(Tint::matrix);
            let amount = wish.shadow_amounts.get(i).filter(|amount| wish.shadows.is_some() && **amount > 0.0);
            let (volumes, n_volumes) =
                volumes::of_view(wish.volumes.get(i).map_or(&[][..], Vec::as_slice), camera);
            let has_air = fog.is_some() || aerial.is_some();
            if has_air || tint.is_some() || amount.is_some() || n_volumes > 0 {
                let [tint_red, tint_green, tint_blue] = rows(tint.unwrap_or(Mat3::IDENTITY));
                let has_strokes = u32::from(has_strokes && cloud.colors.painted().is_some());
                lit.push(SplatLight {
                    tint_red,
                    tint_green,
                    tint_blue,
                    first_record,
                    n_records,
                    has_strokes,
                    volumes,
                    n_volumes,
                    shadow_amount: amount.map_or(0.0, |amount| amount.min(1.0)),
                    ..of_view
                });
            }
            first_record += n_records;
        }
        if lit.is_empty() {
            return Source::default();
        }
        // Views in which nothing is darkened compare nothing.
        let is_shadowed = lit.iter().any(|cloud| cloud.shadow_amount > 0.0);
        let shadows = wish.shadows.as_ref().filter(|_| is_shadowed);
        Source {
            clouds: lit,
            tonemapping: wish.tonemapping,
            table: wish.table.clone(),
            aerial: aerial.map(AerialPerspective::parts),
            shadows: shadows
                .map(|shadows| ([shadows.maps.clone(), shadows.cubes.clone()], shadows.uniforms(camera))),
        }
    }
}

fn rows(tint: Mat3) -> [[f32; 4]; 3] {
    [0, 1, 2].map(|i| tint.row(i).extend(0.0).to_array())
}

/// The uniforms that the clouds of a view share.
fn of_view(camera: &Camera, exposure: f32, fog: Option<&Fog>) -> SplatLight {
    // In f64, because near planes are small numbers.
    let view_from_clip: DMat4 = camera.clip_from_view.as_dmat4().inverse();
    let column = |i: usize| view_from_clip.col(i).as_vec4().to_array();
    let mut light = SplatLight {
        view_from_clip_x: column(0),
        view_from_clip_y: column(1),
        view_from_clip_z: column(2),
        view_from_clip_w: column(3),
        viewport: camera.viewport.as_vec4().to_array(),
        exposure: exposure.exp2(),
        ..bytemuck::Zeroable::zeroed()
    };
    let Some(fog) = fog else { return light };
    let (falloff, extinction, inscattering) = match fog.falloff {
        Falloff::Linear { start, end } => {
            (FALLOFF_LINEAR, Vec3::new(end, steepness(start, end), 0.0), Vec3::ZERO)
        }
        Falloff::Exponential { density } => (FALLOFF_EXPONENTIAL, Vec3::splat(density), Vec3::ZERO),
        Falloff::ExponentialSquared { density } => {
            (FALLOFF_EXPONENTIAL_SQUARED, Vec3::splat(density), Vec3::ZERO)
        }
        Falloff::Atmospheric { extinction, inscattering } => (FALLOFF_ATMOSPHERIC, extinction, inscattering),
    };
    light.fog_color = fog.color.to_array();
    light.fog_strength = fog.strength;
    light.falloff = falloff;
    light.extinction = extinction.to_array();
    light.inscattering = inscattering.to_array();
    light.exponent = fog.exponent;
    // Rigid, so its inverse is its transpose.
    let view_from_world = camera.world_from_view.matrix3.transpose();
    for (place, sun) in light.suns.iter_mut().zip(&fog.suns) {
        let direction = Vec3::from(view_from_world * glam::Vec3A::from(sun.direction));
        *place = FogSun { direction: direction.to_array(), glow: sun.glow.to_array(), ..FogSun::default() };
    }
    light.n_suns = fog.suns.len().min(MAX_SUNS) as u32;
    light
}

mod aerial;
mod shadows;
#[cfg(test)]
mod tests;
mod volumes;
