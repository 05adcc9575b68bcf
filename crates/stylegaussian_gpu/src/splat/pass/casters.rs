//! Shadows that clouds cast.

use super::SplatPass;
use crate::{
    device::GpuEncoder,
    splat::{
        camera::Camera,
        cast::{Cast, CastView, Caster},
        error::SplatError,
    },
};

impl SplatPass {
    /// Compiles the kernel of clouds with a mask or without, and the draws, in any thread, while others draw.
    /// Without this call, the first frame that casts shadows compiles them.
    pub fn prepare_cast(&self, device: &wgpu::Device, masked: bool) {
        self.casts(device).prepare(device, masked);
    }

    /// Projects `casters` into the shadow map of a light at `camera`, and draws their cores into the depths of
    /// `view`, which belongs to this map alone. Nothing is encoded, written or made while nothing changes that
    /// these depend on: light, scenes, their places, thresholds, masks and fades. Splats that a light with
    /// parallel rays has before its near plane cast shadows as if they were in that plane; lights of other
    /// kinds begin at `near`, in world units.
    ///
    /// Commands must be submitted in the order in which they were encoded, and before `view` is used again,
    /// because uniforms are written by `queue`.
    ///
    /// # Errors
    /// If colors, strokes or masks belong to another scene. Nothing is drawn then.
    pub fn project_casters(
        &self,
        gpu: &mut GpuEncoder,
        view: &mut CastView,
        (camera, near): (&Camera, f32),
        casters: &[Caster],
    ) -> Result<(), SplatError> {
        self.casts(gpu.device).project(gpu, view, (camera, near), casters)
    }

    /// Writes the depths of a map's cores into the depth attachment of `pass`, of
    /// [`SHADOW_FORMAT`](crate::splat::SHADOW_FORMAT) with one sample per pixel, where they are nearer to the
    /// light. [`project_casters`](Self::project_casters) comes before.
    pub fn cast(&self, pass: &mut wgpu::RenderPass, view: &CastView) {
        if let Some(cast) = self.cast.get() {
            cast.write(pass, view);
        }
    }

    fn casts(&self, device: &wgpu::Device) -> &Cast {
        self.cast.get_or_init(|| Cast::new(device, &self.project.absent))
    }
}
