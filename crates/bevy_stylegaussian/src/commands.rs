//! Commands for the GPU, in systems of the renderer.

use std::borrow::Cow;

use bevy::{
    ecs::system::SystemParam,
    prelude::*,
    render::{
        diagnostic::RecordDiagnostics,
        renderer::{RenderContext, RenderDevice, RenderQueue},
    },
};
use stylegaussian_gpu::device::GpuEncoder;

/// The GPU, as a system that encodes commands takes it.
#[derive(SystemParam)]
pub(crate) struct GpuCommands<'w, 's> {
    device: Res<'w, RenderDevice>,
    pub(crate) queue: Res<'w, RenderQueue>,
    context: RenderContext<'w, 's>,
}

impl GpuCommands<'_, '_> {
    /// The device.
    pub(crate) fn device(&self) -> &wgpu::Device {
        self.device.wgpu_device()
    }

    /// Encodes commands by `encode`. The diagnostics have their time under the name `span`.
    pub(crate) fn timed<T>(
        &mut self,
        span: impl Into<Cow<'static, str>>,
        encode: impl FnOnce(&mut GpuEncoder) -> T,
    ) -> T {
        let diagnostics = self.context.diagnostic_recorder();
        let diagnostics = diagnostics.as_deref();
        let encoder = self.context.command_encoder();
        let span = diagnostics.time_span(encoder, span);
        let encoded =
            encode(&mut GpuEncoder { device: self.device.wgpu_device(), queue: &self.queue, encoder });
        // Also after an error: a span that is left open would be logged as another one.
        span.end(encoder);
        encoded
    }

    /// Encodes commands by `encode` that are too few to be timed.
    pub(crate) fn encode<T>(&mut self, encode: impl FnOnce(&mut GpuEncoder) -> T) -> T {
        let encoder = self.context.command_encoder();
        encode(&mut GpuEncoder { device: self.device.wgpu_device(), queue: &self.queue, encoder })
    }
}
