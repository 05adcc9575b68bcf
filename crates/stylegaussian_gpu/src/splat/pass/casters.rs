//! Shadows that clouds cast.

use super::SplatPass;
use crate::splat::{
    camera::Camera,
    cast::{Cast, CastView, Caster},
    error::SplatError,
};

impl SplatPass {
    /// Compiles the draw of clouds with a mask or without, in any thread, while others draw. Without this call,
    /// the first frame that casts shadows compiles it.
    pub fn prepare_cast(&self, device: &wgpu::Device, masked: bool) {
        self.casts(device).variant(device, masked);
    }

    /// Uploads what the shadow map of a light at `camera` needs of `casters` to `view`, which belongs to this
    /// map alone. Nothing is written or made if nothing changed. Splats that a light with parallel rays has
    /// before its near plane cast shadows as if they were in that plane; lights of other kinds begin at `near`,
    /// in world units.
    ///
    /// # Errors
    /// If colors, strokes or masks belong to another scene. Nothing is drawn then.
    pub fn write_casters(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        view: &mut CastView,
        (camera, near): (&Camera, f32),
        casters: &[Caster],
    ) -> Result<(), SplatError> {
        self.casts(device).write(device, queue, view, &self.project.absent, (camera, near), casters)
    }

    /// Draws the cores of a map's splats into the depth attachment of `pass`, of
    /// [`SHADOW_FORMAT`](crate::splat::SHADOW_FORMAT) with one sample per pixel, where they are nearer to the
    /// light. [`write_casters`](Self::write_casters) comes before.
    pub fn cast(&self, pass: &mut wgpu::RenderPass, view: &CastView) {
        if let Some(cast) = self.cast.get() {
            cast.encode(pass, view);
        }
    }

    fn casts(&self, device: &wgpu::Device) -> &Cast {
        self.cast.get_or_init(|| Cast::new(device))
    }
}
